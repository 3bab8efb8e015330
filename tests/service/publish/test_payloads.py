"""Payloads are strict JSON that gives back the very numbers that went in."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from support import schemas
from support.fake_zones import FakeZone, columns, doubted, make_update, output, running

from adapters.reading import Quality
from service.publish.payloads import (
    FanPayload,
    ForecastPayload,
    GatePayload,
    StatusPayload,
    VolatilityPayload,
    quality,
)
from service.records.fan import Fan
from service.records.record import document, document_of
from service.records.update import Gate, Update, Volatility


def written(one: object) -> dict:
    """A record as it leaves the daemon, read by a strict parser."""

    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(document(one, "htwg", "living"), parse_constant=refuse)


def test_a_forecast_says_everything_with_units_and_times() -> None:
    update = make_update(3, levels=(0.5, 0.95))
    told = written(ForecastPayload.of(update))
    assert {key: told[key] for key in ("schema", "site", "zone", "output", "unit", "regime", "quality")} == {
        "schema": 1,
        "site": "htwg",
        "zone": "living",
        "output": "T_air",
        "unit": "degC",
        "regime": "low",
        "quality": "good",
    }
    assert told["sample_time"] == "2025-05-03T00:15:00Z"
    assert told["issue_time"] == told["valid_time"] == "2025-05-03T00:20:00Z"
    assert told["period_s"] == 300.0
    assert [interval["level"] for interval in told["intervals"]] == [0.5, 0.95]
    assert told["outputs"][0]["intervals"] == told["intervals"]
    assert told["volatility"]["levels"] == [0.025, 0.5, 0.975]
    assert told["volatility"]["blocks"][0]["cdf"] == told["volatility"]["cdf"] == 0.4
    assert told["inputs"][2] == {
        "channel": "u_heat",
        "value": 5.5,
        "unit": "W",
        "age_s": 0.0,
        "quality": "good",
        "held": False,
    }
    assert "fan" not in told


@pytest.mark.parametrize("value", [0.1 + 0.2, 1 / 3, 21.000000000000004, 5e-324, 1.7976931348623157e308, -0.0])
def test_numbers_survive_to_the_last_digit(value: float) -> None:
    update = make_update(0)
    changed = update._replace(gate=Gate(value, "low"))
    told = written(GatePayload.of(changed))
    assert math.copysign(1.0, told["gate"]) == math.copysign(1.0, value)
    assert told["gate"] == value


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_null(value: float) -> None:
    update = make_update(0)
    volatility = Volatility(("process",), (value,), (value,), (value,), (value,))
    changed = update._replace(log_likelihood=value, volatility=volatility, effective_sample_size=value)
    assert written(GatePayload.of(changed))["log_likelihood"] is None
    told = written(ForecastPayload.of(changed))
    assert told["n_eff"] is None
    assert told["volatility"]["median"] is None


def test_a_status_lists_what_the_model_does_not_know() -> None:
    zone = doubted("living")
    told = written(StatusPayload.of(zone.status(), zone.latest()))
    assert told["findings"] == [
        {"finding": one.finding, "subject": one.subject, "sentence": one.sentence} for one in zone.diagnosis.findings
    ]


def test_every_payload_has_the_fields_of_its_schema() -> None:
    update = make_update(5)
    zone = running("living")
    for told in (
        ForecastPayload.of(update),
        VolatilityPayload.of(update),
        GatePayload.of(update),
        StatusPayload.of(zone.status(), update),
    ):
        schemas.check(written(told), document_of(type(told)))


def test_several_outputs_and_blocks_are_all_there() -> None:
    update = make_update(0)
    forecast = update.forecast._replace(outputs=(output("T_air", 21.0, 0.1, (0.9,)), output("T_wi", 19.0, 0.2, (0.9,))))
    volatility = Volatility(("air", "walls"), (0.5, 0.6), (1.0, 1.5), (2.0, 3.0), (0.3, 0.9))
    payload = ForecastPayload.of(update._replace(forecast=forecast, volatility=volatility))
    assert (payload.output, payload.mean) == ("T_air", 21.0)
    assert [(o.output, o.mean) for o in payload.outputs] == [("T_air", 21.0), ("T_wi", 19.0)]
    assert [(b.block, b.median) for b in payload.volatility.blocks] == [("air", 1.0), ("walls", 1.5)]
    assert payload.volatility.block == "air"


def test_levels_pick_published_intervals_in_the_order_asked() -> None:
    update = make_update(0, levels=(0.5, 0.9, 0.95))
    payload = ForecastPayload.of(update, (0.95, 0.5))
    published = {interval.level: interval.lower for interval in update.forecast.outputs[0].intervals}
    assert [(i.level, i.lower) for i in payload.intervals] == [(0.95, published[0.95]), (0.5, published[0.5])]


def with_input(update: Update, **changes: object) -> Update:
    first, *others = update.forecast.inputs
    return update._replace(forecast=update.forecast._replace(inputs=(replace(first, **changes), *others)))


@pytest.mark.parametrize(
    ("update", "expected"),
    [
        (make_update(0), Quality.GOOD),
        (make_update(0)._replace(outcome="started"), Quality.GOOD),
        (make_update(0)._replace(outcome="missing"), Quality.UNCERTAIN),
        (make_update(0)._replace(outcome="vanished"), Quality.BAD),
        (with_input(make_update(0), quality=Quality.UNCERTAIN), Quality.UNCERTAIN),
        (with_input(make_update(0), held=True, age=300.0), Quality.UNCERTAIN),
        (with_input(make_update(0)._replace(outcome="missing"), quality=Quality.BAD), Quality.BAD),
    ],
)
def test_quality_is_the_worst_of_inputs_and_outcome(update: Update, expected: Quality) -> None:
    assert quality(update) is expected


def test_a_fan_carries_the_standing_forecast_first() -> None:
    update = make_update(0)
    standing = update.forecast
    steps = columns([output("T_air", 21.0 + k, 0.1, (0.8,)) for k in range(4)])
    payload = FanPayload.of_steps(Fan(update, (0.8,), (steps,), ()), ["u_heat"])
    assert (payload.horizon_s, payload.planned, len(payload.fan)) == (900.0, ("u_heat",), 4)
    assert payload.fan[0].outputs == payload.outputs
    assert payload.fan[-1].valid_time == standing.valid_time + 900
    schemas.check(written(payload), document_of(FanPayload))


def test_status_counts_ages_on_the_zones_clock() -> None:
    zone = running("living")
    zone.faults = {"non_numeric": 2}
    payload = StatusPayload.of(zone.status(), zone.latest())
    assert payload.age_s == 360.0
    assert payload.faults == {"non_numeric": 2}
    assert payload.outcome == "assimilated"
    assert {channel.channel: channel.age_s for channel in payload.channels}["T_air"] == 240.0


def test_status_without_a_clock_counts_on_the_wall_clock() -> None:
    zone = running("living")
    payload = StatusPayload.of(zone.status()._replace(now=None), None)
    assert payload.age_s == pytest.approx(datetime.now(UTC).timestamp() - zone.updates[-1].time, abs=60)
    assert payload.outcome is None


def test_status_of_a_zone_without_samples() -> None:
    told = written(StatusPayload.of(FakeZone("z", state="waiting", reason="cold").status(), None))
    assert (told["last_sample_time"], told["age_s"], told["reason"]) == (None, None, "cold")
    assert told["channels"][0] == {"channel": "T_air", "last_good": None, "age_s": None, "stale": True}
