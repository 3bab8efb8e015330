"""`python -m replay.bench.plain SIZE`: the comparison on the processor that Numba's environment names, as JSON."""

from __future__ import annotations

import json
import sys

from replay.bench.plain.measure import compared
from replay.bench.sizes import SIZES

print(json.dumps(compared(SIZES[sys.argv[1]])))
