from adapters.channel import *  # noqa: F403
