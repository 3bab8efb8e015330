"""The process keeps the memory it has freed.

Every sample replaces a zone's arrays, megabytes of them. The C library would hand them back to the operating system
and ask for them again at the next sample, and every page would be cleared anew: up to a third of an update's time.
"""

from __future__ import annotations

import ctypes
import sys

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3
_LARGEST_MMAP_THRESHOLD = 32 << 20
_KEPT = 1 << 30


def keep_freed_memory() -> None:
    """Tell glibc's allocator; elsewhere nothing happens."""
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
