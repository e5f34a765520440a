"""Vectors of lanes in compiled code: one kernel source for scalars, runs of elements and ensembles.

LLVM does not turn the element loops of this engine into vector instructions (stores through
index tables may alias), so vectors are spelled out here: a numba type that is an LLVM vector,
the arithmetic that the force laws use, and memory access by a template that says how many
lanes there are. ``(0.0,) * 8`` is the template of eight float64 lanes, ``(0.0,)`` that of
plain numbers; the kernels are the same.

Arithmetic may be contracted and reassociated (`FAST`), but never assumes that there is no NaN:
the guard against divergence depends on seeing one.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from itertools import product
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    intrinsic,
    lower_builtin,
    register_model,
)
from numba.np.arrayobj import make_array

from openprc.demlat.models.barhinge.laws import select

FAST = ("contract", "reassoc", "nsz", "arcp")


class VectorType(types.Type):  # type: ignore[misc]
    """`width` numbers of type `dtype`."""

    def __init__(self, dtype: types.Type, width: int) -> None:
        self.dtype = dtype
        self.width = width
        super().__init__(name=f"Vector({dtype}, {width})")

    @property
    def key(self) -> tuple[types.Type, int]:
        """What makes two of these types the same."""
        return self.dtype, self.width


class MaskType(types.Type):  # type: ignore[misc]
    """`width` truth values, the result of comparing vectors."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Mask({width})")

    @property
    def key(self) -> int:
        """What makes two of these types the same."""
        return self.width


def _scalar(dtype: types.Type) -> ir.Type:
    return ir.DoubleType() if dtype == types.float64 else ir.FloatType()


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: VectorType) -> None:
        super().__init__(manager, kind, ir.VectorType(_scalar(kind.dtype), kind.width))
        self._array = ir.ArrayType(_scalar(kind.dtype), kind.width)

    # Functions return through memory, and LLVM stores whole vectors with aligned instructions,
    # but does not always align the stack for them; an array asks for no alignment.

    def get_data_type(self) -> ir.Type:
        return self._array

    get_return_type = get_data_type

    def as_data(self, builder: Any, value: Any) -> Any:
        array = ir.Constant(self._array, ir.Undefined)
        for lane in range(self._array.count):
            number = builder.extract_element(value, ir.IntType(32)(lane))
            array = builder.insert_value(array, number, lane)
        return array

    def from_data(self, builder: Any, value: Any) -> Any:
        vector = ir.Constant(self.get_value_type(), ir.Undefined)
        for lane in range(self._array.count):
            number = builder.extract_value(value, lane)
            vector = builder.insert_element(vector, number, ir.IntType(32)(lane))
        return vector

    as_return, from_return = as_data, from_data


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: MaskType) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.width))


def value_type(template: types.Type) -> types.Type:
    """Return what `load` gives for a template of that type."""
    return template.dtype if template.count == 1 else VectorType(template.dtype, template.count)


def _splat(context: Any, builder: Any, value: Any, source: types.Type, kind: VectorType) -> Any:
    value = context.cast(builder, value, source, kind.dtype)
    vector = ir.VectorType(_scalar(kind.dtype), kind.width)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.IntType(32)(0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), kind.width), [0] * kind.width)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), order)


# --- arithmetic ---------------------------------------------------------------------------
# Registered as numba's own operators are, not by `overload`: that would compile one function
# for each operation and each pair of types.

Lower = Callable[[Any, list[Any], tuple[types.Type, ...]], Any]


def _vector_of(*kinds: types.Type) -> VectorType | None:
    """Return the vector type of an operation on vectors and numbers; None when it is neither."""
    vectors = {kind for kind in kinds if isinstance(kind, VectorType)}
    others = [kind for kind in kinds if not isinstance(kind, VectorType)]
    if len(vectors) != 1 or not all(isinstance(kind, types.Number) for kind in others):
        return None
    return vectors.pop()


def _wide(context: Any, builder: Any, kind: VectorType, args: Any, kinds: Any) -> list[Any]:
    return [
        value if source == kind else _splat(context, builder, value, source, kind)
        for value, source in zip(args, kinds, strict=True)
    ]


def _define(symbol: Any, arity: int, emit: Lower, *, compares: bool = False) -> None:
    """Teach numba what `symbol` means when at least one operand is a vector."""

    class _Typing(AbstractTemplate):  # type: ignore[misc]
        key = symbol

        def generic(self, args: Any, kws: Any) -> Any:
            kind = _vector_of(*args) if len(args) == arity else None
            if kind is None:
                return None
            return signature(MaskType(kind.width) if compares else kind, *args)

    infer_global(symbol)(_Typing)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = _vector_of(*sig.args)
        return emit(builder, _wide(context, builder, kind, args, sig.args), sig.args)

    for operands in product((VectorType, types.Number), repeat=arity):
        if VectorType in operands:
            lower_builtin(symbol, *operands)(lower)


def _instruction(name: str) -> Lower:
    return lambda builder, sides, _: getattr(builder, name)(*sides, flags=FAST)


def _library(name: str) -> Lower:
    def emit(builder: Any, sides: list[Any], _: Any) -> Any:
        kind = sides[0].type
        bits = 64 if isinstance(kind.element, ir.DoubleType) else 32
        function = cgutils.get_or_insert_function(
            builder.module,
            ir.FunctionType(kind, [kind] * len(sides)),
            f"{name}.v{kind.count}f{bits}",
        )
        return builder.call(function, sides, fastmath=FAST)

    return emit


def _lane_by_lane(name: str) -> Lower:
    # No vector form exists; these appear off the common path only.
    def emit(builder: Any, sides: list[Any], _: Any) -> Any:
        (vector,) = sides
        element = vector.type.element
        single = name if isinstance(element, ir.DoubleType) else f"{name}f"
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(element, [element]), single
        )
        result = ir.Constant(vector.type, ir.Undefined)
        for lane in range(vector.type.count):
            at = ir.IntType(32)(lane)
            value = builder.call(function, [builder.extract_element(vector, at)])
            result = builder.insert_element(result, value, at)
        return result

    return emit


def _comparison(sign: str) -> Lower:
    return lambda builder, sides, _: builder.fcmp_ordered(sign, *sides)


for _symbol, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
    (operator.iadd, "fadd"),
    (operator.isub, "fsub"),
    (operator.imul, "fmul"),
    (operator.itruediv, "fdiv"),
):
    _define(_symbol, 2, _instruction(_name))
_define(operator.neg, 1, _instruction("fneg"))
_define(operator.lt, 2, _comparison("<"), compares=True)
_define(operator.gt, 2, _comparison(">"), compares=True)
_define(math.sqrt, 1, _library("llvm.sqrt"))
_define(abs, 1, _library("llvm.fabs"))
_define(math.copysign, 2, _library("llvm.copysign"))
_define(math.tan, 1, _lane_by_lane("tan"))
_define(math.cos, 1, _lane_by_lane("cos"))
_define(math.log, 1, _lane_by_lane("log"))


@infer_global(select)
class _SelectTyping(AbstractTemplate):  # type: ignore[misc]
    key = select

    def generic(self, args: Any, kws: Any) -> Any:
        condition, yes, no = args
        if isinstance(condition, MaskType):
            kind = _vector_of(yes, no)
            return None if kind is None else signature(kind, *args)
        if isinstance(yes, types.Float) or isinstance(no, types.Float):
            kind = self.context.unify_types(yes, no)
            return signature(kind, types.boolean, kind, kind)
        return None


@lower_builtin(select, MaskType, types.Any, types.Any)
def _select_lanes(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    sides = _wide(context, builder, sig.return_type, args[1:], sig.args[1:])
    return builder.select(args[0], *sides)


@lower_builtin(select, types.Boolean, types.Float, types.Float)
def _select_number(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.select(args[0], args[1], args[2])


# --- memory -------------------------------------------------------------------------------
# A place is where the lanes of an element stand: one number when they are neighbours in
# memory, a tuple of numbers when every lane has its own.


def _pointer(context: Any, builder: Any, kind: types.Array, array: Any, index: Any) -> Any:
    return builder.gep(make_array(kind)(context, builder, array).data, [index])


def _run(context: Any, builder: Any, kind: Any, arrays: types.Array, array: Any, at: Any) -> Any:
    """Return a pointer to `kind` and its alignment."""
    pointer = _pointer(context, builder, arrays, array, at)
    if not isinstance(kind, VectorType):
        return pointer, None
    lanes = ir.VectorType(_scalar(kind.dtype), kind.width)
    return builder.bitcast(pointer, lanes.as_pointer()), kind.dtype.bitwidth // 8


@intrinsic
def splat(typing: Any, template: Any, value: Any) -> Any:
    """Return a vector, or number, of the template's type with `value` in every lane."""
    kind = value_type(template)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not isinstance(kind, VectorType):
            return context.cast(builder, args[1], sig.args[1], kind)
        return _splat(context, builder, args[1], sig.args[1], kind)

    return kind(template, value), generate


@intrinsic
def place(typing: Any, template: Any, index: Any, block: Any) -> Any:
    """Return the place of block `block`: ``index[block]``, or a row of a 2-D `index`."""
    spread = index.ndim == 2
    kind = types.UniTuple(types.intp, template.count) if spread else types.intp

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def read(at: Any) -> Any:
            value = builder.load(_pointer(context, builder, index, args[1], at))
            return context.cast(builder, value, index.dtype, types.intp)

        if not spread:
            return read(args[2])
        first = builder.mul(args[2], args[2].type(template.count))
        lanes = [read(builder.add(first, first.type(lane))) for lane in range(template.count)]
        return context.make_tuple(builder, kind, lanes)

    return kind(template, index, types.intp), generate


@intrinsic
def load(typing: Any, template: Any, array: Any, at: Any, offset: Any) -> Any:
    """Return the lanes of `array` at place `at` plus `offset`."""
    kind = value_type(template)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if isinstance(at, types.Integer):
            where = builder.add(args[2], args[3])
            pointer, align = _run(context, builder, kind, array, args[1], where)
            return builder.load(pointer, align=align)
        result = ir.Constant(ir.VectorType(_scalar(kind.dtype), kind.width), ir.Undefined)
        for lane, index in enumerate(cgutils.unpack_tuple(builder, args[2])):
            where = builder.add(index, args[3])
            value = builder.load(_pointer(context, builder, array, args[1], where))
            result = builder.insert_element(result, value, ir.IntType(32)(lane))
        return result

    return kind(template, array, at, types.intp), generate


@intrinsic
def store(typing: Any, template: Any, array: Any, at: Any, value: Any) -> Any:
    """Put lanes where ``array[at]`` begins."""
    kind = value_type(template)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer, align = _run(context, builder, kind, array, args[1], args[2])
        builder.store(args[3], pointer, align=align)
        return context.get_dummy_value()

    return types.void(template, array, types.intp, kind), generate


@intrinsic
def add(typing: Any, template: Any, array: Any, at: Any, offset: Any, value: Any) -> Any:
    """Add lanes to `array` at place `at` plus `offset`, one after the other where spread."""
    kind = value_type(template)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if isinstance(at, types.Integer):
            where = builder.add(args[2], args[3])
            pointer, align = _run(context, builder, kind, array, args[1], where)
            old = builder.load(pointer, align=align)
            builder.store(builder.fadd(old, args[4], flags=FAST), pointer, align=align)
            return context.get_dummy_value()
        for lane, index in enumerate(cgutils.unpack_tuple(builder, args[2])):
            pointer = _pointer(context, builder, array, args[1], builder.add(index, args[3]))
            share = builder.extract_element(args[4], ir.IntType(32)(lane))
            builder.store(builder.fadd(builder.load(pointer), share, flags=FAST), pointer)
        return context.get_dummy_value()

    return types.void(template, array, at, types.intp, kind), generate


@intrinsic
def scatter(typing: Any, template: Any, array: Any, index: Any, first: Any, value: Any) -> Any:
    """Put lane l into ``array[index[first + l]]``, except where that index is negative."""
    kind = value_type(template)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        for lane in range(template.count):
            at = builder.add(args[3], args[3].type(lane))
            target = builder.load(_pointer(context, builder, index, args[2], at))
            target = context.cast(builder, target, index.dtype, types.intp)
            share = args[4]
            if isinstance(kind, VectorType):
                share = builder.extract_element(share, ir.IntType(32)(lane))
            with builder.if_then(builder.icmp_signed(">=", target, target.type(0))):
                share = context.cast(builder, share, template.dtype, array.dtype)
                builder.store(share, _pointer(context, builder, array, args[1], target))
        return context.get_dummy_value()

    return types.void(template, array, index, types.intp, kind), generate
