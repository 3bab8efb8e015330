"""A state folder and a backup are looked through as a whole."""

import asyncio
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from support.fake_zones import make_sample, make_update

from service.cli.main import main
from service.errors import BackupError, ServiceError
from service.store.audit import TRAIL, note
from service.store.backup import write_backup
from service.store.checkpoint import Checkpoint
from service.store.store import CHECKPOINTS, JOURNAL, Store
from service.store.verifying import verify

STEPS = 600


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A state folder of two zones, one of which was reset once, and a backup beside it."""
    folder = tmp_path_factory.mktemp("verified")

    async def fill() -> None:
        store = Store(folder / "state")
        for zone in ("bedroom", "living", "living"):
            if zone == "living":
                await store.forget(zone)
            await store.claim(zone, "f")
            await asyncio.gather(*(store.append(zone, make_sample(step)) for step in range(STEPS)))
            for step in range(STEPS):
                store.record(zone, make_update(step))
            store.checkpoints.save(zone, Checkpoint("f", make_sample(STEPS - 1).time, {}, {}))
        await store.run(store.journal.flush)
        store.close()

    asyncio.run(fill())
    write_backup(folder / "state", "house", folder / "kept.tar")
    return folder


def test_what_is_sound_is_counted(sound: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (sound / "state", sound / "kept.tar"):
        assert verify(path) == (2, 2 * STEPS, 2 * STEPS, 2, 0, ())
        assert main(["verify", str(path)]) == 0
        assert "sound; zones: 2, samples: 1200, rows of history: 1200, checkpoints: 2" in capsys.readouterr().out
    assert sorted(path.name for path in sound.iterdir()) == ["kept.tar", "state"]


DAMAGE = {
    "DELETE FROM samples WHERE zone = 'living' AND time = (SELECT max(time) - 3000 FROM samples)": "zone 'living'",
    "UPDATE samples SET outputs = zeroblob(8) WHERE zone = 'bedroom' AND time % 7 = 0": "zone 'bedroom'",
    "UPDATE history SET mean = 1 WHERE zone = 'living' AND time % 3000 = 0": "rows of the history of zone 'living'",
    "CREATE TRIGGER silent BEFORE INSERT ON samples BEGIN SELECT RAISE(IGNORE); END": "the trigger 'silent'",
    # Reading it fails; of another one reading has no end.
    f"DROP TABLE zones; CREATE VIEW zones AS SELECT abs({-(2**63)}) AS zone": "the view 'zones'",
}


@pytest.mark.parametrize("statement", DAMAGE)
def test_damage_in_the_journal_is_told(
    statement: str, sound: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state = tmp_path / "state"
    state.mkdir()
    with closing(sqlite3.connect(sound / "state" / JOURNAL)) as source, closing(sqlite3.connect(state / JOURNAL)) as to:
        source.backup(to)
        with to:
            to.executescript(statement)
    assert main(["verify", str(state)]) == 1
    told = capsys.readouterr()
    assert DAMAGE[statement] in told.err
    assert ": damaged; " in told.out


def test_a_damaged_checkpoint_and_a_damaged_backup_are_told(sound: Path, tmp_path: Path) -> None:
    backup = tmp_path / "kept.tar"
    content = bytearray((sound / "kept.tar").read_bytes())
    content[len(content) // 2] ^= 1
    backup.write_bytes(content)
    with pytest.raises(BackupError, match="does not match its digest"):
        verify(backup)
    with pytest.raises(ServiceError, match="there is no state"):
        verify(tmp_path)
    state = tmp_path / "state"
    (state / CHECKPOINTS / "living").mkdir(parents=True)
    (state / JOURNAL).write_bytes((sound / "state" / JOURNAL).read_bytes())
    (state / CHECKPOINTS / "living" / "000000000001.npz").write_bytes(b"not one")
    note(state, "key", "key 'one' is created")
    (state / TRAIL).write_bytes((state / TRAIL).read_bytes().replace(b"'one'", b"'two'"))
    checkpoint, trail = verify(state).problems
    assert "000000000001.npz is damaged" in checkpoint
    assert "line 1 was changed" in trail
