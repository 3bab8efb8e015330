"""Whether EnergyPlus is here, and the reason why what needs it is skipped."""

import pytest

from replay.energyplus.library import EnergyPlusMissing, library


def _why_missing() -> str:
    try:
        library()
    except EnergyPlusMissing as error:
        return str(error)
    return ""


WHY_MISSING = _why_missing()
needs_energyplus = pytest.mark.skipif(bool(WHY_MISSING), reason=WHY_MISSING)
