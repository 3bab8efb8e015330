"""Findings about a thermostat that is not obeyed, and what is remembered of it between samples."""

import numpy as np
import pytest

from estimator.diagnosis.thermostat import disobedience
from estimator.network.presets import network
from estimator.thermostat.thermostat import no_thermostat, pack, unpack, with_sample

HOUSE = network("tite")
PERIOD = 600
DAY = 144


def told(samples, seed=3):
    """The thermostat after samples of (set-point, temperature, heat)."""
    thermostat = no_thermostat(2)
    for k, (setpoint, temperature, heat) in enumerate(samples):
        thermostat = with_sample(
            thermostat,
            HOUSE,
            k * PERIOD,
            PERIOD,
            setpoint=setpoint,
            temperature=temperature,
            inputs=np.array([5.0, heat]),
            seed=seed,
        )
    return thermostat


def obedient(days):
    """A room that wanders about its set-point of 20 degC, and its heater of 2 kW with a hysteresis of 1 K."""
    on = False
    for k in range(days * DAY):
        temperature = 20.0 + np.sin(k / 5.0)
        on = temperature < (20.5 if on else 19.5)
        yield 20.0, temperature, 2000.0 * on


BEFORE = list(obedient(6))
OFF = [(20.0, 18.0 - 0.01 * k, 0.0) for k in range(40)]
STUCK = [(17.0, 21.0 + 0.01 * k, 2000.0) for k in range(40)]


def found(more):
    return disobedience(HOUSE, told(BEFORE + more))


def test_an_obedient_heater_is_no_finding():
    assert found([]) == []


@pytest.mark.parametrize(
    ("more", "name", "words"),
    [
        (OFF, "calls-without-heat", ("called for heat for 6 of the last 6 h", "boiler")),
        (STUCK, "heat-without-call", ("gave 2000 W", "valve that does not close")),
    ],
)
def test_a_thermostat_that_is_not_obeyed_is_a_finding_with_its_remedy(more, name, words):
    (finding,) = found(more)
    assert (finding.finding, finding.subject) == (name, "u_heat")
    assert all(each in finding.sentence for each in words)


def test_a_cooler_that_gives_nothing_has_no_boiler():
    (finding,) = disobedience(
        HOUSE, told([(setpoint, 40.0 - temperature, -heat) for setpoint, temperature, heat in BEFORE + OFF])
    )
    assert "called for cold for 6 of the last 6 h" in finding.sentence
    assert "check whether cooling unit or pump are off" in finding.sentence


def test_a_boiler_that_was_off_for_an_hour_is_no_finding():
    assert found(OFF[:6]) == []


def test_a_day_without_the_boiler_does_not_change_the_law():
    before, after = told(BEFORE).laws, told(BEFORE + OFF * 4).laws
    assert after.numbers == pytest.approx(before.numbers, abs=0.05)


def test_the_laws_are_fitted_once_a_day_and_zones_take_turns():
    samples = BEFORE[: 4 * DAY]
    fitted = [len(told(samples[:count], seed=7200).laws.column) for count in range(DAY - 2, 2 * DAY)]
    assert sum(a != b for a, b in zip(fitted[1:], fitted[:-1], strict=True)) <= 1
    assert len(told(samples[: DAY // 2 + 60], seed=43200).laws.column) == 1
    assert len(told(samples[: DAY // 2 + 60], seed=0).laws.column) == 0


def test_a_state_from_before_there_was_a_thermostat_is_resumed_without_one():
    assert not len(unpack({}, 2).memory.times)
    assert not len(unpack(pack(told(BEFORE)), 3).memory.times), "another number of inputs"
