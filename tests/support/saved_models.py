"""Models of notebooks as earlier versions saved them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import thermogate as tg
from service.store.checkpoint import decode, encode


def as_saved_before(model: Any, folder: Path, settings: Sequence[str] = (), arrays: tuple[str, ...] = ()) -> Any:
    """`model`, saved in `folder` and loaded without these `settings`, and without arrays whose names begin so."""
    model.save(folder / "now.npz")
    now: Any = decode((folder / "now.npz").read_bytes(), folder)
    kept = {name: value for name, value in now.meta["settings"].items() if name not in settings}
    then = {name: value for name, value in now.arrays.items() if not name.startswith(arrays)}
    (folder / "then.npz").write_bytes(encode(now._replace(arrays=then, meta={**now.meta, "settings": kept})))
    return tg.load(folder / "then.npz")
