from adapters.fields.tables import *  # noqa: F403
