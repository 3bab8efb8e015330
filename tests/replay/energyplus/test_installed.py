"""Without EnergyPlus, one sentence says how to install it."""

import ctypes
import importlib.util
from unittest.mock import Mock

import pytest
from support.energyplus import needs_energyplus

from replay.energyplus import library
from replay.energyplus.buildings import BUILDINGS
from replay.energyplus.plant import Plant
from service.cli.main import main


def test_without_the_extra_one_sentence_names_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(library.EnergyPlusMissing, match=r"pip install 'thermogate\[energyplus\]'"):
        Plant(BUILDINGS["timber"])
    assert main(["simulate-energyplus", "--building", "timber", "--out", "unused"]) == 1
    said = capsys.readouterr().err
    assert "EnergyPlus is not installed" in said
    assert len(said.splitlines()) == 1


@needs_energyplus
def test_without_the_library_of_the_system_one_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    library.library.cache_clear()
    missing = OSError("libX11.so.6: cannot open shared object file")
    monkeypatch.setattr(ctypes, "CDLL", Mock(side_effect=missing))
    with pytest.raises(library.EnergyPlusMissing, match="apt-get install libx11-6"):
        library.library()
