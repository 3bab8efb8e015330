"""How every kernel is compiled: plain Numba, one particle after the other."""

from __future__ import annotations

from typing import Any

JIT: Any = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
"""Kept on disk, without the interpreter lock, 1 / 0 is infinite, multiply and add may be fused; nothing is reordered.

The same inputs give the same bits wherever arrays lie.
"""

INLINE: Any = JIT | {"forceinline": True}
"""How what kernels are made of is compiled: a call would hand over every array of its arguments, field by field."""
