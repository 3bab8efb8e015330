from adapters.routing import *  # noqa: F403
