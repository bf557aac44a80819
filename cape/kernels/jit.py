"""The one place for compile options.

No fast math: every operation is done as written, in IEEE arithmetic, so that a result has the same bits whether a loop
was vectorised or not, inlined or not, compiled just now or taken from the cache, on one thread or many. (With LLVM's
`reassoc` and `contract` a fresh compile and its own cache differed.)

No reference counts (`_nrt=False`): kernels allocate nothing and their callers keep the arrays alive. Counting costs far
more than the arithmetic in a small function that takes a dozen arrays, such as the response to a contact.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.dispatcher import _FunctionCompiler  # pyright: ignore[reportAttributeAccessIssue]

import skeleton.shapes


def _stamp_of_all_kernels() -> str:
    """Digest of every kernel's source: a compiled function holds the code of those it calls, whatever their file.

    The distances from shapes are among them.
    """
    digest = hashlib.sha256()
    for folder in (Path(__file__).parent, Path(skeleton.shapes.__file__).parent):
        for source in sorted(folder.glob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


STAMP = _stamp_of_all_kernels()
"""Tells versions of the kernels apart."""


class _NoAliasCompiler(_FunctionCompiler):
    """Marks every pointer argument `noalias`, as numba itself does for the bodies of prange loops."""

    def _customize_flags(self, flags):
        flags.noalias = True
        return flags


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop over arrays **that do not overlap**, so that LLVM may vectorise it.

    Without the promise a loop with three outputs and eight inputs stays scalar, since LLVM gives up on checking all
    pairs for overlap. `tests/bench/kernels.py` tells what a vertex costs.
    """
    dispatcher = _compiled(function)
    if dispatcher is function:
        return function
    plain = dispatcher._compiler
    dispatcher._compiler = _NoAliasCompiler(
        plain.py_func, plain.targetdescr, plain.targetoptions, plain.locals, plain.pipeline_class
    )
    return dispatcher


def driver(function: Callable[..., Any]) -> Any:
    """Compile a function that calls kernels; arguments that are None are pruned with the branches that test them."""
    return _compiled(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a formula that is always inlined: loops that use it still vectorise, and no call passes whole arrays."""
    return _compiled(function, forceinline=True)


_SETTINGS: dict[str, Any] = {"nogil": True, "_nrt": False, "error_model": "numpy", "no_cfunc_wrapper": True}
INLINED: dict[str, Any] = {**_SETTINGS, "forceinline": True}
"""The options of `inlined`, for what numba compiles on its own."""


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    settings: dict[str, Any] = {**_SETTINGS, "cache": True, **options}
    dispatcher: Any = njit(**settings)(function)
    if dispatcher is function:  # as it is with the compiler off (NUMBA_DISABLE_JIT=1)
        return function
    # numba looks at the function's own file alone, and would go on with stale code after a change in another one.
    dispatcher._cache._cache_file._source_stamp = STAMP
    return dispatcher
