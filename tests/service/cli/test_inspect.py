"""`thermogate inspect` on a checkpoint of a zone."""

import re
from pathlib import Path

import pytest
from support.zone_samples import sample, worker

from service.cli.main import main
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot


def test_the_zone_is_told_wherever_the_file_lies_and_damage_is_named(
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
    content = path.read_bytes()
    for part in (content[: len(content) // 2], content[:500] + b"\x00" + content[501:], b""):
        copied.write_bytes(part)
        assert main(["inspect", str(copied)]) == 1
        told = capsys.readouterr()
        assert told.out == ""
        assert re.fullmatch(rf"thermogate: {copied} is damaged \(.*\); the daemon sets such a file .*\n", told.err)
