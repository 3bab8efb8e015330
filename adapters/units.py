"""Units of telemetry, and how a value in one becomes a value in another."""

from typing import NamedTuple

from adapters.errors import SourceConfigError


class Affine(NamedTuple):
    """The conversion `value * scale + offset`."""

    scale: float
    offset: float


IDENTITY = Affine(1.0, 0.0)

# Every unit in terms of the first one of its dimension.
_DIMENSIONS: dict[str, dict[str, Affine]] = {
    "temperature": {"degC": IDENTITY, "K": Affine(1.0, -273.15), "degF": Affine(5 / 9, -160 / 9)},
    "power": {
        "W": IDENTITY,
        "kW": Affine(1e3, 0.0),
        "MW": Affine(1e6, 0.0),
        "BTU/h": Affine(1055.05585262 / 3600, 0.0),
    },
    "irradiance": {"W/m2": IDENTITY, "kW/m2": Affine(1e3, 0.0)},
    "dimensionless": {"1": IDENTITY, "%": Affine(0.01, 0.0)},
}

ENERGIES = {"J": 1.0, "Wh": 3600.0, "kWh": 3.6e6, "MWh": 3.6e9, "MJ": 1e6, "GJ": 1e9}
"""Units of energy, in J. A channel in one of them is a counter, or amounts of energy, of which power is made."""

SYMBOLS = {"°C": "degC", "°F": "degF", "W/m²": "W/m2"}
"""Symbols of units that a keyboard may not have, as they are written here."""

# Wider than any building: what lies outside is a broken sensor or a wrong unit, not weather.
_VALID_RANGES = {"degC": (-60.0, 80.0), "W": (-1e6, 1e6), "W/m2": (-20.0, 2000.0)}

# What is larger cannot be measured anywhere, and the arithmetic of an estimator would not survive it.
_POSSIBLE_RANGES = {"degC": (-273.15, 1e4)}
_ANY = (-1e9, 1e9)


def conversion(from_unit: str, to_unit: str, nominal: float | None = None) -> Affine:
    """The conversion from `from_unit` to `to_unit`; a unit not known here (a user's own) converts to itself only.
    Percent become power by `nominal`, the power at 100 % in `to_unit`; energy becomes power times s, to be divided by
    the time that it took. Raises SourceConfigError with the units that would do."""
    if from_unit == to_unit:
        return IDENTITY
    for dimension, units in _DIMENSIONS.items():
        if to_unit not in units:
            continue
        target = units[to_unit]
        if dimension == "power" and from_unit in ENERGIES:
            return Affine(ENERGIES[from_unit] / target.scale, 0.0)
        if dimension == "power" and from_unit == "%":
            if nominal is None:
                raise SourceConfigError(
                    f"unit '%' is no power by itself; give nominal, the power at 100 % in {to_unit}, "
                    "such as nominal = 2000"
                )
            return Affine(nominal / 100, 0.0)
        if from_unit not in units:
            more = f", % with nominal, and for energy {', '.join(ENERGIES)}" if dimension == "power" else ""
            raise SourceConfigError(
                f"unit '{from_unit}' cannot be converted to {to_unit}; the units of {dimension} are "
                f"{', '.join(units)}{more}"
            )
        source = units[from_unit]
        return Affine(source.scale / target.scale, (source.offset - target.offset) / target.scale)
    raise SourceConfigError(
        f"unit '{from_unit}' cannot be converted to '{to_unit}'; give the channel in {to_unit}, "
        "with 'scale' and 'offset' where needed"
    )


def default_valid_range(unit: str) -> tuple[float, float]:
    """Lowest and highest believable value of a channel in `unit`, when the configuration does not say."""
    return _VALID_RANGES.get(unit, _ANY)


def possible_range(unit: str) -> tuple[float, float]:
    """What no range of believable values of a channel in `unit` may go beyond."""
    return _POSSIBLE_RANGES.get(unit, _ANY)
