"""How the forecasts of a zone have turned out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class HorizonSkill(NamedTuple):
    """Verified forecasts of one horizon. Temperatures are K; NaN where nothing was verified."""

    lead: int
    """From the last sample that the forecast knew to the one that it is about, s."""
    forecasts: int
    coverage: float
    """Share of the forecasts whose interval at `Skill.level` held what came."""
    crps: float
    rmse: float
    width: float
    """Mean width of those intervals."""
    persistence_rmse: float
    """Of a forecast that nothing changes."""
    arx_rmse: float
    """Of a linear regression on past outputs and inputs, learned online beside the estimator."""

    @property
    def against_persistence(self) -> float:
        """Share by which the RMSE is smaller than that of persistence; negative where it is larger."""
        return _smaller(self.rmse, self.persistence_rmse)

    @property
    def against_arx(self) -> float:
        """The same against the ARX model."""
        return _smaller(self.rmse, self.arx_rmse)


class Skill(NamedTuple):
    """What a zone's own forecasts were worth, horizon by horizon from the shortest."""

    time: int
    """UTC s of the newest sample that was compared with a forecast."""
    level: float
    windows: Mapping[int, tuple[HorizonSkill, ...]]
    """By the number of days that each window looks back."""
    weights: Mapping[str, tuple[float, ...]]
    """What each member of a bank weighs at the horizons; empty where there is no bank."""


def _smaller(own: float, other: float) -> float:
    return 1.0 - own / other if other > 0.0 else float("nan")
