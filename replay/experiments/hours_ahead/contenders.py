"""Who makes forecasts: naive rules, direct regressions, and every estimator as a user gets it."""

import tomllib
from collections.abc import Iterator
from importlib.util import find_spec

from estimator import registry
from replay.errors import ReplayError
from replay.experiments.hours_ahead.answered import ANSWERED, SCHEDULED, AnsweredRun, run_answered
from replay.experiments.hours_ahead.direct import BLIND, BOOSTING, DIRECT, RIDGE, lightgbm, run_direct
from replay.experiments.hours_ahead.forecasts import PERSISTENCE, YESTERDAY, PlainRun, leads_of, run_naive
from replay.experiments.hours_ahead.recordings import Recording
from replay.experiments.hours_ahead.runs import PLANNED, run_hours, run_planned
from replay.experiments.jobs import Job
from replay.experiments.request import Request, chosen
from replay.experiments.series.filtering import FilterRun
from replay.experiments.study import Contender

NAIVE = (PERSISTENCE, YESTERDAY)
BANK = "bank"
DRAWS_NOTHING = ("arx", "daily", "direct", "ekf", "ukf")
_USUAL = (
    *(*NAIVE, RIDGE, BLIND, BOOSTING),
    *("arx", "daily", "direct", "ekf", "ukf", "rbpf:preset='paper'", "rbpf", "mkf", BANK),
)


def seeded(contender: Contender) -> bool:
    name = contender.estimator
    return name in (*registry.ESTIMATORS, PLANNED, *ANSWERED) and name not in DRAWS_NOTHING


def contenders(request: Request) -> list[Contender]:
    """Those of --contender, or the usual ones and what the zone of --config has been given; with --particles if given.

    A zone that leaves its estimator at the defaults adds none: it would be another name for the same.
    """
    if request.contender:
        found = [named(text) for text in request.contender]
        if any(contender.estimator == BOOSTING for contender in found):
            lightgbm()
    else:
        found = [named(text) for text in _USUAL if text != BOOSTING or find_spec("lightgbm") is not None]
        if request.config is not None:
            _, zone = chosen(request)
            if (zone.estimator, zone.estimator_options) not in [(one.estimator, one.options) for one in found]:
                label = f"as configured ({zone.estimator})"
                found.append(Contender(label, zone.estimator, zone.estimator_options))
    return [one if "particles" in one.options else one.with_particles(request.particles) for one in found]


def named(text: str, place: str = "--contender") -> Contender:
    """NAME, or NAME:OPTIONS with the options of an estimator as between the braces of a TOML table; ReplayError, which
    begins with the `place` of `text`, for anything else."""
    name, _, given = text.partition(":")
    known = (*NAIVE, *DIRECT, PLANNED, *ANSWERED, *registry.ESTIMATORS)
    if name not in known:
        raise ReplayError(f"{place} {text}: there is no '{name}'; the contenders are {', '.join(known)}")
    if given and name not in registry.ESTIMATORS:
        raise ReplayError(f"{place} {text}: {name} has no options; leave them out")
    try:
        options = tomllib.loads(f"options = {{{given}}}")["options"]
    except tomllib.TOMLDecodeError as error:
        raise ReplayError(
            f"{place} {text}: the options are not TOML ({error}); write them as in mkf:particles=64"
        ) from None
    return Contender(text, name, options)


def jobs_of(contender: Contender, recording: Recording, seeds: tuple[int, ...]) -> Iterator[Job]:
    """The runs of `contender` on `recording`, one for each seed that it makes a difference to.

    Raises OptionsError where the estimator refuses its options.
    """
    leads, series, period = tuple(leads_of(recording.period).values()), recording.series, recording.period
    if contender.estimator in (*NAIVE, *DIRECT):
        work = run_naive if contender.estimator in NAIVE else run_direct
        run = PlainRun(contender.estimator, series, period, leads, seeds[0])
        yield Job(recording.name, contender.label, seeds[0], work, run)
        return
    asked, options, where = contender.estimator, contender.options, recording.whereabouts
    estimator = BANK if asked in (PLANNED, *ANSWERED) else asked
    if asked.startswith(SCHEDULED) and series.setpoints is None:
        return
    registry.resolve(estimator, recording.network, period, options)
    for seed in seeds if seeded(contender) else seeds[:1]:
        zone = FilterRun(estimator, options, recording.network, period, series, seed, where, leads)
        if asked in ANSWERED:
            yield Job(recording.name, contender.label, seed, run_answered, AnsweredRun(asked, zone))
        else:
            yield Job(recording.name, contender.label, seed, run_planned if asked == PLANNED else run_hours, zone)
