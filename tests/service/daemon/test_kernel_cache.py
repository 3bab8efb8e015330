"""A cache of compiled kernels that is damaged, or cannot be written: kernels are compiled, and one sentence says so."""

import errno
import importlib.util
import os
from collections.abc import Callable

import pytest
from numba.core import caching, config

from service.daemon import kernel_cache
from service.daemon.kernel_cache import guard_kernel_cache

SOURCE = "from numba import njit\n\n@njit(cache=True)\ndef plus_one(x):\n    return x + 1\n"


@pytest.fixture
def kernel(tmp_path, monkeypatch):
    """A function that Numba has not looked for in its cache yet, the same one each time."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(kernel_cache, "_told", set())
    guard_kernel_cache()
    path = tmp_path / "sample_kernel.py"
    path.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("sample_kernel", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.plus_one

    return load


def files(tmp_path, ending):
    return sorted((tmp_path / "cache").rglob(f"*.{ending}"))


def test_a_sound_cache_is_used_whoever_wrote_it(kernel, tmp_path, caplog):
    caplog.set_level("INFO")
    assert kernel()(1) == 2
    assert [record.message.partition(",")[0] for record in caplog.records] == ["compiling the estimators"]
    caplog.clear()
    (data,) = files(tmp_path, "nbc")
    for content in (data.read_bytes(), data.read_bytes().rpartition(kernel_cache._MARK)[0]):
        # Numba by itself writes no mark.
        data.write_bytes(content)
        again = kernel()
        assert again(1) == 2
        assert sum(again.stats.cache_hits.values()) == 1
    assert not caplog.records


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "truncated": lambda content: content[: len(content) // 2],
    "a bit": lambda content: content[:300] + bytes([content[300] ^ 1]) + content[301:],
}


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_cache_is_set_aside_and_compiled_anew(kernel, tmp_path, caplog, damage, ending):
    assert kernel()(1) == 2
    for path in files(tmp_path, ending):
        path.write_bytes(DAMAGE[damage](path.read_bytes()))
    assert kernel()(1) == 2
    if ending == "nbc" or damage == "truncated":
        (sentence,) = caplog.messages
        assert "damaged" in sentence
        assert str(tmp_path / "cache") in sentence
        assert files(tmp_path, "nbi.damaged")
    third = kernel()
    assert third(1) == 2
    assert sum(third.stats.cache_hits.values()) == 1, "and it is whole again"


@pytest.mark.parametrize("part", ["folder", "nbi", "nbc"])
@pytest.mark.parametrize("how", ["mode", "owner"])
def test_a_cache_that_others_can_write_is_not_used(kernel, tmp_path, caplog, part, how):
    """What lies in it is run, as code and as pickles."""
    assert kernel()(1) == 2
    (index,) = files(tmp_path, "nbi")
    (open_to_all,) = [index.parent] if part == "folder" else files(tmp_path, part)
    if how == "mode":
        open_to_all.chmod(0o777)
    elif os.geteuid() == 0:
        os.chown(open_to_all, 65534, -1)
    else:
        pytest.skip("only root can give a file away")
    before = index.read_bytes()
    again = kernel()
    assert again(1) == 2
    assert not again.stats.cache_hits
    assert index.read_bytes() == before
    (sentence,) = caplog.messages
    assert f"say: {'chmod go-w' if part == 'folder' else 'rm'} {open_to_all}, " in sentence


def test_a_cache_that_cannot_be_written_costs_a_compilation(kernel, caplog, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "_open_for_write", full)
    assert [kernel()(1), kernel()(2)] == [2, 3]
    (sentence,) = caplog.messages
    assert "No space left on device" in sentence
    assert "NUMBA_CACHE_DIR" in sentence
