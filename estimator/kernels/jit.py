"""How every kernel is compiled: plain Numba, a block of particles at a time.

A quantity of a block is an array whose last axis is the particle. The innermost loop runs over that axis and neither
branches nor calls the C library, so that LLVM makes vector instructions of it. Loops over the states of a network may
stand inside it where their number is known to the compiler: from the type of `size`, a tuple of as many entries.
"""

from typing import Any

JIT: Any = {
    "cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_cfunc_wrapper": True,
}  # fmt: skip
"""Kept on disk, without the interpreter lock, 1 / 0 is infinite, multiply and add may be fused; nothing is reordered.

The same inputs give the same bits wherever arrays lie.
"""

PART: Any = JIT | {"no_cpython_wrapper": True}
"""A part of kernels, called from them only: taking apart what Python hands over would take as long to compile as it."""

INLINE: Any = PART | {"forceinline": True}
"""A part that is compiled into its caller: LLVM then knows the shapes of arrays, and with them their strides."""

WIDTH = 32
"""Particles of a block: enough for long loops, few enough that what is known of them stays in the nearest cache."""
