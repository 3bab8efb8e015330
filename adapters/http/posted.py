"""One value as a client posts it, out of SenML packs and of line protocol. Pure."""

from collections.abc import Iterator, Mapping
from math import isfinite
from typing import NamedTuple

from adapters.payload import line_protocol, senml
from adapters.reading import Fault, Quality

NO_TAGS: Mapping[str, str] = {}
_SHOWN = 80


class Posted(NamedTuple):
    """A posted value, called by its `name` or, of line protocol, by measurement (`name`), `field` and `tags`. `value`
    may be the fault for which there is none; `time` (UTC s) and `unit` are None where not given."""

    name: str
    value: float | Fault
    time: float | None = None
    field: str | None = None
    tags: Mapping[str, str] = NO_TAGS
    quality: Quality = Quality.GOOD
    unit: str | None = None

    @property
    def shown(self) -> str:
        """What it is called, for people: shortened, on one line."""
        text = self.name if self.field is None else f"{self.name} {self.field}"
        return "".join(character if character.isprintable() else "?" for character in text[:_SHOWN])


def from_lines(text: str, precision: str) -> Iterator[Posted]:
    """The values of lines in InfluxDB line protocol. Raises ValueError with one sentence that names the line."""
    for point in line_protocol.points(text, precision):
        value = Fault.NON_NUMERIC if isinstance(point.value, str) else point.value
        yield Posted(point.measurement, value, point.time, point.field, point.tags)


def from_senml(document: object, now: float) -> Iterator[Posted]:
    """The values of a SenML pack; relative times count from `now`, UTC s. Raises ValueError with one sentence."""
    for record in senml.records(document):
        when = record.time
        if when is not None and not isfinite(when):
            raise ValueError(f'has a record "{record.name}" whose time is not finite')
        if when is not None and when < senml.ABSOLUTE_FROM:
            when += now
        yield Posted(record.name, _senml_value(record), when, unit=record.unit)


def _senml_value(record: senml.Record) -> float | Fault:
    if record.value is None:
        return Fault.NON_NUMERIC if record.text else Fault.NOT_AVAILABLE
    try:
        return float(record.value)
    except OverflowError:
        return Fault.NOT_FINITE
