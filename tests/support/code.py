"""What the compiler makes of a function, for tests that look at it."""

import platform
from collections.abc import Sequence
from typing import Any

import pytest

from cape.assembly.contact import link_distances
from cape.kernels import store
from cape.kernels.jit import COMPILER_OFF, Function
from cape.kernels.linking import STEP, Linker
from cape.kernels.packing import ArrayKind, GroupKind, Packed
from cape.kernels.team import Team
from cape.scene.scene import Scene
from cape.solvers import Solver
from cape.solvers.running import Thread
from tests.support.scenes import Run

compiled_only = pytest.mark.skipif(COMPILER_OFF, reason="the compiler is off")

_SAME = {"amd64": "x86_64", "arm64": "aarch64"}
MACHINE = _SAME.get(platform.machine().lower(), platform.machine().lower())
"""The processor's kind."""


def assembly(function: Function, kinds: Sequence[Any]) -> str:
    """Assembly of a function with all that it calls, compiled anew for arguments of some kinds, or numba types."""
    from cape.kernels.compiler import library
    from cape.kernels.compiler.kinds import type_of

    anew = Function(function.python, noalias=function.noalias, inline=function.inline, formula=function.formula)
    types = tuple(type_of(kind) if isinstance(kind, (str, ArrayKind, GroupKind)) else kind for kind in kinds)
    return library.machine().emit_assembly(library.made(anew, types).library.link_and_optimise())


def assembly_of_unit(unit: Function, group: Any) -> str:
    """Assembly of a unit for a group."""
    return assembly(unit, (Packed(group).kind, Packed(Team.alone(0)).kind, *STEP))


def requests_of(scene: Scene, solver: Solver, *, threads: int = 1) -> list[store.Request]:
    """All code that a frame of a scene needs, for a thread alone or for the first of several."""
    running, linker = Run(scene, solver, threads=threads).running, Linker()
    order = solver.units(Thread(running, 0, threads, None), linker)
    linker.frame(order.begin, order.substep, Team.alone(scene.cloth.vertices))
    contacts = running.assembly.contacts
    if contacts.colliders is not None:
        link_distances(scene, contacts.colliders, contacts.faces, linker)
    return [request for request, _ in linker._wanted]


def name_of(request: store.Request) -> str:
    """The name of a request's function; of one that belongs to a kind of shape with that."""
    function = request.function
    shape = (function.formula or function).__module__.rpartition(".")
    return function.__name__ + (f" of {shape[2]}" if shape[0] == "skeleton.shapes" else "")
