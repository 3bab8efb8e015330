from adapters.fields.numbers import *  # noqa: F403
