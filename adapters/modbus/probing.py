"""One look at the channels of a Modbus source for the person who sets it up: what is there, and what might be meant."""

import asyncio
from collections.abc import Iterator, Sequence
from math import isfinite

from adapters.modbus.client import Answer, ModbusLink, NoAnswer, Refused
from adapters.modbus.codec import BIT_TABLES, Format, decode, is_available, other_orders, other_sign
from adapters.modbus.points import ModbusChannel
from adapters.reading import Probe

_NEARLY_NOTHING = 1e-6
_SCALES = (0.1, 0.01, 0.001, 10.0)
_SWAPPED_STEP = 65536
_LIFETIME = 50 * 365.25 * 86_400.0
_OTHER_TABLE = {"holding": "input", "input": "holding", "coil": "discrete", "discrete": "coil"}
_NUMBERED = {"1": "discrete", "3": "input", "4": "holding"}
"""What the first of five digits means in lists that number registers 40001 and so on."""


async def probe_all(link: ModbusLink, channels: Sequence[ModbusChannel], seconds: float) -> list[Probe]:
    """A probe of every channel, in their order. Counters are read twice, `seconds` apart. Raises SourceUnavailable."""
    silent: dict[int, str] = {}
    answers = [await _look(link, channel, silent) for channel in channels]
    again: dict[str, Answer | Refused | str] = {}
    pairs = list(zip(channels, answers, strict=True))
    counters = [one for one, answer in pairs if one.edge.counter and isinstance(answer, Answer)]
    if counters:
        await asyncio.sleep(seconds)
        again = {one.id: await _look(link, one, silent) for one in counters}
    probes = []
    for channel, answer in pairs:
        if isinstance(answer, str):
            probes.append(Probe(channel.id, channel.place, "-", None, None, answer))
            continue
        if isinstance(answer, Refused):
            verdict = f"the device refuses it: {answer}; check table and register"
            probe = Probe(channel.id, channel.place, "-", None, None, verdict, tuple(_numbered(channel)))
        else:
            later = again.get(channel.id)
            probe = probed(channel, answer, later if isinstance(later, Answer) else None)
        sound = probe.verdict == "good" or probe.verdict.startswith("not available")
        if not sound and channel.point.unit not in silent:
            probe = probe._replace(hints=(*probe.hints, *await _nearby(link, channel)))
        probes.append(probe)
    return probes


async def _look(link: ModbusLink, channel: ModbusChannel, silent: dict[int, str]) -> Answer | Refused | str:
    """The answer for `channel`, or the sentence about a unit that is silent, which is not asked again."""
    if channel.point.unit not in silent:
        try:
            return await link.read(*channel.point)
        except Refused as error:
            return error
        except NoAnswer as error:
            silent[channel.point.unit] = f"{error}; check unit_id and the device"
    return silent[channel.point.unit]


def probed(channel: ModbusChannel, answer: Answer, later: Answer | None = None) -> Probe:
    """What a person should know about the answer for `channel`; a counter has been read a second time `later`."""
    words, edge = answer.words, channel.edge
    bits = channel.point.table in BIT_TABLES
    raw = " ".join(str(word) if bits else f"0x{word:04x}" for word in words)
    layout = channel.format.type if len(words) == 1 else f"{channel.format.type} {channel.format.order}"
    verdict, others = channel.judged(words), list[str]()
    if edge.counter and verdict.raw is not None:
        sentence, others = _counted(channel, answer, later)
        verdict = verdict._replace(sentence=sentence)
    probe = channel.probed(verdict, raw, answer.time, others)._replace(place=f"{channel.place} {layout}")
    if verdict.raw is None or edge.counter:
        return probe
    if edge.fault(edge.value(verdict.raw)) is None and 0 < abs(verdict.raw) < _NEARLY_NOTHING:
        probe = probe._replace(verdict="doubtful: nearly but not quite 0, as numbers with swapped registers are")
    return probe if probe.verdict == "good" else probe._replace(hints=tuple(_hints(channel, words)))


def _hints(channel: ModbusChannel, words: Sequence[int]) -> Iterator[str]:
    number, twin = decode(words, channel.format), other_sign(words, channel.format)
    for order, other in other_orders(words, channel.format).items():
        yield _would_be(channel, order, other) or f"{order} would be {channel.edge.value(other):.6g}"
    scales = _SCALES if isfinite(number) and channel.format.type != "bool" else ()
    others = [twin] if twin is not None else []
    others += [(f"scale = {channel.edge.scale * scale:g}", number * scale) for scale in scales]
    yield from filter(None, (_would_be(channel, name, other) for name, other in others))


def _would_be(channel: ModbusChannel, name: str, number: float) -> str | None:
    """The hint that the raw `number`, which is there under another `name`, would be plausible; None if it is not."""
    value = channel.edge.value(number)
    plausible = abs(number) >= _NEARLY_NOTHING and channel.edge.is_usual(value)
    return f"{name} would be {value:.6g}, which is plausible" if plausible else None


def _numbered(channel: ModbusChannel) -> Iterator[str]:
    """Lists that begin with 40001 name the table by the first digit."""
    digits = str(channel.register)
    if len(digits) == 5 and digits[0] in _NUMBERED and 1 <= channel.register % 10_000 <= 9999:
        table, register = _NUMBERED[digits[0]], channel.register % 10_000
        yield (
            f"a list that writes {digits} means register {register} of table {table}: write first_register = 1, "
            f'table = "{table}" and register = {register}'
        )


async def _nearby(link: ModbusLink, channel: ModbusChannel) -> list[str]:
    """What stands beside the channel's registers, and in the other table, where it would be plausible."""
    point, found = channel.point, []
    steps = sorted({-point.size, -1, 1, point.size}, key=lambda step: (abs(step), step))
    places = [(f"register {channel.register + step}", point._replace(address=point.address + step)) for step in steps]
    other = _OTHER_TABLE[point.table]
    places.append((f"table {other}", point._replace(table=other)))
    if channel.edge.counter or channel.format.type == "bool":
        return []
    for name, place in places:
        if not 0 <= place.address <= 65536 - place.size:
            continue
        try:
            words = (await link.read(*place)).words
        except Refused:
            continue
        except NoAnswer:
            break
        if is_available(words, channel.format):
            found.append(_would_be(channel, name, decode(words, channel.format)))
    return [hint for hint in found if hint is not None]


def _counted(channel: ModbusChannel, first: Answer, second: Answer | None) -> tuple[str, list[str]]:
    """What one or two readings of a counter say, beside where it stands."""
    edge, form = channel.edge, channel.format
    number = decode(first.words, form)
    hints: list[str] = []
    verdict = "good"
    whole = not form.type.startswith("float")
    if whole and form.registers > 1 and number >= _SWAPPED_STEP and number % _SWAPPED_STEP == 0:
        verdict = f"doubtful: it stands at a multiple of {_SWAPPED_STEP}, as counters with swapped words do"
    elif not isfinite(number) or number < 0 or 0 < number < _NEARLY_NOTHING:
        verdict = "doubtful: no counter stands there"
    elif second is not None and is_available(second.words, form):
        power = _power(channel, form, first, second)
        span = second.time - first.time
        moved = decode(second.words, form) - number
        if power is None:
            verdict = f"doubtful: it went back by {-moved * edge.scale:g} within {span:.1f} s"
        elif not edge.is_usual(power):
            verdict = f"doubtful: it moved by {moved * edge.scale:g} within {span:.1f} s, which would be {power:.6g}"
        else:
            hints.append(f"it moved by {moved * edge.scale:g} within {span:.1f} s")
    if verdict == "good" and not _lived(channel, number):
        verdict = "doubtful: it stands higher than it could in fifty years"
    if verdict != "good":
        for order in other_orders(first.words, form):
            other = Format(form.type, order)
            stand = decode(first.words, other)
            power = None if second is None else _power(channel, other, first, second)
            steady = power is not None and edge.is_usual(power) and not (whole and stand and stand % _SWAPPED_STEP == 0)
            believable = _lived(channel, stand) and (whole or stand >= _NEARLY_NOTHING)
            mark = ", which is plausible" if steady and believable else ""
            hints.append(f"{order} would stand at {stand * edge.scale + edge.offset:g}{mark}")
    return verdict, hints


def _lived(channel: ModbusChannel, stand: float) -> bool:
    """Whether a counter can have come to `stand` at the usual power."""
    edge = channel.edge
    return stand * edge.scale * edge.conversion.scale <= edge.usual[1] * _LIFETIME


def _power(channel: ModbusChannel, form: Format, first: Answer, second: Answer) -> float | None:
    """The least power that two readings allow, since a counter of whole steps may just have made one; None where it
    went back."""
    moved = decode(second.words, form) - decode(first.words, form)
    span = second.time - first.time
    if not moved >= 0 or span <= 0:
        return None
    steps = moved if form.type.startswith("float") else max(moved - 1.0, 0.0)
    return steps * channel.edge.scale * channel.edge.conversion.scale / span
