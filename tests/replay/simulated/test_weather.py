import numpy as np
import pytest

from replay.localtime import midnight
from replay.simulated.weather import KONSTANZ, clear_sky, cos_zenith, solar_time, weather

YEAR_2025 = midnight(2025, 1, 1, "UTC") + 600 * np.arange(365 * 144)


def test_same_arguments_give_the_same_weather_and_another_seed_another() -> None:
    times = YEAR_2025[:1000]
    first, again, other = weather(times, KONSTANZ, 3), weather(times, KONSTANZ, 3), weather(times, KONSTANZ, 4)
    np.testing.assert_array_equal(first, again)
    assert np.abs(first.outdoor - other.outdoor).max() > 0.5


def test_sun_stands_where_astronomy_says() -> None:
    solstice = midnight(2025, 6, 21, "UTC") + 60 * np.arange(1440)
    height = np.degrees(np.arcsin(cos_zenith(solstice, KONSTANZ)))
    assert height.max() == pytest.approx(90 - 47.66 + 23.44, abs=0.3)
    assert height.min() == pytest.approx(-(90 - 47.66) + 23.44, abs=0.3)
    # 9.18 degrees east: the sun is highest 36.7 min before 12 UTC, and 2 min later for the equation of time.
    noon = solstice[np.argmax(height)] - solstice[0]
    assert noon / 60 == pytest.approx(720 - 36.7 + 1.9, abs=1.5)
    assert solar_time(solstice, KONSTANZ)[np.argmax(height)] == pytest.approx(12.0, abs=0.05)


def test_a_year_looks_like_konstanz() -> None:
    sky = weather(YEAR_2025, KONSTANZ, 0)
    assert sky.outdoor.mean() == pytest.approx(10.0, abs=1.5)
    january, july = slice(0, 31 * 144), slice(181 * 144, 212 * 144)
    assert sky.outdoor[july].mean() - sky.outdoor[january].mean() > 14.0
    assert -20 < sky.outdoor.min() < sky.outdoor.max() < 38
    afternoon = sky.outdoor[july].reshape(31, 144).mean(axis=0)
    assert 13 <= np.argmax(afternoon) / 6 <= 16  # UTC; solar time is .6 h ahead
    assert 110 < sky.irradiance.mean() < 160
    assert (sky.irradiance >= 0).all()
    assert (sky.irradiance <= clear_sky(YEAR_2025)).all()
