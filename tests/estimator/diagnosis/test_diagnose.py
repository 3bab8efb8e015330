"""Findings about real estimators: at the first heating, after days of data, and in a bank."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.small_building import PERIOD, building, record
from support.tables import tabled

from estimator.diagnosis.diagnose import EVERY, diagnose, due
from estimator.diagnosis.finding import AT_BOUND, IMPLAUSIBLE, MEMBERS_DISAGREE, MISSES_SOMETHING, NARROWER_BOUNDS
from estimator.diagnosis.members import carried, disagreement, variants
from estimator.diagnosis.record import no_record, with_sample
from estimator.diagnosis.telemetry.recent import nothing_recent
from estimator.network.presets import automatic, network
from estimator.registry import build
from estimator.thermostat.thermostat import no_thermostat

KINDS = {"rbpf": {"particles": 500}, "ekf": {}, "ukf": {}, "mkf": {}, "arx": {}}


def run(estimator, data, steps):
    state = estimator.start(1, data.outputs[0], data.inputs[0])
    seen = no_record(data.inputs.shape[1])
    for k in range(steps):
        seen = with_sample(seen, k * PERIOD, PERIOD, float(data.outputs[k, 0]), data.inputs[k])
        state = estimator.predict(estimator.update(state, data.outputs[k]).state, data.inputs[k])
    return state, seen, data.inputs[steps - 1]


def diagnosed(estimator, state, seen, inputs, **options):
    """Of a zone without a thermostat, and without a fortnight."""
    options |= {"thermostat": no_thermostat(len(inputs)), "recent": nothing_recent(len(inputs), 600)}
    return diagnose(estimator, state, seen, inputs, driving=lambda times, rows: rows, **options)


def names(diagnosis):
    return {(finding.finding, finding.subject) for finding in diagnosis.findings}


@pytest.mark.parametrize("kind", KINDS)
def test_a_well_known_building_brings_no_finding_and_nothing_is_changed(kind):
    estimator = build(kind, building(), PERIOD, KINDS[kind])
    state, seen, inputs = run(estimator, record(5 * 144, seed=4), 5 * 144)
    before = {name: np.array(value) for name, value in estimator.pack(state).items()}
    found = diagnosed(estimator, state, seen, inputs)
    assert names(found) <= {("parameter-not-identified", p.name) for p in building().parameters}
    assert diagnosed(estimator, state, seen, inputs) == found
    for name, value in estimator.pack(state).items():
        assert np.array_equal(before[name], value, equal_nan=True)


@pytest.mark.parametrize(("name", "remedy"), [("titethria", "give the floor area"), ("room-1", "narrow the bounds")])
def test_the_first_heating_under_wide_bounds_is_implausible(name, remedy):
    estimator = build("rbpf", replace(network("titethria"), name=name), 3600.0, {"particles": 500})
    data = record(30, seed=3)
    inputs = data.inputs.copy()
    inputs[:, 1] = 0.0
    inputs[-1, 1] = 3000.0
    state, seen, held = run(estimator, data._replace(inputs=inputs), 30)
    (finding,) = diagnosed(estimator, state, seen, held).findings
    assert (finding.finding, finding.subject) == (IMPLAUSIBLE, "zone")
    assert "no room" in finding.sentence
    assert remedy in finding.sentence


@pytest.mark.parametrize(("days", "narrow", "proposed"), [(6, False, False), (8, False, True), (8, True, False)])
def test_bounds_are_proposed_after_a_week_and_only_from_a_model_that_fits(days, narrow, proposed):
    net = building().with_parameter("C_i", lower=1e4, upper=1e9)
    if narrow:
        net = net.with_parameter("g_e_out", lower=20.0, upper=60.0, nominal=None)
    estimator = build("ekf", net, PERIOD, {})
    state, seen, inputs = run(estimator, record(days * 144, seed=5), days * 144)
    found = diagnosed(estimator, state, seen, inputs, proposes_bounds=True)
    assert ((NARROWER_BOUNDS, "zone") in names(found)) is proposed
    assert not narrow or (AT_BOUND, "g_e_out") in names(found)
    assert NARROWER_BOUNDS not in {each.finding for each in diagnosed(estimator, state, seen, inputs).findings}


def test_before_the_third_day_nothing_is_said_about_parameters():
    estimator = build("ekf", network("titethria"), PERIOD, {})
    state, seen, inputs = run(estimator, record(2 * 144, seed=5), 2 * 144)
    assert names(diagnosed(estimator, state, seen, inputs)) <= {(IMPLAUSIBLE, "zone")}


MEMBERS = {
    "one": {"estimator": "ekf", "measurement_sd": 0.02},
    "other": {"estimator": "ekf"},
    "ground": {"estimator": "ekf", "network": "ground"},
    "blind": {"estimator": "arx"},
}


def bank(**changes):
    return build("bank", building(), PERIOD, {"members": MEMBERS} | changes)


def test_members_that_are_sure_of_different_values_disagree():
    estimator = bank(members={name: MEMBERS[name] for name in ("one", "other")})
    state, _, _ = run(estimator, record(144, seed=4), 144)
    calm = disagreement(estimator, state, (0.025, 0.5, 0.975))
    first, second = state.members
    mean = second.mean.copy()
    mean[2] += 0.5
    sure = (first._replace(root=0.01 * first.root), second._replace(mean=mean, root=0.01 * second.root))
    found = disagreement(estimator, state._replace(members=sure), (0.025, 0.5, 0.975))
    assert not calm
    told = {finding.subject: finding.sentence for finding in found if finding.finding == MEMBERS_DISAGREE}
    assert re.fullmatch(
        r"two ways of looking at this room give different values of C_i, \S+ and \S+ J/K; treat it as \S+ \+- \S+ J/K",
        told["C_i"],
    )


def test_the_weights_of_variants_add_up_and_black_boxes_are_told_apart():
    estimator = bank()
    state, _, _ = run(estimator, record(144, seed=4), 144)
    found = variants(estimator, state)
    assert [each.variant for each in found] == ["own", "ground"]
    assert sum(each.weight for each in found) == pytest.approx(1.0)
    excess = np.zeros_like(state.costs.excess)
    excess[:3] = 1000.0
    blind = state._replace(costs=state.costs._replace(excess=excess))
    assert MISSES_SOMETHING in {finding.finding for finding in carried(estimator, blind)}
    excess[2:] = excess[2:][::-1]
    ground = state._replace(costs=state.costs._replace(excess=excess))
    assert ("network-variant", "ground") in {
        (finding.finding, finding.subject) for finding in carried(estimator, ground)
    }


def test_black_boxes_that_begin_with_most_of_the_weight_are_no_finding():
    estimator = bank(members={**MEMBERS, "blind": {"estimator": "arx", "prior": 100.0}})
    state = estimator.start(1, np.array([20.0]), np.zeros(len(estimator.network.inputs)))
    assert estimator.member_weights(state)["blind"][estimator.compared] > 0.9
    assert carried(estimator, state) == []


@tabled
def test_only_channels_that_are_not_there_are_a_remedy(channels, remedy):
    estimator = build("bank", automatic(channels), PERIOD, {"members": {"blind": {"estimator": "arx"}}})
    state = estimator.start(1, np.array([20.0]), np.zeros(len(estimator.network.inputs)))
    (finding,) = carried(estimator, state)
    assert finding.sentence.endswith(remedy)


def test_a_diagnosis_is_due_every_few_hours_and_at_the_first_heating():
    net, quiet = building(), no_record(2)
    times = [time for time in range(0, 86400, 600) if due(net, quiet, quiet, time, 600, 7)]
    assert len(times) == 86400 // EVERY
    other = [time for time in range(0, 86400, 600) if due(net, quiet, quiet, time, 600, 7 + 3600)]
    assert set(times).isdisjoint(other), "zones of a site take turns"
    seldom = [time for time in range(0, 7 * 86400, 600) if due(net, quiet, quiet, time, 600, 7, 7 * EVERY)]
    assert len(seldom) == 4
    heated = quiet._replace(largest=np.array([0.0, 2000.0]))
    assert due(net, quiet, heated, 600, 600, 0)
    assert not due(net, heated, heated._replace(largest=np.array([0.0, 2200.0])), 600, 600, 0)
