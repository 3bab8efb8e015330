"""How far a command is."""

from types import SimpleNamespace

from numba.core.event import end_event, start_event

from service.recordings import progress
from service.recordings.progress import Progress


def test_compiling_is_announced_once_and_left_out_of_the_estimate(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("tqdm.std.time", lambda: now[0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(time=lambda: now[0]))
    with Progress("fit", 1000, True) as bar:
        for _ in range(2):
            start_event("numba:compiler_lock")
            start_event("numba:compile")
            now[0] += 50.0
            end_event("numba:compile")
            end_event("numba:compiler_lock")
        now[0] += 1.0
        bar.update(100)
    shown = capsys.readouterr().err
    assert shown.count("compiling") == 1
    assert "100/1000 [01:41<00:09, 100.00 samples/s]" in shown
