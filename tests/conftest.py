"""What all tests share: the daemon's choice of a kernel cache, made before anything imports Numba."""

import service  # noqa: F401
