"""What is compiled, in four words; each function is compiled when it is first needed.

- a **unit** is a piece of a frame: forces, contact, a stage of a solver. It is compiled once for itself and called by
  its address, never compiled into who calls it;
- a **kernel** is a loop over arrays that do not overlap, within a unit;
- an **inlined** function is a formula;
- a **routine** is anything else that these call.

All may also be called from Python, with arrays, numbers and NamedTuples of them. With the compiler off
(NUMBA_DISABLE_JIT=1) they are plain Python. What has been compiled is kept on disk (`kernels.store`); where all that a
run needs is there, the compiler is not even imported.

No fast math: every operation is done as written, in IEEE arithmetic but for `compiler.subnormals`, so that a result has
the same bits whether a loop was vectorised or not, inlined or not, compiled just now or taken from the disk, on one
thread or many. Where a product and a sum may be one instruction, `kernels.fused` says so.
"""

import importlib
import os
from collections.abc import Callable
from typing import Any

from cape.kernels.packing import Arguments, GroupKind, Packed

COMPILER_OFF = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


class Function:
    """A function that is compiled when it is first needed.

    Attributes:
        python: the function as it is written.
        noalias: whether its arrays do not overlap.
        inline: whether it always becomes part of who calls it.
        formula: what it was made around, if it is a loop that many formulas share.
        made: what was compiled in this process for other compiled code, by the types of its arguments.
    """

    def __init__(
        self,
        python: Callable[..., Any],
        *,
        noalias: bool = False,
        inline: bool = False,
        formula: "Function | None" = None,
    ) -> None:
        """Nothing is compiled yet."""
        self.python, self.noalias, self.inline, self.formula = python, noalias, inline, formula
        self.made: dict[Any, Any] = {}
        self.__name__, self.__doc__, self.__module__ = python.__name__, python.__doc__, python.__module__

    @property
    def place(self) -> str:
        """Module and name, and those of the formula."""
        own = f"{self.python.__module__}:{self._path}"
        return own if self.formula is None else f"{own}<{self.formula.place}>"

    @property
    def _path(self) -> str:
        """Where it is found in its module; what a loop made goes by the loop's name."""
        path = self.python.__qualname__
        return self.__name__ if "<locals>" in path else path

    def __repr__(self) -> str:
        """Name it."""
        return f"<compiled {self.place}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pass it to another process by its name."""
        return find_function, (self.__module__, self._path, self.formula)

    def __call__(self, *arguments: Any) -> Any:
        """Call it from Python."""
        if COMPILER_OFF:
            return self.python(*arguments)
        from cape.kernels import calling

        packed = Packed(Arguments(arguments))
        assert isinstance(packed.kind, GroupKind)
        return calling.entry_of(self, packed.kind)(packed.address)


def unit(function: Callable[..., None]) -> Any:
    """A piece of a frame, called as `function(group, team, substep, substeps, step)`; see `kernels.program`."""
    return Function(function)


def kernel(function: Callable[..., Any]) -> Any:
    """A loop over arrays **that do not overlap**, so that LLVM may vectorise it.

    Without the promise a loop with three outputs and eight inputs stays scalar, since LLVM gives up on checking all
    pairs for overlap. `tests/bench/kernels.py` tells what a vertex costs.
    """
    return Function(function, noalias=True)


def routine(function: Callable[..., Any]) -> Any:
    """A function that calls kernels, formulas and other routines."""
    return Function(function)


def inlined(function: Callable[..., Any]) -> Any:
    """A formula that is always inlined: loops that use it still vectorise, and no call passes whole arrays."""
    return Function(function, inline=True)


def formula_of(python: Callable[..., Any]) -> Function:
    """A plain Python function as a formula, always the same one."""
    known = _formulas.get(python)
    if known is None:
        known = _formulas[python] = Function(python, inline=True)
    return known


_formulas: dict[Callable[..., Any], Function] = {}


class Loop:
    """A function that is compiled anew around each formula; `around` gives the one for a formula."""

    def __init__(self, make: Callable[[Function], Callable[..., Any]]) -> None:
        """Hold what makes the function around a formula."""
        self._make, self.__name__, self.__doc__ = make, make.__name__, make.__doc__
        self._known: dict[Function, Function] = {}

    def around(self, formula: Function) -> Function:
        """The loop around a formula."""
        function = self._known.get(formula)
        if function is None:
            function = self._known[formula] = Function(self._make(formula), formula=formula)
        return function


def loop(make: Callable[[Function], Callable[..., Any]]) -> Loop:
    """A loop around formulas; give a function of the same name that calls its argument, the formula."""
    return Loop(make)


def find_function(module: str, name: str, formula: Function | None = None) -> Function:
    """The function of that name, in another process than the one that asks for it."""
    found: Any = importlib.import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    if isinstance(found, Loop):
        assert formula is not None
        return found.around(formula)
    return found if isinstance(found, Function) else formula_of(found)


class Intrinsic:
    """What the machine can do and Python has no words for.

    Attributes:
        define: as for numba's own intrinsics: gives a signature and what generates the code.
        python: what stands in for it with the compiler off.
    """

    def __init__(self, define: Callable[..., Any], python: Callable[..., Any]) -> None:
        """Hold both."""
        self.define, self.python = define, python
        self.__name__, self.__doc__ = define.__name__, define.__doc__

    def __call__(self, *arguments: Any) -> Any:
        """Call what stands in for it in Python."""
        return self.python(*arguments)


def intrinsic(python: Callable[..., Any]) -> Callable[[Callable[..., Any]], Any]:
    """Make an `Intrinsic` of a definition, with what stands in for it in plain Python."""
    return lambda define: Intrinsic(define, python)
