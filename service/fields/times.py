from adapters.fields.times import *  # noqa: F403
