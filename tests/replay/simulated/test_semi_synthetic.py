from pathlib import Path

import numpy as np
import pytest
from support.tables import tabled

from replay.errors import WeatherFileError
from replay.simulated.semi_synthetic import generate, read_weather


def test_same_seed_same_numbers_and_fewer_days_are_a_beginning() -> None:
    long, short = generate(None, days=4, seed=5), generate(None, days=2, seed=5)
    assert len(short.times) == 2 * 144
    np.testing.assert_array_equal(long.truth.states[: 2 * 144], short.truth.states)
    again, other = (generate(None, days=2, seed=seed).columns for seed in (5, 6))
    for name in ("T_i", "T_out", "I_sol"):
        np.testing.assert_array_equal(again[name], short.columns[name])
        assert (other[name] != short.columns[name]).any()


def test_label_marks_the_interval_that_ends_at_the_step() -> None:
    truth = generate(None, days=30, seed=1).truth
    assert truth.disturbance_dominated.any()
    assert not truth.disturbance_dominated[0]
    np.testing.assert_array_equal(truth.disturbance_dominated[1:], truth.unmeasured_gain[:-1] > 0)


@tabled
def test_a_weather_file_that_is_none_is_refused_in_one_sentence(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "weather.csv"
    path.write_text(text)
    with pytest.raises(WeatherFileError, match=complaint) as caught:
        generate(path, seed=1)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("offset", ["", "Z", "+00:00"])
def test_the_times_of_a_weather_file_are_utc_and_may_say_so(offset: str, tmp_path: Path) -> None:
    path = tmp_path / "weather.csv"
    rows = [f"2016-04-10 00:{minute}:00{offset},3,0" for minute in ("00", "10")]
    path.write_text("\n".join(["timestamp_utc,T_out_degC,GHI_W_m2", *rows]) + "\n")
    assert read_weather(path)[0].tolist() == [1460246400, 1460247000]
