"""From functions to machine code, by numba's front end and LLVM. Imported when something must be compiled.

Numba's own dispatchers optimise every function for itself, link it into each of its callers and optimise these again,
and make a wrapper for Python and machine code for all of them. Here a function that others call stays as it was
lowered; what is asked for by Python is linked with all that it calls, optimised once, and written out as an object.
"""

import gc
import hashlib
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, codegen, compiler, typed_passes, types, untyped_passes
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.imputils import impl_ret_borrowed, lower_constant
from numba.core.registry import cpu_target
from numba.core.typing.templates import AttributeTemplate, make_intrinsic_template
from numba.extending import infer_getattr, lower_getattr_generic, models, register_model, typeof_impl
from numba.np.arrayobj import make_array, populate_array
from numba.np.numpy_support import from_dtype

from cape.kernels.jit import Function, Intrinsic
from cape.kernels.packing import ArrayKind, GroupKind, Kind, dtype_of, words_of

_typing: Any = cpu_target.typing_context
_target: Any = cpu_target.target_context
_typing.refresh()
_target.refresh()

_NUMBERS: dict[str, types.Type] = {
    "int": types.int64,
    "float": types.float64,
    "single": types.float32,
    "bool": types.boolean,
    "none": types.none,
}
_NAMES = {kind: name for name, kind in _NUMBERS.items()} | {types.uint64: "unsigned"}


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
    return GroupType(kind) if isinstance(kind, GroupKind) else _NUMBERS[kind]


@register_model(GroupType)
class _GroupModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, ir.IntType(64).as_pointer())


@infer_getattr
class _GroupAttribute(AttributeTemplate):
    key = GroupType

    def generic_resolve(self, group, name):
        return group.types.get(name)


@lower_getattr_generic(GroupType)
def _read_field(context, builder, group, table, name):
    field, word = group.types[name], group.words[name]
    if field is types.none:
        return context.get_dummy_value()
    if isinstance(field, types.Array):
        return impl_ret_borrowed(context, builder, field, _read_array(context, builder, field, table, word))
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
    array = make_array(kind)(context, builder)
    shape = [_read_word(builder, table, word + 1 + axis) for axis in range(kind.ndim)]
    itemsize = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    if kind.layout == "C":
        strides = [itemsize]
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length, flags=["nsw"]))
    else:
        strides = [_read_word(builder, table, word + 1 + kind.ndim + axis) for axis in range(kind.ndim)]
    populate_array(
        array,
        data=builder.inttoptr(_read_word(builder, table, word), array.data.type),
        shape=shape,
        strides=strides,
        itemsize=itemsize,
        meminfo=None,
    )
    return array._getvalue()


def _read_word(builder, table, word):
    """A word of a table, of which LLVM is told that it never changes: it may read it before a loop."""
    value = builder.load(builder.gep(table, [ir.Constant(ir.IntType(64), word)]))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


class FunctionType(types.Callable, types.Opaque):
    """The type of a `Function`, in code that calls it."""

    def __init__(self, function: Function) -> None:
        """The type of one function."""
        self.function = function
        super().__init__(f"function({function.place}, {id(function)})")

    @property
    def key(self) -> Function:
        """What tells it from others."""
        return self.function

    def get_call_type(self, context, args, kws):
        """Lower the function for arguments of these types, and give its signature."""
        assert not kws, f"{self.function.place} is called with keywords"
        return _made(self.function, args).signature

    def get_call_signatures(self):
        """Signatures that it was lowered for."""
        return [made.signature for made in self.function.made.values()], True

    def get_impl_key(self, sig):
        """What the code of a signature is known by."""
        return self.function.made[sig.args]


register_model(FunctionType)(models.OpaqueModel)


@typeof_impl.register(Function)
def _type_of_function(function, _):
    return FunctionType(function)


@lower_constant(FunctionType)
def _no_value(context, builder, kind, value):
    return context.get_dummy_value()


_intrinsics: dict[Intrinsic, types.Type] = {}


@typeof_impl.register(Intrinsic)
def _type_of_intrinsic(intrinsic, _):
    known = _intrinsics.get(intrinsic)
    if known is None:
        template = make_intrinsic_template(intrinsic, intrinsic.define, intrinsic.__name__)
        known = _intrinsics[intrinsic] = types.Function(template)
    return known


class _Library(codegen.JITCodeLibrary):
    """The code of one function; only with all that it calls, `link_and_optimise`, is it ever used."""

    def add_ir_module(self, ir_module):
        module = llvm.parse_assembly(cgutils.normalize_ir_text(str(ir_module)))
        module.name = ir_module.name
        self._optimize_functions(module)
        self._final_module.link_in(module)

    def finalize(self):
        self._finalized = True

    def link_and_optimise(self) -> llvm.ModuleRef:
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
            if isinstance(library, _Library):
                library._called(known)
            else:
                known[library] = None
        known[self] = None
        return known


class _Pipeline(compiler.CompilerBase):
    """Numba's passes, but for those that serve what is not used here: closures, literals, array expressions."""

    def define_pipelines(self):
        passes = PassManager("cape")
        for kind, description in (
            (untyped_passes.TranslateByteCode, "analyzing bytecode"),
            (untyped_passes.FixupArgs, "fix up args"),
            (untyped_passes.IRProcessing, "processing IR"),
            (untyped_passes.RewriteSemanticConstants, "rewrite semantic constants"),
            (untyped_passes.DeadBranchPrune, "dead branch pruning"),
            (untyped_passes.GenericRewrites, "rewrites"),
            (untyped_passes.ReconstructSSA, "ssa"),
            (untyped_passes.DeadBranchPrune, "dead branch pruning"),
            (typed_passes.NopythonTypeInference, "type inference"),
            (typed_passes.PreLowerStripPhis, "remove phis nodes"),
            (typed_passes.IRLegalization, "ensure IR is legal prior to lowering"),
            (typed_passes.NativeLowering, "native lowering"),
            (typed_passes.NoPythonBackend, "backend"),
        ):
            passes.add_pass(kind, description)
        passes.finalize()
        return [passes]


_PIPELINE: Any = _Pipeline


class _Typing:
    """Numba's typing, which remembers what operators on numbers give instead of finding it out at each place."""

    def __init__(self, context: Any) -> None:
        self._context, self._known = context, {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function, arguments, keywords):
        if keywords or not all(isinstance(a, types.Number | types.Boolean) for a in arguments):
            return self._context.resolve_function_type(function, arguments, keywords)
        key = function, tuple(arguments)
        known = self._known.get(key)
        if known is None:
            known = self._context.resolve_function_type(function, arguments, keywords)
            if not isinstance(function, FunctionType):
                self._known[key] = known
        return known


_remembering = _Typing(_typing)


class _Made:
    """A function that was lowered for some types of arguments."""

    def __init__(self, result: Any) -> None:
        self.library, self.description, self.signature = result.library, result.fndesc, result.signature


def _made(function: Function, arguments: tuple[types.Type, ...]) -> _Made:
    arguments = tuple(arguments)
    made = function.made.get(arguments)
    if made is None:
        plain = tuple(types.unliteral(a) for a in arguments)
        made = function.made.get(plain) or _lower(function, plain)
        function.made[arguments] = function.made[plain] = made
    return made


def _lower(function: Function, arguments: tuple[types.Type, ...]) -> _Made:
    flags: Any = compiler.Flags()
    flags.nrt = False  # no reference counts: nothing is allocated here, and callers keep their arrays alive
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    flags.error_model = "numpy"
    flags.noalias, flags.forceinline = function.noalias, function.inline
    library = _Library(_target.codegen(), function.python.__qualname__)
    made = _Made(
        compiler.compile_extra(_remembering, _target, function.python, arguments, None, flags, {}, library, _PIPELINE)
    )
    _target.insert_user_function(made, made.description, [library])
    return made


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
        names: dict[str, Any] = {"function": function}
        exec(f"def entry(group):\n    return function({', '.join(f'group.{name}' for name, _ in group.fields)})", names)
        function = Function(names["entry"])
    made = _made(function, tuple(type_of(kind) for kind in kinds))
    module = made.library.link_and_optimise()
    return made.description.llvm_func_name, _returned(made.signature.return_type), _emit(module)


def _emit(module: llvm.ModuleRef) -> bytes:
    return _target.codegen()._tm.emit_object(module)


def _returned(kind: types.Type) -> Any:
    kind = types.unliteral(kind)
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return tuple(_returned(part) for part in parts)
    return _NAMES[kind]
