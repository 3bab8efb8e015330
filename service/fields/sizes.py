from adapters.fields.sizes import *  # noqa: F403
