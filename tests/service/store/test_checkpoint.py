"""Checkpoints survive crashes, damage and changed configurations."""

import errno
import io
import json
import os
import zipfile
from collections.abc import Iterator, Mapping
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


def bits(arrays: Mapping[str, np.ndarray]) -> dict[str, tuple[object, ...]]:
    return {name: (array.dtype, array.shape, array.tobytes()) for name, array in arrays.items()}


@pytest.fixture
def store(tmp_path: Path) -> CheckpointStore:
    return CheckpointStore(tmp_path / "checkpoints")


def test_round_trip_is_bit_exact_in_a_plain_npz(store: CheckpointStore) -> None:
    path = store.save("living", make(12))
    assert path.name == "000000000012.npz"
    loaded = store.load("living", "f1")
    assert bits(make(12).arrays) == bits(loaded.arrays)
    assert (loaded.fingerprint, loaded.step, loaded.meta) == ("f1", 12, make(12).meta)
    with np.load(path, allow_pickle=False) as archive:
        assert np.array_equal(archive["array.bit_generator"], ARRAYS["bit_generator"])
    with pytest.raises(CheckpointError, match="holds Python objects"):
        store.save("living", make(1)._replace(arrays={"bad": np.array([object()])}))


def broken(original: bytes) -> Iterator[tuple[bytes, bool]]:
    """Damaged contents, and whether each is certain to be of no use: a flipped bit may be nobody's."""
    yield from ((original[:length], True) for length in (*range(0, len(original), 211), len(original) - 1))
    for offset in range(0, len(original), 17):
        content = bytearray(original)
        content[offset] ^= 0xFF
        yield bytes(content), False
    with np.load(io.BytesIO(original)) as archive:
        parts = dict(archive)
    swapped = io.BytesIO()
    np.savez(swapped, **parts | {"array.scale": np.array([3.0])})
    yield swapped.getvalue(), True


def test_what_is_damaged_gives_no_other_numbers_and_is_set_aside(
    store: CheckpointStore, caplog: pytest.LogCaptureFixture
) -> None:
    store.save("living", make(1))
    path = store.save("living", make(2))
    for content, certain in broken(path.read_bytes()):
        path.write_bytes(content)
        loaded = store.load("living", "f1")
        assert bits(make(loaded.step).arrays) == bits(loaded.arrays)
        assert loaded.meta == make(loaded.step).meta
        if loaded.step == 2:
            assert not certain
            continue
        assert path.with_name("000000000002.npz.corrupt").read_bytes() == content
        assert "is damaged" in caplog.text
        caplog.clear()
        assert not path.exists()


def test_a_newer_format_with_another_digest_is_not_taken_for_damage(store: CheckpointStore) -> None:
    path = store.save("living", make(1))
    header = np.frombuffer(json.dumps({"format": 9}).encode(), dtype=np.uint8)
    with path.open("wb") as file:
        np.savez(file, header=header)
    with pytest.raises(CheckpointError, match="format 9"):
        store.load("living", "f1")


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


def test_a_file_whose_name_looks_like_a_number_and_is_none_is_left_alone(store: CheckpointStore) -> None:
    saved = store.save("living", make(1))
    saved.with_name("\N{SUPERSCRIPT TWO}.npz").write_bytes(b"")
    assert store.files("living") == [saved]


def test_a_checkpoint_of_another_zone_is_not_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Zones alike have the same fingerprint."""
    store = CheckpointStore(tmp_path)
    store.save("kitchen", make(300))
    path = store.save("attic", make(600))
    path.rename(tmp_path / "kitchen" / path.name)
    found = store.load("kitchen", "f1")
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
