"""`python -m replay.measuring.bench.plain SIZE`: the comparison as JSON, for the processor in Numba's environment."""

from __future__ import annotations

import json
import sys

from replay.measuring.bench.sections.plain import compared
from replay.measuring.bench.sizes import SIZES

print(json.dumps(compared(SIZES[sys.argv[1]])))
