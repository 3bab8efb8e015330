"""What the semi-synthetic experiment is held to: targets for building 67 over measured weather, checked by numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from estimator.network.network import Network
from replay.experiments import published
from replay.experiments.semi_synthetic.scores import DOMINATED, LOW, OVERALL, RunScores
from replay.experiments.semi_synthetic.tables import Scores
from replay.experiments.verdict import Verdict, at_least, at_most, between, near, within

FLOOR_WINKLER = published.ONE_STEP["floor: truth and gain known, reference"].winkler
MINUTES = 15.0
WALK = "with walk .001"
"""Marks EKF and UKF with the random walk that brings out the paper's table 5."""


def verdicts(scores: Scores, network: Network, core_minutes: float) -> list[Verdict]:
    """Every target, by estimator; `core_minutes` is the computing time of all runs in minutes of one core."""

    def values(label: str, pick: Callable[[RunScores], float]) -> list[float]:
        return [pick(run) for run in scores[label]]

    found: list[Verdict] = []
    for label in scores:
        if label.startswith("RBPF paper, "):
            found += _as_the_authors(label, scores[label])
        if label.startswith("floor"):
            winkler = values(label, lambda run: run.one_step[OVERALL].winkler)
            found.append(near(f"{label}: one_step Winkler, K", winkler, FLOOR_WINKLER, 0.01))
    for label in (
        label for label in scores if label.startswith(("RBPF default, ", "RBPF paper, ")) and "true" not in label
    ):
        found += [
            between(f"{label}: one_step coverage", values(label, lambda r: r.one_step[OVERALL].coverage), 0.945, 0.96),
            at_most(f"{label}: one_step Winkler, K", values(label, lambda r: r.one_step[OVERALL].winkler), 0.95),
            at_most(f"{label}: parasitic-learning index", values(label, lambda r: r.parasitic_learning), 1.2),
            at_least(f"{label}: AUC of alpha", values(label, lambda r: r.auc), 0.95),
        ]
    for label in (label for label in scores if label.startswith("MKF")):
        disturbed = values(label, lambda run: run.one_step[DOMINATED].coverage)
        found += [
            at_most(f"{label}: one_step Winkler, K", values(label, lambda r: r.one_step[OVERALL].winkler), 0.88),
            at_least(f"{label}: one_step coverage, disturbance-dominated", disturbed, 0.93),
            at_most(f"{label}: H2, worst channel", values(label, lambda run: float(run.h2.max())), 0.04),
        ]
    for label in (label for label in scores if label.startswith(("EKF", "UKF"))):
        if WALK in label:
            found += _as_the_paper(label, scores[label])
        else:
            disturbed = values(label, lambda run: run.one_step[DOMINATED].coverage)
            winkler = values(label, lambda run: run.one_step[OVERALL].winkler)
            found += [
                between(f"{label}: one_step Winkler, K", winkler, 2.5, 3.5),
                at_most(f"{label}: one_step coverage, disturbance-dominated", disturbed, 0.1),
            ]
        found.append(at_least(f"{label}: parasitic-learning index", values(label, lambda r: r.parasitic_learning), 3.0))
    for label in (label for label in scores if label in ("RBPF default, 6 free", "RBPF paper, 6 free")):
        for (channel, name), limit in zip(published.CHANNELS.items(), published.AUTHORS_H2, strict=True):
            place = network.inputs.index(channel)
            found.append(at_most(f"{label}: H2 {name}", [float(run.h2[place]) for run in scores[label]], limit))
    found.append(at_most("computing time of all filters over two cores, minutes", [core_minutes / 2.0], MINUTES))
    return found


def _as_the_paper(label: str, runs: Sequence[RunScores]) -> list[Verdict]:
    """EKF or UKF beside the paper's Table 5, in its convention."""
    wanted = published.FILTERED[f"{label.split()[0]}, paper (Table 5)"]
    return [
        near(f"{label}: filtered RMSE, K", [run.filtered_rmse for run in runs], wanted.rmse, 0.05),
        near(f"{label}: filtered Winkler, K", [r.filtered[OVERALL].winkler for r in runs], wanted.winkler, 0.05),
        at_most(
            f"{label}: filtered coverage, disturbance-dominated", [r.filtered[DOMINATED].coverage for r in runs], 0.1
        ),
    ]


def _as_the_authors(label: str, runs: Sequence[RunScores]) -> list[Verdict]:
    """The `filtered` convention beside the authors' runs."""
    wanted = published.AUTHORS_FILTERED
    return [
        near(f"{label}: filtered RMSE, K", [run.filtered_rmse for run in runs], wanted.rmse, 0.05),
        near(f"{label}: filtered Winkler, K", [r.filtered[OVERALL].winkler for r in runs], wanted.winkler, 0.05),
        near(f"{label}: filtered width, K", [r.filtered[OVERALL].width for r in runs], wanted.width, 0.05),
        within(f"{label}: filtered coverage", [r.filtered[OVERALL].coverage for r in runs], wanted.coverage, 0.01),
        within(
            f"{label}: filtered coverage, low-disturbance", [r.filtered[LOW].coverage for r in runs], wanted.low, 0.01
        ),
        within(
            f"{label}: filtered coverage, disturbance-dominated",
            [r.filtered[DOMINATED].coverage for r in runs],
            wanted.dominated,
            0.01,
        ),
    ]
