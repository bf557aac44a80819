"""A frame as a program: units called by their addresses, one after the other, in every substep.

A unit is compiled for its own group of arrays alone. The loop over a program is compiled once for all scenes, and what
a scene lacks is not in its program. A call costs some 10 ns.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import Function, inlined, intrinsic, routine, unit
from cape.kernels.team import Team, meet


class Use(NamedTuple):
    """A unit and the group of arrays that it works on."""

    unit: Function
    group: Any


class Program(NamedTuple):
    """Addresses of units, and of the groups that they work on, (n,) each."""

    units: NDArray[Any]
    groups: NDArray[Any]


class FrameCall(NamedTuple):
    """What a frame takes: `begin` once, `substep` as often as `substeps` (1,) says, in `duration` (1,) [s].

    A call takes it from one substep to before another, `part` (2,), so that the caller may break off in between.
    """

    begin: Program
    substep: Program
    team: Team
    substeps: NDArray[np.int64]
    duration: NDArray[np.float64]
    part: NDArray[np.int64]


class Nothing(NamedTuple):
    """A group without arrays."""


@unit
def wait_for_all(g, team, substep, substeps, step):
    """Wait until all threads have come here."""
    meet(team)


def _call_in_python(unit: Any, group: Any, team: Any, substep: int, substeps: int, step: float) -> None:
    unit.python(group, team, substep, substeps, step)


@intrinsic(_call_in_python)
def call_unit(typingctx, unit, group, team, substep, substeps, step):
    """Call the unit at an address with the group at another, for a team that is an address or a group."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        word, number = ir.IntType(64), ir.DoubleType()
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.IntType(32), [pointer, pointer, pointer, pointer, word, word, number])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        given = [
            builder.inttoptr(argument, pointer) if argument.type == word else builder.bitcast(argument, pointer)
            for argument in arguments[1:3]
        ]
        with builder.goto_entry_block():
            ignored = builder.bitcast(builder.alloca(word, 8), pointer)
        builder.call(function, [ignored, ignored, *given, *arguments[3:]])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, team, types.int64, types.int64, types.float64), generate


@inlined
def run(program, team, substep, substeps, step):
    """Call the units of a program."""
    for k in range(program.units.size):
        call_unit(program.units[k], program.groups[k], team, substep, substeps, step)


@routine
def run_frame(begin, substep, team, substeps, duration, part):
    """Advance a cloth by a part of a frame; the arguments are the fields of a `FrameCall`."""
    step = duration[0] / substeps[0]
    if part[0] == 0:
        run(begin, team, 0, substeps[0], step)
    for k in range(part[0], part[1]):
        run(substep, team, k, substeps[0], step)
