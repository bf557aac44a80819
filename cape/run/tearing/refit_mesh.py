"""How the arrays of a running mesh follow what has split.

Springs follow in place. Under a solver that steps spare vertices (`Solver.splits`) so does all else, as of a grid.
Under others, where there is no room, and where a limit of strain lists threads from where they are held, all but
springs is laid out anew.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import assemble, spare_vertices
from cape.assembly.mesh.places import NoRoom
from cape.assembly.mesh.split_records import Splits, move_bends, move_membrane, move_springs, move_triangles
from cape.assembly.mesh.split_springs import ActingSprings, Changed, SplitMeshSprings, follow_split
from cape.cloth.split_mesh import SplitMesh
from cape.forces.air import Air
from cape.forces.elastic import Elastic
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.run.hanging import Hanging
from cape.run.tearing.refit import go_on_in, move_faces, weigh, write_masses
from cape.run.tearing.sheet import Sheet
from cape.run.tearing.tethers import let_go

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def refit_mesh(cloth: Hanging, sheet: Sheet, copies: IntArray) -> float:
    """Have a mesh go on split as a sheet is, whose last vertices are copies of the given ones; see `refit.refit`."""
    assembly, mesh, springs = cloth.assembly, cloth.assembly.cloth, cloth.assembly.springs
    assert isinstance(mesh, SplitMesh)
    slots, first = springs.slots if isinstance(springs, ActingSprings) else springs, mesh.in_use
    assert isinstance(slots, SplitMeshSprings)
    copied = np.concatenate([np.argsort(mesh.order), np.arange(len(mesh.order), first)])[copies]
    state, missing = cloth.state, sheet.vertices - mesh.vertices
    if missing > 0:
        more = missing + (spare_vertices(mesh.whole) if springs.in_slots else 0)
        mesh = mesh.with_spare(mesh.vertices - first + more)
        state = State(*(np.concatenate([component, component[np.zeros(more, np.int64)]]) for component in state))
    for component in state:
        component[first : sheet.vertices] = component[copied]
    positions = np.stack(state[:3], axis=1).astype(float)
    split = mesh.split(sheet.cells, sheet.parents)
    slots, changed = follow_split(slots, split, copied, positions)
    try:
        if missing > 0 or cloth.running.links is not None or not springs.in_slots:
            raise NoRoom
        _fill(cloth.running.arrays.forces, slots, changed)
        assembly = replace(assembly, cloth=split, springs=slots)
        weigh(assembly, first, sheet.vertices)
        cloth.follow(assembly, changed)
    except NoRoom:
        _lay_out(cloth, split, slots, state, spare=springs.in_slots)
        return changed.released
    if assembly.contacts.faces is not None:
        move_faces(assembly, mesh.triangles, split.triangles)
    write_masses(cloth.running.arrays, assembly)
    let_go(assembly)
    return changed.released


def following(cloth: Hanging) -> list[Request]:
    """The code that `refit_mesh` needs whatever the solver, to be compiled together with other code."""
    mesh, springs = cloth.assembly.cloth, cloth.assembly.springs
    slots = springs.slots if isinstance(springs, ActingSprings) else springs
    if not isinstance(mesh, SplitMesh) or not isinstance(slots, SplitMeshSprings):
        return []
    return slots.following.requests(slots, mesh)


def _fill(forces: Any, springs: SplitMeshSprings, changed: Changed) -> None:
    """Write what has changed into the arrays of forces.

    Raises:
        NoRoom: something has no room in them, and they are of no use any more.
    """
    if Elastic in forces:
        links = forces[Elastic]
        splits: Splits = links.splits
        if splits.springs is not None:
            move_springs(links.springs, splits.springs, springs, changed.slots)
        if splits.membrane is not None:
            move_membrane(links.springs, splits.membrane, springs, changed)
        if links.bends is not None:
            move_bends(links.bends, springs, changed.rows)
    if Air in forces:
        move_triangles(forces[Air].splits.air, springs.faces, changed.triangles)


def give_up_spares(cloth: Hanging) -> None:
    """Have a mesh go on without spare vertices, for solvers that step none."""
    mesh, springs = cloth.assembly.cloth, cloth.assembly.springs
    if isinstance(mesh, SplitMesh) and isinstance(springs, SplitMeshSprings):
        state = State(*(component[: mesh.in_use].copy() for component in cloth.state))
        _lay_out(cloth, mesh.with_spare(0), springs, state, spare=False)


def _lay_out(cloth: Hanging, mesh: SplitMesh, springs: SplitMeshSprings, state: State, *, spare: bool) -> None:
    """Lay out anew all but the springs of a mesh, which has so many vertices as a state, `spare` ones or none."""
    scene, threads, hands = cloth.assembly.scene, len(cloth.assembly.ranks), cloth.assembly.hands
    laid_out = assemble(scene, cloth.held, threads=threads, spare=spare, split=mesh, springs=springs, hands=hands)
    go_on_in(cloth, laid_out, state)
