"""The network of a zone as it is written in the configuration: a preset, perhaps with changes, or inline."""

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, PlainValidator, model_validator

from adapters.fields.tables import Table
from adapters.fields.values import Flag, Identifier, Name, Number, Positive, Text, number
from adapters.fields.words import shown
from adapters.units import possible_range
from estimator.network.boxes import WIDEST

_SMALLEST_AREA, _LARGEST_AREA = 1, 100_000

SPREAD_ALONE = "has a spread but no typical value that it is about; add typical, or remove spread"


class BoundsConfig(Table):
    """What can be said about a parameter: the bounds of its prior, a nominal value and a typical one, or a value that
    fixes it."""

    lower: Positive | None = Field(default=None, description="lower bound, in the parameter's unit")
    upper: Positive | None = Field(default=None, description="upper bound")
    nominal: Positive | None = Field(default=None, description="value where it is fixed, within the bounds")
    typical: Positive | None = Field(default=None, description="what it usually is")
    spread: Positive | None = Field(
        default=None, description="standard deviation of its logarithm about `typical`; none: 1, a factor of 2.7"
    )
    value: Positive | None = Field(default=None, description="fixes it; excludes the other keys")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        lower, upper = self.lower, self.upper
        if self.value is not None and (lower, upper, self.nominal, self.typical, self.spread) != (None,) * 5:
            raise ValueError(
                "has both a value, which fixes it, and bounds, which let it be learned; give one of the two"
            )
        if lower is not None and upper is not None and lower >= upper:
            raise ValueError(f"lower = {lower:g} is not below upper = {upper:g}; swap or correct them")
        for name, value in (("nominal", self.nominal), ("typical", self.typical)):
            below = value is not None and lower is not None and value < lower
            above = value is not None and upper is not None and value > upper
            if below or above:
                raise ValueError(f"{name} = {value:g} lies outside the bounds; move it or the bounds")
        return self

    @property
    def complete(self) -> bool:
        """Whether it says enough to stand alone, without a preset behind it."""
        return self.value is not None or (self.lower is not None and self.upper is not None)

    def required(self) -> Self:
        """The table itself; ValueError if it is not `complete`, or has a spread about nothing."""
        if not self.complete:
            raise ValueError("needs lower and upper (it is learned between them) or value (it is fixed)")
        if self.spread is not None and self.typical is None:
            raise ValueError(SPREAD_ALONE)
        return self


class CompleteConfig(BoundsConfig):
    """The same without a preset behind it."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        return self.required()


class CapacitanceConfig(CompleteConfig):
    """The capacitance of an inline network's node, J/K."""

    name: Name | None = Field(default=None, description="parameter, J/K; none: `C_` and the node without `T_`")


class ConductanceConfig(CompleteConfig):
    """A conductance of an inline network, W/K."""

    name: Name = Field(description='its name, such as "g_air_wall"')
    between: tuple[Name, Name] = Field(description='the two nodes that it connects, such as ["T_air", "T_wall"]')


class GainConfig(BoundsConfig):
    """Gain of a heat input: a number (`constant`), a parameter (`name`), or what another leaves of 1 (`rest_of`)."""

    constant: Number | None = Field(default=None, description="known gain")
    name: Name | None = Field(default=None, description="parameter that the gain is, with bounds or a value")
    unit: Text | None = Field(default=None, description="unit of the parameter; none: by the channel's")
    rest_of: Name | None = Field(default=None, description="1 minus the gain of this name")

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if [self.constant, self.name, self.rest_of].count(None) != 2:
            raise ValueError(
                'must be a number, { name = "A_w", unit = "m2", lower = 0.1, upper = 30 }, '
                'or { rest_of = "f_air" } for what that gain leaves of 1'
            )
        if self.name is not None:
            self.required()
        elif self.model_fields_set - {"constant", "rest_of"}:
            raise ValueError("has bounds, a value or a unit but no name; give it a name, such as A_w")
        return self


def _gain(value: object) -> object:
    return value if isinstance(value, dict | GainConfig) else {"constant": value}


class HeatInputConfig(Table):
    """A heat input of an inline network."""

    channel: Name = Field(description='the channel that brings it, such as "u_heat"')
    node: Name = Field(description='the state node that it enters, such as "T_air"')
    unit: Text = Field(default="W", description="unit of the channel")
    gain: Annotated[GainConfig, BeforeValidator(_gain)] = Field(
        default=GainConfig(constant=1.0), description="W into the node per unit: a number or a table"
    )


def _initial_source(value: object) -> str | float:
    if isinstance(value, str) and value:
        return value
    try:
        degrees = number(value)
    except ValueError:
        raise ValueError(
            f'must be "measured", the name of a boundary node, or a temperature in degC, not {shown(value)}'
        ) from None
    lower, upper = possible_range("degC")
    if not lower <= degrees <= upper:
        raise ValueError(f"must be a temperature from {lower:g} to {upper:g} degC, not {shown(value)}")
    return degrees


class InitialConfig(Table):
    """Where a state node starts: `source` is "measured", a boundary node or degC; `sd` is in K."""

    source: Annotated[str | float, PlainValidator(_initial_source)] | None = Field(
        default=None, description='`"measured"`, a boundary or degC'
    )
    sd: Positive | None = Field(default=None, description="standard deviation, K")


class SolarConfig(BoundsConfig):
    """Global irradiance into `node` (default: the first measured one) through a solar aperture, m2."""

    node: Name | None = Field(default=None, description="node that the sun heats; none: the first measured one")


def _solar(value: object) -> object:
    if isinstance(value, dict | SolarConfig):
        return value
    if not isinstance(value, bool):
        raise ValueError(
            f'must be true, or a table such as {{ node = "T_i", lower = 0.1, upper = 30 }}, not {shown(value)}'
        )
    return {} if value else None


def _floor_area(value: object) -> tuple[float, float]:
    ends = value if isinstance(value, list | tuple) else (value, value)
    if len(ends) != 2:
        raise ValueError(f"must be a number of m2, or the smallest and the largest it can be, not {shown(value)}")
    smallest, largest = (number(end) for end in ends)
    if not _SMALLEST_AREA <= smallest <= largest <= _LARGEST_AREA:
        raise ValueError(
            f"must lie within {_SMALLEST_AREA} to {_LARGEST_AREA} m2, the smaller first, not {shown(value)}"
        )
    return smallest, largest


class BoxConfig(Table):
    """The floor area that the bounds follow from, m2, and whether narrower ones are proposed after a week."""

    floor_area: Annotated[tuple[float, float], PlainValidator(_floor_area)] = Field(
        description="the heated floor area in m2: a number, or a range such as [80, 200]"
    )
    propose: Flag = Field(default=False, description="a finding proposes narrower bounds after a week")


def _box(value: object) -> object:
    if isinstance(value, dict | BoxConfig):
        return value
    if value not in ("wide", "auto"):
        raise ValueError(f'must be "wide", "auto", or a table such as {{ floor_area = 120 }}, not {shown(value)}')
    return {"floor_area": WIDEST, "propose": value == "auto"}


class PresetConfig(Table):
    """A preset, with changes."""

    preset: Text = Field(description="the name of a preset; `thermogate networks` lists them")
    solar: Annotated[SolarConfig | None, BeforeValidator(_solar)] = Field(
        default=None, description="true or a table: adds `I_sol` and an aperture `A_w`"
    )
    box: Annotated[BoxConfig | None, BeforeValidator(_box)] = Field(
        default=None, description='bounds by floor area: `"wide"`, `"auto"` or a table'
    )
    fixed: tuple[Text, ...] = Field(default=(), description='a list of parameters to hold at nominal, such as ["C_h"]')
    parameters: dict[str, BoundsConfig] = Field(
        default={}, description="a table with one line per parameter, such as C_i = { lower = 1e5, upper = 1e7 }"
    )
    initial: dict[str, InitialConfig] = Field(
        default={}, description='a table with one line per state node, such as T_e = { source = "T_out", sd = 3.0 }'
    )


class InlineConfig(Table):
    """A network of one's own."""

    name: Identifier = Field(default="inline", description="name in payloads and reports")
    measured: tuple[Name, ...] = Field(description='the list of measured state nodes, such as ["T_air"]')
    boundaries: tuple[Name, ...] = Field(description='the list of prescribed temperatures, such as ["T_out"]')
    capacitances: dict[Name, CapacitanceConfig] = Field(
        description="a table with one line per state node, such as T_air = { lower = 1e5, upper = 1e7 }"
    )
    conductances: tuple[ConductanceConfig, ...] = Field(
        description="[[zones.network.conductances]] tables with name, between, and lower and upper"
    )
    heat_inputs: tuple[HeatInputConfig, ...] = Field(
        default=(), description="[[zones.network.heat_inputs]] tables with channel, node and gain"
    )
    initial: dict[str, InitialConfig] = Field(
        default={}, description='a table with one line per state node, such as T_wall = { source = "T_out", sd = 3.0 }'
    )


NetworkConfig = PresetConfig | InlineConfig


def network_model(raw: str | dict[str, Any]) -> tuple[type[PresetConfig] | type[InlineConfig], dict[str, Any]]:
    """The model that describes `raw`, and `raw` in its long form (a bare preset name becomes a table)."""
    if isinstance(raw, str):
        return PresetConfig, {"preset": raw}
    if "preset" not in raw and raw.keys() & {"capacitances", "conductances", "measured"}:
        return InlineConfig, raw
    return PresetConfig, raw
