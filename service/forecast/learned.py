"""Questions about what a zone has learned: its model, its parameters, and what its forecasts were worth."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array
from estimator.statespace.matrices import StateSpace, of_draws, of_point
from estimator.statespace.simulate import gain_forecast
from estimator.thermostat.law import shortest_times
from estimator.thermostat.memory import in_order
from estimator.types import ModelDraws, ParameterSummary
from service.errors import NoModel
from service.forecast.answers import (
    DrawsPayload,
    GainForecastPayload,
    LearnedLaw,
    MatricesPayload,
    ModelPayload,
    QuantityPayload,
    Range,
)
from service.forecast.foresight import foresee
from service.forecast.shares import Shares, in_own_watts
from service.records.outlook import Weather
from service.records.skill import Skill
from service.zone.worker import Standing, ZoneWorker

GAIN = "gain"
"""The state that is the unmeasured gain."""


class ModelQuestion(NamedTuple):
    """Asks for state-space matrices at a step of `periods` periods: at the posterior mean, and of `most` draws at
    most."""

    periods: int
    most: int
    estimator: str

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> ModelPayload | None:
        """The model; None where there is no forecast now. NoModel for an estimator without physics."""
        standing = worker.unstalled
        if standing is None:
            return None
        drawn, step = in_own_watts(model_draws(worker, standing, self.most)), worker.period * self.periods
        draws, mean = (of(drawn, worker.period, self.periods) for of in (of_draws, of_point))
        network, forecast, gain = worker.network, standing.update.forecast, gain_forecast(draws, DAY // step)
        gains = [(GAIN, "W")] if draws.state.shape[1] > len(network.nodes) else []
        own, drawn_ones = _letters(mean, 0, len(network.inputs)), _letters(draws, slice(None), len(network.inputs))
        return ModelPayload(
            sample_time=standing.update.time,
            issue_time=forecast.issue_time,
            valid_time=forecast.valid_time,
            period_s=float(worker.period),
            step_s=float(step),
            network=network.name,
            estimator=self.estimator,
            member=drawn.member,
            share=drawn.share,
            fan_mean="mean" if drawn.point_is_fan else "draws",
            states=_quantities([*((node, "degC") for node in network.nodes), *gains]),
            inputs=_quantities((channel, network.channel_unit(channel)) for channel in network.inputs),
            outputs=_quantities((channel, "degC") for channel in network.measured),
            mean=MatricesPayload(C=mean.c, **own),
            covariance=drawn.covariance,
            draws=DrawsPayload(weights=draws.weights, **drawn_ones),
            known_heat=_known_heat(worker, standing, weather, mean.b[0, :, len(network.inputs) :], self.periods),
            gain=GainForecastPayload(*gain) if gain.size else None,
        )


def _quantities(named: Iterable[tuple[str, str]]) -> tuple[QuantityPayload, ...]:
    return tuple(QuantityPayload(*each) for each in named)


def _letters(model: StateSpace, which: int | slice, inputs: int) -> dict[str, Array]:
    """The arrays of one model, or of all, by the letters of the payload, with the measured inputs alone."""
    a, b, q, r, state = (array[which] for array in (model.a, model.b[:, :, :inputs], model.q, model.r, model.state))
    return {"A": a, "B": b, "Q": q, "R": r, "state": state}


class Parameters(NamedTuple):
    """What a zone has learned of its building and its thermostat."""

    summary: ParameterSummary
    laws: tuple[LearnedLaw, ...]


class ParametersQuestion(NamedTuple):
    """Asks for posterior quantiles of the parameters, and for the law of the thermostat."""

    levels: tuple[float, ...]

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Parameters | None:
        """Both; None before the first sample."""
        summary = worker.parameters(self.levels)
        return None if summary is None else Parameters(summary, learned_laws(worker))


class SkillQuestion(NamedTuple):
    """Asks what the zone's forecasts have been worth."""

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Skill | None:
        """The scores; None before the first sample."""
        return worker.skill()


def learned_laws(worker: ZoneWorker) -> tuple[LearnedLaw, ...]:
    """The laws of the thermostat; none where none is known."""
    thermostat, found, shares = worker.carried.thermostat, [], Shares.of(worker)
    laws, memory = thermostat.laws, thermostat.memory
    if len(laws.column):
        memory = in_order(memory, float(np.nanmax(memory.times)))
    for place, column in enumerate(laws.column.astype(int).tolist()):
        mean, spread = laws.numbers[place], 1.96 * np.sqrt(np.diagonal(laws.covariance[place]))
        # Power and band are no less than nothing.
        lower = np.maximum(mean - spread, [0.0, -np.inf, 0.0])
        power, offset, band = (
            Range(*each) for each in zip(mean.tolist(), lower.tolist(), (mean + spread).tolist(), strict=True)
        )
        if worker.network.inputs[column] in worker.network.shares:
            # Both are unsure by a factor.
            own, unsure = power.mean * float(shares.medians[column]), 1.96 * float(shares.spreads[column])
            unsure = float(np.exp(np.hypot(unsure, np.log(power.upper / power.mean))))
            power = Range(own, own / unsure, own * unsure)
        on, off = shortest_times(laws, place, memory, worker.period)
        found.append(
            LearnedLaw(
                channel=worker.network.inputs[column],
                side="heating" if laws.side[place] > 0.0 else "cooling",
                law="on-off" if laws.switching[place] > 0.0 else "proportional",
                power=power,
                offset=offset,
                band=band,
                explained=float(laws.explained[place]),
                days=int(laws.days[place]),
                shortest_on=on / 60.0,
                shortest_off=off / 60.0,
            )
        )
    return tuple(found)


def _known_heat(worker: ZoneWorker, standing: Standing, weather: Weather, response: Array, periods: int) -> Array:
    """(h, n_x + G): what known heat adds over each step of `periods` periods of a day, by the `response` (n_x + G, m)
    to the mean of the known part of each term; h is 0 without terms."""
    steps = DAY // (worker.period * periods)
    if not response.shape[1]:
        return np.empty((0, len(response)))
    forecast = standing.update.forecast
    rows = foresee(worker, standing, steps * periods, weather).rows
    times = forecast.valid_time + worker.period * np.arange(len(rows), dtype=np.float64)
    known = worker.loop.driving(times, rows)[:, rows.shape[1] :].reshape(steps, periods, -1).mean(axis=1)
    return np.asarray(known @ response.T, dtype=np.float64)


def model_draws(worker: ZoneWorker, standing: Standing, count: int) -> ModelDraws:
    """At most `count` linear models; NoModel for an estimator without physics."""
    draws = worker.estimator.draws(standing.state, count)
    if draws is None:
        raise NoModel("it knows no physics, so it has no state-space model and no scenarios; its forecasts it has")
    return draws
