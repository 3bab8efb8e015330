"""The daemon: configuration, alignment, zone workers, durability, REST, Zenoh publishing, metrics, command line."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path


def _numba_needs_a_cache() -> None:
    """Give Numba a folder for compiled kernels where it would find none, and would refuse to start.

    It caches beside the package or in the home folder; under a hardened service both may be read-only. A folder of this
    process's own costs a compilation at every start: a unit sets NUMBA_CACHE_DIR to a lasting one.
    """
    package = Path(__file__).resolve().parent.parent / "estimator"
    places = (package / "__pycache__", package, Path.home() / ".cache", Path.home())
    if "NUMBA_CACHE_DIR" in os.environ or any(place.is_dir() and os.access(place, os.W_OK) for place in places):
        return
    folder = tempfile.mkdtemp(prefix="thermogate-numba-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = folder


_numba_needs_a_cache()
