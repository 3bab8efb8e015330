"""The measurements of `make bench`, one module each; `python -m replay.bench` runs them."""

# Before anything imports Numba: the daemon's choice of a kernel cache.
import service  # noqa: F401
