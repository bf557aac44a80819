"""What the compiler makes of a function, for tests that look at it."""

import platform
from collections.abc import Sequence
from typing import Any

import pytest

from cape.kernels.jit import COMPILER_OFF, Function
from cape.kernels.linking import STEP
from cape.kernels.packing import Kind, Packed
from cape.kernels.team import Team

compiled_only = pytest.mark.skipif(COMPILER_OFF, reason="the compiler is off")

_SAME = {"amd64": "x86_64", "arm64": "aarch64"}
MACHINE = _SAME.get(platform.machine().lower(), platform.machine().lower())
"""The processor's kind."""


def assembly(function: Function, kinds: Sequence[Kind | Any]) -> str:
    """Assembly of a function with all that it calls, compiled anew for arguments of some kinds, or numba types."""
    from cape.kernels import compiler

    anew = Function(function.python, noalias=function.noalias, inline=function.inline, formula=function.formula)
    types = tuple(compiler.type_of(kind) if isinstance(kind, str | tuple) else kind for kind in kinds)
    module = compiler._made(anew, types).library.link_and_optimise()
    return compiler._target.codegen()._tm.emit_assembly(module)


def assembly_of_unit(unit: Function, group: Any) -> str:
    """Assembly of a unit for a group."""
    return assembly(unit, (Packed(group).kind, Packed(Team.alone(0)).kind, *STEP))
