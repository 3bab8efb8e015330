"""The process's own settings, made by the entry points: kernel cache, memory, threads, garbage."""

import asyncio
import atexit
import ctypes
import gc
import hashlib
import os
import shutil
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3
_LARGEST_MMAP_THRESHOLD = 32 << 20
_KEPT = 1 << 30
_COLLECT_AFTER_WHILE_STARTING = (50_000, 10, 10)
"""Importing makes hardly any garbage; looking for it every 700 objects took a twelfth of the time of a start."""
_COLLECT_AFTER = (5000, 10, 1000)
"""Thresholds of the garbage collector. A full collection holds every thread, for 60 ms with a thousand zones, and finds
little: what is thrown away here are no cycles, but for connections that are lost. So it is rare, and goes by time."""
_COLLECT_SECONDS = 300.0
"""From one full collection to the next. Connections come and go even where nothing else happens."""
_SWITCH_SECONDS = 0.0005
"""After how long a thread hands on the interpreter lock that another one waits for. The event loop takes it back
several times for one answer; at Python's 5 ms each, REST would be slow whenever zones are stepped."""
_NICENESS = 5
"""Of the threads that compute, beyond that of their process; Linux keeps it per thread."""


def prepare_process(shared: bool = False) -> None:
    """What every entry point calls first, before anything imports NumPy or Numba. `shared`: the process is not ours,
    but a notebook's, whose linear algebra keeps its threads."""
    if not shared:
        # Our matrices are small, and zones or runs are spread over threads and processes already. OpenBLAS would start
        # a thread per processor in each, which wait for each other by turning round: three fits beside each other on
        # two processors took four times as long.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        gc.set_threshold(*_COLLECT_AFTER_WHILE_STARTING)
    _give_numba_a_cache()
    _keep_freed_memory()


def favour_the_event_loop() -> None:
    """In a daemon: let its event loop be prompt beside threads that compute."""
    sys.setswitchinterval(_SWITCH_SECONDS)
    gc.set_threshold(*_COLLECT_AFTER)


def stand_back() -> None:
    """In a thread that computes: let the event loop go first where processors are short, so that REST stays prompt."""
    # A sandbox may forbid it; then REST is a little less prompt.
    with suppress(OSError):
        thread = threading.get_native_id()
        os.setpriority(os.PRIO_PROCESS, thread, os.getpriority(os.PRIO_PROCESS, thread) + _NICENESS)


async def collect_garbage() -> None:
    """A full collection now and then, for ever."""
    while True:
        await asyncio.sleep(_COLLECT_SECONDS)
        gc.collect()


def _give_numba_a_cache() -> None:
    """Choose the folder of compiled kernels, unless NUMBA_CACHE_DIR does.

    It is named after the sources of the estimator: Numba itself sees a change only in the file of the kernel that it
    caches, not in what that kernel calls. Where there is no home folder that can be written, as under a hardened
    service, a folder of this process's own costs a compilation at every start; a unit sets NUMBA_CACHE_DIR to a lasting
    one.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    sources = sorted((Path(__file__).resolve().parents[2] / "estimator").rglob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = cache / "thermogate" / f"kernels-{digest}"
        folder.mkdir(parents=True, exist_ok=True)
        usable = os.access(folder, os.W_OK)
    except (OSError, RuntimeError):
        # RuntimeError is what Python says of an account without a home.
        usable = False
    if not usable:
        folder = Path(tempfile.mkdtemp(prefix="thermogate-kernels-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


def _keep_freed_memory() -> None:
    """Tell glibc's allocator to keep what is freed: every sample replaces megabytes of arrays, and to hand them back to
    the operating system and ask for them again takes up to a third of an update's time."""
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for option, value in (
            (_MMAP_THRESHOLD, _LARGEST_MMAP_THRESHOLD),
            (_TRIM_THRESHOLD, _KEPT),
            (_TOP_PAD, 1 << 20),
        ):
            mallopt(option, value)
