from adapters.fields.values import *  # noqa: F403
