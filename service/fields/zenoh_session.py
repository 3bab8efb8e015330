from adapters.zenoh.fields import *  # noqa: F403
