"""Arrays as LLVM's instructions: their elements, views of them, and how they are passed to functions.

An array is a struct, as numba has it: data, shape, strides in bytes. Its fields are read and set as values here, where
numba spreads them over the stack at every index. To a function only those are passed that tell one array from another
of its type.
"""

import sys
from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from llvmlite.ir.instructions import InsertValue
from numba.core import cgutils, types
from numba.core.datamodel.models import ArrayModel
from numba.np.numpy_support import as_dtype

WORD = ir.IntType(64)


class ArrayValue:
    """An array whose struct is at hand."""

    def __init__(self, lowering: Any, kind: types.Array, value: Any) -> None:
        """Fields are read when they are asked for."""
        self.context, self.builder, self.kind, self.value = lowering.context, lowering.builder, kind, value
        self._natural, self._found = lowering.natural, lowering.found
        self._model = self.context.data_model_manager[kind]

    def field(self, name: str, axis: int | None = None) -> Any:
        """A field, of shape and strides the part of an axis."""
        place = self._model.get_field_position(name)
        return part_of(self.builder, self.value, [place] if axis is None else [place, axis])

    def is_element(self, axes: Sequence[types.Type]) -> bool:
        """Tell whether indices of some kinds name an element, rather than a part of the array."""
        return len(axes) == self.kind.ndim and not any(map(is_stretch, axes))

    def element(self, axes: Sequence[types.Type], chosen: Sequence[Any]) -> Any:
        """Where the element is that an integer for each axis names."""
        builder, offset = self.builder, None
        for axis, (kind, index) in enumerate(zip(axes, chosen, strict=True)):
            number = self._from_end(index, kind, axis)
            if self.kind.layout != "C":
                number = builder.mul(number, self.field("strides", axis))
            elif offset is not None:
                offset = builder.mul(offset, self.field("shape", axis))
            offset = number if offset is None else builder.add(offset, number)
        if self.kind.layout != "C":
            return cgutils.pointer_add(builder, self.field("data"), offset)
        return builder.gep(self.field("data"), [offset], inbounds=True)

    def view(self, axes: Sequence[types.Type], chosen: Sequence[Any], kind: types.Array) -> Any:
        """The array, of a given kind, that integers, slices without a step and all further axes name."""
        builder, offset = self.builder, WORD(0)
        shape, strides = [], []
        for axis in range(self.kind.ndim):
            stride = self.field("strides", axis)
            if axis >= len(axes):
                shape.append(self.field("shape", axis))
                strides.append(stride)
                continue
            if is_stretch(axes[axis]):
                start, length = self._stretch(axes[axis], chosen[axis], axis)
                shape.append(length)
                strides.append(stride)
            else:
                start = self._from_end(chosen[axis], axes[axis], axis)
            if not (isinstance(start, ir.Constant) and start.constant == 0):
                offset = builder.add(offset, builder.mul(start, stride))
        data = cgutils.pointer_add(builder, self.field("data"), offset)
        return array_of(self.context.data_model_manager[kind], builder, data, shape, strides)

    def _from_end(self, index: Any, kind: Any, axis: int) -> Any:
        """An index as Python means it: below zero from the end."""
        plain = types.unliteral(kind)
        number = self.context.cast(self.builder, index, plain, types.int64 if kind.signed else types.uint64)
        return number if not kind.signed else self._wrapped(number, self.field("shape", axis))

    def _wrapped(self, number: Any, length: Any) -> Any:
        if number in self._natural:
            return number
        if isinstance(number, ir.Constant):
            return number if number.constant >= 0 else self.builder.add(number, length)
        below = self.builder.icmp_signed("<", number, WORD(0))
        return self.builder.select(below, self.builder.add(number, length), number)

    def _stretch(self, kind: types.Type, chosen: Any, axis: int) -> tuple[Any, Any]:
        """Where a slice begins and how long it is, both within the axis; found once for all arrays of its length."""
        length, model = self.field("shape", axis), self.context.data_model_manager[kind]
        bounds = [part_of(self.builder, chosen, [model.get_field_position(name)]) for name in ("start", "stop")]
        key = self.builder.block, length, *bounds
        if key not in self._found:
            self._found[key] = self._within(length, *bounds)
        return self._found[key]

    def _within(self, length: Any, *bounds: Any) -> tuple[Any, Any]:
        builder = self.builder

        def within(number: Any) -> Any:
            if isinstance(number, ir.Constant) and number.constant in (0, sys.maxsize):
                return length if number.constant else number
            number = self._wrapped(number, length)
            number = builder.select(builder.icmp_signed("<", number, WORD(0)), WORD(0), number)
            return builder.select(builder.icmp_signed(">", number, length), length, number)

        start, stop = map(within, bounds)
        some = builder.icmp_signed("<", start, stop)
        return start, builder.select(some, builder.sub(stop, start), WORD(0))


def is_stretch(kind: types.Type) -> bool:
    """Tell whether an index is a slice without a step."""
    return isinstance(kind, types.SliceType) and not kind.has_step


def array_of(
    model: ArrayModel, builder: Any, data: Any, shape: Sequence[Any], strides: Sequence[Any] | None = None
) -> Any:
    """The struct of an array, without strides of one that has no gaps."""
    itemsize = WORD(as_dtype(model.fe_type.dtype).itemsize)
    if strides is None:
        dense = [itemsize]
        for length in reversed(shape[1:]):
            dense.insert(0, builder.mul(dense[0], length, flags=["nsw"]))
        strides = dense
    size = WORD(1) if not shape else shape[0]
    for length in shape[1:]:
        size = builder.mul(size, length, flags=["nsw"])
    array = model.get_value_type()(None)  # nothing counts references
    for name, value in (("data", data), ("itemsize", itemsize), ("nitems", size)):
        array = builder.insert_value(array, value, model.get_field_position(name))
    for name, values in (("shape", shape), ("strides", strides)):
        for axis, value in enumerate(values):
            array = builder.insert_value(array, value, [model.get_field_position(name), axis])
    return array


def part_of(builder: Any, value: Any, place: list[int]) -> Any:
    """What is at a place in a struct: what was put there, if that can be seen, rather than read from the struct."""
    while isinstance(value, InsertValue):
        struct, part = value.operands
        known = list(value.indices)
        if known == place[: len(known)]:
            return part if known == place else builder.extract_value(part, place[len(known) :])
        value = struct
    return builder.extract_value(value, place)


class PassedArray(ArrayModel):
    """An array whose data, shape and, if it may have gaps, strides are passed to functions, one by one."""

    def get_argument_type(self) -> tuple[Any, ...]:
        """Their types."""
        data = self.get_model(self.get_field_position("data")).get_value_type()
        return data, *[WORD] * (self._axes * (1 if self._dense else 2))

    def as_argument(self, builder: Any, value: Any) -> tuple[Any, ...]:
        """Taken from the struct."""
        fields = ["shape"] if self._dense else ["shape", "strides"]
        places = [[self.get_field_position(name), axis] for name in fields for axis in range(self._axes)]
        return tuple(part_of(builder, value, place) for place in [[self.get_field_position("data")], *places])

    def from_argument(self, builder: Any, value: Sequence[Any]) -> Any:
        """The struct again."""
        data, *lengths = value
        return array_of(self, builder, data, lengths[: self._axes], None if self._dense else lengths[self._axes :])

    @property
    def _axes(self) -> int:
        return self.fe_type.ndim

    @property
    def _dense(self) -> bool:
        return self.fe_type.layout == "C"
