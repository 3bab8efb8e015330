"""The state folder is nobody's business but the daemon's."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from service.store.checkpoint import Checkpoint
from service.store.store import Store
from service.web.keys import create_key


def test_only_the_owner_can_look_in(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = tmp_path / "var" / "state"
        store = Store(folder)
        store.checkpoints.save("living", Checkpoint("f", 0, {}, {}))
        store.close()
        create_key(folder / "keys.json", "one", "read")
    finally:
        os.umask(before)
    found = {path: stat.S_IMODE(path.stat().st_mode) for path in (folder, *folder.rglob("*"))}
    assert found == {path: 0o700 if path.is_dir() else 0o600 for path in found}
    assert {path.suffix for path in found} >= {".sqlite3", ".npz", ".json"}
