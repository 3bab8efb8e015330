"""Forecasts of many zones as records, and models as NumPy's npz."""

import io
from typing import Any

import numpy as np

from adapters.reading import Quality
from service.errors import NoModel, ServiceError
from service.forecast.answers import DrawsPayload, MatricesPayload, ModelAbout, ModelPayload
from service.publish.payloads import credible, quality
from service.records.fan import Fan
from service.records.record import document, names
from service.records.view import ZoneView
from service.web.answering import no_forecast
from service.web.control.models import ZoneForecastPayload


def model_npz(model: ModelPayload, site: str, zone: str) -> bytes:
    """The model of `zone` as an npz of arrays: the matrices at the posterior mean by their letters, those of the draws
    with `draws_` before them, and everything else as JSON in `about`."""
    about = document(ModelAbout(*(getattr(model, name) for name in names(ModelAbout))), site, zone).decode()
    gain = np.empty((2, 0)) if model.gain is None else np.array([model.gain.mean, model.gain.sd])
    arrays: dict[str, Any] = {name: getattr(model.mean, name) for name in names(MatricesPayload)}
    arrays |= {"covariance": model.covariance, "gain": gain, "known_heat": model.known_heat}
    first, *others = names(DrawsPayload)
    arrays |= {f"draws_{name}": getattr(model.draws, name) for name in (*others, first)}
    file = io.BytesIO()
    np.savez_compressed(file, about=np.array(about), **arrays)
    return file.getvalue()


def zone_forecast(zone: ZoneView, fan: Fan | ServiceError | None, horizon: float) -> ZoneForecastPayload:
    """The forecast of one zone under one plan, or why there is none."""
    state = zone.now()
    trust = state.trust.at(horizon + zone.period)
    if not isinstance(fan, Fan):
        nothing = (None, None, None, zone.period, Quality.BAD, trust, (), (), ())
        return ZoneForecastPayload(zone.id, _reason(zone, fan), *nothing)
    update, forecast = fan.update, fan.update.forecast
    means = ((output.output, value) for output in fan.outputs for value in output.mean.tolist())
    found = quality(update) if credible(state.status, means, zone.surroundings.limits) else Quality.BAD
    times = (update.time, forecast.issue_time, forecast.valid_time)
    return ZoneForecastPayload(zone.id, None, *times, zone.period, found, trust, fan.origins, fan.levels, fan.outputs)


def _reason(zone: ZoneView, error: ServiceError | None) -> str:
    if isinstance(error, NoModel):
        return f"the estimator '{zone.estimator}' has no scenarios: {error}"
    return str(no_forecast(zone) if error is None else error)
