"""Sources of kind "prometheus": the history in Prometheus, VictoriaMetrics and others with its range queries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from adapters.series.database import Prometheus
from adapters.series.source import SeriesSource
from service.sources.channel import Binding, SourceKind
from service.sources.series import SeriesChannelConfig, SeriesConfig, series_source


class PrometheusConfig(SeriesConfig):
    """[sources.<name>] of kind "prometheus"."""

    kind: Literal["prometheus"] = "prometheus"


def _build(name: str, table: PrometheusConfig, bindings: Sequence[Binding]) -> SeriesSource:
    return series_source(name, table, Prometheus(table.server), bindings)


KIND = SourceKind("prometheus", PrometheusConfig, SeriesChannelConfig, False, 'query = "..."', _build)
