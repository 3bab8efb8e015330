"""Which requests read a set of Modbus points: neighbours together, small gaps filled, none longer than allowed."""

from collections.abc import Iterable
from typing import NamedTuple

from adapters.modbus.codec import BIT_TABLES, BITS_AT_MOST
from adapters.modbus.config import ModbusConfig


class Point(NamedTuple):
    """Where the number of a channel is: `size` registers or bits of a unit from `address` on, counted from 0."""

    unit: int
    table: str
    address: int
    size: int


class Request(NamedTuple):
    """One read of `size` registers or bits from `address` on, and the points that it covers, in ascending order."""

    unit: int
    table: str
    address: int
    size: int
    points: tuple[Point, ...]


def plan(points: Iterable[Point], limits: ModbusConfig) -> list[Request]:
    """The requests that read `points`, by unit, table and address; equal points are read once. `limits`: registers in a
    request, and those without a channel that are read to save one, of bits sixteen times as many; without its `batch`
    every point has a request of its own."""
    requests: list[list[Point]] = []
    for point in sorted(set(points)):
        if requests and limits.batch and _fits(requests[-1], point, limits):
            requests[-1].append(point)
        else:
            requests.append([point])
    return [spanning(members) for members in requests]


def spanning(points: Iterable[Point]) -> Request:
    members = tuple(sorted(points))
    address = members[0].address
    return Request(*members[0][:3], _end(members) - address, members)


def halves(request: Request) -> tuple[Request, Request]:
    """Two requests for the points of one that has several, each without what lies between them."""
    middle = len(request.points) // 2
    return spanning(request.points[:middle]), spanning(request.points[middle:])


def _fits(members: list[Point], point: Point, limits: ModbusConfig) -> bool:
    if members[0][:2] != point[:2]:
        return False
    bits = point.table in BIT_TABLES
    longest = min(BITS_AT_MOST, 16 * limits.max_registers) if bits else limits.max_registers
    gap = 16 * limits.fill_gaps if bits else limits.fill_gaps
    end = _end(members)
    return point.address - end <= gap and max(end, point.address + point.size) - members[0].address <= longest


def _end(points: Iterable[Point]) -> int:
    return max(point.address + point.size for point in points)
