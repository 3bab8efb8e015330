"""Both Ecolar periods through the daemon: synthetic stand-ins, or the recording that THERMOGATE_ECOLAR_CSV names."""

import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.harness import EXAMPLES, Daemon

from replay.scores import coverage, rmse
from replay.simulated.ecolar import write_standin

RECORDING = os.environ.get("THERMOGATE_ECOLAR_CSV")
# First and last whole hour, UTC, of what each stand-in must bring.
PERIODS = {"spring": ("2025-05-02T22", "2025-06-01T21"), "autumn": ("2025-10-19T22", "2025-11-02T22")}
DAYS = {"spring": 30, "autumn": 14}
# Of the autumn, two weeks around the change of clocks, by local date; `make replay-ecolar` reads all of it.
SHOWN = {"spring": ("2025-05-03", "2025-06-02"), "autumn": ("2025-10-20", "2025-11-03")}

CASES = {"recording": Path(RECORDING)} if RECORDING else dict.fromkeys(PERIODS)


@pytest.mark.parametrize("case", CASES)
def test_a_recorded_period_streams_through_the_daemon(case, tmp_path):
    path = CASES[case]
    if path is None:
        path = tmp_path / f"ecolar-{case}-SYNTHETIC.csv"
        header, *rows = write_standin(path, case).read_text().splitlines(keepends=True)
        first, end = SHOWN[case]
        path.write_text("".join([header, *(row for row in rows if first <= row < end)]))
    settings = {
        "sources.recording.files": [str(path)],
        "site.state_dir": str(tmp_path / "state"),
        # The paper's 20,000 particles take minutes; `make replay-ecolar` runs them.
        "zones.0.estimator_options.particles": 300,
    }
    with Daemon(EXAMPLES / "ecolar.toml", tmp_path / "log", settings) as daemon:
        daemon.wait_until_ended()
        rows = daemon.history("living")
        status, parameters = daemon.get("/zones/living/parameters")
        code = daemon.terminate()
    assert (status, code) == (200, 0)
    assert "Traceback" not in daemon.log()
    y, mean, lower, upper = (
        np.array([np.nan if row[name] is None else row[name] for row in rows])
        for name in ("y", "mean", "lower", "upper")
    )
    assert 0.9 < coverage(y, lower, upper) <= 1.0
    assert rmse(y - mean) < 0.5
    assert len(parameters["parameters"]) == 10
    # Strictly increasing on the grid in UTC: the duplicated hour of the clock change neither repeats nor vanishes.
    times = np.array([np.datetime64(row["time"].rstrip("Z")) for row in rows])
    steps = np.diff(times) / np.timedelta64(300, "s")
    assert (steps >= 1).all()
    assert (steps == np.round(steps)).all()
    # Every gap starts a new segment, and nothing else does.
    for (before, after), step in zip(pairwise(rows), steps, strict=True):
        assert (after["segment"] == before["segment"] + 1) == (step > 1), after["time"]
    if not RECORDING:
        first, last = PERIODS[case]
        assert rows[0]["time"] < first + ":59"
        assert rows[-1]["time"] > last
        assert len(rows) > 0.9 * DAYS[case] * 288
        if case == "autumn":
            hour = [row for row in rows if row["time"].startswith(("2025-10-26T00", "2025-10-26T01"))]
            assert len(hour) == 24, "both passes of the repeated hour are there"
