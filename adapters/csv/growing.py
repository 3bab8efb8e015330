"""A CSV file that somebody else appends to, read in pieces of whole lines."""

from errno import ENOENT
from pathlib import Path

from adapters.errors import SourceUnavailable

_MOST_BYTES = 2**24
"""Of one piece: a long recording is taken in several."""


class GrowingFile:
    """The lines of a file completed since the last look; another or a shorter file is read from its beginning."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._header = b""
        self._read = 0
        self._inode = 0

    def piece(self) -> bytes | None:
        """The header and the whole lines that are new, None if there are none. Raises SourceUnavailable."""
        try:
            if not self._path.is_file():
                raise FileNotFoundError(ENOENT, "there is no such file")
            with self._path.open("rb") as file:
                file.seek(0, 2)
                inode, size = self._path.stat().st_ino, file.tell()
                if inode != self._inode or size < self._read:
                    self._inode, self._read = inode, 0
                file.seek(self._read)
                new = file.read(_MOST_BYTES)
        except OSError as error:
            reason = error.strerror or error
            raise SourceUnavailable(f"file '{self._path}' cannot be read ({reason}); check its path") from error
        # What follows the last end of line is still being written.
        new = new[: new.rfind(b"\n") + 1]
        if not new:
            return None
        header = b"" if self._read == 0 else self._header
        if self._read == 0:
            self._header = new[: new.index(b"\n") + 1]
        self._read += len(new)
        return header + new
