"""Errors of the recorded and simulated periods, one tree with one base."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from service.errors import ServiceError


class ReplayError(ServiceError):
    """Base of every error replay raises on purpose; its text is one sentence naming the place and the remedy."""


class WeatherFileError(ReplayError):
    """A weather file that cannot be read or is not on the grid it has to be on."""


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """Make the folder `out` for what the block writes there; ReplayError where that cannot be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise ReplayError(f"--out {out}: cannot be written ({error.strerror}); choose another folder") from error
