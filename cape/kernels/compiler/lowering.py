"""From typed instructions to LLVM's, for one function.

Numba's lowering serves all types that there are: of each addition it finds out anew what it adds, and an array is
spread over the stack to read a number of it. Numbers, elements of arrays and calls are nearly all that kernels are
made of, so these are lowered here, to the same operations in the same order; the rest is left to numba. Nothing is
allocated, no reference counted, and nothing raises.
"""

import operator
from typing import Any

from llvmlite import ir as llvm_ir
from numba.core import cgutils, ir, lowering, typed_passes, types

from cape.kernels.compiler.kinds import WORD, FunctionType, IntrinsicType

_ON_REALS = {operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul", operator.truediv: "fdiv"}
_ON_INTEGERS = {operator.add: "add", operator.sub: "sub", operator.mul: "mul", operator.and_: "and_", operator.or_: "or_"}
_COMPARISONS = {
    operator.lt: "<",
    operator.le: "<=",
    operator.gt: ">",
    operator.ge: ">=",
    operator.eq: "==",
    operator.ne: "!=",
}


class Lowering(lowering.Lower):
    """Numba's lowering, with short ways."""

    def lower_block(self, block):
        """Lower a block; what goes wrong tells where."""
        self.pre_block(block)
        for instruction in block.body:
            self.loc = instruction.loc
            try:
                self.lower_inst(instruction)
            except Exception as error:
                error.add_note(f"while lowering {instruction} at {instruction.loc}")
                raise
        self.post_block(block)

    def lower_inst(self, inst):
        """Lower an instruction."""
        if isinstance(inst, ir.Assign):
            self.storevar(self.lower_assign(self.typeof(inst.target.name), inst), inst.target.name)
        elif not (isinstance(inst, ir.SetItem | ir.StaticSetItem) and self._lower_write(inst)):
            super().lower_inst(inst)

    def storevar(self, value, name, argidx=None):
        """Keep the value of a variable."""
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self._alloca_var(name, self.typeof(name))
            self.builder.store(value, self.getvar(name))

    def lower_expr(self, resty, expr):
        """Lower an expression, by a short way if there is one."""
        short = None
        if expr.op in ("binop", "inplace_binop"):
            short = self._lower_arithmetic(resty, expr)
        elif expr.op in ("getitem", "static_getitem"):
            short = self._lower_read(resty, expr)
        return super().lower_expr(resty, expr) if short is None else short

    def lower_call(self, resty, expr):
        """Lower a call."""
        kind = self.typeof(expr.func.name)
        if not isinstance(kind, FunctionType | IntrinsicType):
            return super().lower_call(resty, expr)
        signature = self.fndesc.calltypes[expr]
        given = [self._cast_var(variable, to) for variable, to in zip(expr.args, signature.args, strict=True)]
        if isinstance(kind, IntrinsicType):
            _, generate = kind.made[signature.args]
            result = generate(self.context, self.builder, signature, given)
        else:
            result = self._call(kind.function.made[signature.args], given)
        return self.context.cast(self.builder, result, signature.return_type, resty)

    def _call(self, made, given):
        """Call what was lowered already, by numba's convention: places for the result and what is raised, the rest."""
        convention, builder = self.call_conv, self.builder
        self.library.add_linking_library(made.library)
        function = self.context.declare_function(self.module, made.description)
        place = cgutils.alloca_once(builder, convention.get_return_type(made.signature.return_type).pointee)
        nothing = function.args[1].type(None)
        packer = convention._get_arg_packer(made.signature.args)
        builder.call(function, [place, nothing, *packer.as_arguments(builder, given)])
        return self.context.get_returned_value(builder, made.signature.return_type, builder.load(place))

    def _lower_arithmetic(self, resty, expr):
        """An operation on two numbers of one type, or None."""
        signature = self.fndesc.calltypes[expr]
        kind, other = signature.args
        operation = expr.immutable_fn if expr.op == "inplace_binop" else expr.fn
        if kind != other or not isinstance(kind, types.Float | types.Integer):
            return None
        real = isinstance(kind, types.Float)
        emit = getattr(self.builder, (_ON_REALS if real else _ON_INTEGERS).get(operation, "none"), None)
        sign = _COMPARISONS.get(operation)
        if emit is None and sign is None:
            return None
        left, right = self._cast_var(expr.lhs, kind), self._cast_var(expr.rhs, kind)
        if emit is not None:
            result = emit(left, right)
        elif not real:
            compare = self.builder.icmp_signed if kind.signed else self.builder.icmp_unsigned
            result = compare(sign, left, right)
        else:
            compare = self.builder.fcmp_unordered if sign == "!=" else self.builder.fcmp_ordered
            result = compare(sign, left, right)
        return self.context.cast(self.builder, result, signature.return_type, resty)

    def _lower_read(self, resty, expr):
        """An element of an array, or None."""
        index = expr.index if expr.op == "getitem" else expr.index_var
        place = self._place(expr.value, index)
        if place is None:
            return None
        array = self.typeof(expr.value.name)
        align = None if array.aligned else 1
        value = self.context.unpack_value(self.builder, array.dtype, place, align=align)
        return self.context.cast(self.builder, value, array.dtype, resty)

    def _lower_write(self, inst):
        """Write an element of an array; tell whether it is one."""
        index = inst.index if isinstance(inst, ir.SetItem) else inst.index_var
        value = self.typeof(inst.value.name)
        if not isinstance(value, types.Number | types.Boolean):
            return False
        place = self._place(inst.target, index)
        if place is None:
            return False
        array = self.typeof(inst.target.name)
        align = None if array.aligned else 1
        self.context.pack_value(self.builder, array.dtype, self._cast_var(inst.value, array.dtype), place, align=align)
        return True

    def _place(self, array, index) -> Any:
        """Where an element of an array is, or None if it is not one that the index names."""
        if index is None:
            return None
        kind, chosen = self.typeof(array.name), self.typeof(index.name)
        axes = tuple(chosen) if isinstance(chosen, types.BaseTuple) else (chosen,)
        if (
            not isinstance(kind, types.Array)
            or kind.layout not in "CA"
            or len(axes) != kind.ndim
            or not all(isinstance(axis, types.Integer) for axis in axes)
        ):
            return None
        builder, value, numbers = self.builder, self.loadvar(array.name), self.loadvar(index.name)
        model = self.context.data_model_manager[kind]

        def field(name: str, axis: int | None = None) -> Any:
            at = model.get_field_position(name)
            return builder.extract_value(value, at if axis is None else [at, axis])

        offset = None
        for axis, number_kind in enumerate(axes):
            number = builder.extract_value(numbers, axis) if isinstance(chosen, types.BaseTuple) else numbers
            number = self._from_end(number, number_kind, lambda axis=axis: field("shape", axis))
            if kind.layout == "A":
                number = builder.mul(number, field("strides", axis))
            elif offset is not None:
                offset = builder.mul(offset, field("shape", axis))
            offset = number if offset is None else builder.add(offset, number)
        data = field("data")
        if kind.layout == "A":
            return cgutils.pointer_add(builder, data, offset)
        return builder.gep(data, [offset], inbounds=True)

    def _from_end(self, number, kind, length):
        """An index as Python means it: below zero from the end."""
        literal = getattr(kind, "literal_value", None)
        number = self.context.cast(self.builder, number, types.unliteral(kind), types.int64 if kind.signed else types.uint64)
        if not kind.signed or (literal is not None and literal >= 0):
            return number
        if isinstance(number, llvm_ir.Constant):
            return number if number.constant >= 0 else self.builder.add(number, length())
        below = self.builder.icmp_signed("<", number, WORD(0))
        return self.builder.select(below, self.builder.add(number, length()), number)


class NativeLowering(typed_passes.NativeLowering):
    """Numba's pass, with the lowering of this module."""

    @property
    def lowering_class(self):
        """Which lowering it is."""
        return Lowering
