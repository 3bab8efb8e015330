import numpy as np
import pytest

from estimator.heat.sun import clear_sky, sun
from replay.localtime import midnight
from replay.simulated.weather import KONSTANZ, solar_time, weather

YEAR_2025 = midnight(2025, 1, 1, "UTC") + 600 * np.arange(365 * 144)


def test_the_sun_is_highest_at_twelve_by_its_own_time() -> None:
    solstice = midnight(2025, 6, 21, "UTC") + 60 * np.arange(1440)
    # 9.18 degrees east: the sun is highest 36.7 min before 12 UTC, and 2 min later for the equation of time.
    noon = np.argmin(np.abs(solar_time(solstice) - 12.0))
    assert noon == pytest.approx(720 - 36.7 + 1.9, abs=1.5)


def test_a_year_looks_like_konstanz() -> None:
    sky = weather(YEAR_2025, 0)
    assert sky.outdoor.mean() == pytest.approx(10.0, abs=1.5)
    january, july = slice(0, 31 * 144), slice(181 * 144, 212 * 144)
    assert sky.outdoor[july].mean() - sky.outdoor[january].mean() > 14.0
    assert -20 < sky.outdoor.min() < sky.outdoor.max() < 38
    afternoon = sky.outdoor[july].reshape(31, 144).mean(axis=0)
    assert 13 <= np.argmax(afternoon) / 6 <= 16  # UTC; solar time is .6 h ahead
    assert 110 < sky.irradiance.mean() < 160
    assert (sky.irradiance >= 0).all()
    assert (sky.irradiance <= clear_sky(sun(YEAR_2025[:, None], KONSTANZ))).all()
