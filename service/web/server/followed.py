"""Files that are read again when they change."""

from __future__ import annotations

from pathlib import Path

_Signature = tuple[int, ...] | None


class FollowedFiles:
    """Some files, and whether one of them is another than when it was last looked at."""

    def __init__(self, *paths: Path) -> None:
        """Looks at the files for the first time; one that is not there may come."""
        self._paths = paths
        self.look()

    def look(self) -> None:
        """Take the files for known as they are now; to be called before they are read, so that what changes meanwhile
        is read again."""
        self._seen: list[_Signature] | None = self._signatures()

    def forget(self) -> None:
        """They could not be read after all, and have to be looked at again."""
        self._seen = None

    def changed(self) -> bool:
        """Whether a file is another one than at the last look."""
        return self._signatures() != self._seen

    def _signatures(self) -> list[_Signature]:
        return [_signature(path) for path in self._paths]


def _signature(path: Path) -> _Signature:
    """What changes when the file does; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode
