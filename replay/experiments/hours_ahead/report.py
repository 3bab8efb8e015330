"""The report of the hours-ahead experiment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from replay.experiments.hours_ahead import plots, tables
from replay.experiments.hours_ahead.horizons import EVERY, SHARE
from replay.experiments.hours_ahead.outcome import Outcome
from replay.experiments.hours_ahead.rivals import BANK, REGRESSIONS, rivals
from replay.experiments.hours_ahead.runs import SAMPLES
from replay.experiments.hours_ahead.verdicts import COVERAGE, best_rival, values, verdicts
from replay.experiments.report import Report, Section
from replay.experiments.request import Request
from replay.experiments.verdict import verdict_table
from replay.localtime import DAY, HOUR

_AHEAD_BY_FAR = 0.9
"""A regression whose CRPS is below this share of that of every other single model knows something that they miss."""


def report(outcomes: Sequence[Outcome], request: Request, seeds: Sequence[int]) -> Report:
    """The report of all recordings."""
    return Report(
        "Forecasts of the hours ahead",
        _lead(outcomes),
        (
            _done(outcomes, request, seeds),
            _targets(outcomes, request, seeds),
            _compared(outcomes, seeds),
            *_learned(outcomes),
            *(_recording(outcome) for outcome in outcomes),
            _later(outcomes),
            _settings(outcomes, request),
        ),
    )


def _lead(outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    sentences = [
        f"{label}: over all recordings and horizons its CRPS is {mean:.2f} times that of the best forecast, chosen "
        f"afterwards; at worst {worst:.2f} times ({where})."
        for label, mean, worst, where in tables.ranked(outcomes)[:3]
    ]
    others = [
        f"{_percent(share)} ({outcome.recording.name}, {horizon})"
        for share, outcome, horizon in _coverages(outcomes)
        if not COVERAGE[0] <= share <= COVERAGE[1]
    ]
    cells = len(_coverages(outcomes))
    sentences.append(
        f"The 95 % interval of the bank covers {_percent(COVERAGE[0])} to {_percent(COVERAGE[1])} in "
        f"{cells - len(others)} of {cells} cases{'; elsewhere ' + ', '.join(others) if others else ''}."
    )
    return tuple(sentences)


def _coverages(outcomes: Sequence[Outcome]) -> list[tuple[float, Outcome, str]]:
    """Coverage of the bank, mean over seeds, for every recording and horizon that was scored."""
    found = [
        (float(values(outcome, BANK, horizon, "coverage").mean()), outcome, horizon)
        for outcome in outcomes
        for horizon in outcome.leads
    ]
    return [entry for entry in found if np.isfinite(entry[0])]


def _done(outcomes: Sequence[Outcome], request: Request, seeds: Sequence[int]) -> Section:
    listed = "; ".join(
        f"{outcome.recording.name}: {outcome.recording.what} ({len(outcome.recording.series.times):,} samples every "
        f"{outcome.recording.period // 60} min, {_days(outcome):.0f} days)"
        for outcome in outcomes
    )
    minutes = sum(outcome.seconds for outcome in outcomes) / 60
    particles = "" if request.particles is None else f" RBPF with {request.particles:,} particles."
    return Section(
        "What was done",
        (
            f"Recordings: {listed}.",
            "Every estimator learned each building online from the recording, with its options as shipped, and made "
            "forecasts on the way: of the next sample at every step, and of the hours ahead every "
            f"{EVERY // HOUR} hours, under the inputs that really followed. So a model is judged by what it makes of "
            "the weather and of the heating, not by how well anybody foresaw them.",
            f"Seeds: {', '.join(map(str, seeds))}, of the estimators; the recordings are the same for all. Figures are "
            f"means over seeds ± standard deviation. Estimators that draw nothing ran once.{particles} One "
            f"after the other, the runs took {minutes:.0f} minutes.",
            "Persistence: nothing changes. Previous day: as 24 hours before. Least squares: the network fitted in open "
            "loop to what came before the first forecast that counts, then simulated from the state of an EKF with "
            "these parameters. The others are Thermogate's estimators with their defaults, and the RBPF also with the "
            "settings of the paper. ARX and daily, a regression on what changed since the day before, are told the "
            "errors of their forecasts as they come true.",
            f"Hours ahead, the particles of an RBPF are thinned to {SAMPLES} (`Estimator.issue`), and an MKF draws as "
            "many scenarios as it does by default. The others make the fans that they publish.",
            "Forecasts count from the fourth day on (where that leaves less than a quarter of the record: from its "
            "middle on). A second set of tables counts them after 30 % of the record. CRPS is in K and scores the "
            "whole distribution; for a point forecast it is the mean absolute error.",
        ),
    )


def _targets(outcomes: Sequence[Outcome], request: Request, seeds: Sequence[int]) -> Section:
    found = verdicts(outcomes)
    met, missed = (sum(verdict.met is state for verdict in found) for state in (True, False))
    reduced = request.days is not None or request.particles is not None or len(seeds) < 5
    note = (
        "The targets are meant for whole recordings, default particles and at least five seeds; this run differs, so "
        "read them as an orientation only."
        if reduced
        else "This is the setting of the targets."
    )
    fewest, where = min(_counts(outcomes))
    return Section(
        "Targets",
        (
            f"{met} are met, {missed} missed, {len(found) - met - missed} open. {note}",
            f"Coverage takes many forecasts: an honest 95 % interval misses one in twenty, and the smallest number of "
            f"forecasts here is {fewest} ({where}). Forecasts that overlap miss together.",
        ),
        (verdict_table(found),),
    )


def _counts(outcomes: Sequence[Outcome]) -> list[tuple[int, str]]:
    """How many forecasts of the bank were scored, for every recording and horizon that was."""
    return [
        (int(values(outcome, BANK, horizon, "samples").min()), f"{outcome.recording.name}, {horizon}")
        for _, outcome, horizon in _coverages(outcomes)
    ]


def _compared(outcomes: Sequence[Outcome], seeds: Sequence[int]) -> Section:
    compared = [
        tables.ranking(tables.ranked(outcomes)),
        tables.by_recording(outcomes, "crps", "CRPS, K"),
        tables.by_recording(outcomes, "coverage", "Coverage of the 95 % interval"),
    ]
    if len(seeds) > 1:
        compared.append(tables.seeds_compared(outcomes))
    return Section(
        "Which forecast is best?",
        (
            "No single setting serves all horizons: what follows every sample closely drifts over a day. Compare the "
            "columns row by row, and then how far a column is behind the best of its row at worst.",
        ),
        tuple(compared),
    )


def _learned(outcomes: Sequence[Outcome]) -> tuple[Section, ...]:
    """Nothing where no recording has a simulator that knows."""
    known = [(outcome, outcome.recording.known) for outcome in outcomes if outcome.recording.known is not None]
    if not known:
        return ()
    return (
        Section(
            "Is what was learned true?",
            (
                "EnergyPlus knows what its rooms lose, and what nobody measures there: heat of people, equipment and "
                "lights, and what open windows take away. Least squares is left out: it is fitted to the first days.",
            ),
            (tables.against_truth([outcome for outcome, _ in known]),),
            tuple(plots.heat_loss_by_day(outcome, truth) for outcome, truth in known),
        ),
    )


def _recording(outcome: Outcome) -> Section:
    drawn = [plots.crps_by_horizon(outcome), plots.coverage_by_horizon(outcome)]
    if outcome.weights is not None and len(outcome.weights.days):
        drawn.append(plots.weights_over_time(outcome, outcome.weights))
    drawn.append(plots.calibration(outcome))
    return Section(outcome.recording.name, (_sentence(outcome),), (tables.in_full(outcome),), tuple(drawn))


def _sentence(outcome: Outcome) -> str:
    parts = []
    for horizon in outcome.leads:
        label, best = best_rival(outcome, horizon)
        own = float(values(outcome, BANK, horizon, "crps").mean())
        if np.isfinite(own) and np.isfinite(best):
            parts.append(f"{horizon} {own:.3f} K (best rival: {label}, {best:.3f} K)")
    return f"CRPS of the bank: {'; '.join(parts)}." if parts else "The recording is too short to be scored."


def _later(outcomes: Sequence[Outcome]) -> Section:
    return Section(
        "After 30 % of the record",
        ("The same forecasts, counted from another time on. Least squares has a fit of its own for it.",),
        (
            tables.by_recording(outcomes, "crps", "CRPS, K", SHARE),
            tables.by_recording(outcomes, "coverage", "Coverage of the 95 % interval", SHARE),
        ),
    )


def _settings(outcomes: Sequence[Outcome], request: Request) -> Section:
    online = {rival.label: rival for rival in rivals(request)}
    best, mean, worst, where = next(standing for standing in tables.ranked(outcomes) if standing[0] in online)
    options = [f"{name} = {_toml(value)}" for name, value in online[best].options.items()]
    table = "\n".join(
        [
            "[[zones]]",
            f'estimator = "{online[best].estimator}"',
            *(["", "[zones.estimator_options]", *options] if options else []),
        ]
    )
    paragraphs = [
        f"On these recordings the estimator to plan with is {best}: its CRPS is {mean:.2f} times that of the best "
        f"forecast over all horizons, at worst {worst:.2f} times ({where}).",
        f"```\n{table}\n```",
    ]
    narrow = [
        f"{outcome.recording.name}, {horizon} ({_percent(coverage)})"
        for outcome in outcomes
        for horizon in outcome.leads
        if (coverage := float(values(outcome, best, horizon, "coverage").mean())) < 0.9
    ]
    if narrow:
        paragraphs.append(f"Keep a margin where its 95 % interval covered less than 90 %: {', '.join(narrow)}.")
    beaten = [outcome.recording.name for outcome in outcomes if _a_regression_is_ahead(outcome)]
    if beaten:
        paragraphs.append(
            f"On {', '.join(beaten)} a regression without physics (ARX, daily) is ahead of every single model of the "
            "building by more than a tenth, six hours ahead or a day ahead. The network misses something there: run "
            "`thermogate experiment topology`."
        )
    return Section("What to set", tuple(paragraphs))


def _a_regression_is_ahead(outcome: Outcome) -> bool:
    physical = [label for label in outcome.parameters if label not in (*REGRESSIONS, BANK)]
    for horizon in ("6 h", "24 h"):
        if horizon in outcome.leads and physical:
            regressions, others = (
                [float(values(outcome, label, horizon, "crps").mean()) for label in labels]
                for labels in (REGRESSIONS, physical)
            )
            if min(regressions) < _AHEAD_BY_FAR * min(others):
                return True
    return False


def _days(outcome: Outcome) -> float:
    times = outcome.recording.series.times
    return float(times[-1] - times[0]) / DAY


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _toml(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)
