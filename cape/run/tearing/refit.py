"""How the arrays of a running cloth follow what has split.

A grid has spare vertices, and lists with room for all that its cells may leave astray: what has changed is written in
place, and the programs of a frame stay as they are. A grid whose spare vertices are used up is assembled anew, which
takes the time of many frames. Of meshes `cape.run.tearing.refit_mesh` tells.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly, assemble, inverse_of, spare_rows
from cape.assembly.fabrics import of_vertices
from cape.assembly.grid.limits import fill_links, longest_threads
from cape.assembly.grid.split_springs import Changed, SplitSprings, move_springs
from cape.assembly.self_contact import layers_of
from cape.cloth.split_grid import SplitGrid
from cape.forces.air import Air
from cape.forces.elastic import Elastic
from cape.forces.strays import Strays, StraysInAir, fill_air, fill_springs
from cape.forces.viscous_air import ViscousAir
from cape.kernels.state import State
from cape.run.hanging import Hanging
from cape.run.tearing.layers import SplitLayers
from cape.run.tearing.sheet import Sheet
from cape.run.tearing.tethers import let_go

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def refit(cloth: Hanging, sheet: Sheet, copies: IntArray) -> float:
    """Have a grid go on split as a sheet is, whose last vertices are copies of the given ones.

    They are where those are, and as fast; masses are those of the triangles that each is left with.
    What was stored in what no longer resists is given [J].
    """
    grid = cloth.assembly.cloth
    assert isinstance(grid, SplitGrid)
    if sheet.vertices > grid.vertices:
        _enlarge(cloth, sheet.vertices)
        grid = cloth.assembly.cloth
        assert isinstance(grid, SplitGrid)
    first = sheet.vertices - len(copies)
    for component in cloth.state:
        component[first : sheet.vertices] = component[copies]
    before, grid = grid, grid.split(sheet.cells, sheet.parents)
    moved = np.flatnonzero((before.corners != grid.corners).any(axis=1))
    springs = cloth.assembly.springs
    assert isinstance(springs, SplitSprings)
    changed = move_springs(springs, grid, moved)
    assembly = replace(cloth.assembly, cloth=grid, springs=replace(springs))
    weigh(assembly, first, sheet.vertices)
    if assembly.contacts.faces is not None:
        move_faces(assembly, before.triangles, grid.triangles)
    _fill(cloth.running.arrays, assembly, changed, moved)
    let_go(assembly)
    _limit(cloth, assembly)
    cloth.assembly = cloth.running.assembly = assembly
    return changed.energy(np.stack(cloth.state[:3], axis=1).astype(float))


def look_at_layers(cloth: Hanging, layers: SplitLayers) -> None:
    """Have contact of a cloth with itself know what has split."""
    assembly, known = cloth.assembly, cloth.assembly.layers
    if known is None or layers.follow(known, assembly.cloth):
        return
    found = layers_of(assembly.scene, assembly.cloth, alarm=known.alarm, spreads=known.spreads)
    assert found is not None
    cloth.assembly = assembly.with_layers(found)
    cloth.running.go_on_with(cloth.assembly)


def weigh(assembly: Assembly, first: int, after: int) -> None:
    """Set masses, and set vertices free that were spare and are copies of free ones."""
    mass = assembly.cloth.masses()
    assembly.free[first:after] = True
    assembly.contacts.free[first:after] = True
    assembly.mass[:] = mass
    assembly.inverse_mass[:] = inverse_of(mass, assembly.free)


def move_faces(assembly: Assembly, before: NDArray[np.int32], now: NDArray[np.int32]) -> None:
    """Give triangles that colliders could poke through their corners, which were others before, shape (T, 3)."""
    faces = assembly.contacts.faces
    assert faces is not None
    changed = np.flatnonzero((before != now).any(axis=1))
    count = assembly.cloth.vertices
    numbered = faces.corners.T.astype(np.int64) @ [count * count, count, 1]
    wanted = before[changed].astype(np.int64) @ [count * count, count, 1]
    order = np.argsort(numbered)
    places = order[np.minimum(np.searchsorted(numbered, wanted, sorter=order), len(order) - 1)]
    there = numbered[places] == wanted
    faces.corners[:, places[there]] = now[changed[there]].T
    faces.known_of[places[there]] = -1


def _fill(arrays: Any, assembly: Assembly, changed: Changed, cells: IntArray) -> None:
    """Write springs that have changed, masses, and cells (c,) that have moved into the arrays of a solver."""
    springs, forces, grid = assembly.springs, arrays.forces, assembly.cloth
    assert isinstance(springs, SplitSprings)
    assert isinstance(grid, SplitGrid)
    families, links = springs.families, forces[Elastic]
    assert families is not None
    family, start = np.divmod(changed.slots, grid.whole.vertices)
    links.springs.stiffness[family, start] = families.stiffness[family, start]
    if links.bends is not None:
        start = changed.bend_slots % grid.whole.vertices
        links.bends.stiffness[:2, grid.columns + start] = families.bend_stiffness[:, start]
        links.bends.stiffness[2, grid.columns + start] = families.twist_stiffness[start]
    fill_springs(forces[Strays].springs, springs)
    if Air in forces:
        forces[Air].air.cells[grid.whole_cells[cells, 0]] = 0.0
        fill_air(forces[StraysInAir].air, grid)
    write_masses(arrays, assembly)


def write_masses(arrays: Any, assembly: Assembly) -> None:
    """Write masses, and the drag of what sticks to them, into the arrays of a solver."""
    inertia, wind = arrays.inertia, assembly.scene.wind
    if ViscousAir in arrays.forces and wind is not None:
        density = of_vertices(assembly.cloth, lambda fabric: fabric.density)
        arrays.forces[ViscousAir].skin.drag[:] = wind.viscous / density * assembly.mass
    inertia.mass[:], inertia.free[:], inertia.inverse_mass[:] = assembly.mass, assembly.free, assembly.inverse_mass


def _limit(cloth: Hanging, assembly: Assembly) -> None:
    """Let threads be as long as they may that are left in a grid, and those that have gone astray."""
    running = cloth.running
    if running.longest is not None and running.strays is not None:
        with cloth.limit.refitted(assembly.springs):
            running.longest[:] = longest_threads(assembly, running.longest.dtype.type)
            fill_links(running.strays, assembly)


def _enlarge(cloth: Hanging, vertices: int) -> None:
    """Make more room for a grid, for so many vertices at least."""
    assembly, grid = cloth.assembly, cloth.assembly.cloth
    assert isinstance(grid, SplitGrid)
    missing = -(-(vertices - grid.vertices) // grid.columns)
    rows = grid.rows - grid.whole.rows + max(missing, spare_rows(grid.whole))
    larger = SplitGrid.of(grid.whole, rows).split(grid.corners, grid.parents)
    grown = assemble(assembly.scene, cloth.held, threads=len(assembly.ranks), split=larger, hands=assembly.hands)
    go_on_in(cloth, grown, State(*(grown.inwards(component[: grid.in_use]) for component in cloth.state)))


def go_on_in(cloth: Hanging, assembly: Assembly, state: State) -> None:
    """Have a cloth go on in another assembly of the same bones and what they hold, at a state about its origin."""
    for now, before in zip(assembly.carried, cloth.assembly.carried, strict=True):
        now.points[:], now.lift[:], now.drift[:] = before.points, before.lift, before.drift
    confined, kept = assembly.confined, cloth.assembly.confined
    if confined is not None and kept is not None:
        confined.animated.points[:], confined.normals[:] = kept.animated.points, kept.normals
    assembly.wind[:] = cloth.assembly.wind
    cloth.begin_in(assembly, state)
    cloth.look()
