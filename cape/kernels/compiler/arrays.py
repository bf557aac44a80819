"""Elements and views of arrays, as LLVM's instructions.

An array is a struct, as numba has it: data, shape, strides in bytes. Its fields are read and set as values here, where
numba spreads them over the stack at every index.
"""

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.np.numpy_support import as_dtype

WORD = ir.IntType(64)


class ArrayValue:
    """An array whose struct is at hand."""

    def __init__(self, context: Any, builder: Any, kind: types.Array, value: Any) -> None:
        """Fields are read when they are asked for."""
        self.context, self.builder, self.kind, self.value = context, builder, kind, value
        self._model = context.data_model_manager[kind]

    def field(self, name: str, axis: int | None = None) -> Any:
        """A field, of shape and strides the part of an axis."""
        place = self._model.get_field_position(name)
        return self.builder.extract_value(self.value, place if axis is None else [place, axis])

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
            offset = builder.add(offset, builder.mul(start, stride))
        data = cgutils.pointer_add(builder, self.field("data"), offset)
        return array_of(self.context, builder, kind, data, shape, strides)

    def _from_end(self, index: Any, kind: Any, axis: int) -> Any:
        """An index as Python means it: below zero from the end."""
        plain = types.unliteral(kind)
        number = self.context.cast(self.builder, index, plain, types.int64 if kind.signed else types.uint64)
        if not kind.signed:
            return number
        if isinstance(number, ir.Constant):
            return number if number.constant >= 0 else self.builder.add(number, self.field("shape", axis))
        return self._wrapped(number, self.field("shape", axis))

    def _wrapped(self, number: Any, length: Any) -> Any:
        below = self.builder.icmp_signed("<", number, WORD(0))
        return self.builder.select(below, self.builder.add(number, length), number)

    def _stretch(self, kind: types.Type, chosen: Any, axis: int) -> tuple[Any, Any]:
        """Where a slice begins and how long it is, both within the axis."""
        builder, length = self.builder, self.field("shape", axis)
        model = self.context.data_model_manager[kind]

        def bound(name: str) -> Any:
            number = self._wrapped(builder.extract_value(chosen, model.get_field_position(name)), length)
            number = builder.select(builder.icmp_signed("<", number, WORD(0)), WORD(0), number)
            return builder.select(builder.icmp_signed(">", number, length), length, number)

        start, stop = bound("start"), bound("stop")
        some = builder.icmp_signed("<", start, stop)
        return start, builder.select(some, builder.sub(stop, start), WORD(0))


def is_stretch(kind: types.Type) -> bool:
    """Tell whether an index is a slice without a step."""
    return isinstance(kind, types.SliceType) and not kind.has_step


def array_of(
    context: Any, builder: Any, kind: types.Array, data: Any, shape: Sequence[Any], strides: Sequence[Any] | None = None
) -> Any:
    """The struct of an array, without strides of one that has no gaps."""
    itemsize = WORD(as_dtype(kind.dtype).itemsize)
    if strides is None:
        dense = [itemsize]
        for length in reversed(shape[1:]):
            dense.insert(0, builder.mul(dense[0], length, flags=["nsw"]))
        strides = dense
    size = WORD(1) if not shape else shape[0]
    for length in shape[1:]:
        size = builder.mul(size, length, flags=["nsw"])
    model = context.data_model_manager[kind]
    array = context.get_value_type(kind)(None)  # nothing counts references
    for name, value in (("data", data), ("itemsize", itemsize), ("nitems", size)):
        array = builder.insert_value(array, value, model.get_field_position(name))
    for name, values in (("shape", shape), ("strides", strides)):
        for axis, value in enumerate(values):
            array = builder.insert_value(array, value, [model.get_field_position(name), axis])
    return array
