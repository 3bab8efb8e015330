"""The state of a zone, and the sentences that explain it and what of its telemetry is suspected."""

import logging
from collections.abc import Iterator, Sequence

from adapters.fields.times import written_time
from estimator.arrays import HOUR
from estimator.diagnosis.telemetry.lies import SETTLED, Suspicion, finding
from estimator.network.network import Network
from service.zone.clock import implausible
from service.zone.worker import Progress


def state_and_reason(
    progress: Progress,
    *,
    has_forecast: bool,
    failure: str | None,
    trouble: Sequence[str],
    live: bool,
    ended: bool,
    now: float,
    lag: str | None = None,
) -> tuple[str, str]:
    """One of `service.records.status.STATES`, and why.

    `failure` is why the last step failed, `trouble` why sources do not deliver; `live` says that the zone goes by the
    wall clock, `ended` that no source will deliver any more, `lag` why the estimator has not kept up, `now` what the
    wall clock says (UTC s).
    """
    if failure is not None:
        return "failed", failure
    if trouble and not live:
        return "stalled", trouble[0]
    if live and (wrong := implausible(now)) is not None:
        return "stalled" if has_forecast else "waiting", wrong
    if not has_forecast:
        if ended:
            return "waiting", "its recording has come to an end without one complete sample; see the faults"
        return "waiting", "; ".join((progress.stalled or "no complete sample yet", *trouble))
    if progress.stalled is not None:
        return "stalled", "; ".join((progress.stalled, *trouble))
    if lag is not None:
        return "stalled", lag
    if ended:
        return "stalled", "its recording has come to an end; the last forecast stands"
    if live and progress.last_time is not None and progress.last_time > now:
        return "stalled", (
            "the clock of this machine is behind the newest sample, so readings are refused until it has caught up; "
            "set the clock, or give the zone's state up with --reset"
        )
    # The clock of a live zone goes on without its sources: for a while held inputs carry the forecasts.
    return "running", "; ".join(trouble)


def telemetry_news(
    network: Network, before: Sequence[Suspicion], now: Sequence[Suspicion], time: float
) -> Iterator[tuple[int, str]]:
    """Level and text for the log where other telemetry was suspected `before` than `now`, at `time` [UTC s]."""
    stood, stands = ({(one.name, one.column): one for one in each} for each in (before, now))
    for one in (stands[key] for key in stands.keys() - stood.keys()):
        yield logging.WARNING, f"{finding(network, one).sentence} (since {written_time(one.since)} at the earliest)"
    for one in (stood[key] for key in stood.keys() - stands.keys()):
        told = f"{finding(network, one).subject} is believed again: {one.name} since {written_time(one.since)}"
        if time - one.since < SETTLED * HOUR:
            yield logging.INFO, f"{told} has ended"
        else:
            yield logging.WARNING, f"{told} has lasted for a week and is taken for true from now on"
