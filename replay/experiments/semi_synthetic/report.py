"""The report of the semi-synthetic experiment: what was done, what came out, what it means, what to set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from replay.experiments import published
from replay.experiments.report import Report, Section
from replay.experiments.request import Request
from replay.experiments.semi_synthetic import plots, tables
from replay.experiments.semi_synthetic.causes import causes
from replay.experiments.semi_synthetic.scores import DOMINATED, OVERALL, Fitted, RunScores
from replay.experiments.semi_synthetic.tables import BUILDING, over_seeds
from replay.experiments.semi_synthetic.verdicts import verdicts
from replay.experiments.series.filtering import Series, Trace
from replay.experiments.verdict import verdict_table
from replay.simulated.semi_synthetic import FULL_DAYS, MEASUREMENT_NOISE_SD, PERIOD, Truth

LEAST_SQUARES = "least squares, offline"
TRUE_PARAMETERS = "true parameters"


@dataclass(frozen=True)
class Outcome:
    """Everything the report speaks of; over seeds, by estimator, or of the first seed."""

    network: Network
    request: Request
    seeds: tuple[int, ...]
    scores: Mapping[str, Sequence[RunScores]]
    learners: tuple[str, ...]
    """The estimators that learn parameters."""
    fits: Sequence[Fitted]
    true_open_loop: Sequence[Array]
    examples: Mapping[str, Trace]
    series: Series
    truth: Truth
    seconds: float
    """Computing time of all filters on one core."""


def report(outcome: Outcome) -> Report:
    """The report."""
    learned = {label: outcome.scores[label] for label in outcome.learners}
    held_to = outcome.network.name == BUILDING
    return Report(
        f"Semi-synthetic building: {outcome.network.name}",
        _lead(outcome),
        (
            _done(outcome),
            *([_targets(outcome)] if held_to else []),
            _calibration(outcome, held_to),
            _learning(outcome, learned),
            _volatility(outcome, learned),
            *([causes(outcome.scores, outcome.network)] if held_to else []),
            _settings(outcome),
        ),
    )


def _lead(outcome: Outcome) -> tuple[str, ...]:
    """Sentences for a hurried reader, with the numbers of this run."""
    default = next(label for label in outcome.learners if label.startswith("RBPF default"))
    others = [label for label in outcome.learners if label.startswith(("EKF", "UKF"))]
    runs = outcome.scores[default]
    floor = next(label for label in outcome.scores if label.startswith("floor"))
    best = min((over_seeds(outcome.scores[label], _winkler) for label in others), key=lambda figure: figure.mean)
    inside = over_seeds(runs, lambda run: run.one_step[OVERALL].coverage)
    disturbed = over_seeds(runs, lambda run: run.one_step[DOMINATED].coverage)
    worst = max(over_seeds(outcome.scores[label], lambda run: run.parasitic_learning).mean for label in others)
    own = over_seeds(runs, lambda run: run.parasitic_learning)
    # In a few days there may be no unmeasured heat.
    disturbing = np.isfinite([disturbed.mean, own.mean, worst]).all()
    meanwhile = f", {100 * disturbed.mean:.1f} % while heat acted that nobody measured" if disturbing else ""
    sentences = [
        f"Thermogate's default ({default}): of the temperatures measured, {100 * inside.mean:.1f} % fell into the 95 % "
        f"interval published ten minutes before{meanwhile}.",
        f"Its Winkler score, width and misses in one number, is {over_seeds(runs, _winkler)} K; the best that anyone "
        f"could reach who knew building and disturbance is {over_seeds(outcome.scores[floor], _winkler)} K, the best "
        f"EKF or UKF here reaches {best} K.",
    ]
    if disturbing:
        sentences.append(
            f"Unmeasured heat changes how fast its parameters move by a factor of {own}; EKF and UKF reach up to "
            f"{worst:.2f}. A factor near 1 means that the model does not learn from what it cannot see."
        )
    return tuple(sentences)


def _done(outcome: Outcome) -> Section:
    request, series = outcome.request, outcome.series
    weather = "weather generated for Konstanz" if request.file is None else f"weather from `{request.file.name}`"
    days = len(series.times) * PERIOD / 86_400
    share = float(outcome.truth.disturbance_dominated.mean())
    particles = request.particles or 9000
    comparable = (
        "This is the setting of the targets below."
        if request.file is not None and days >= FULL_DAYS - 1 and len(outcome.seeds) >= 5 and particles == 9000
        else "The targets below were set for measured weather, 154 days, 9,000 particles and at least 5 seeds; this "
        "run differs, so read them as an orientation only."
    )
    return Section(
        "What was done",
        (
            f"A computer simulated the building `{outcome.network.name}` over {days:.0f} days of {weather}, a sample "
            f"every {PERIOD // 60} min, with a heater that switches at random and, {100 * share:.0f} % of the time, a "
            "strong heat gain (people, sun, an oven) that no estimator is told of. The thermometer has "
            f"{MEASUREMENT_NOISE_SD} K of noise. Every estimator then learned the building online from the recorded "
            "temperature, weather and heater power, as it would in the daemon, knowing nothing else.",
            f"Seeds: {', '.join(map(str, outcome.seeds))}. Each has heater, gains and noise of its own, and the "
            "estimators' own random numbers. Figures are means "
            f"over seeds ± standard deviation. RBPF with {particles:,} particles. {comparable}",
            "Two conventions are reported and never mixed. `one_step` is what the daemon promises: the interval "
            "published before the temperature was measured, against the measurement. `filtered` is the interval of the "
            "state after the measurement, against the true temperature, which only a simulation knows; the paper's "
            "table 5 is of that kind.",
            "'6 free' holds C_i, C_h, C_s and g_is at the truth, as the paper's authors did in their runs; '10 free' "
            "learns everything, as an installation has to. 'paper' are the settings of the paper, 'default' those of "
            "Thermogate.",
        ),
    )


def _targets(outcome: Outcome) -> Section:
    found = verdicts(outcome.scores, outcome.network, outcome.seconds / 60.0)
    met, missed = (sum(verdict.met is state for verdict in found) for state in (True, False))
    still_open = len(found) - met - missed
    counted = f"{met} of {len(found)} are met" + (f", {still_open} open" if still_open else "")
    return Section(
        "Targets",
        (f"{counted}; 'Why targets are missed' below looks into those that are missed.",),
        (verdict_table(found),),
    )


def _calibration(outcome: Outcome, held_to: bool) -> Section:
    one_step, filtered = (published.ONE_STEP, published.FILTERED) if held_to else ({}, {})
    few = _picked(outcome, ("RBPF default", "RBPF paper, ", "EKF paper, ", "UKF paper, "))
    return Section(
        "Can the intervals be trusted?",
        (
            "A controller that plans with a 95 % interval needs 95 of 100 temperatures to fall into it, in every "
            "regime, and needs it narrow. Coverage says the first, width the second, the Winkler score both.",
        ),
        (
            tables.calibration(outcome.scores, "one_step", one_step),
            tables.calibration(outcome.scores, "filtered", filtered),
            tables.by_volatility(outcome.scores),
        ),
        (
            plots.start_of_an_event(_first_of_each(few), outcome.series, outcome.truth),
            plots.onset_coverage({label: outcome.scores[label] for label in few}),
            plots.calibration_histogram(few),
        ),
    )


def _learning(outcome: Outcome, learned: Mapping[str, Sequence[RunScores]]) -> Section:
    fits = {LEAST_SQUARES: outcome.fits}
    simulated: dict[str, Sequence[Array]] = {label: [run.open_loop for run in runs] for label, runs in learned.items()}
    simulated |= {LEAST_SQUARES: [fit.open_loop for fit in outcome.fits], TRUE_PARAMETERS: outcome.true_open_loop}
    return Section(
        "Has it learned the building?",
        (
            "A controller asks the model what happens if it heats, if the sun shines, if it gets cold: the transfer "
            "functions from each input to the room. And it asks for hours ahead, without measurements in between: the "
            "open-loop error.",
        ),
        (tables.transfer({**learned, **fits}, outcome.network), tables.open_loop(simulated, outcome.network)),
        (plots.transfer_errors_over_time(learned, outcome.network),),
    )


def _volatility(outcome: Outcome, learned: Mapping[str, Sequence[RunScores]]) -> Section:
    dominated = outcome.truth.disturbance_dominated
    default = next(label for label in outcome.learners if label.startswith("RBPF default"))
    few = _picked(outcome, ("RBPF default", "RBPF paper, ", "EKF paper, ", "UKF paper, "))
    return Section(
        "Does it notice what it cannot see?",
        (
            "Alpha is how far the model can be trusted now. When unmeasured heat acts it should rise, widen the "
            "interval and stop the learning.",
        ),
        (tables.learning(learned, outcome.network),),
        (plots.volatility_distribution(outcome.examples[default], dominated), plots.update_sizes(few, dominated)),
    )


def _settings(outcome: Outcome) -> Section:
    return Section(
        "What to set",
        (
            "Leave the estimator at its default and give the two things that only you know: the network, and the noise "
            "of the thermometer. `measurement_sd` too small makes the filter take noise for disturbances; too large "
            "hides them.",
            '```\n[[zones]]\nnetwork = "titeth"          # `thermogate networks` lists them\n'
            'estimator = "rbpf"\n\n[zones.estimator_options]\n'
            f"measurement_sd = {MEASUREMENT_NOISE_SD}          # K, from the data sheet of the sensor\n```",
            "Where a parameter is known, from plans or a nameplate, fix it or narrow its bounds: compare '6 free' with "
            "'10 free' above for what that is worth.",
        ),
    )


def _picked(outcome: Outcome, beginnings: tuple[str, ...]) -> dict[str, Trace]:
    return {label: trace for label, trace in outcome.examples.items() if label.startswith(beginnings)}


def _first_of_each(traces: Mapping[str, Trace]) -> dict[str, Trace]:
    """One trace of every kind of estimator."""
    first: dict[str, Trace] = {}
    for label, trace in traces.items():
        if not any(known.split()[0] == label.split()[0] for known in first):
            first[label] = trace
    return first


def _winkler(run: RunScores) -> float:
    return run.one_step[OVERALL].winkler
