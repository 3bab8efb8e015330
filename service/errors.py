"""Errors of the daemon, one tree with one base."""

from collections.abc import Sequence
from typing import Any


class ServiceError(Exception):
    """Base of every error the service raises on purpose; its text is one sentence naming the place and the remedy."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Another process has it as it is, whatever its class is made from.
        return _as_it_is, (type(self), self.args, self.__dict__)


class ConfigError(ServiceError):
    """A mistake in the configuration. `problems` holds one sentence per mistake, each beginning with its place."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = [one_line(problem) for problem in problems]
        super().__init__("\n".join(self.problems))


class DataError(ServiceError):
    """A table of measurements, a plan or a file of a model that cannot be used."""


class _Refusal(ServiceError):
    """Something is refused for `problems`, one sentence each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = list(problems)


class ReloadRefused(_Refusal):
    """Nothing was changed. `problems` holds one sentence for every obstacle."""


class PlanError(ServiceError):
    """What is planned of an input cannot be; the text goes on after the place of the input."""


class RequestError(_Refusal):
    """A request for forecasts that cannot be answered as it is. `problems` holds one sentence per mistake."""


class TooManyQuestions(ServiceError):
    """More is to be computed than there is room for; asking again later helps."""


class KeyFileError(ServiceError):
    """The file of API keys cannot be read, written or trusted, or has no such key."""


class CertificateError(ServiceError):
    """Certificate or key of the HTTP server cannot be used."""


class Away(ServiceError):
    """A member of a fleet cannot be asked now: it is being started, or its machine is lost."""


class NoModel(ServiceError):
    """The estimator of a zone has no physics, and so no state-space model and no sampled futures."""


class NoLaw(ServiceError):
    """Set-points are planned of a zone that does not know what its thermostat does with them."""


class JournalError(ServiceError):
    """The journal cannot be opened or written."""


class Fenced(JournalError):
    """Another owner has what was to be written to: `zones`, or without any the lease of this one, and so everything."""

    def __init__(self, sentence: str, zones: Sequence[str] = ()) -> None:
        super().__init__(sentence)
        self.zones = tuple(zones)


class LeaseHeld(ServiceError):
    """The lease `name` belongs to `owner`, and expires in `seconds` unless it is renewed."""

    def __init__(self, name: str, owner: str, seconds: float) -> None:
        super().__init__(
            f"the lease '{name}' belongs to {owner} for {seconds:.0f} s more; stop that owner, or wait until it expires"
        )
        self.name, self.owner, self.seconds = name, owner, seconds


class CheckpointError(ServiceError):
    """A checkpoint that cannot be read, or that belongs to something else."""


class BackupError(ServiceError):
    """A backup that cannot be made, read or put back."""


class StateMismatch(ServiceError):
    """The stored state of `zone`, in `place`, was made with another network or other structural options; `reset` tells
    how state is given up there, if not by the daemon on one machine."""

    def __init__(self, zone: str, place: object, reset: str | None = None) -> None:
        super().__init__(
            f"zone '{zone}': the stored state in {place} belongs to another network or other estimator options; "
            f"restore the configuration it was made with, or give that state up {reset or reset_by_run(zone)}"
        )


def _as_it_is(kind: type[ServiceError], args: tuple[Any, ...], more: dict[str, Any]) -> ServiceError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(more)
    return error


def reset_by_run(zone: str) -> str:
    """How the state of `zone` is given up in a state folder."""
    return f"with `thermogate run CONFIG --reset {zone}`"


def one_line(sentence: str) -> str:
    """`sentence` with what a file may hold and a terminal should not get written as Python writes it."""
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in sentence)
