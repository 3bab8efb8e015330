"""The report of the control experiment."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from replay.experiments.control import plots
from replay.experiments.control.cases import CASES, PRICES, UNDISTURBED, WARMEST
from replay.experiments.control.controllers import DECISION, EARLY
from replay.experiments.control.outcome import Outcome
from replay.experiments.control.perfect import PASSES
from replay.experiments.control.runs import ESTIMATOR, PERFECT, THERMOGATE, THERMOSTAT
from replay.experiments.control.scores import Scores
from replay.experiments.control.verdicts import verdicts
from replay.experiments.report import Report, Section
from replay.experiments.table import Table, spread
from replay.experiments.verdict import verdict_table
from replay.localtime import HOUR

_COLUMNS: tuple[tuple[str, Callable[[Scores], float]], ...] = (
    ("energy, kWh", lambda one: one.energy),
    ("cost", lambda one: one.cost),
    ("too cold, K h", lambda one: one.cold),
    ("too warm, K h", lambda one: one.warm),
    ("discomfort, K h", lambda one: one.discomfort),
    ("peak, kW", lambda one: one.peak),
    ("switched on, per room and day", lambda one: one.switches),
    ("share of time under a thermostat", lambda one: one.fallback),
)


def report(outcomes: Sequence[Outcome], seeds: Sequence[int]) -> Report:
    """The report of all buildings and cases."""
    return Report(
        "The loop closed",
        tuple(_lead(outcome) for outcome in outcomes),
        (_done(outcomes, seeds), _targets(outcomes), *map(_section, outcomes), _settings()),
    )


def _lead(outcome: Outcome) -> str:
    own, thermostat = (
        (
            spread(outcome.figures(label, lambda one: one.cost)).mean,
            spread(outcome.figures(label, lambda one: one.discomfort)).mean,
        )
        for label in (THERMOGATE, THERMOSTAT)
    )
    text = (
        f"{outcome.name}: Thermogate's controller pays {own[0]:.1f} at a discomfort of {own[1]:.1f} K h, the "
        f"thermostat {thermostat[0]:.1f} at {thermostat[1]:.1f} K h"
    )
    shares = outcome.shares(THERMOGATE)
    known = outcome.scene.case == UNDISTURBED and all(share == share for share in shares)
    return (
        f"{text}; at equal discomfort that is {spread(shares).mean:.0%} of the way to perfect knowledge."
        if known
        else f"{text}."
    )


def _done(outcomes: Sequence[Outcome], seeds: Sequence[int]) -> Section:
    buildings = {outcome.scene.building: outcome.scene for outcome in outcomes}
    listed = "; ".join(f"{scene.building}: {scene.of.what}, weather of {scene.weather}" for scene in buildings.values())
    cases = {outcome.scene.case for outcome in outcomes}
    scene = outcomes[0].scene
    history = max(outcome.scene.days - outcome.scene.controlled for outcome in outcomes)
    tariff = ", ".join(f"{name} {price:.2f}" for name, price in PRICES.items())
    return Section(
        "What was done",
        (
            f"Buildings: {listed}. A thermostat heats for {history} days, then each controller for "
            f"{scene.controlled} days, which are scored. Seeds {', '.join(map(str, seeds))}, of people, thermometers "
            "and estimators. EnergyPlus steps every 5 min; thermometers have a noise of 0.03 K.",
            *(f"{name}: {CASES[name].what}" for name in CASES if name in cases),
            f"A kWh costs by tariff: {tariff} (night from 22:00 to 6:00, peak from 17:00 to 20:00). Comfort is from "
            f"the set-point of the room, which is lowered at night, to {WARMEST:.0f} degC; discomfort is what the "
            "exact temperature of each room lies outside, in K h, whether anybody is there or not.",
            "The thermostat looks every 5 min, has a hysteresis of 0.3 K above the band, and is set up "
            f"{EARLY / HOUR:.0f} h before the night setback ends. Every other controller is `deploy/examples/mpc.py` "
            "over the routes of a Thermogate in this process, whose zones take journaled samples: it plans 24 h ahead "
            f"every {DECISION / 60:.0f} min by a linear programme, each room for itself, with the weather as it will "
            "be and the last plans of the other rooms, and holds the planned temperature every 5 min. So models of the "
            "building are compared, and not forecasts of the weather.",
            "Least squares: the network `auto` fitted in open loop to the history (in a new season: to the first half "
            "of the days, in which a thermostat heats), its states followed by an EKF. EKF: all parameters learned "
            "online. Both take every forecast for good, and so does Thermogate without trust. Thermogate: the "
            f"estimator `{ESTIMATOR}` with its defaults, planning as far as its trust reaches, otherwise the "
            "thermostat.",
            f"Perfect knowledge: EnergyPlus is deterministic, so the period is lived {PASSES} times over. Each pass "
            "plans with what the pass before did to the plant, corrected by heat pulses measured on the plant itself. "
            "It knows weather, people, windows and thermal response, and plans all rooms together; programme, costs, "
            "horizon, step and limits are those of the others. So it bounds what any model could give the same "
            "controller.",
            "Cost at equal discomfort: thermostat and perfect knowledge are run with several comfort margins, the "
            "thermostat also with other times of setting up. Costs between neighbouring points of these two fronts are "
            "interpolated at the discomfort of the controller in question, which has only its usual setting.",
        ),
    )


def _targets(outcomes: Sequence[Outcome]) -> Section:
    found = verdicts(outcomes)
    met, missed = (sum(verdict.met is state for verdict in found) for state in (True, False))
    full = min(outcome.scene.controlled for outcome in outcomes) >= 28
    note = "" if full else " The targets are meant for four controlled weeks; read a shorter run as an orientation."
    return Section("Targets", (f"{met} are met, {missed} missed.{note}",), (verdict_table(found),))


def _section(outcome: Outcome) -> Section:
    figures = [plots.a_week(outcome)]
    if outcome.scene.case == UNDISTURBED:
        figures.insert(0, plots.cost_and_discomfort(outcome))
    return Section(outcome.name, (CASES[outcome.scene.case].what,), (_table(outcome),), tuple(figures))


def _table(outcome: Outcome) -> Table:
    swept = outcome.scene.case == UNDISTURBED
    names = tuple(name for name, _ in _COLUMNS) + (("share of the way",) if swept else ())
    rows = []
    for label in outcome.controllers:
        cells = [spread(outcome.figures(label, figure)) for _, figure in _COLUMNS]
        known = swept and label not in (THERMOSTAT, PERFECT)
        rows.append((label, *cells, *((spread(outcome.shares(label)) if known else None,) if swept else ())))
    return Table(
        f"{outcome.scene.building}-{outcome.scene.case}".replace(" ", "-"),
        f"{outcome.name}: every controller at its usual setting",
        ("controller", *names),
        tuple(rows),
        "Mean over seeds ± standard deviation."
        + (
            " Share of the way from the thermostat to perfect knowledge in cost, at the controller's own discomfort."
            if swept
            else ""
        ),
    )


def _settings() -> Section:
    return Section(
        "What to set",
        (
            f'For a controller: `estimator = "{ESTIMATOR}"`, `installed` for every heater, `stuck_after` for the '
            "thermometers, a forecast of the weather, and the plans of neighbouring rooms in the request. Plan as far "
            "as the trust reaches, and let a thermostat look at the room every few minutes where it does not.",
        ),
    )
