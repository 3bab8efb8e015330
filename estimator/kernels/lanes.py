"""Lanes: eight particles in one processor register, as values inside Numba kernels.

A loop that the compiler may or may not turn into vector instructions depends on what it can prove about arrays; a value
that *is* a vector does not. `lanes` is a Numba type of eight float64 with arithmetic, loads and stores; LLVM maps it to
what the processor has: one register of AVX-512, two of AVX2, four of NEON.

The same arithmetic is there at two levels. In a kernel, lanes are ordinary values with operators. Where code depends
on the number of states it is written by Python: `Value` wraps an LLVM vector and has the same operators, so a plain
function over numbers, arrays or Values (`estimator.kernels.algebra`) computes, or writes code, as its arguments are.

Multiply and add may be fused; nothing is reordered. The same inputs give the same bits wherever arrays lie.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from math import inf
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 8

JIT: Any = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
"""How every kernel is compiled: without the interpreter lock, 1 / 0 is infinite, multiply and add may be fused."""

INT32, WORD, BIT = ir.IntType(32), ir.IntType(64), ir.IntType(1)
DOUBLES, FLOATS, WORDS, INTS, BITS = (
    ir.VectorType(kind, LANES) for kind in (ir.DoubleType(), ir.FloatType(), WORD, INT32, BIT)
)
_FUSED = ("contract",)
_SUFFIX = {DOUBLES: f"v{LANES}f64", FLOATS: f"v{LANES}f32"}


class Value:
    """Eight floating-point numbers in code that is being written; the bits of their kind are as many integers."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder, self.value = builder, value

    def __add__(self, other: Any) -> Value:
        return self.of(self.builder.fadd(self.value, self._operand(other), flags=_FUSED))

    def __sub__(self, other: Any) -> Value:
        return self.of(self.builder.fsub(self.value, self._operand(other), flags=_FUSED))

    def __rsub__(self, other: Any) -> Value:
        return self.of(self.builder.fsub(self._operand(other), self.value, flags=_FUSED))

    def __mul__(self, other: Any) -> Value:
        return self.of(self.builder.fmul(self.value, self._operand(other), flags=_FUSED))

    def __truediv__(self, other: Any) -> Value:
        return self.of(self.builder.fdiv(self.value, self._operand(other)))

    def __rtruediv__(self, other: Any) -> Value:
        return self.of(self.builder.fdiv(self._operand(other), self.value))

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Value:
        return self.of(self.builder.fneg(self.value))

    def __abs__(self) -> Value:
        return self._call("llvm.fabs")

    def sqrt(self) -> Value:
        """Square roots."""
        return self._call("llvm.sqrt")

    def minimum(self, other: Any) -> Value:
        """The smaller of each pair; the other where one is not a number."""
        return self.chosen(self.below(other), other)

    def maximum(self, other: Any) -> Value:
        """The larger of each pair; the other where one is not a number."""
        return self.chosen(self.above(other), other)

    def below(self, other: Any) -> ir.Value:
        """Whether each is less than the other."""
        return self.builder.fcmp_ordered("<", self.value, self._operand(other))

    def above(self, other: Any) -> ir.Value:
        """Whether each is greater than the other."""
        return self.builder.fcmp_ordered(">", self.value, self._operand(other))

    def chosen(self, condition: ir.Value, other: Any) -> Value:
        """These where the condition holds, the others elsewhere."""
        return self.of(self.builder.select(condition, self.value, self._operand(other)))

    def of(self, value: ir.Value) -> Value:
        """Another vector of the same code."""
        return Value(self.builder, value)

    def _call(self, name: str) -> Value:
        kind = self.value.type
        function = ir.FunctionType(kind, [kind])
        callee = cgutils.get_or_insert_function(self.builder.module, function, f"{name}.{_SUFFIX[kind]}")
        return self.of(self.builder.call(callee, [self.value]))

    def _operand(self, other: Any) -> ir.Value:
        return other.value if isinstance(other, Value) else repeated(self.value.type, float(other))


def repeated(kind: ir.VectorType, number: float | int) -> ir.Constant:
    """Eight times one number."""
    return ir.Constant(kind, [number] * LANES)


def splat(builder: ir.IRBuilder, scalar: ir.Value, kind: ir.VectorType) -> ir.Value:
    """Eight times one scalar that is not known yet."""
    nothing = ir.Constant(kind, ir.Undefined)
    single = builder.insert_element(nothing, scalar, ir.Constant(INT32, 0))
    return builder.shuffle_vector(single, nothing, repeated(INTS, 0))


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name="lanes")


class _Mask(types.Type):
    def __init__(self) -> None:
        super().__init__(name="lane_mask")


lanes, mask = _Lanes(), _Mask()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, DOUBLES)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, BITS)


def as_value(context: Any, builder: ir.IRBuilder, kind: types.Type, value: ir.Value) -> Value:
    """An argument of a kernel: lanes, or a number for all of them."""
    if isinstance(kind, _Lanes):
        return Value(builder, value)
    return Value(builder, splat(builder, context.cast(builder, value, kind, types.float64), DOUBLES))


def _lower(write: Callable[..., Value]) -> Callable[..., ir.Value]:
    def codegen(context: Any, builder: ir.IRBuilder, sig: Any, values: Sequence[ir.Value]) -> ir.Value:
        return write(*(as_value(context, builder, k, v) for k, v in zip(sig.args, values, strict=True))).value

    return codegen


def _binary_operator(symbol: Callable[[Any, Any], Any]) -> None:
    """Let `symbol` work in kernels on lanes, and on lanes and numbers."""

    @infer_global(symbol)
    class Typing(AbstractTemplate):
        def generic(self, arguments: Sequence[types.Type], keywords: Any) -> Any:
            ours = [isinstance(kind, _Lanes) for kind in arguments]
            if len(arguments) == 2 and any(ours) and all(isinstance(kind, _Lanes | types.Number) for kind in arguments):
                return signature(lanes, *arguments)
            return None

    for kinds in ((_Lanes, _Lanes), (_Lanes, types.Number), (types.Number, _Lanes)):
        lower_builtin(symbol, *kinds)(_lower(symbol))


for _symbol in (operator.add, operator.sub, operator.mul, operator.truediv):
    _binary_operator(_symbol)


def unary(write: Callable[[Value], Value]) -> Any:
    """A function of one Value as a function of lanes in kernels."""

    @intrinsic
    def function(typingctx, x):  # type: ignore[no-untyped-def]
        return lanes(x), _lower(write)

    return function


def binary(write: Callable[[Value, Value], Value]) -> Any:
    """A function of two Values as a function of lanes, or a number for all of them, in kernels."""

    @intrinsic
    def function(typingctx, x, y):  # type: ignore[no-untyped-def]
        return lanes(x, y), _lower(write)

    return function


minimum = binary(Value.minimum)
maximum = binary(Value.maximum)
square_root = unary(Value.sqrt)


def _folded(combine: Callable[[Value, Value], Value]) -> Any:
    """The eight numbers combined to one, halves first: always in the same order."""

    @intrinsic
    def function(typingctx, x):  # type: ignore[no-untyped-def]
        def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
            value, nothing = Value(builder, values[0]), ir.Constant(DOUBLES, ir.Undefined)
            for distance in (4, 2, 1):
                order = ir.Constant(INTS, [(lane + distance) % LANES for lane in range(LANES)])
                value = combine(value, value.of(builder.shuffle_vector(value.value, nothing, order)))
            return builder.extract_element(value.value, ir.Constant(INT32, 0))

        return types.float64(x), codegen

    return function


total = _folded(operator.add)
largest = _folded(Value.maximum)


@intrinsic
def within(typingctx, first, count):  # type: ignore[no-untyped-def]
    """Mask of the particles first..first+7 that are below `count`."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        left = splat(builder, builder.sub(values[1], values[0]), WORDS)
        return builder.icmp_signed("<", ir.Constant(WORDS, list(range(LANES))), left)

    return mask(types.int64, types.int64), codegen


@intrinsic
def spread(typingctx, number):  # type: ignore[no-untyped-def]
    """Eight times one number."""
    return lanes(types.float64), _lower(lambda value: value)


@intrinsic
def choose_below(typingctx, x, bound, then, otherwise):  # type: ignore[no-untyped-def]
    """`then` where x < bound, `otherwise` elsewhere."""
    return lanes(x, bound, then, otherwise), _lower(lambda a, b, c, d: c.chosen(a.below(b), d))


def _place(context: Any, builder: ir.IRBuilder, kind: types.Array, array: ir.Value, index: ir.Value) -> ir.Value:
    parts = context.make_array(kind)(context, builder, array)
    place = builder.extract_value(index, 0)
    for axis in range(1, kind.ndim):
        place = builder.mul(place, builder.extract_value(parts.shape, axis))
        place = builder.add(place, builder.extract_value(index, axis))
    return builder.bitcast(builder.gep(parts.data, [place]), DOUBLES.as_pointer())


def _masked(builder: ir.IRBuilder, move: str, result: ir.Type, operands: Sequence[ir.Value]) -> ir.Value:
    kind = ir.FunctionType(result, [operand.type for operand in operands])
    callee = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.{move}.v{LANES}f64.p0")
    return builder.call(callee, operands)


_ALIGNED = ir.Constant(INT32, 8)


class Columns:
    """The particles first..first+7 of a contiguous (rows, N) float64 array, in code that is being written."""

    def __init__(self, context: Any, builder: ir.IRBuilder, kind: types.Array, values: Sequence[ir.Value]) -> None:
        """`values` are the array, `first` and the mask."""
        array, self._first, self._inside = values
        self._builder, self._parts = builder, context.make_array(kind)(context, builder, array)

    def read(self, row: int) -> Value:
        """A row; zero outside the mask."""
        operands = [self._pointer(row), _ALIGNED, self._inside, repeated(DOUBLES, 0.0)]
        return Value(self._builder, _masked(self._builder, "load", DOUBLES, operands))

    def write(self, row: int, value: Value) -> None:
        """A row becomes `value`, what is outside the mask does not."""
        operands = [value.value, self._pointer(row), _ALIGNED, self._inside]
        _masked(self._builder, "store", ir.VoidType(), operands)

    def _pointer(self, row: int) -> ir.Value:
        builder = self._builder
        start = builder.mul(ir.Constant(WORD, row), builder.extract_value(self._parts.shape, 1))
        place = builder.gep(self._parts.data, [builder.add(start, self._first)])
        return builder.bitcast(place, DOUBLES.as_pointer())


def scalars(context: Any, builder: ir.IRBuilder, kind: types.Array, array: ir.Value) -> Callable[[int], Value]:
    """The entries of a contiguous float64 array, each as eight times itself, in code that is being written."""
    data = context.make_array(kind)(context, builder, array).data

    def entry(index: int) -> Value:
        return Value(builder, splat(builder, builder.load(builder.gep(data, [ir.Constant(WORD, index)])), DOUBLES))

    return entry


def _loading(fill: float) -> Any:
    @intrinsic
    def function(typingctx, array, index, inside):  # type: ignore[no-untyped-def]
        def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
            pointer = _place(context, builder, sig.args[0], values[0], values[1])
            return _masked(builder, "load", DOUBLES, [pointer, _ALIGNED, values[2], repeated(DOUBLES, fill)])

        return lanes(array, types.UniTuple(types.int64, array.ndim), mask), codegen

    return function


load = _loading(0.0)
"""load(array, index, inside): eight entries of a contiguous float64 array from a tuple on, zero outside the mask."""
load_log = _loading(-inf)
"""The same for logarithms: minus infinity outside the mask."""


@intrinsic
def store(typingctx, array, index, inside, value):  # type: ignore[no-untyped-def]
    """Eight entries of a contiguous float64 array from the tuple `index` on become `value`, inside the mask only."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        pointer = _place(context, builder, sig.args[0], values[0], values[1])
        _masked(builder, "store", ir.VoidType(), [values[3], pointer, _ALIGNED, values[2]])
        return context.get_dummy_value()

    return types.void(array, types.UniTuple(types.int64, array.ndim), mask, lanes), codegen
