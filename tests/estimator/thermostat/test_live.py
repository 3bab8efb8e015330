"""Live forecasts of a thermostat's house: under planned set-points, and where nobody plans."""

from functools import cache

import numpy as np
import pytest
from support.forecasts import unfolded
from support.thermostat_house import recorded

from estimator.foresight import foreseen, no_day, with_inputs
from estimator.network.presets import network
from estimator.registry import build
from estimator.thermostat.answers import JOULES, energy
from estimator.thermostat.futures import GUESSES, ToCome, guesses
from estimator.thermostat.live import FUTURES, PLANNED, Ahead, LiveForecasts, Now
from estimator.thermostat.memory import no_memory, remembered
from estimator.thermostat.thermostat import no_thermostat, with_sample
from estimator.verification.hindsight import issued_at

HOUSE = network("tite")
PERIOD = 1800
DAILY = 48
SEED = 5
TAILS = np.array([0.025, 0.975])


def ahead(rows, strays=(0.0, 0.0)):
    return Ahead(rows, rows, np.array(strays))


class Zone:
    """A zone's loop as far as its thermostat needs it."""

    def __init__(self, name="ekf", options=None):
        self.estimator = build(name, HOUSE, float(PERIOD), options or {})
        self.forecasts = LiveForecasts(self.estimator, SEED)
        self.thermostat, self.live = no_thermostat(2), self.forecasts.begin()
        self.day = no_day(2, PERIOD)
        self.state, self.issued, self.before, self.time = None, {}, np.full(2, np.nan), 0

    def step(self, k, outputs, inputs, setpoint):
        if self.state is None:
            self.state = self.estimator.start(SEED, outputs, inputs)
        else:
            self.state = self.estimator.update(self.state, outputs).state
            self.live = self.forecasts.learned(self.live, self.thermostat, outputs)
        self.thermostat = with_sample(
            self.thermostat,
            HOUSE,
            k * PERIOD,
            PERIOD,
            setpoint=setpoint,
            temperature=outputs[0],
            inputs=inputs,
            seed=SEED,
        )
        self.day = with_inputs(self.day, k * PERIOD, inputs)
        self.state, self.before, self.time = self.estimator.predict(self.state, inputs), inputs, (k + 1) * PERIOD
        issues = issued_at(self.time, PERIOD, SEED)
        self.live = self.forecasts.advanced(self.live, self.now(), self.coming if issues else None)
        if issued := self.forecasts.issued(self.live):
            self.issued[k] = issued

    def coming(self, steps):
        return ahead(foreseen(HOUSE, self.day, self.before, self.time + PERIOD * np.arange(float(steps))).rows)

    def now(self):
        return Now(self.state, self.thermostat, self.before, self.time)

    def run(self, data, begin, end):
        for k in range(begin, end):
            self.step(k, *(rows[k] for rows in data))
        return self


@cache
def lived():
    """A zone that has lived in its house for some days, and what follows."""
    data, days = recorded(16, PERIOD), 14
    return Zone().run(data, 0, days * DAILY), data, days * DAILY


def missed(fan, outputs):
    """Root mean square of how far a fan's mean is off."""
    means = (fan.outputs.means[:-1, 0] * fan.outputs.weights[:-1]).sum(axis=1)
    return np.sqrt(np.mean((means - outputs) ** 2))


def after(data, begin, steps=DAILY):
    outputs, inputs, wanted = (rows[begin : begin + steps] for rows in data)
    return outputs[:, 0], inputs, wanted


def test_under_a_plan_of_set_points_the_forecast_is_right_to_tenths_of_a_kelvin():
    zone, data, now = lived()
    outputs, rows, wanted = after(data, now)
    blind = rows.copy()
    blind[:, 1] = zone.before[1]
    fan = zone.forecasts.planned(zone.live, zone.now(), wanted, ahead(blind))
    assert missed(fan, outputs) < 0.3
    heat = (fan.heat.values[:, :, 0].T * fan.heat.weights).sum(axis=1)
    assert abs(heat.sum() / rows[:, 1].sum() - 1.0) < 0.1
    assert fan.chances.shape[1] == 0


def test_energy_is_as_uncertain_as_the_weather_that_is_foreseen():
    zone, data, now = lived()
    _, rows, wanted = after(data, now)

    def told(strays):
        fan = zone.forecasts.planned(zone.live, zone.now(), wanted, ahead(rows, strays))
        weights = fan.heat.weights.mean(axis=0)
        sums = fan.heat.values[:, :, 0].sum(axis=1)
        mean = float(weights @ sums)
        return mean, float(np.sqrt(weights @ (sums - mean) ** 2))

    (mean, sd), (moved, wide), (_, wider) = (told((outdoors, 0.0)) for outdoors in (0.0, 4.0, 8.0))
    assert moved == pytest.approx(mean, rel=0.03)
    # What is due to the weather adds up with the rest as independent errors do, and is in proportion to its own.
    assert wide > 1.1 * sd
    assert np.sqrt(wider**2 - sd**2) == pytest.approx(2.0 * np.sqrt(wide**2 - sd**2), rel=0.2)


def test_the_interval_of_an_energy_is_as_wide_as_energies_proved_to_stray():
    outputs, rows, wanted = recorded(24, PERIOD)
    # A heater whose strength changes from day to day, which no future knows of.
    strength = np.repeat(np.random.default_rng(7).uniform(0.6, 1.4, 24), DAILY)
    told = rows * np.column_stack([np.ones(len(rows)), strength])
    zone, covered, scales = Zone().run((outputs, told, wanted), 0, 14 * DAILY), [], []
    for k in range(14 * DAILY, 23 * DAILY, 6):
        zone.run((outputs, told, wanted), k, k + 6)
        came, plan = told[k + 6 : k + 6 + DAILY], wanted[k + 6 : k + 6 + DAILY]
        fan = zone.forecasts.planned(zone.live, zone.now(), plan, ahead(came))
        scales.append(fan.energy_scales[-1])
        lower, upper = energy(fan.heat, PERIOD).stretched(fan.energy_scales[-1:]).quantiles(TAILS)[0]
        covered.append(lower <= came[:, 1].sum() * PERIOD / JOULES <= upper)
    assert min(scales) > 1.5
    assert np.mean(covered) > 0.8


def test_where_nobody_plans_a_regular_schedule_is_found_and_the_interval_is_honest():
    zone, data, now = lived()
    outputs, rows, _ = after(data, now)
    blind = rows.copy()
    blind[:, 1] = zone.before[1]
    fan = zone.forecasts.unplanned(zone.live, zone.now(), ahead(blind))
    held = unfolded(zone.estimator, zone.state, blind)
    assert missed(fan, outputs) < 0.4
    assert np.sqrt(np.mean([(held[k].mean()[0] - outputs[k]) ** 2 for k in range(DAILY)])) > 1.5
    chances = dict(zip(FUTURES, fan.chances[-1], strict=True))
    assert chances["as-yesterday"] + chances["as-usual"] + chances["as-last-week"] > 0.8
    assert fan.chances.sum(axis=1) == pytest.approx(np.ones(DAILY))
    assert fan.heat.weights.sum(axis=1) == pytest.approx(np.ones(DAILY))


def test_sampled_futures_stand_for_the_forecast():
    zone, data, now = lived()
    _, rows, wanted = after(data, now)
    fan = zone.forecasts.planned(zone.live, zone.now(), wanted, ahead(rows))
    paths = fan.paths(40)
    assert paths.shape == (40, DAILY + 1, 1)
    means = (fan.outputs.means[:, 0] * fan.outputs.weights).sum(axis=1)
    assert np.abs(paths[:, :, 0].mean(axis=0) - means).max() < 0.15


def test_the_likely_set_points_are_those_of_the_guess_that_proved_best():
    zone, data, now = lived()
    likely = zone.forecasts.likely(zone.live, zone.thermostat, zone.time + PERIOD * np.arange(float(DAILY)))
    assert np.mean(likely == after(data, now)[2]) > 0.9


def covered(forecast, value):
    lower, upper = forecast.quantiles(TAILS, 0)
    return lower <= value <= upper


def test_where_nobody_plans_the_interval_covers_as_it_claims():
    zone, (outputs, *_), now = lived()
    told = [(k + DAILY, issued[-1]) for k, issued in zone.issued.items() if now - 8 * DAILY < k]
    assert len(told) > 150
    assert 0.9 <= np.mean([covered(forecast, outputs[k, 0]) for k, forecast in told]) <= 0.99


def test_under_a_plan_the_interval_covers_as_it_claims():
    data, begin, inside = recorded(16, PERIOD), 9 * DAILY, []
    zone = Zone().run(data, 0, begin)
    for k in range(begin, begin + 4 * DAILY):
        outputs, _, wanted = after(data, k)
        fan = zone.forecasts.planned(zone.live, zone.now(), wanted, zone.coming(DAILY))
        inside.append(covered(fan.outputs.at(DAILY - 1), outputs[-1]))
        zone.run(data, k, k + 1)
    assert 0.9 <= np.mean(inside) <= 0.99


def test_before_a_law_is_known_the_heat_is_held_or_as_the_day_before():
    zone = Zone().run(recorded(1, PERIOD), 0, 10)
    rows = np.tile(zone.before, (DAILY, 1))
    assert zone.forecasts.planned(zone.live, zone.now(), rows[:, 0], ahead(rows)) is None
    assert zone.forecasts.unplanned(zone.live, zone.now(), ahead(rows)).chances[:, : len(GUESSES)].max() == 0.0


def test_a_black_box_has_no_answer_to_a_plan_of_set_points():
    zone = Zone("arx").run(recorded(3, PERIOD), 0, 3 * DAILY)
    assert len(zone.thermostat.laws.column) == 1
    rows = np.tile(zone.before, (DAILY, 1))
    assert zone.forecasts.planned(zone.live, zone.now(), np.full(DAILY, 20.0), ahead(rows)) is None
    assert len(zone.forecasts.unplanned(zone.live, zone.now(), ahead(rows)).outputs.means) == DAILY + 1


def bits(zone):
    """The arrays of everything that forecasts and estimator of `zone` carry."""
    carried = zone.forecasts.pack(zone.live) | zone.estimator.pack(zone.state)
    return {name: array.tobytes() for name, array in carried.items()}


BANK = {
    "members": {
        "jump": {"estimator": "mkf", "particles": 24, "scenarios": 64},
        "ekf": {"estimator": "ekf"},
        "arx": {"estimator": "arx"},
    },
    "scenarios": 16,
}


def test_asking_a_bank_changes_nothing():
    zone = Zone("bank", BANK).run(recorded(3, PERIOD), 0, 2 * DAILY)
    rows, before = np.tile(zone.before, (DAILY, 1)), bits(zone)
    zone.forecasts.unplanned(zone.live, zone.now(), ahead(rows))
    zone.forecasts.planned(zone.live, zone.now(), rows[:, 0] + 15.0, ahead(rows))
    assert bits(zone) == before


def test_a_member_that_does_not_count_under_plans_is_judged_as_well_and_can_come_back():
    data = recorded(4, PERIOD)
    zone = Zone("bank", BANK).run(data, 0, 3 * DAILY)
    members = zone.live.members
    behind = np.repeat([[0.0], [500.0]], members.excess.shape[1], axis=1)
    zone.live = zone.forecasts.restarted(zone.live)._replace(members=members._replace(excess=behind))
    zone.run(data, 3 * DAILY, 4 * DAILY)
    # Where the first was the worse one of the two, it has lost something.
    assert (zone.live.members.excess[0] > 0.0).any()


def test_what_was_stored_before_there_was_any_begins_anew():
    forecasts = Zone("bank", BANK).forecasts
    assert forecasts.unpack({}).step == 0
    assert forecasts.unpack(Zone().forecasts.pack(Zone().live)).members.excess.shape[0] == 2


def test_what_was_stored_before_forecasts_were_verified_as_asked_goes_on_without_those_that_wait():
    zone = Zone().run(recorded(3, PERIOD), 0, 3 * DAILY)
    stored = zone.forecasts.pack(zone.live)
    old = {
        name: value
        for name, value in stored.items()
        if name not in ("errors", "issues.foreseen", "issues.errors") and not name.startswith("forced.")
    }
    again = zone.forecasts.unpack(old | {"rows": np.zeros((DAILY, 2))})
    assert again.issues == ()
    assert again.members.excess.tobytes() == zone.live.members.excess.tobytes()
    assert again.widths[PLANNED].verified.tolist() == zone.live.widths[PLANNED].verified.tolist()
    assert again.errors.tobytes() == zone.forecasts.begin().errors.tobytes()


def test_what_was_stored_before_forecasts_could_be_seldom_came_every_hour():
    zone = Zone().run(recorded(3, PERIOD), 0, 3 * DAILY)
    stored = zone.forecasts.pack(zone.live)
    again = zone.forecasts.unpack({name: value for name, value in stored.items() if name != "issues.stands"})
    assert again.issues
    assert {float(issue.stands) for issue in again.issues} == {1.0}


def told_every_hour(days, setpoint):
    memory = no_memory(2)
    for moment in range(0, days * 86400, 3600):
        memory = remembered(memory, moment, 3600, setpoint(moment), 20.0, np.zeros(2), np.zeros(2))
    return memory


def test_guesses_are_as_now_yesterday_last_week_and_usual_by_kind_of_day():
    # 1970 began on a Thursday; the set-point is the day's number, and on Saturdays and Sundays 100 more.
    def setpoint(moment):
        day = moment // 86400
        return float(day) + 100.0 * ((day + 3) % 7 >= 5)

    found = guesses(told_every_hour(11, setpoint), 33.0, 11 * 86400 + 3600.0 * np.arange(48))
    assert (found[0] == 33.0).all()
    assert set(found[1]) == {setpoint(10 * 86400)}
    assert found[2].tolist() == [setpoint(4 * 86400)] * 24 + [setpoint(5 * 86400)] * 24
    working = [setpoint(day * 86400) for day in range(11) if (day + 3) % 7 < 5]
    assert set(found[3]) == {sorted(working)[(len(working) - 1) // 2]}


def test_a_guess_is_as_now_where_nothing_is_remembered():
    found = guesses(told_every_hour(2, lambda moment: 18.0), 21.0, 2 * 86400 + 3600.0 * np.arange(24))
    assert (found[GUESSES.index("as-last-week")] == 21.0).all()
    assert (found[GUESSES.index("as-yesterday")] == 18.0).all()
    assert (guesses(no_memory(2), 21.0, np.arange(3.0)) == 21.0).all()


def test_after_the_clocks_are_changed_people_keep_their_hours():
    """Warm from 6 to 22 by clocks that are two hours ahead of UTC, and one after twelve days."""
    change = 12 * 86400

    def offsets(times):
        return np.where(np.asarray(times) < change, 7200.0, 3600.0)

    memory = told_every_hour(12, lambda moment: 21.0 if 6 <= (moment + 7200) // 3600 % 24 < 22 else 17.0)
    found = guesses(memory, 19.0, change + 3600.0 * np.arange(22), ToCome(offsets=offsets))
    hours = (np.arange(22) + 1) % 24
    for guess in ("as-yesterday", "as-last-week", "as-usual"):
        assert found[GUESSES.index(guess)].tolist() == np.where((hours >= 6) & (hours < 22), 21.0, 17.0).tolist(), guess


def test_a_bank_without_a_set_point_asks_its_blind_regressions_too():
    outputs, inputs, _ = recorded(6, PERIOD)
    members = {"ekf": {"estimator": "ekf"}, "blind": {"estimator": "direct", "blind": True}}
    zone = Zone("bank", {"members": members}).run((outputs, inputs, np.full(len(outputs), np.nan)), 0, 6 * DAILY)
    fan = zone.forecasts.unplanned(zone.live, zone.now(), ahead(np.tile(zone.before, (DAILY, 1))))
    chances = dict(zip(FUTURES, fan.chances[-1], strict=True))
    assert min(chances[name] for name in ("heat-held", "heat-of-yesterday", "by-regression")) > 0.0
    assert sum(chances[name] for name in GUESSES) == 0.0
    assert fan.outputs.weights[-1, fan.simulated :].sum() == pytest.approx(chances["by-regression"])
    assert zone.issued
    assert {len(issued) for issued in zone.issued.values()} == {len(zone.forecasts.leads)}
