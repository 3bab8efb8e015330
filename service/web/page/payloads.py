"""What the page is sent."""

from __future__ import annotations

from typing import Literal

from pydantic import AwareDatetime, Field

from service.publish.payloads import Envelope, Number, Payload


class ExpectedPayload(Payload):
    """The temperature some time ahead, inputs held."""

    lead_s: float = Field(description="after expected_from, s; shorter for zones with periods of less than 30 s")
    mean: Number = Field(description="degC")
    lower: Number = Field(description="degC, bound of the 95 % interval")
    upper: Number = Field(description="degC, bound of the 95 % interval")


class SparkPayload(Payload):
    """The measured temperature of the last day in few points."""

    start: AwareDatetime
    step_s: float
    values: list[Number] = Field(description="degC, means of one step each; null: not measured")


class FindingName(Payload):
    """A finding without its sentence, which the zone's status has."""

    finding: str
    subject: str


class OverviewRow(Payload):
    """One zone at a glance."""

    id: str
    state: str = Field(description="waiting, running, stalled or failed")
    reason: str
    period_s: float
    sample_time: AwareDatetime | None = Field(description="start of the last interval that was used")
    temperature: Number = Field(description="the first measured temperature of that sample, degC")
    disturbed: bool = Field(description="the volatility is high: something acts on the zone that nobody measures")
    expected: list[ExpectedPayload] = Field(
        description="1 h and 6 h ahead; empty until it has been computed, which happens while somebody streams"
    )
    expected_from: AwareDatetime | None = Field(description="valid_time of the forecast behind `expected`")
    trust: str | None = Field(
        description="how far the forecasts 6 h ahead can be relied on: learning, trusted, doubtful or untrusted; null "
        "before the first sample"
    )
    trust_reason: str = Field(description="one sentence; empty while trusted")
    findings: list[FindingName]
    spark: SparkPayload | None = Field(
        default=None, description="null until it has been read, and in events that bring nothing new of it"
    )


class OverviewPayload(Payload):
    """Every zone at a glance."""

    schema_version: Literal[1] = Field(default=1, alias="schema")
    site: str
    time_zone: str | None = Field(description="IANA name of the site's time zone; null: not configured")
    unit: Literal["degC"] = "degC"
    zones: list[OverviewRow]


class OverviewChange(Payload):
    """The zones that have news, in an event of the stream."""

    schema_version: Literal[1] = Field(default=1, alias="schema")
    site: str
    zones: list[OverviewRow]
    removed: list[str] = Field(description="ids of zones that are no longer there")


class SeriesInput(Payload):
    """An input channel in the buckets of a series."""

    channel: str
    unit: str
    values: list[Number] = Field(description="means, in unit")


class SeriesGain(Payload):
    """Unmeasured heat in the buckets of a series, W: means of its quantiles."""

    unit: Literal["W"] = "W"
    lower: list[Number] = Field(description=".025 quantile, W")
    median: list[Number] = Field(description="W")
    upper: list[Number] = Field(description=".975 quantile, W")


class SeriesPayload(Envelope):
    """History in buckets, for a chart. All lists run parallel to `times`; buckets without a sample are left out."""

    output: str
    unit: Literal["degC"] = "degC"
    period_s: float
    bucket_s: float = Field(description="length of a bucket, a whole number of periods")
    start: AwareDatetime
    end: AwareDatetime
    times: list[AwareDatetime] = Field(description="when each bucket begins")
    y: list[Number] = Field(description="mean of the measurements, degC")
    y_low: list[Number] = Field(description="lowest measurement, degC")
    y_high: list[Number] = Field(description="highest measurement, degC")
    mean: list[Number] = Field(description="mean of the forecasts that stood before the measurements, degC")
    lower: list[Number] = Field(description="lowest bound of their intervals, degC")
    upper: list[Number] = Field(description="highest bound of their intervals, degC")
    alpha: list[Number] = Field(description="mean of the volatility's medians")
    gate: list[Number] = Field(description="mean of the learning gate")
    setpoint: list[Number] | None = Field(description="mean of the set-point, degC; null where none was told")
    gain: SeriesGain | None = Field(description="null where no estimator knew of any")
    inputs: list[SeriesInput]
