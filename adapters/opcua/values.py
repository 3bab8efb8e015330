"""What an OPC UA server says of a node: value, status and time, and how far that can be believed. Pure."""

from typing import NamedTuple

from adapters.reading import Fault, Quality
from adapters.watched import Verdict

_REFUSALS = {
    "BadAttributeIdInvalid",
    "BadNodeIdInvalid",
    "BadNodeIdUnknown",
    "BadNotReadable",
    "BadNotSupported",
    "BadUserAccessDenied",
}
_NOTHING = {"BadNoData", "BadNoDataAvailable", "BadWaitingForInitialData"}


class Seen(NamedTuple):
    """What a server last said of a node; `time` (UTC s) is the time stamp of the value's source."""

    value: object
    status: str = "Good"
    time: float | None = None

    @property
    def is_refusal(self) -> bool:
        return self.status in _REFUSALS

    def judged(self) -> Verdict:
        if self.is_refusal:
            sentence = f"the server refuses it: {self.status}; check node, or list what there is with --scan"
            return Verdict(None, Quality.BAD, Fault.REFUSED_BY_DEVICE, sentence)
        if self.status in _NOTHING or (self.value is None and not self.status.startswith("Bad")):
            return Verdict(None, Quality.BAD, Fault.NOT_AVAILABLE, "not available: the server has no value here now")
        if self.status.startswith("Bad"):
            return Verdict(None, Quality.BAD, Fault.REPORTED_BAD, f"reported bad: its status is {self.status}")
        if not isinstance(self.value, bool | int | float):
            found = type(self.value).__name__
            return Verdict(None, Quality.BAD, Fault.NON_NUMERIC, f"not usable: the value is no number but a {found}")
        if self.status.startswith("Uncertain"):
            return Verdict(float(self.value), Quality.UNCERTAIN, None, f"uncertain: its status is {self.status}")
        return Verdict(float(self.value))
