"""How the arrays of a running mesh follow what has split.

Under a solver that steps spare vertices (`Solver.splits`) what has changed is written in place, as of a grid. Where
there is no room, and where a limit of strain lists threads from where they are held, all is laid out anew from the
springs that are known; under other solvers a mesh is assembled anew, which takes the time of many frames.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import assemble, spare_vertices
from cape.assembly.mesh.places import NoRoom
from cape.assembly.mesh.split_records import Splits, move_bends, move_membrane, move_springs, move_triangles
from cape.assembly.mesh.split_springs import Changed, SplitMeshSprings, follow_split
from cape.cloth.cloth import MeshCloth
from cape.cloth.split_mesh import SplitMesh
from cape.forces.air import Air
from cape.forces.elastic import Elastic
from cape.kernels.state import State
from cape.run.hanging import Hanging
from cape.run.tearing.refit import go_on_in, move_faces, weigh, write_masses
from cape.run.tearing.sheet import Sheet
from cape.run.tearing.sheets import split_mesh
from cape.run.tearing.tethers import let_go
from cape.solvers.euler import shortened

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def refit_mesh(cloth: Hanging, sheet: Sheet, copies: IntArray) -> float:
    """Have a mesh go on split as a sheet is, whose last vertices are copies of the given ones; see `refit.refit`."""
    assembly, mesh = cloth.assembly, cloth.assembly.cloth
    if not isinstance(mesh, SplitMesh):
        return _assemble_anew(cloth, sheet, copies)
    first, springs = mesh.in_use, assembly.springs
    assert isinstance(springs, SplitMeshSprings)
    copied = np.concatenate([np.argsort(mesh.order), np.arange(len(mesh.order), first)])[copies]
    state, missing = cloth.state, sheet.vertices - mesh.vertices
    if missing > 0:
        more = missing + spare_vertices(mesh.whole)
        mesh = mesh.with_spare(mesh.vertices - first + more)
        state = State(*(np.concatenate([component, component[np.zeros(more, np.int64)]]) for component in state))
    for component in state:
        component[first : sheet.vertices] = component[copied]
    positions = np.stack(state[:3], axis=1).astype(float)
    before, split = mesh.triangles, mesh.split(sheet.cells, sheet.parents)
    springs, changed = follow_split(springs, split, copied, positions)
    try:
        if missing > 0 or cloth.running.links is not None:
            raise NoRoom
        _fill(cloth.running.arrays.forces, springs, changed)
    except NoRoom:
        grown = assemble(assembly.scene, cloth.held, threads=len(assembly.ranks), split=split, springs=springs)
        go_on_in(cloth, grown, state)
        return changed.released
    assembly = replace(assembly, cloth=split, springs=springs)
    weigh(assembly, first, sheet.vertices)
    if assembly.contacts.faces is not None:
        move_faces(assembly, before, split.triangles)
    write_masses(cloth.running.arrays, assembly)
    let_go(assembly)
    cloth.running.arrays = shortened(cloth.running.arrays, assembly, changed)
    cloth.assembly = cloth.running.assembly = assembly
    return changed.released


def _fill(forces: Any, springs: SplitMeshSprings, changed: Changed) -> None:
    """Write what has changed into the arrays of forces.

    Raises:
        NoRoom: something has no room in them, and they are of no use any more.
    """
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


def give_up_spares(cloth: Hanging, sheet: Sheet) -> None:
    """Have a mesh go on without spare vertices, for solvers that step none."""
    mesh = cloth.assembly.cloth
    if isinstance(mesh, SplitMesh):
        state = [cloth.assembly.outwards(values) for values in cloth.state]
        _assemble_apart(cloth, sheet, sheet.parents[mesh.whole.vertices :], state)


def _assemble_anew(cloth: Hanging, sheet: Sheet, copies: IntArray) -> float:
    """Assemble a mesh anew as it has split; gives by how much less energy it stores [J]."""
    assembly, stored = cloth.assembly, _elastic_energy(cloth)
    state = [np.concatenate([values, values[copies]]) for values in map(assembly.outwards, cloth.state)]
    _assemble_apart(cloth, sheet, copies, state)
    return stored - _elastic_energy(cloth)


def _assemble_apart(cloth: Hanging, sheet: Sheet, copies: IntArray, state: list[NDArray[Any]]) -> None:
    """Assemble a mesh whose scene has copies of some vertices from now on, at a state as that numbers them."""
    assembly = cloth.assembly
    mesh = assembly.scene.cloth
    assert isinstance(mesh, MeshCloth)
    split = split_mesh(mesh, sheet, copies)
    scene = replace(
        assembly.scene,
        cloth=split,
        attachments=[replace(each, cloth_vertices=split.vertices) for each in assembly.scene.attachments],
        confinements=[
            replace(each, animated=replace(each.animated, cloth_vertices=split.vertices))
            for each in assembly.scene.confinements
        ],
    )
    grown = assemble(scene, cloth.held, threads=len(assembly.ranks))
    go_on_in(cloth, grown, State(*(np.ascontiguousarray(grown.inwards(values)) for values in state)))


def _elastic_energy(cloth: Hanging) -> float:
    return Elastic.energy(cloth.assembly, np.stack(cloth.state[:3], axis=1).astype(float))
