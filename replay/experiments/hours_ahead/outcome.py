"""What the runs of one recording came to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.experiments.hours_ahead.forecasts import Forecasts, point_forecasts
from replay.experiments.hours_ahead.horizons import THREE_DAYS, WINDOWS, leads_of, scored_from
from replay.experiments.hours_ahead.recordings import Recording
from replay.experiments.hours_ahead.rivals import BANK, LEAST_SQUARES
from replay.experiments.hours_ahead.scores import ByHorizon, score
from replay.experiments.hours_ahead.truth import Learned, learned
from replay.experiments.jobs import Arrays, Job
from replay.localtime import DAY


class Planned(NamedTuple):
    """A run of a rival, and the windows in which its forecasts are scored."""

    label: str
    windows: tuple[str, ...]
    job: Job


class Weights(NamedTuple):
    """What the members (E,) of a bank weigh over time at every horizon: `days` (n,) and `shares` (n, E, H)."""

    members: tuple[str, ...]
    days: Array
    shares: Array


class Outcome(NamedTuple):
    """Of one recording. Everything by label is in the order in which the report has it."""

    recording: Recording
    leads: Mapping[str, int]
    """Steps ahead by horizon."""
    begins: Mapping[str, int]
    """First row that counts, by window."""
    scores: Mapping[str, Mapping[str, Sequence[ByHorizon]]]
    """By window and label, for every seed."""
    examples: Mapping[str, Forecasts]
    """By label, of the first seed."""
    learned: Mapping[str, Sequence[Learned]]
    """By label, for every seed, against what the simulator knows; empty where nobody knows."""
    parameters: Mapping[str, Array]
    """By label the .025, .5 and .975 quantiles (seeds, n_theta, 3) at the end."""
    weights: Weights | None
    """Of the bank with the first seed."""
    seconds: float
    """Computing time of all runs."""


def outcome(recording: Recording, planned: Sequence[Planned], results: Sequence[Arrays]) -> Outcome:
    """The outcome of the runs `planned` for `recording`, whose arrays are `results`."""
    series, leads, begins = recording.series, leads_of(recording.period), scored_from(recording.series)
    scores: dict[str, dict[str, list[ByHorizon]]] = {window: {} for window in WINDOWS}
    examples: dict[str, Forecasts] = {}
    parameters: dict[str, list[Array]] = {}
    known: dict[str, list[Learned]] = {}

    def keep(label: str, windows: Sequence[str], forecasts: Forecasts) -> None:
        for window in windows:
            found = score(series.outputs[:, 0], forecasts, leads, begins[window])
            scores[window].setdefault(label, []).append(found)
        if THREE_DAYS in windows:
            examples.setdefault(label, forecasts)

    for label, forecasts in point_forecasts(series, recording.period, tuple(leads.values())).items():
        keep(label, WINDOWS, forecasts)
    for plan, arrays in zip(planned, results, strict=True):
        keep(plan.label, plan.windows, Forecasts(*(arrays[name] for name in Forecasts._fields)))
        if THREE_DAYS in plan.windows:
            parameters.setdefault(plan.label, []).append(arrays["parameters"])
            if recording.known is not None and plan.label != LEAST_SQUARES:
                known.setdefault(plan.label, []).append(learned(recording.known, series.times, arrays))
    banks = [arrays for plan, arrays in zip(planned, results, strict=True) if plan.label == BANK]
    return Outcome(
        recording,
        leads,
        begins,
        scores,
        examples,
        known,
        {label: np.array(found) for label, found in parameters.items()},
        _weights(recording, leads, banks[0]) if banks else None,
        sum(float(arrays["seconds"]) for arrays in results),
    )


def _weights(recording: Recording, leads: Mapping[str, int], arrays: Arrays) -> Weights:
    known = arrays["weight_leads"].tolist()
    times = recording.series.times[arrays["weight_rows"]]
    return Weights(
        tuple(arrays["members"].tolist()),
        (times - recording.series.times[0]) / DAY,
        arrays["weights"][:, :, [known.index(lead) for lead in leads.values()]],
    )
