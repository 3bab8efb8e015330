"""Bad telemetry is counted by kind and shown; it crashes no zone, poisons no state and reaches no neighbour."""

import json
import math
from datetime import UTC, datetime, timedelta

import pytest
from support import sites

FAULTS = {
    20: {"T_i": "warm"},
    21: {"T_i": "nan"},
    22: {"T_out": "inf"},
    23: {"T_i": "-273"},
    24: {"T_i": "1e308"},
    25: {"time": "2025-01-01 02:05:00"},
    26: {"time": "yesterday"},
    27: {"T_i": ""},
    28: {"u_heat": "-inf"},
    30: {"T_i": "79.9"},
}
"""Row number to the cells it gets instead; 79.9 degC is in range, but no particle explains it."""

KINDS = {
    "non_numeric": 1,
    "not_finite": 3,
    "out_of_range": 2,
    "naive_timestamp": 3,
    "bad_timestamp": 3,
    "duplicated": 3,
}


def rows(count, changes):
    begin = datetime(2025, 1, 1, tzinfo=UTC)
    yield "time,T_i,T_out,u_heat"
    for k in range(count):
        cells = {
            "time": (begin + timedelta(minutes=5 * k)).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "T_i": f"{20 + math.sin(k / 15):.3f}",
            "T_out": f"{3 + math.cos(k / 40):.2f}",
            "u_heat": "1500" if k % 6 < 2 else "0",
        } | changes.get(k, {})
        yield ",".join(cells.values())
        if changes and k == 35:
            yield ",".join(cells.values())


def test_every_kind_is_counted_and_the_zone_goes_on(tmp_path):
    sources, zones = {}, []
    columns = {name: {"column": name} for name in sites.UNITS}
    for name, changes in (("clean", {}), ("dirty", FAULTS)):
        (tmp_path / f"{name}.csv").write_text("\n".join(rows(60, changes)) + "\n")
        sources[name] = {"kind": "csv", "files": [f"{name}.csv"], "timestamp": {"column": "time"}}
        zones.append(sites.zone(name, name, columns, period="5min", estimator_options={"particles": 200}))
    found = sites.replayed(sites.written(tmp_path, sources, zones), tmp_path / "out")
    told = json.loads((tmp_path / "out" / "summary.json").read_text())["zones"]
    assert {name: zone["faults"] for name, zone in told.items()} == {"clean": {}, "dirty": KINDS}
    history, neighbour = found["dirty"], found["clean"]
    assert len(neighbour) == 60
    assert len(history) == 60, "missing outputs and held inputs are bridged"
    assert history[-1]["mean"] == pytest.approx(neighbour[-1]["y"], abs=1.0)
    for row in history[1:]:
        assert math.isfinite(row["mean"])
        assert 0 < row["sd"] < 50
    # The row that no particle explains is flagged, not learned from.
    assert (history[30]["log_likelihood"], history[30]["gate"]) == (None, 0)
    assert history[31]["log_likelihood"] is not None
