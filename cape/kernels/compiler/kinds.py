"""What numba does not know: packed groups, functions of `kernels.jit`, intrinsics."""

import hashlib
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.imputils import lower_constant
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, lower_getattr_generic, models, register_model, typeof_impl
from numba.np.numpy_support import from_dtype

from cape.kernels.compiler.arrays import WORD, array_of
from cape.kernels.jit import Function, Intrinsic
from cape.kernels.packing import ArrayKind, GroupKind, Kind, dtype_of, words_of

NUMBERS: dict[str, types.Type] = {
    "int": types.int64,
    "float": types.float64,
    "single": types.float32,
    "bool": types.boolean,
    "none": types.none,
}


class GroupType(types.Type):
    """A packed group, `kernels.packing`: a pointer to its table."""

    def __init__(self, kind: GroupKind) -> None:
        """Work out where each field's words are."""
        self.kind = kind
        self.types = {name: type_of(field) for name, field in kind.fields}
        self.words: dict[str, int] = {}
        word = 0
        for name, field in kind.fields:
            self.words[name] = word
            word += words_of(field)
        super().__init__(name=f"{kind.name}_{hashlib.sha256(repr(kind).encode()).hexdigest()[:12]}")

    @property
    def key(self) -> GroupKind:
        """What tells it from others."""
        return self.kind


def type_of(kind: Kind) -> types.Type:
    """The numba type of a kind."""
    if isinstance(kind, ArrayKind):
        return types.Array(from_dtype(dtype_of(kind.dtype)), kind.dimensions, "C" if kind.dense else "A")
    return GroupType(kind) if isinstance(kind, GroupKind) else NUMBERS[kind]


@register_model(GroupType)
class _GroupModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, WORD.as_pointer())


@infer_getattr
class _GroupAttribute(AttributeTemplate):
    key = GroupType

    def generic_resolve(self, group, name):
        return group.types.get(name)


@lower_getattr_generic(GroupType)
def read_field(context, builder, group, table, name):
    """Read a field of a group from its table."""
    field, word = group.types[name], group.words[name]
    if field is types.none:
        return context.get_dummy_value()
    if isinstance(field, types.Array):
        return _read_array(context, builder, field, table, word)
    number = _read_word(builder, table, word)
    if isinstance(field, GroupType):
        return builder.inttoptr(number, context.get_value_type(field))
    if field is types.float64:
        return builder.bitcast(number, ir.DoubleType())
    if field is types.float32:
        return builder.bitcast(builder.trunc(number, ir.IntType(32)), ir.FloatType())
    if field is types.boolean:
        return builder.trunc(number, context.get_value_type(field))
    return number


def _read_array(context, builder, kind, table, word):
    model = context.data_model_manager[kind]
    pointer = context.get_value_type(model.get_type("data"))
    shape = [_read_word(builder, table, word + 1 + axis) for axis in range(kind.ndim)]
    strides = None
    if kind.layout != "C":
        strides = [_read_word(builder, table, word + 1 + kind.ndim + axis) for axis in range(kind.ndim)]
    return array_of(model, builder, builder.inttoptr(_read_word(builder, table, word), pointer), shape, strides)


def _read_word(builder, table, word):
    """A word of a table, of which LLVM is told that it never changes: it may read it before a loop."""
    value = builder.load(builder.gep(table, [WORD(word)]))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


class FunctionType(types.Opaque):
    """The type of a `Function`, in code that calls it."""

    def __init__(self, function: Function) -> None:
        """The type of one function."""
        self.function = function
        super().__init__(f"function({function.place}, {id(function)})")

    @property
    def key(self) -> Function:
        """What tells it from others."""
        return self.function


class IntrinsicType(types.Opaque):
    """The type of an `Intrinsic`, in code that calls it.

    Attributes:
        intrinsic: whose type it is.
        made: by the types of its arguments, the signature and what generates the code.
    """

    def __init__(self, intrinsic: Intrinsic) -> None:
        """The type of one intrinsic."""
        self.intrinsic = intrinsic
        self.made: dict[tuple[types.Type, ...], tuple[Any, Any]] = {}
        super().__init__(f"intrinsic({intrinsic.__name__}, {id(intrinsic)})")

    @property
    def key(self) -> Intrinsic:
        """What tells it from others."""
        return self.intrinsic

    def define(self, context: Any, arguments: tuple[types.Type, ...]) -> Any:
        """The signature for arguments of some types."""
        made = self.made.get(arguments)
        if made is None:
            made = self.made[arguments] = self.intrinsic.define(context, *arguments)
        return made[0]


_intrinsics: dict[Intrinsic, IntrinsicType] = {}


@typeof_impl.register(Function)
def _type_of_function(function, _):
    return FunctionType(function)


@typeof_impl.register(Intrinsic)
def _type_of_intrinsic(intrinsic, _):
    known = _intrinsics.get(intrinsic)
    if known is None:
        known = _intrinsics[intrinsic] = IntrinsicType(intrinsic)
    return known


for _kind in (FunctionType, IntrinsicType):
    register_model(_kind)(models.OpaqueModel)


@lower_constant(FunctionType)
@lower_constant(IntrinsicType)
def _no_value(context, builder, kind, value):
    return context.get_dummy_value()
