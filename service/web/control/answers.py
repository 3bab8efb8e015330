"""Models and forecasts of many zones as payloads, and as NumPy's npz."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np

from adapters.reading import Quality
from estimator.arrays import Array
from estimator.network.network import Network
from estimator.statespace.matrices import StateSpace
from service.errors import NoModel, ServiceError
from service.fields.times import utc
from service.publish.rendering import believable, quality
from service.records.fan import Fan
from service.records.model import ZoneModel
from service.records.view import ZoneView
from service.web.control.models import (
    CompactOutputPayload,
    DrawsPayload,
    GainForecastPayload,
    MatricesPayload,
    ModelPayload,
    QuantityPayload,
    ZoneForecastPayload,
)
from service.web.zones import no_forecast

GAIN = "gain"
"""The state that is the unmeasured gain."""


def model_payload(site: str, zone: ZoneView, model: ZoneModel) -> ModelPayload:
    """The model of `zone`."""
    draws, forecast = model.draws, model.update.forecast
    return ModelPayload(
        site=site,
        zone=zone.id,
        sample_time=utc(model.update.time),
        issue_time=utc(forecast.issue_time),
        valid_time=utc(forecast.valid_time),
        period_s=zone.period,
        step_s=float(model.step),
        network=draws.network.name,
        estimator=zone.estimator,
        member=model.member,
        share=model.share,
        fan_mean=model.fan_is,
        states=[QuantityPayload(name=name, unit=unit) for name, unit in _states(draws)],
        inputs=[QuantityPayload(name=name, unit=unit) for name, unit in _channels(draws.network)],
        outputs=[QuantityPayload(name=name, unit="degC") for name in draws.network.measured],
        mean=_matrices(model.mean),
        covariance=model.covariance.tolist(),
        draws=DrawsPayload(
            weights=draws.weights.tolist(),
            **{name: value.tolist() for name, value in _letters(draws, slice(None)).items() if name != "C"},
        ),
        known_heat=model.known_heat.tolist(),
        gain=GainForecastPayload(mean=model.gain[0].tolist(), sd=model.gain[1].tolist()) if model.gain.size else None,
    )


def model_npz(payload: ModelPayload, model: ZoneModel) -> bytes:
    """The same as an npz of arrays: the matrices at the posterior mean by their letters, those of the draws with
    `draws_` before them, and everything else of the payload as JSON in `about`."""
    arrays: dict[str, Any] = {**_letters(model.mean, 0), "covariance": model.covariance, "gain": model.gain}
    arrays |= {"known_heat": model.known_heat}
    arrays |= {f"draws_{name}": value for name, value in _letters(model.draws, slice(None)).items() if name != "C"}
    arrays["draws_weights"] = model.draws.weights
    about = payload.model_dump(
        mode="json", by_alias=True, exclude={"mean", "draws", "covariance", "known_heat", "gain"}
    )
    file = io.BytesIO()
    np.savez_compressed(file, about=np.array(json.dumps(about)), **arrays)
    return file.getvalue()


def zone_payload(zone: ZoneView, fan: Fan | ServiceError | None, horizon: float) -> ZoneForecastPayload:
    """The forecast of one zone under one plan, or why there is none."""
    if not isinstance(fan, Fan):
        return _missing(zone, _reason(zone, fan), horizon)
    forecast = fan.update.forecast
    found = quality(fan.update, forecast.inputs)
    means = [(output.output, value) for output in fan.outputs for value in output.mean.tolist()]
    if zone.status().state in ("stalled", "failed") or not believable(means, zone.surroundings.limits):
        found = Quality.BAD
    return ZoneForecastPayload(
        zone=zone.id,
        problem=None,
        sample_time=utc(fan.update.time),
        issue_time=utc(forecast.issue_time),
        valid_time=utc(forecast.valid_time),
        period_s=zone.period,
        quality=found,
        trust=zone.trust().at(horizon + zone.period),
        inputs=fan.origins,
        levels=list(fan.levels),
        outputs=[
            CompactOutputPayload.model_construct(
                output=output.output,
                unit="degC",
                mean=_finite(output.mean),
                median=_finite(output.median),
                sd=_finite(output.sd),
                lower=_finite(output.lower),
                upper=_finite(output.upper),
                scenarios=_finite(fan.paths[:, :, place]),
            )
            for place, output in enumerate(fan.outputs)
        ],
    )


def _reason(zone: ZoneView, error: ServiceError | None) -> str:
    if isinstance(error, NoModel):
        return f"the estimator '{zone.estimator}' has no scenarios: {error}"
    return str(no_forecast(zone) if error is None else error)


def _missing(zone: ZoneView, sentence: str, horizon: float) -> ZoneForecastPayload:
    return ZoneForecastPayload(
        zone=zone.id,
        problem=sentence,
        sample_time=None,
        issue_time=None,
        valid_time=None,
        period_s=zone.period,
        quality=Quality.BAD,
        trust=zone.trust().at(horizon + zone.period),
        inputs=(),
        levels=[],
        outputs=[],
    )


def _finite(values: Array) -> list[Any]:
    """Lists of floats, which are already JSON numbers or null: millions of them need not be looked at again."""
    return np.where(np.isfinite(values), values, np.nan).tolist()


def _matrices(model: StateSpace) -> MatricesPayload:
    return MatricesPayload(**{name: value.tolist() for name, value in _letters(model, 0).items()})


def _letters(model: StateSpace, which: int | slice) -> dict[str, Array]:
    """The arrays of one model, or of all, by the letters of the payload."""
    return {
        "A": model.a[which],
        "B": model.b[which],
        "C": model.c,
        "Q": model.q[which],
        "R": model.r[which],
        "state": model.state[which],
    }


def _states(model: StateSpace) -> list[tuple[str, str]]:
    gains = model.state.shape[1] - len(model.network.nodes)
    return [(node, "degC") for node in model.network.nodes] + [(GAIN, "W")] * gains


def _channels(network: Network) -> list[tuple[str, str]]:
    return [(channel, network.channel_unit(channel)) for channel in network.inputs]
