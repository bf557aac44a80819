"""From functions to machine code.

Numba's own dispatchers optimise every function for itself, link it into each of its callers and optimise these again,
and make a wrapper for Python and machine code for all of them. Here a function that others call stays as it was
lowered; what is asked for by Python is linked with all that it calls, optimised once, and written out as an object.
"""

import gc
from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from llvmlite.ir.instructions import PhiInstr
from numba.core import cgutils, codegen, compiler, types
from numba.core.compiler_lock import global_compiler_lock

from cape.kernels.compiler.kinds import NUMBERS, type_of
from cape.kernels.compiler.processor import CODEGEN, machine
from cape.kernels.compiler.subnormals import count_subnormals_as_zero, restore
from cape.kernels.compiler.typing import Typing, lower
from cape.kernels.jit import Function
from cape.kernels.packing import GroupKind, Kind

_NAMES = {kind: name for name, kind in NUMBERS.items()} | {types.uint64: "unsigned"}


class Library(codegen.JITCodeLibrary):
    """The code of one function; only with all that it calls, `link_and_optimise`, is it ever used."""

    def add_ir_module(self, ir_module: Any) -> None:
        """Take in what was lowered."""
        for function in ir_module.functions:
            leave_out_unused(function)
        module = llvm.parse_assembly(cgutils.normalize_ir_text(str(ir_module)))
        module.name = ir_module.name
        self._optimize_functions(module)
        self._final_module.link_in(module)

    def finalize(self) -> None:
        """There will be no more to take in."""
        self._finalized = True

    def link_and_optimise(self) -> llvm.ModuleRef:
        """The module of this function and of all that it calls."""
        # LLVM leaves out what nothing calls yet, so that who calls must come first.
        for library in list(self._called({}))[-2::-1]:
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)
        return self._final_module

    def _called(self, known: dict[Any, None]) -> dict[Any, None]:
        """All that this calls, whatever is called before who calls it, and this at last."""
        for library in self._linking_libraries:
            if library in known:
                continue
            if isinstance(library, Library):
                library._called(known)
            else:
                known[library] = None
        known[self] = None
        return known


_WITHOUT_EFFECT = frozenset(("insertvalue", "extractvalue", "getelementptr", "load", "mul", "inttoptr", "bitcast"))


def leave_out_unused(function: Any) -> None:
    """Leave out what is read or put together of arrays and never used, before it is written as text and read again."""
    uses: Counter[int] = Counter()
    removable = []
    for block in function.blocks:
        for instruction in block.instructions:
            uses.update(map(id, _operands(instruction)))
            if instruction.opname in _WITHOUT_EFFECT:
                removable.append(instruction)
    unused: set[int] = set()
    waiting = [instruction for instruction in removable if not uses[id(instruction)]]
    known = {id(instruction): instruction for instruction in removable}
    while waiting:
        instruction = waiting.pop()
        unused.add(id(instruction))
        for operand in instruction.operands:
            uses[id(operand)] -= 1
            if not uses[id(operand)] and id(operand) in known:
                waiting.append(operand)
    for block in function.blocks:
        block.instructions[:] = [each for each in block.instructions if id(each) not in unused]


def _operands(instruction: Any) -> Iterable[Any]:
    if isinstance(instruction, PhiInstr):
        return (value for value, _ in instruction.incomings)
    return instruction.operands


class Made(NamedTuple):
    """A function that was lowered for some types of arguments."""

    library: Any
    description: Any
    signature: Any


def made(function: Function, arguments: tuple[types.Type, ...]) -> Made:
    """A function lowered for arguments of some types, once."""
    known = function.made.get(arguments)
    if known is None:
        flags: Any = compiler.Flags()
        flags.nrt = False  # no reference counts: nothing is allocated here, and callers keep their arrays alive
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        flags.error_model = "numpy"
        flags.noalias, flags.forceinline = function.noalias, function.inline
        library = Library(CODEGEN, function.python.__qualname__)
        known = function.made[arguments] = Made(library, *lower(function.python, arguments, flags, library, _typing))
    return known


_typing = Typing(made)


@global_compiler_lock
def machine_code(function: Function, kinds: tuple[Kind, ...], *, spread: bool) -> tuple[str, Any, bytes]:
    """Compile a function for arguments of some kinds; `spread` ones are the fields of the one group that comes.

    Returns the symbol of the code, what it returns, and an object file.
    """
    collecting = gc.isenabled()
    gc.disable()  # a sixth of the time, for what is garbage at the end only
    try:
        return _machine_code(function, kinds, spread)
    finally:
        if collecting:
            gc.enable()


def _machine_code(function: Function, kinds: tuple[Kind, ...], spread: bool) -> tuple[str, Any, bytes]:
    if spread:
        (group,) = kinds
        assert isinstance(group, GroupKind)
        fields = ", ".join(f"group.{name}" for name, _ in group.fields)
        names: dict[str, Any] = {"function": function, "begin": count_subnormals_as_zero, "end": restore}
        exec(
            f"def entry(group):\n    mode = begin()\n    result = function({fields})\n    end(mode)\n    return result",
            names,
        )
        function = Function(names["entry"])
    whole = made(function, tuple(type_of(kind) for kind in kinds))
    module = whole.library.link_and_optimise()
    return whole.description.llvm_func_name, _returned(whole.signature.return_type), machine().emit_object(module)


def _returned(kind: types.Type) -> Any:
    kind = types.unliteral(kind)
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return tuple(_returned(part) for part in parts)
    return _NAMES[kind]
