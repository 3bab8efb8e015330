"""What switches the heat of a simulated room: a relay with hysteresis, or a valve under PI control."""

from dataclasses import dataclass
from typing import Protocol


class Thermostat(Protocol):
    """A controller whose whole memory is one number, 0.0 at first."""

    @property
    def power(self) -> float: ...

    def step(self, memory: float, excess: float, seconds: float) -> tuple[float, float]:
        """New memory, and the power in W for the next `seconds`, at `excess` K above the set-point."""
        ...

    def can_give(self, power: float) -> str | None:
        """None if it can give `power` W when it is told to; otherwise what it can give, in words."""
        ...


@dataclass(frozen=True)
class Relay:
    """An electric panel of `power` W behind a relay with `hysteresis` K around the set-point; memory: on or off."""

    power: float
    hysteresis: float

    def step(self, memory: float, excess: float, seconds: float) -> tuple[float, float]:
        if abs(excess) > self.hysteresis / 2:
            memory = float(excess < 0)
        return memory, memory * self.power

    def can_give(self, power: float) -> str | None:
        return None if power in (0.0, self.power) else f"a relay gives 0 or {self.power:g} W"


@dataclass(frozen=True)
class PiValve:
    """A valve that lets 0 to `power` W pass: `gain` in W/K, `integral_time` in s; memory: the integral part in W, which
    stands still where the valve is at its end and the error would drive it further (anti-windup)."""

    power: float
    gain: float
    integral_time: float

    def step(self, memory: float, excess: float, seconds: float) -> tuple[float, float]:
        integral = memory - self.gain * excess * seconds / self.integral_time
        wanted = integral - self.gain * excess
        flow = min(max(wanted, 0.0), self.power)
        return (integral if wanted == flow else memory), flow

    def can_give(self, power: float) -> str | None:
        return None if 0.0 <= power <= self.power else f"it gives 0 to {self.power:g} W"
