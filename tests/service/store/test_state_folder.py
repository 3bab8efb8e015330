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
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE((folder / "checkpoints").stat().st_mode) == 0o700
