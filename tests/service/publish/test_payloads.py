"""Payloads are strict JSON that gives back the very numbers that went in."""

import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest
from support.fake_zones import make_update, running
from support.tables import tabled

from adapters.reading import Quality
from estimator.diagnosis.finding import AT_BOUND, METER_DEAD, Diagnosis, Finding
from service.publish.payloads import ForecastPayload, GatePayload, StatusPayload, quality, vouched
from service.records.record import document
from service.records.update import Gate, Volatility


def written(one: object) -> dict:
    """A record as it leaves the daemon, read by a strict parser."""

    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(document(one, "htwg", "living"), parse_constant=refuse)


@pytest.mark.parametrize("value", [0.1 + 0.2, 21.000000000000004, 5e-324, 1.7976931348623157e308, -0.0])
def test_numbers_survive_to_the_last_digit(value: float) -> None:
    told = written(GatePayload.of(make_update(0)._replace(gate=Gate(value, "low"))))["gate"]
    assert (told, math.copysign(1.0, told)) == (value, math.copysign(1.0, value))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_null(value: float) -> None:
    volatility = Volatility(("process",), (value,), (value,), (value,), (value,))
    changed = make_update(0)._replace(log_likelihood=value, volatility=volatility, effective_sample_size=value)
    assert written(GatePayload.of(changed))["log_likelihood"] is None
    told = written(ForecastPayload.of(changed))
    assert (told["n_eff"], told["volatility"]["median"]) == (None, None)


@tabled
def test_quality_is_the_worst_of_inputs_and_outcome(outcome: str, input: dict[str, Any], expected: str) -> None:
    update = make_update(0)._replace(outcome=outcome)
    first, *others = update.forecast.inputs
    first = replace(first, **input | {"quality": Quality(input.get("quality", first.quality))})
    assert quality(update._replace(forecast=update.forecast._replace(inputs=(first, *others)))) == expected


def test_a_forecast_names_what_is_suspected_of_its_telemetry_beside_its_quality() -> None:
    lie, other = (Finding(name, "u_heat", "a sentence") for name in (METER_DEAD, AT_BOUND))
    update, status = make_update(0), running("living").now().status
    for findings, expected in (((), []), ((other,), []), ((lie, other), [METER_DEAD])):
        told = written(vouched(ForecastPayload.of(update), status._replace(diagnosis=Diagnosis(findings))))
        assert (told["quality"], told["suspected"]) == ("good", expected)


def test_status_without_a_clock_counts_on_the_wall_clock() -> None:
    zone = running("living")
    payload = StatusPayload.of(zone.now().status._replace(now=None), None)
    assert payload.age_s == pytest.approx(datetime.now(UTC).timestamp() - zone.updates[-1].time, abs=60)
    assert payload.outcome is None
