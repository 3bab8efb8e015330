"""What the paper found in its topology pre-selection, May-June 2025 (Table 3 and section 4.3.3): numbers only."""

from __future__ import annotations

from typing import NamedTuple


class Published(NamedTuple):
    """A row of Table 3; errors in K."""

    label: str
    solar: bool
    states: int
    train_rmse: float
    full_mae: float
    night_mae: float
    day_mae: float
    j_acf: float


TABLE_3 = (
    Published("M1", False, 2, 0.637, 0.508, 0.314, 0.934, 0.136),
    Published("M2", False, 3, 0.369, 0.284, 0.284, 0.560, 0.047),
    Published("M4", False, 4, 0.359, 0.274, 0.256, 0.549, 0.021),
    Published("M4", True, 4, 0.363, 0.277, 0.258, 0.543, 0.051),
    Published("M8", False, 5, 0.365, 0.277, 0.270, 0.533, 0.016),
)
