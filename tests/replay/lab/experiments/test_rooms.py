"""Readers of measured rooms, on small files of the same layout."""

from pathlib import Path

import numpy as np
import pytest
from support.tables import tabled

from replay.errors import ReplayError
from replay.lab.experiments.recordings import at_hand
from replay.lab.experiments.rooms import FILES, ROOMS, read_room


def written(folder: Path, text: str, file: str = "rooms/ou44.csv") -> Path:
    path = folder / file
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8")
    return folder


HEAD = "room,time,T_room,valve_pct,damper_pct,people,T_out,GHI\n"


def test_a_room_is_read_from_the_rows_that_are_its_own(tmp_path: Path) -> None:
    lines = [f"22-508-1,2017-03-21T00:{m}0:00,{20 + m},50,0,1,{'' if m == 3 else 9},6\n" for m in range(6)]
    other = "22-511-2,2017-03-21T00:00:00,18,0,0,0,9,6\n"
    found = read_room("OU44 22-508-1", written(tmp_path, HEAD + other + "".join(lines)))
    assert found.network.inputs == ("T_out", "u_heat", "I_sol")
    np.testing.assert_array_equal(found.series.outputs[:, 0], [20, 21, 22, 23, 24, 25])
    np.testing.assert_array_equal(found.series.inputs, [[9, 500, 6]] * 6)
    assert found.series.times[0] == 1_490_054_400
    assert {"sun_south", "habit_weekend_09"} < {term.name for term in found.network.terms}
    assert found.measured


def test_a_file_that_is_not_there_is_no_recording(tmp_path: Path) -> None:
    assert [read_room(name, tmp_path) for name in ROOMS] == [None] * len(ROOMS)
    assert read_room("housetemp", None) is None
    assert len(FILES) == 7


@tabled
def test_a_file_of_another_layout_is_refused_in_one_sentence(name: str, text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match=said):
        at_hand(written(tmp_path, text, ROOMS[name].file), [name])
