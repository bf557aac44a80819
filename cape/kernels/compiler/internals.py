"""What of numba's inside is used here, without a promise that it stays: a version that lacks it is told at once."""

from collections.abc import Iterable
from importlib import import_module
from importlib.metadata import version

USED = (
    "numba.core.codegen:JITCodeLibrary._optimize_functions",
    "numba.core.codegen:JITCodeLibrary._get_module_for_linking",
    "numba.core.codegen:JITCPUCodegen._customize_tm_features",
    "numba.core.codegen:JITCPUCodegen._module_pass_manager",
    "numba.core.cgutils:normalize_ir_text",
    "numba.core.compiler:Flags",
    "numba.core.compiler_lock:global_compiler_lock",
    "numba.core.lowering:Lower",
    "numba.core.registry:cpu_target",
    "numba.core.rewrites.registry:rewrite_registry",
    "numba.core.ssa:reconstruct_ssa",
    "numba.core.analysis:dead_branch_prune",
    "numba.core.ir_utils:build_definitions",
    "numba.core.datamodel.registry:default_manager",
    "numba.cpython.builtins:do_minmax",
)


def require(used: Iterable[str] = USED) -> None:
    """Look whether all is there.

    Raises:
        ImportError: something is not; its `name` is numba.
    """
    missing = [each for each in used if not _is_there(each)]
    if missing:
        raise unfit("it has no " + ", ".join(each.replace(":", ".") for each in missing))


def unfit(reason: object) -> ImportError:
    """The error of a numba that can't be used."""
    told = f"numba {version('numba')} can't compile the cloth solver, use 0.65 or another: {reason}"
    return ImportError(told, name="numba")


def _is_there(used: str) -> bool:
    module, _, path = used.partition(":")
    try:
        found = import_module(module)
        for name in path.split("."):
            found = getattr(found, name)
    except (ImportError, AttributeError):
        return False
    return True
