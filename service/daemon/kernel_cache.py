"""The cache of compiled kernels, which must never be what a zone fails for.

Numba writes it without checksums and fails on what it cannot read or write: a truncated file after a power failure, or
a full disk, would fail every zone at every sample.
"""

import hashlib
import logging
import os
import stat
from glob import escape
from pathlib import Path
from typing import Any

from service.store.ownership import others_can_change

_MARK = b"thermogate:sha256:"
"""What stands between the content of a file and its checksum. Files without are read as Numba does."""

_log = logging.getLogger(__name__)
_told: set[str] = set()


def guard_kernel_cache() -> None:
    """Let Numba compile where its cache cannot be read, and go on where it cannot be written; safe to call again."""
    from numba.core import caching

    if getattr(caching.Cache, "guarded", False):
        return
    caching.Cache.guarded = True
    read = caching.IndexDataCacheFile._load_data
    load, save = caching.Cache.load_overload, caching.Cache.save_overload

    def load_or_compile(cache: Any, *arguments: Any) -> Any:
        if _is_foreign(cache):
            cache.disable()
            return None
        try:
            if (kernel := load(cache, *arguments)) is None:
                _tell("compiling the estimators, which takes up to a minute once; later starts find them", logging.INFO)
            return kernel
        # What unpickling makes of a damaged file can be anything.
        except Exception as error:
            _set_aside(cache, error)
            return None

    def save_if_possible(cache: Any, *arguments: Any) -> None:
        try:
            try:
                save(cache, *arguments)
            except OSError:
                raise
            except Exception as error:
                # The index is read before it is written.
                _set_aside(cache, error)
                save(cache, *arguments)
        except Exception as error:
            _tell(
                f"compiled kernels cannot be kept in {cache.cache_path} ({_reason(error)}); free space there or set "
                "NUMBA_CACHE_DIR to another folder, or every start compiles them again"
            )

    def read_if_sound(files: Any, name: str) -> Any:
        content, mark, digest = Path(files._data_path(name)).read_bytes().rpartition(_MARK)
        if mark and hashlib.sha256(content).digest() != digest:
            raise ValueError("a checksum is wrong")
        # What follows the content is of no concern to Numba.
        return read(files, name)

    caching.Cache.load_overload, caching.Cache.save_overload = load_or_compile, save_if_possible
    caching.IndexDataCacheFile._save_data = _save_data
    caching.IndexDataCacheFile._load_data = read_if_sound


def _is_foreign(cache: Any) -> bool:
    """Whether other accounts can change the kernel of `cache`, which is code and pickles; said once."""
    folder, index = Path(cache.cache_path), Path(cache._cache_file._index_path)
    for path in (folder, *folder.glob(f"{escape(index.stem)}.*")):
        try:
            status = path.stat()
        except OSError:
            continue  # There is nothing to read.
        # The folder itself must be private: in one like /tmp, others can make the files that are not there yet.
        if not others_can_change(status, (0, os.geteuid())) and not status.st_mode & stat.S_IWOTH:
            continue
        _tell(
            f"the compiled kernels in {path} can be replaced by other accounts of this machine, and are not used; "
            f"say: {'chmod go-w' if path == folder else 'rm'} {path}, or set NUMBA_CACHE_DIR to a private folder, or "
            "every start compiles them anew"
        )
        return True
    return False


def _save_data(files: Any, name: str, data: object) -> None:
    content = files._dump(data)
    with files._open_for_write(files._data_path(name)) as file:
        file.write(content + _MARK + hashlib.sha256(content).digest())


def _set_aside(cache: Any, error: Exception) -> None:
    """Have the kernel of `cache` compiled anew, and its files replaced."""
    _tell(
        f"the compiled kernels in {cache.cache_path} are damaged ({_reason(error)}); they are set aside and compiled "
        "anew"
    )
    index = Path(cache._cache_file._index_path)
    try:
        index.replace(index.with_name(f"{index.name}.damaged"))
    except FileNotFoundError:
        pass
    except OSError:
        # It cannot be replaced either.
        cache.disable()


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__


def _tell(sentence: str, level: int = logging.ERROR) -> None:
    """Log it, once in the life of the process: there are dozens of kernels."""
    if sentence not in _told:
        _told.add(sentence)
        _log.log(level, "%s", sentence)
