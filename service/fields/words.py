from adapters.fields.words import *  # noqa: F403
