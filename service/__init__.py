"""The daemon: configuration, alignment, zone workers, durability, REST, Zenoh publishing, metrics, command line."""

import atexit
import hashlib
import os
import shutil
import tempfile
from pathlib import Path

from service.allocator import keep_freed_memory


def _give_numba_a_cache() -> None:
    """Choose the folder of compiled kernels, unless NUMBA_CACHE_DIR does.

    It is named after the sources of the estimator: Numba itself sees a change only in the file of the kernel that it
    caches, not in what that kernel calls. Where the home folder cannot be written, as under a hardened service, a
    folder of this process's own costs a compilation at every start; a unit sets NUMBA_CACHE_DIR to a lasting one.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    sources = sorted((Path(__file__).resolve().parent.parent / "estimator").glob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "thermogate" / f"kernels-{digest}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        usable = os.access(folder, os.W_OK)
    except OSError:
        usable = False
    if not usable:
        folder = Path(tempfile.mkdtemp(prefix="thermogate-kernels-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


_give_numba_a_cache()
keep_freed_memory()
