"""How far a slow command is. Compiling is announced, and spoils no estimate of the time that is left."""

import sys
import time
from typing import Any

from numba.core.event import Event, Listener, register, unregister
from tqdm import tqdm

SLOW = 2.0
"""s after which a command shows how far it is."""
_SMOOTHING = 0.05
"""Weight of the newest speed in the estimate: processes beside each other tell of what they have done by turns."""
_COMPILER, _COMPILING = "numba:compiler_lock", "numba:compile"
"""Events of Numba: a kernel is compiled or read from the cache; it is compiled."""


class Kernels(Listener):
    """What Numba does from now on, until it is closed: the first time that it compiles is announced."""

    def __init__(self) -> None:
        self.seconds = 0.0
        """s that kernels took to compile or to read."""
        self._depth, self._began, self._announced = 0, 0.0, False
        register(_COMPILER, self)
        register(_COMPILING, self)

    def on_start(self, event: Event) -> None:
        if event.kind == _COMPILER:
            self._began = self._began if self._depth else time.time()
            self._depth += 1
        elif not self._announced:
            self._announced = True
            tqdm.write("compiling the estimators, which takes up to a minute once; later starts find them", sys.stderr)

    def on_end(self, event: Event) -> None:
        if event.kind == _COMPILER:
            self._depth -= 1
            self.seconds += 0.0 if self._depth else time.time() - self._began

    def close(self) -> None:
        unregister(_COMPILER, self)
        unregister(_COMPILING, self)


class Progress(tqdm):
    """A bar that appears after SLOW s; with `shown` None on a terminal only."""

    _kernels: Kernels | None = None

    def __init__(self, what: str, total: int | None, shown: bool | None, unit: str = "samples", done: int = 0) -> None:
        hidden = None if shown is None else not shown
        looks = {"desc": what, "unit": f" {unit}", "delay": SLOW, "smoothing": _SMOOTHING}
        super().__init__(total=total, initial=done, disable=hidden, **looks)
        self._kernels = None if self.disable else Kernels()
        self._left_out = 0.0

    def update(self, n: float | None = 1) -> Any:
        """Note that `n` more are done."""
        if self._kernels is not None:
            self.last_print_t += self._kernels.seconds - self._left_out
            self._left_out = self._kernels.seconds
        return super().update(n)

    def close(self) -> None:
        if self._kernels is not None:
            self._kernels.close()
            self._kernels = None
        super().close()
