"""Checkpoints survive crashes, damage and changed configurations."""

from __future__ import annotations

import errno
import io
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from service.errors import CheckpointError
from service.store import checkpoint as module
from service.store.checkpoint import Checkpoint, CheckpointStore

ARRAYS = {
    "log_weights": np.array([-np.inf, -0.0, np.nan, 5e-324, 0.1 + 0.2]),
    "bit_generator": np.array([2**64 - 1, 0, 1], dtype=np.uint64),
    "flags": np.array([True, False]),
    "covariance": np.arange(24.0).reshape(2, 3, 4)[:, ::2],
    "step": np.int64(5),
    "empty": np.empty((0, 3)),
    "file": np.array([1.0]),
}


def make(step: int, fingerprint: str = "f1", scale: float = 1.0) -> Checkpoint:
    arrays = {name: np.asarray(array) for name, array in ARRAYS.items()} | {"scale": np.array([scale])}
    return Checkpoint(fingerprint, step, arrays, {"time": 1_746_230_400, "segment": step, "held": [1.5, None]})


def same(left: Mapping[str, np.ndarray], right: Mapping[str, np.ndarray]) -> bool:
    return left.keys() == right.keys() and all(
        np.asarray(left[name]).dtype == right[name].dtype
        and np.asarray(left[name]).shape == right[name].shape
        and np.asarray(left[name]).tobytes() == right[name].tobytes()
        for name in left
    )


@pytest.fixture
def store(tmp_path: Path) -> CheckpointStore:
    return CheckpointStore(tmp_path / "checkpoints")


def files(store: CheckpointStore, zone: str = "living") -> list[str]:
    return sorted(path.name for path in (store.path / zone).iterdir())


def test_round_trip_is_bit_exact(store: CheckpointStore) -> None:
    path = store.save("living", make(12))
    assert path.name == "000000000012.npz"
    loaded = store.load("living", "f1")
    assert loaded is not None
    assert same(make(12).arrays, loaded.arrays)
    assert (loaded.fingerprint, loaded.step, loaded.meta) == ("f1", 12, make(12).meta)


def test_the_file_is_a_plain_npz_without_pickle(store: CheckpointStore) -> None:
    with np.load(store.save("living", make(1)), allow_pickle=False) as archive:
        assert np.array_equal(archive["array.bit_generator"], ARRAYS["bit_generator"])


def test_objects_are_never_stored(store: CheckpointStore) -> None:
    with pytest.raises(CheckpointError, match="holds Python objects"):
        store.save("living", make(1)._replace(arrays={"bad": np.array([object()])}))


def check_damage(store: CheckpointStore, content: bytes, original: bytes, caplog: pytest.LogCaptureFixture) -> None:
    """A newest checkpoint with `content` is either whole or set aside for the one before."""
    path = store.path / "living" / "000000000002.npz"
    path.write_bytes(content)
    loaded = store.load("living", "f1")
    assert loaded is not None
    if loaded.step == 2:
        assert same(make(2).arrays, loaded.arrays)
        assert loaded.meta == make(2).meta
        return
    assert loaded.step == 1
    assert same(make(1).arrays, loaded.arrays)
    assert path.with_name("000000000002.npz.corrupt").read_bytes() == content
    assert "is damaged" in caplog.text
    caplog.clear()
    assert not path.exists()


def test_truncation_anywhere_is_noticed(store: CheckpointStore, caplog: pytest.LogCaptureFixture) -> None:
    store.save("living", make(1))
    path = store.save("living", make(2))
    original = path.read_bytes()
    for length in [*range(0, len(original), 37), len(original) - 1]:
        check_damage(store, original[:length], original, caplog)
        assert not path.exists(), f"{length} of {len(original)} bytes passed for a whole checkpoint"


def test_flipped_bytes_never_give_other_numbers(store: CheckpointStore, caplog: pytest.LogCaptureFixture) -> None:
    store.save("living", make(1))
    original = store.save("living", make(2)).read_bytes()
    for offset in range(0, len(original), 5):
        content = bytearray(original)
        content[offset] ^= 0xFF
        check_damage(store, bytes(content), original, caplog)


def test_a_valid_archive_with_swapped_arrays_is_damaged(
    store: CheckpointStore, caplog: pytest.LogCaptureFixture
) -> None:
    store.save("living", make(1))
    path = store.save("living", make(2))
    original = path.read_bytes()
    with np.load(io.BytesIO(original)) as archive:
        parts = dict(archive)
    parts["array.scale"] = np.array([3.0])
    buffer = io.BytesIO()
    np.savez(buffer, **parts)
    check_damage(store, buffer.getvalue(), original, caplog)
    assert not path.exists()


def test_a_newer_format_with_another_digest_is_not_taken_for_damage(store: CheckpointStore) -> None:
    path = store.save("living", make(1))
    header = np.frombuffer(json.dumps({"format": 9}).encode(), dtype=np.uint8)
    with path.open("wb") as file:
        np.savez(file, header=header)
    with pytest.raises(CheckpointError, match="format 9"):
        store.load("living", "f1")


def test_an_unusable_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    store = CheckpointStore(tmp_path / "file")
    with pytest.raises(CheckpointError, match="cannot be written"):
        store.save("living", make(1))


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EACCES, errno.EIO])
def test_a_folder_that_cannot_be_listed_is_not_an_empty_one(
    store: CheckpointStore, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """Taken for empty, its zone would begin anew, and a backup would be without it; retention would end for good."""
    store.save("living", make(1))

    def refuse(path: object) -> NoReturn:
        raise OSError(number, os.strerror(number), str(path))

    for function in ("listdir", "scandir"):
        monkeypatch.setattr(os, function, refuse)
    for ask in (store.oldest, store.files, lambda zone: store.load(zone, "f1")):
        with pytest.raises(CheckpointError, match=r"living cannot be (listed|read)"):
            ask("living")


def test_reset_sets_everything_aside(store: CheckpointStore) -> None:
    assert store.reset("living") is None
    content = store.save("living", make(1)).read_bytes()
    store.save("bedroom", make(1))
    aside = store.reset("living")
    assert aside is not None
    assert aside.name.startswith("reset-")
    assert (aside / "000000000001.npz").read_bytes() == content
    assert store.load("living", "another") is None
    assert store.load("bedroom", "f1") is not None
    store.save("living", make(1, "another"))
    assert store.load("living", "another") is not None
    assert store.reset("living") not in (None, aside)


def test_a_checkpoint_of_another_zone_is_not_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Zones alike have the same fingerprint."""
    store = CheckpointStore(tmp_path)
    store.save("kitchen", make(300))
    path = store.save("attic", make(600))
    path.rename(tmp_path / "kitchen" / path.name)
    found = store.load("kitchen", "f1")
    assert found is not None
    assert (found.step, found.zone) == (300, "kitchen")
    assert "it is of zone 'attic'" in caplog.text


def test_a_file_that_unpacks_to_more_than_it_is_is_refused_unread(tmp_path: Path) -> None:
    bomb = io.BytesIO()
    np.savez_compressed(bomb, header=np.zeros(2**24, dtype=np.uint8))
    with pytest.raises(ValueError, match="compressed"):
        module.decode(bomb.getvalue(), tmp_path / "bomb.npz")
    claims = io.BytesIO()
    with zipfile.ZipFile(claims, "w") as archive:
        archive.writestr("header.npy", b"x" * 100)
    content = claims.getvalue().replace((100).to_bytes(4, "little"), (2**31).to_bytes(4, "little"))
    with pytest.raises(module.DAMAGE):
        module.decode(content, tmp_path / "claims.npz")
