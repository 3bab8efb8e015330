"""Without EnergyPlus, one sentence says how to install it."""

import ctypes
import importlib.util

import pytest
from support.energyplus import needs_energyplus

from replay.energyplus import library
from replay.energyplus.buildings import BUILDINGS
from replay.energyplus.plant import Plant


def test_without_the_extra_one_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(library.EnergyPlusMissing, match=r"pip install 'thermogate\[energyplus\]'"):
        Plant(BUILDINGS["timber"])


@needs_energyplus
def test_without_the_library_of_the_system_one_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: str) -> None:
        raise OSError("libX11.so.6: cannot open shared object file")

    library.library.cache_clear()
    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with pytest.raises(library.EnergyPlusMissing, match="apt-get install libx11-6"):
        library.library()
