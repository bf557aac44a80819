"""From typed instructions to LLVM's, for one function.

Numba's lowering serves all types that there are: of each addition it finds out anew what it adds, and an array is
spread over the stack to read a number of it. Numbers, elements of arrays and calls are nearly all that kernels are
made of, so these are lowered here, to the same operations in the same order, with loops that count up by one, and
views; the rest is left to numba. What numba keeps on the stack for LLVM to find again is a value here wherever it can
be. Nothing is allocated, no reference counted, and nothing raises.
"""

import operator
import sys
from collections import defaultdict
from typing import Any

from llvmlite import ir as llvm_ir
from numba.core import cgutils, ir, lowering, typed_passes, types
from numba.core.analysis import compute_cfg_from_blocks, must_use_alloca
from numba.cpython.builtins import do_minmax

from cape.kernels.compiler.arrays import ArrayValue, is_stretch, part_of
from cape.kernels.compiler.kinds import FunctionType, GroupType, IntrinsicType, read_field

_ON_REALS = {operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul", operator.truediv: "fdiv"}
_ON_WHOLE = {operator.add: "add", operator.sub: "sub", operator.mul: "mul", operator.and_: "and_", operator.or_: "or_"}
_COMPARISONS = {
    operator.lt: "<",
    operator.le: "<=",
    operator.gt: ">",
    operator.ge: ">=",
    operator.eq: "==",
    operator.ne: "!=",
}
_SHORT = ("getiter", "iternext", "pair_first", "pair_second", "getattr")


def comparison_of(function: Any, arguments: Any) -> Any:
    """What tells that a number is to be chosen before another, in a call of `min` or `max` with several, else None."""
    if isinstance(function, types.Function) and len(arguments) > 1:
        compare = {min: operator.lt, max: operator.gt}.get(getattr(function, "typing_key", None))
        if compare is not None and all(isinstance(kind, types.Number) for kind in arguments):
            return compare
    return None


class Lowering(lowering.Lower):
    """Numba's lowering, with short ways.

    Attributes:
        counted: loops that count up by one, by their iterator: where the number is, its end, and whether they start
            at a constant of 0 or more.
        natural: numbers that are never below zero.
        found: what was found in a block already, to be found once.
    """

    def init(self):
        """Begin a function."""
        self.counted: dict[Any, tuple[Any, Any, bool]] = {}
        self.natural: set[Any] = set()
        self.found: dict[Any, Any] = {}
        super().init()

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
            self._target = inst.target.name
            self.storevar(self.lower_assign(self.typeof(inst.target.name), inst), inst.target.name)
        elif not (isinstance(inst, ir.SetItem | ir.StaticSetItem) and self._lower_write(inst)):
            super().lower_inst(inst)

    def _find_singly_assigned_variable(self):
        """Find the variables that need no room on the stack: assigned once, on every way to where they are read."""
        self._copies = defaultdict(list)
        assigned, several = {}, set(must_use_alloca(self.blocks))
        read = defaultdict(set)
        for label, block in self.blocks.items():
            for place, instruction in enumerate(block.body):
                reads = instruction
                if isinstance(instruction, ir.Assign):
                    reads, target = instruction.value, instruction.target.name
                    if target in assigned:
                        several.add(target)
                    assigned[target] = label, place
                    if isinstance(reads, ir.Var):
                        self._copies[reads.name].append(target)
                for variable in instruction._rec_list_vars(reads):
                    read[variable.name].add((label, place))
        before = compute_cfg_from_blocks(self.blocks).dominators()
        self._singly_assigned_vars = {
            name
            for name, (label, place) in assigned.items()
            if name not in several
            and all(
                there > place if where == label else label < where and label in before[where]
                for where, there in read[name]
            )
        }
        self._blk_local_varmap = {}

    def storevar(self, value, name, argidx=None):
        """Keep the value of a variable."""
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self._alloca_var(name, self.typeof(name))
            self.builder.store(value, self.getvar(name))

    def alloca_lltype(self, name, lltype, datamodel=None):
        """Room on the stack for a variable."""
        return cgutils.alloca_once(self.builder, lltype, name=name)

    def lower_expr(self, resty, expr):
        """Lower an expression, by a short way if there is one."""
        short = None
        if expr.op in ("binop", "inplace_binop"):
            short = self._lower_arithmetic(resty, expr)
        elif expr.op in ("getitem", "static_getitem"):
            short = self._lower_read(resty, expr)
        elif expr.op in _SHORT:
            short = getattr(self, f"_lower_{expr.op}")(resty, self.loadvar(expr.value.name), expr)
        return super().lower_expr(resty, expr) if short is None else short

    def lower_call(self, resty, expr):
        """Lower a call."""
        kind: Any = self.typeof(expr.func.name)
        signature = self.fndesc.calltypes[expr]
        compare = comparison_of(kind, signature.args)
        if compare is None and not isinstance(kind, FunctionType | IntrinsicType):
            short = None
            if isinstance(kind, types.Function) and not expr.kws:
                short = self._lower_stretch(kind.typing_key, resty, expr, signature)
            return super().lower_call(resty, expr) if short is None else short
        given = [self._cast_var(variable, to) for variable, to in zip(expr.args, signature.args, strict=True)]
        if compare is not None:
            result = do_minmax(self.context, self.builder, signature.args, given, compare)
        elif isinstance(kind, IntrinsicType):
            _, generate = kind.made[signature.args]
            result = generate(self.context, self.builder, signature, given)
        else:
            result = self._call(kind.function.made[signature.args], given)
        return self.context.cast(self.builder, result, signature.return_type, resty)

    def _call(self, made, given):
        """Call what was lowered already, by numba's convention: places for the result and what is raised, the rest.

        Whether it raised is not asked.
        """
        convention, builder = self.call_conv, self.builder
        self.library.add_linking_library(made.library)
        function = self.context.declare_function(self.module, made.description)
        place = cgutils.alloca_once(builder, convention.get_return_type(made.signature.return_type).pointee)
        packer = convention._get_arg_packer(made.signature.args)
        raised = convention._get_excinfo_argument(self.function)
        builder.call(function, [place, raised, *packer.as_arguments(builder, given)])
        return self.context.get_returned_value(builder, made.signature.return_type, builder.load(place))

    def _lower_stretch(self, function, resty, expr, signature):
        """A range of numbers, or of places in an array, by steps of one, or None."""
        count = len(signature.args)
        if count > 2 or not (
            (function is range and isinstance(resty, types.RangeType))
            or (function is slice and isinstance(resty, types.SliceType) and not resty.has_step)
        ):
            return None
        whole = self.context.get_value_type(resty)
        given = [
            None if kind is types.none else self._cast_var(variable, kind)
            for variable, kind in zip(expr.args, signature.args, strict=True)
        ]
        start, stop = given if count == 2 else (None, *given)
        value = whole(None)
        for place, (number, absent) in enumerate(((start, 0), (stop, sys.maxsize), (None, 1))):
            number = whole.elements[place](absent) if number is None else number
            value = self.builder.insert_value(value, number, place)
        return value

    def _lower_getiter(self, resty, value, expr):
        """Begin a loop over a range; None unless it counts up by one."""
        if not isinstance(resty, types.RangeIteratorType):
            return None
        start, stop, step = (part_of(self.builder, value, [place]) for place in range(3))
        if not (isinstance(step, llvm_ir.Constant) and step.constant == 1 and self._is_value(self._target)):
            return None
        place = cgutils.alloca_once(self.builder, start.type)
        self.builder.store(start, place)
        iterator = self.context.get_value_type(resty)(None)
        iterator = self.builder.insert_value(iterator, place, 0)
        natural = isinstance(start, llvm_ir.Constant) and start.constant >= 0
        self.counted[iterator] = place, stop, natural
        return iterator

    def _is_value(self, name):
        """Tell whether a variable is no place on the stack, nor any that it is copied to."""
        return name in self._singly_assigned_vars and all(map(self._is_value, self._copies[name]))

    def _lower_iternext(self, resty, iterator, expr):
        """Take a number of a loop, and whether there was one left; None if it doesn't count up by one."""
        if iterator not in self.counted:
            return None
        place, stop, natural = self.counted[iterator]
        number = self.builder.load(place)
        if natural:
            self.natural.add(number)
        signed = resty.first_type.signed
        left = (self.builder.icmp_signed if signed else self.builder.icmp_unsigned)("<", number, stop)
        self.builder.store(self.builder.add(number, number.type(1)), place)
        pair = self.context.get_value_type(resty)(None)
        return self.builder.insert_value(self.builder.insert_value(pair, number, 0), left, 1)

    def _lower_pair_first(self, resty, pair, expr):
        return part_of(self.builder, pair, [0])

    def _lower_pair_second(self, resty, pair, expr):
        return part_of(self.builder, pair, [1])

    def _lower_getattr(self, resty, value, expr):
        """A field of a group, size or shape of an array, or None."""
        kind: Any = self.typeof(expr.value.name)
        if isinstance(kind, GroupType):
            key = self.builder.block, value, expr.attr
            if key not in self.found:
                self.found[key] = read_field(self.context, self.builder, kind, value, expr.attr)
            return self.context.cast(self.builder, self.found[key], kind.types[expr.attr], resty)
        if not isinstance(kind, types.Array) or expr.attr not in ("size", "shape"):
            return None
        array = ArrayValue(self, kind, value)
        if expr.attr == "size":
            return array.field("nitems")
        shape = self.context.get_value_type(resty)(None)
        for axis in range(kind.ndim):
            shape = self.builder.insert_value(shape, array.field("shape", axis), axis)
        return shape

    def _lower_arithmetic(self, resty, expr):
        """An operation on two numbers of one type, or None."""
        signature = self.fndesc.calltypes[expr]
        kind: Any = signature.args[0]
        operation: Any = expr.immutable_fn if expr.op == "inplace_binop" else expr.fn
        if kind != signature.args[1] or not isinstance(kind, types.Float | types.Integer):
            return None
        real, signed = isinstance(kind, types.Float), getattr(kind, "signed", True)
        name, sign = (_ON_REALS if real else _ON_WHOLE).get(operation), _COMPARISONS.get(operation)
        if name is None and sign is None:
            return None
        left, right = self._cast_var(expr.lhs, kind), self._cast_var(expr.rhs, kind)
        if name is not None:
            result = getattr(self.builder, name)(left, right)
        elif not real:
            compare = self.builder.icmp_signed if signed else self.builder.icmp_unsigned
            result = compare(sign, left, right)
        else:
            compare = self.builder.fcmp_unordered if sign == "!=" else self.builder.fcmp_ordered
            result = compare(sign, left, right)
        return self.context.cast(self.builder, result, signature.return_type, resty)

    def _lower_read(self, resty, expr):
        """An element or a view of an array, or a part of a tuple that a constant names, or None."""
        kind: Any = self.typeof(expr.value.name)
        if expr.op == "static_getitem" and isinstance(kind, types.BaseTuple) and isinstance(expr.index, int):
            value = part_of(self.builder, self.loadvar(expr.value.name), [expr.index % len(kind)])
            parts: Any = kind
            return self.context.cast(self.builder, value, parts.types[expr.index], resty)
        array, axes, chosen = self._chosen(expr.value, expr.index if expr.op == "getitem" else expr.index_var)
        if array is None:
            return None
        if array.is_element(axes):
            kind, place = array.kind.dtype, array.element(axes, chosen)
            value = self.context.unpack_value(self.builder, kind, place, align=_alignment(array.kind))
        else:
            kind = self.fndesc.calltypes[expr].return_type
            value = array.view(axes, chosen, kind)
        return self.context.cast(self.builder, value, kind, resty)

    def _lower_write(self, inst):
        """Write an element of an array; tell whether it is one."""
        array, axes, chosen = self._chosen(inst.target, inst.index if isinstance(inst, ir.SetItem) else inst.index_var)
        number = isinstance(self.typeof(inst.value.name), types.Number | types.Boolean)
        if array is None or not number or not array.is_element(axes):
            return False
        kind = array.kind.dtype
        value = self._cast_var(inst.value, kind)
        self.context.pack_value(self.builder, kind, value, array.element(axes, chosen), align=_alignment(array.kind))
        return True

    def _chosen(self, array, index) -> tuple[ArrayValue | None, tuple[types.Type, ...], list[Any]]:
        """An array, and kind and value of each index; no array where there is another kind of index."""
        kind = self.typeof(array.name)
        if index is None or not isinstance(kind, types.Array) or kind.layout not in "CA":
            return None, (), []
        chosen = self.typeof(index.name)
        several = isinstance(chosen, types.BaseTuple)
        axes: Any = chosen if several else (chosen,)
        if len(axes) > kind.ndim or not all(isinstance(axis, types.Integer) or is_stretch(axis) for axis in axes):
            return None, (), []
        value = self.loadvar(index.name)
        values = [part_of(self.builder, value, [k]) for k in range(len(axes))] if several else [value]
        return ArrayValue(self, kind, self.loadvar(array.name)), axes, values


def _alignment(kind: types.Array) -> int | None:
    return None if kind.aligned else 1


class NativeLowering(typed_passes.NativeLowering):
    """Numba's pass, with the lowering of this module."""

    @property
    def lowering_class(self):
        """Which lowering it is."""
        return Lowering
