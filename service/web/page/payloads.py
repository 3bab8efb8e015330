"""What the page is sent."""

from typing import Literal

from service.records.record import Number, Time, constant, record, shown

Numbers = tuple[Number, ...]


@record
class ExpectedPayload:
    """The temperature some time ahead, inputs foreseen."""

    lead_s: float = shown("after expected_from, s; shorter for zones with periods of less than 30 s")
    mean: Number = shown("degC")
    lower: Number = shown("degC, bound of the 95 % interval")
    upper: Number = shown("degC, bound of the 95 % interval")


@record
class SparkPayload:
    """The measured temperature of the last day in few points."""

    start: Time
    step_s: float
    values: Numbers = shown("degC, means of one step each; null: not measured")


@record
class FindingName:
    """A finding without its sentence, which the zone's status has."""

    finding: str
    subject: str


@record
class OverviewRow:
    """One zone at a glance."""

    id: str
    state: str = shown("waiting, running, stalled or failed")
    reason: str
    period_s: float
    sample_time: Time | None = shown("start of the last interval that was used")
    temperature: Number = shown("the first measured temperature of that sample, degC")
    setpoint: Number = shown("what the room was meant to have then, degC; null where nobody told")
    risen: bool = shown("the set-point rose in the last 6 h: the room may still be warming up; needs the read history")
    disturbed: bool = shown("the volatility is high: something acts on the zone that nobody measures")
    expected: tuple[ExpectedPayload, ...] = shown(
        "1 h and 6 h ahead, from the newest look ahead; empty before the first"
    )
    expected_from: Time | None = shown("valid_time of the forecast behind `expected`")
    trust: str | None = shown(
        "how far the forecasts 6 h ahead can be relied on: learning, trusted, doubtful or untrusted; null "
        "before the first sample"
    )
    trust_reason: str = shown("one sentence, also where simpler forecasts are better; empty while nothing is wrong")
    good_up_to_s: float = shown("as in the trust of the zone")
    findings: tuple[FindingName, ...]
    too_cold_h: Number = shown("h of the last day for which it was too cold for its set-point; null until it was read")
    too_warm_h: Number = shown("the same for which it was too warm for the highest set-point of 7 days")
    often: Literal["", "cold", "warm"] = shown(
        "what it was, too cold or too warm, for more than 5 % of the last 7 days, as in the answers about the room"
    )
    often_h: Number = shown("the hours of the last 7 days in which it was what `often` says; null until it was read")
    to_do: bool = shown("whether the room's `to_do` is not empty; before the days were read, without what they tell")
    spark: SparkPayload | None = shown("null until it has been read, and in events that bring nothing new of it")


@record
class OverviewPayload:
    """Every zone at a glance."""

    time_zone: str | None = shown("IANA name of the site's time zone; null: not configured")
    unit: Literal["degC"] = constant("degC")
    zones: tuple[OverviewRow, ...]


@record
class OverviewChange:
    """The zones that have news, in an event of the stream."""

    zones: tuple[OverviewRow, ...]
    removed: tuple[str, ...] = shown("ids of zones that are no longer there")


@record
class SeriesInput:
    """An input channel in the buckets of a series."""

    channel: str
    unit: str
    values: Numbers = shown("means, in unit")


@record
class SeriesGain:
    """Unmeasured heat in the buckets of a series, W: means of its quantiles."""

    unit: Literal["W"] = constant("W")
    lower: Numbers = shown(".025 quantile, W")
    median: Numbers = shown("W")
    upper: Numbers = shown(".975 quantile, W")


@record
class SeriesPayload:
    """History in buckets, for a chart. All lists run parallel to `times`; buckets without a sample are left out."""

    output: str
    unit: Literal["degC"] = constant("degC")
    period_s: float
    bucket_s: float = shown("length of a bucket, a whole number of periods")
    start: Time
    end: Time
    times: tuple[Time, ...] = shown("when each bucket begins")
    y: Numbers = shown("mean of the measurements, degC")
    y_low: Numbers = shown("lowest measurement, degC")
    y_high: Numbers = shown("highest measurement, degC")
    mean: Numbers = shown("mean of the forecasts that stood before the measurements, degC")
    lower: Numbers = shown("lowest bound of their intervals, degC")
    upper: Numbers = shown("highest bound of their intervals, degC")
    alpha: Numbers = shown("mean of the volatility's medians")
    gate: Numbers = shown("mean of the learning gate")
    setpoint: Numbers | None = shown("mean of the set-point, degC; null where none was told")
    gain: SeriesGain | None = shown("null where no estimator knew of any")
    inputs: tuple[SeriesInput, ...]
