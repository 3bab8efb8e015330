from adapters.csv.config import *  # noqa: F403
