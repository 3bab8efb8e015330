from adapters.fields.addresses import *  # noqa: F403
