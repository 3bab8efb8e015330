"""`thermogate inspect` on a checkpoint of a zone."""

from pathlib import Path

import pytest
from support.zone_samples import sample, worker

from service.cli.main import main
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot


def test_the_zone_is_told_wherever_the_file_lies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    learned = worker()
    learned.step(sample(0))
    checkpoint = snapshot.take(learned, "mark", "rbpf")
    assert checkpoint is not None
    path = CheckpointStore(tmp_path / "checkpoints").save("living", checkpoint)
    copied = tmp_path / "copied.npz"
    copied.write_bytes(path.read_bytes())
    monkeypatch.chdir(path.parent)
    for file in (path.name, str(copied)):
        assert main(["inspect", file]) == 0
        assert capsys.readouterr().out.splitlines()[0].split() == ["zone", "living"]
