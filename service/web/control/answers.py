"""Models and forecasts of many zones as records, and as NumPy's npz."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from adapters.reading import Quality
from estimator.arrays import Array
from estimator.statespace.matrices import StateSpace
from service.errors import NoModel, ServiceError
from service.publish.payloads import credible, quality
from service.records.fan import Fan
from service.records.model import ZoneModel
from service.records.record import document
from service.records.view import ZoneView
from service.web.control.models import (
    DrawsPayload,
    GainForecastPayload,
    MatricesPayload,
    ModelAbout,
    ModelPayload,
    QuantityPayload,
    ZoneForecastPayload,
)
from service.web.zones import no_forecast

GAIN = "gain"
"""The state that is the unmeasured gain."""


def model_json(site: str, zone: ZoneView, model: ZoneModel) -> bytes:
    """The model of `zone` as a document."""
    draws = {name: value for name, value in _letters(model.draws, slice(None)).items() if name != "C"}
    gain = GainForecastPayload(*model.gain) if model.gain.size else None
    learned = (MatricesPayload(**_letters(model.mean, 0)), model.covariance, DrawsPayload(model.draws.weights, **draws))
    return document(ModelPayload(*(*_about(zone, model), *learned, model.known_heat, gain)), site, zone.id)


def model_npz(site: str, zone: ZoneView, model: ZoneModel) -> bytes:
    """The same as an npz of arrays: the matrices at the posterior mean by their letters, those of the draws with
    `draws_` before them, and everything else as JSON in `about`."""
    arrays: dict[str, Any] = {**_letters(model.mean, 0), "covariance": model.covariance, "gain": model.gain}
    arrays |= {"known_heat": model.known_heat}
    arrays |= {f"draws_{name}": value for name, value in _letters(model.draws, slice(None)).items() if name != "C"}
    arrays["draws_weights"] = model.draws.weights
    about = document(ModelAbout(*_about(zone, model)), site, zone.id).decode()
    file = io.BytesIO()
    np.savez_compressed(file, about=np.array(about), **arrays)
    return file.getvalue()


def zone_forecast(zone: ZoneView, fan: Fan | ServiceError | None, horizon: float) -> ZoneForecastPayload:
    """The forecast of one zone under one plan, or why there is none."""
    trust = zone.trust().at(horizon + zone.period)
    if not isinstance(fan, Fan):
        nothing = (None, None, None, zone.period, Quality.BAD, trust, (), (), ())
        return ZoneForecastPayload(zone.id, _reason(zone, fan), *nothing)
    update, forecast = fan.update, fan.update.forecast
    means = ((output.output, value) for output in fan.outputs for value in output.mean.tolist())
    found = quality(update) if credible(zone.status(), means, zone.surroundings.limits) else Quality.BAD
    times = (update.time, forecast.issue_time, forecast.valid_time)
    return ZoneForecastPayload(zone.id, None, *times, zone.period, found, trust, fan.origins, fan.levels, fan.outputs)


def _reason(zone: ZoneView, error: ServiceError | None) -> str:
    if isinstance(error, NoModel):
        return f"the estimator '{zone.estimator}' has no scenarios: {error}"
    return str(no_forecast(zone) if error is None else error)


def _about(zone: ZoneView, model: ZoneModel) -> tuple[Any, ...]:
    """The fields of a ModelAbout, in their order."""
    network, forecast = model.draws.network, model.update.forecast
    gains = model.draws.state.shape[1] - len(network.nodes)
    states = [*((node, "degC") for node in network.nodes), *[(GAIN, "W")] * gains]
    inputs = [(channel, network.channel_unit(channel)) for channel in network.inputs]
    outputs = [(channel, "degC") for channel in network.measured]
    times = (model.update.time, forecast.issue_time, forecast.valid_time, zone.period, model.step)
    named = (network.name, zone.estimator, model.member, model.share, model.fan_is)
    quantities = [tuple(QuantityPayload(*each) for each in listed) for listed in (states, inputs, outputs)]
    return (*times, *named, *quantities)


def _letters(model: StateSpace, which: int | slice) -> dict[str, Array]:
    """The arrays of one model, or of all, by the letters of the payload."""
    a, b, q, r = (array[which] for array in (model.a, model.b, model.q, model.r))
    return {"A": a, "B": b, "C": model.c, "Q": q, "R": r, "state": model.state[which]}
