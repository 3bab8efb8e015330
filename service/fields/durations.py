from adapters.fields.durations import *  # noqa: F403
