from adapters.fields.problems import *  # noqa: F403
