"""Files that are read again when they change."""

import logging
from collections.abc import Callable
from pathlib import Path

from service.errors import ServiceError

_Signature = tuple[int, ...] | None
_log = logging.getLogger(__name__)


class FollowedFiles:
    """Some files, and whether one of them is another than when it was last looked at."""

    def __init__(self, *paths: Path) -> None:
        """Looks at the files for the first time; one that is not there may come."""
        self._paths = paths
        self.complaint = ""
        """Why they cannot be read now."""
        self.look()

    def look(self) -> None:
        """Take the files for known as they are now; to be called before they are read, so that what changes meanwhile
        is read again."""
        self._seen: list[_Signature] | None = list(map(_signature, self._paths))

    def follow(self, read: Callable[[], None], until_then: str) -> bool:
        """`read` them if one is another than at the last look; whether they have been read. What keeps them from it is
        logged once, with what holds until then, and they are read again at the next call."""
        before = self._seen
        self.look()
        if self._seen == before:
            return False
        try:
            read()
        except ServiceError as error:
            # It may be that only the moment was wrong.
            self._seen = None
            if str(error) != self.complaint:
                self.complaint = str(error)
                _log.error("%s; until then %s", error, until_then)
            return False
        self.complaint = ""
        return True


def _signature(path: Path) -> _Signature:
    """What changes when the file does; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode
