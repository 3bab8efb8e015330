"""An update: what one sample brought, from the score of its forecast to the next forecast."""

import math
from typing import Literal, NamedTuple

from adapters.reading import Quality
from estimator.types import Outcome
from service.records.record import Number, constant, record, shown


@record
class Interval:
    """A central prediction interval."""

    level: float = shown("probability content, between 0 and 1")
    lower: Number = shown("degC")
    upper: Number = shown("degC")


@record
class OutputForecast:
    """The predictive distribution of one measured temperature."""

    output: str = shown("channel of the network")
    unit: Literal["degC"] = constant("degC", "unit of mean, median and interval bounds")
    mean: Number = shown("degC")
    median: Number = shown("degC")
    sd: Number = shown("standard deviation in K")
    intervals: tuple[Interval, ...]


@record
class InputUsed:
    """An input as the forecast uses it."""

    channel: str = shown(examples=["u_heat"])
    value: Number = shown("in unit", examples=[2000.0])
    unit: str = shown(examples=["W"])
    age: Number = shown("age of the value at issue time, s", key="age_s")
    quality: Quality
    held: bool = shown("true if the last interval brought no reading and an older value is held")


class Forecast(NamedTuple):
    """The standing forecast of a zone, issued when sample `sample_time` closed, for the sample at `valid_time`."""

    sample_time: int
    issue_time: int
    valid_time: int
    outputs: tuple[OutputForecast, ...]
    inputs: tuple[InputUsed, ...]


class Volatility(NamedTuple):
    """Alpha after an update: (block, .025, .5, .975 quantile) as parallel tuples, and where its median stands (F_k).
    Empty where the estimator has no volatility."""

    blocks: tuple[str, ...]
    lower: tuple[float, ...]
    median: tuple[float, ...]
    upper: tuple[float, ...]
    cdf: tuple[float, ...]


CONSTANT = "constant"
"""The regime where the estimator has no volatility."""


class Gate(NamedTuple):
    """The learning gate g_k and the regime it follows from: low, transitional or high volatility, or constant."""

    value: float
    regime: str


class Score(NamedTuple):
    """The forecast that had been published for y_k, against y_k. Tuples run over outputs; `y` is NaN where missing."""

    y: tuple[float, ...]
    mean: tuple[float, ...]
    sd: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    residual: tuple[float, ...]
    level: float


class Disturbance(NamedTuple):
    """What the estimator knows of what nobody measures, at the levels of `Volatility`.

    `gain` is unmeasured heat [W] into the first measured node, NaN without a model of it, `probability_on` that there
    is any; `measurement_sd` is sigma_y [K] of every output.
    """

    gain: tuple[float, float, float]
    probability_on: float
    measurement_sd: tuple[tuple[float, float, float], ...]


class Update(NamedTuple):
    """What one sample brought. `score` is None where no forecast stood; `outcome` is an `estimator.types.Outcome`
    value, or "started" for the first sample of a segment."""

    time: int
    segment: int
    outcome: str
    y: tuple[float, ...]
    score: Score | None
    volatility: Volatility
    gate: Gate | None
    """None where the estimator has none."""
    effective_sample_size: float | None
    """None where the estimator has no particles."""
    resampled: bool
    floored: bool
    log_likelihood: float
    parameters: tuple[float, ...]
    forecast: Forecast
    step_seconds: float
    """Wall time of the step; not part of what must be reproducible."""
    disturbance: Disturbance | None = None
    """None for an estimator without a model of disturbances."""
    setpoint: float = math.nan
    """Of the sample, degC; NaN where nobody says."""

    @property
    def shown_gate(self) -> Gate:
        """The gate as everything that leaves the daemon or is stored states it: an estimator without one learns fully
        from what it assimilates."""
        if self.gate is not None:
            return self.gate
        return Gate(1.0 if self.outcome == Outcome.ASSIMILATED else 0.0, CONSTANT)

    @property
    def shown_sample_size(self) -> float:
        """The effective sample size as everything that leaves the daemon or is stored states it: NaN where there are
        no particles."""
        return math.nan if self.effective_sample_size is None else self.effective_sample_size
