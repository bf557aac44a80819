"""From a Python function to typed instructions, by numba's front end.

Of numba's passes only those are run that kernels need, and numba's bookkeeping between them, for references and
generators, is left out. Branches on what is None, or is not, are taken here: the other side is never compiled.
"""

from collections.abc import Callable
from typing import Any

from numba.core import bytecode, compiler, ssa, targetconfig, transforms, typed_passes, types, untyped_passes
from numba.core.analysis import dead_branch_prune, rewrite_semantic_constants
from numba.core.datamodel.manager import DataModelManager
from numba.core.datamodel.registry import default_manager
from numba.core.ir_utils import build_definitions
from numba.core.registry import cpu_target
from numba.core.rewrites.registry import rewrite_registry
from numba.core.typing.templates import signature

from cape.kernels.compiler.arrays import PassedArray
from cape.kernels.compiler.kinds import FunctionType, IntrinsicType
from cape.kernels.compiler.lowering import NativeLowering, comparison_of
from cape.kernels.compiler.processor import CODEGEN

_Target: Any = type(cpu_target.target_context)


class Target(_Target):
    """Numba's target, with arrays passed as `PassedArray`; it is not searched for new registrations at every step."""

    def refresh(self) -> None:
        """There is nothing new."""


_context: Any = cpu_target.typing_context
_numbas: Any = cpu_target.target_context
_context.refresh()
_numbas.refresh()
target: Any = Target.__new__(Target)
# What numba compiles for itself goes on passing arrays in its own way.
target.__dict__ = {
    **_numbas.__dict__,
    "data_model_manager": DataModelManager({types.Array: PassedArray}).chain(default_manager),
    "cached_internal_func": {},
    "_internal_codegen": CODEGEN,
}


class Typing:
    """Numba's typing, which remembers what a call gives instead of finding it out at each place."""

    def __init__(self, lower: Callable[[Any, tuple[types.Type, ...]], Any]) -> None:
        """Hold what lowers a function for arguments of some types."""
        self._lower, self._known = lower, {}

    def __getattr__(self, name: str) -> Any:
        """All else is numba's."""
        return getattr(_context, name)

    def refresh(self) -> None:
        """There is nothing new."""

    def resolve_function_type(self, function: Any, arguments: Any, keywords: Any) -> Any:
        """The signature of a call."""
        if isinstance(function, FunctionType | IntrinsicType):
            assert not keywords, f"{function} is called with keywords"
            plain = tuple(types.unliteral(a) for a in arguments)
            if isinstance(function, IntrinsicType):
                return function.define(self, plain)
            return self._lower(function.function, plain).signature
        if keywords:
            return _context.resolve_function_type(function, arguments, keywords)
        if comparison_of(function, arguments) is not None:
            return signature(_context.unify_types(*arguments), *map(types.unliteral, arguments))
        key = function, tuple(arguments)
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = _context.resolve_function_type(function, arguments, keywords)
        return known


class _Something:
    """In the place of a type that is not None."""

    def __init__(self, kind: types.Type) -> None:
        self.literal_type = kind


def lower(
    python: Callable[..., Any], arguments: tuple[types.Type, ...], flags: Any, library: Any, typing: Typing
) -> tuple[Any, Any]:
    """Lower a function for arguments of some types into a library; returns its description and signature."""
    state: Any = compiler.CompilerBase(typing, target, library, arguments, None, flags, {}).state
    state.func_id = bytecode.FunctionIdentity.from_function(python)
    state.lifted, state.lifted_from = (), None
    with targetconfig.ConfigStack().enter(flags.copy()):
        _read(state)
        state.typemap, state.return_type, state.calltypes, _ = typed_passes.type_inference_stage(
            state.typingctx, target, state.func_ir, state.args, None
        )
        state.func_ir = typed_passes.PreLowerStripPhis()._strip_phi_nodes(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        _tidy(state)
        NativeLowering().run_pass(state)
    state.pipeline = None
    return state.cr.fndesc, signature(state.return_type, *arguments)


def _read(state: Any) -> None:
    """From bytecode to instructions of which each variable is assigned once."""
    for one in (untyped_passes.ExtractByteCode, untyped_passes.TranslateByteCode, untyped_passes.FixupArgs):
        one().run_pass(state)
    state.func_ir.generator_info = None
    _tidy(state)
    rewrite_semantic_constants(state.func_ir, state.args)
    dead_branch_prune(state.func_ir, [kind if kind is types.none else _Something(kind) for kind in state.args])
    for kind in rewrite_registry.rewrites["before-inference"]:
        rewrite = kind(state)
        waiting = list(state.func_ir.blocks.items())
        while waiting:
            key, block = waiting.pop()
            if rewrite.match(state.func_ir, block, state.typemap, state.calltypes):
                block = state.func_ir.blocks[key] = rewrite.apply()
                waiting.append((key, block))
    _tidy(state)
    state.func_ir = ssa.reconstruct_ssa(state.func_ir)
    state.func_ir._definitions = build_definitions(state.func_ir.blocks)


def _tidy(state: Any) -> None:
    state.func_ir.blocks = transforms.canonicalize_cfg(state.func_ir.blocks)
