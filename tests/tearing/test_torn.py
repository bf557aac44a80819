"""A cloth across a tear: what it keeps, the forces on what has split, threads, solvers."""

from itertools import pairwise

import numpy as np
import pytest

import cape
from motions.errors import ValueRangeError
from tests.tearing.to_tear import FABRIC, IDENTITY, fans, mesh_of, still

GRID = cape.Cloth.rectangle(width=0.4, height=0.5, spacing=0.05, fabric=FABRIC)
CLOTHS = {"grid": GRID, "mesh": mesh_of(GRID, jitter=0.01)}
ACROSS = 5 * GRID.columns + np.arange(GRID.columns)  # a row of vertices from border to border
TEARING = cape.Tearing(strain=1e3)  # by hand only
FREE = {"gravity": (0.0, 0.0, 0.0), "tearing": TEARING}


def crumpled(cloth: cape.Cloth, *, tearing: cape.Tearing | None = TEARING, **scene) -> cape.Simulation:
    """A free cloth, its vertices a little off their places, each with a velocity of its own, in double precision."""
    solver = cape.SymplecticEuler(substeps=1, precision="double")
    simulation = cape.Simulation(
        cape.Scene(cloth, gravity=(0.0, 0.0, 0.0), tearing=tearing, **scene), solver=solver, threads=1
    )
    simulation.start({})
    rng = np.random.default_rng(4)
    places = simulation.positions + rng.normal(scale=2e-3, size=(cloth.vertices, 3))
    simulation.draw(places, rng.normal(scale=0.1, size=places.shape), 1.0)
    return simulation


def masses(simulation: cape.Simulation) -> np.ndarray:
    return simulation.assembly.outwards(simulation.assembly.mass)


def forces(simulation: cape.Simulation) -> np.ndarray:
    """Forces on the vertices [N], from what one step of a microsecond does to their velocities."""
    before = simulation.velocities
    simulation.step({}, 1e-6)
    return masses(simulation)[:, None] * (simulation.velocities - before) / 1e-6


@pytest.mark.parametrize("kind", CLOTHS)
def test_mass_momentum_and_energy_across_a_tear(kind):
    simulation = crumpled(CLOTHS[kind])

    def kept() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mass, x, v = masses(simulation), simulation.positions, simulation.velocities
        return mass.sum(), mass @ v, mass @ np.cross(x, v)

    before, energy = kept(), simulation.energy
    assert simulation.tear(ACROSS) == len(ACROSS) - 1
    assert len(simulation.positions) == GRID.vertices + len(ACROSS)
    for now, then in zip(kept(), before, strict=True):
        assert np.allclose(now, then, rtol=1e-12, atol=1e-15)
    after = simulation.energy
    assert after.kinetic == pytest.approx(energy.kinetic, rel=1e-12)
    if kind == "grid":  # a mesh is fitted to its fabric anew, which may also store more
        assert simulation.released > 0.0
    assert energy.elastic - after.elastic == pytest.approx(simulation.released, rel=1e-9)
    # Both parts go on, and nothing but each other acts on them.
    for _ in range(200):
        simulation.step({}, 1e-4)
    assert np.allclose(kept()[1], before[1], atol=1e-12)


def test_forces_of_a_torn_grid_are_those_of_its_energy():
    fabric = cape.Fabric(density=0.2, stretch=2000.0, shear=20.0, bend=1.0, damping_time=0.0, bend_damping_time=0.0)
    simulation = crumpled(cape.Cloth.rectangle(width=0.3, height=0.3, spacing=0.05, fabric=fabric))
    simulation.tear([21, 22, 23, 30, 31])
    x, v = simulation.positions, simulation.velocities
    force = forces(simulation)
    nudge, gradient = 1e-6, np.zeros_like(x)
    for vertex in [15, 22, 23, 30, *range(49, len(x))]:  # on both sides, at a tip, beside, and what has split off
        for axis in range(3):
            energies = []
            for way in (nudge, -nudge):
                moved = x.copy()
                moved[vertex, axis] += way
                simulation.draw(moved, v, 1.0)
                energies.append(simulation.energy.elastic)
            gradient[vertex, axis] = (energies[0] - energies[1]) / (2.0 * nudge)
    known = np.abs(gradient).max(axis=1) > 0.0
    assert known.sum() > 6
    # Central differences err by the square of the nudge, and by rounding: 1e-16 of some joules over it.
    assert np.allclose(force[known], -gradient[known], atol=1e-4 * np.abs(gradient).max())


def test_the_air_pushes_a_torn_grid_as_it_does_a_whole_one():
    wind = cape.Wind(velocity=(3.0, 1.0, 0.5))
    pushed = []
    for tears in (False, True):
        simulation = crumpled(GRID, wind=wind)
        if tears:
            simulation.tear(ACROSS)
        pushed.append(forces(simulation).sum(axis=0))
    assert np.linalg.norm(pushed[0]) > 0.1
    assert np.allclose(*pushed, rtol=1e-6)


def drawn_apart(cloth: cape.Cloth, *, threads: int = 1, frames: int = 25, solver=None, **scene) -> cape.Simulation:
    """A sheet held by two ends that part by 3 mm in each frame, and which bears 4 %."""
    holds = [cape.attach(cloth, "rod", "top"), cape.attach(cloth, "hook", "bottom")]
    scene = cape.Scene(cloth, holds, tearing=cape.Tearing(strain=0.04), **scene)
    simulation = cape.Simulation(scene, threads=threads, solver=solver)
    simulation.start(still("rod", "hook"))
    for frame in range(1, frames):
        simulation.step({**still("rod"), "hook": ([0.0, 0.0, -0.003 * frame], IDENTITY)}, 1 / 60)
    return simulation


@pytest.mark.parametrize("kind", CLOTHS)
@pytest.mark.parametrize("more", [{}, {"self_contact": cape.SelfContact()}])
def test_a_sheet_that_is_drawn_apart_parts_in_two_the_same_on_all_threads(kind, more):
    one, two = (drawn_apart(CLOTHS[kind], threads=threads, wind=cape.Wind(), **more) for threads in (1, 2))
    cloth = CLOTHS[kind]
    assert one.tears == two.tears >= len(cloth.regions["top"]) - 1
    assert np.array_equal(one.positions, two.positions)
    assert np.array_equal(one.topology.triangles, two.topology.triangles)
    triangles = one.topology.triangles
    assert fans(triangles).max() == 1
    assert one.mass == pytest.approx(cloth.masses().sum(), rel=1e-12)
    # No way leads from one end to the other, and what the hook carries is where it is.
    reached = set(cloth.regions["top"].tolist())
    while more := {int(v) for t in triangles if reached & set(t.tolist()) for v in t} - reached:
        reached |= more
    assert not reached & set(cloth.regions["bottom"].tolist())


def test_xpbd_tears_a_mesh_the_same_on_all_threads():
    more = {"wind": cape.Wind(), "self_contact": cape.SelfContact()}
    one, two = (drawn_apart(CLOTHS["mesh"], threads=n, solver=cape.XPBD(), frames=14, **more) for n in (1, 2))
    assert one.tears == two.tears > 0
    assert np.array_equal(one.positions, two.positions)
    assert np.array_equal(one.topology.triangles, two.topology.triangles)


@pytest.mark.parametrize("solver", [cape.XPBD(), cape.BackwardEuler()])
def test_other_solvers_tear_it_too(solver):
    small = cape.Cloth.rectangle(width=0.15, height=0.3, spacing=0.05, fabric=FABRIC)
    simulation = drawn_apart(small, solver=solver, frames=10)
    assert simulation.tears > 0
    assert fans(simulation.topology.triangles).max() == 1
    assert simulation.mass == pytest.approx(small.masses().sum(), rel=1e-12)


def test_a_grid_gets_more_room_when_its_spare_vertices_are_used_up():
    simulation = crumpled(GRID)
    spare = simulation.assembly.cloth.vertices - GRID.vertices
    columns, momentum = GRID.columns, masses(simulation) @ simulation.velocities
    for row in range(1, GRID.rows - 1):
        simulation.tear(row * columns + np.arange(columns))
    assert len(simulation.positions) == GRID.vertices + columns * (GRID.rows - 2) > GRID.vertices + spare
    assert fans(simulation.topology.triangles).max() == 1
    assert simulation.mass == pytest.approx(GRID.masses().sum(), rel=1e-12)
    simulation.step({}, 1e-5)
    assert np.allclose(masses(simulation) @ simulation.velocities, momentum, atol=1e-12)


def test_a_cloth_that_could_tear_and_does_not_moves_as_any_other():
    runs = []
    for tearing in (None, TEARING):
        simulation = crumpled(GRID, tearing=tearing)
        for _ in range(50):
            simulation.step({}, 1e-4)
        runs.append(simulation.positions)
    # What a cell adds to a spring is added up in another order.
    assert np.allclose(*runs, atol=1e-12)


def test_a_ledger_closes_across_a_tear():
    ledger = cape.Ledger()
    holds = [cape.attach(GRID, "rod", "top"), cape.attach(GRID, "hook", "bottom")]
    scene = cape.Scene(GRID, holds, tearing=cape.Tearing(strain=0.04))
    simulation = cape.Simulation(scene, ledger=ledger, threads=1)
    simulation.start(still("rod", "hook"))
    for frame in range(1, 20):
        simulation.step({**still("rod"), "hook": ([0.0, 0.0, -0.003 * frame], IDENTITY)}, 1 / 60)
    balance = ledger.balance
    assert simulation.tears > 0
    assert balance.gap < 0.01
    assert balance.moved[-1] == pytest.approx(-simulation.released, rel=1e-3, abs=1e-9)


def test_what_can_not_be_torn_is_told():
    simulation = crumpled(GRID)
    with pytest.raises(ValueRangeError, match="no edge leads from vertex 0 to 2"):
        simulation.tear([0, 2])
    with pytest.raises(ValueRangeError, match="vertex 999 is outside"):
        simulation.tear([0, 999])
    with pytest.raises(ValueRangeError, match="Tearing"):
        crumpled(GRID, tearing=None).tear(ACROSS)
    mark = simulation.mark()
    simulation.tear(ACROSS)
    with pytest.raises(ValueRangeError, match="torn"):
        simulation.go_back(mark)


@pytest.mark.parametrize("kind", CLOTHS)
def test_patches_of_contact_with_itself_follow_what_has_split(kind):
    simulation = crumpled(CLOTHS[kind], self_contact=cape.SelfContact())
    kept = simulation.assembly.layers
    simulation.tear(ACROSS)
    simulation.tear([2, GRID.columns + 2, 2 * GRID.columns + 2])
    layers, triangles = simulation.assembly.layers, simulation.assembly.cloth.triangles
    assert layers is not None
    assert layers is kept  # in place
    patches = layers.patches
    assert set(map(tuple, patches.triangles.T.tolist())) == set(map(tuple, triangles.tolist()))
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    known = patches.edges[:, : patches.edge_start[-1]].T
    assert np.array_equal(np.unique(known, axis=0), np.unique(ends, axis=0))
    assert len(known) == len(np.unique(ends, axis=0))
    assert sorted(patches.vertices[: patches.vertex_start[-1]].tolist()) == list(range(len(simulation.positions)))
    # Each is in the first patch of a triangle that has it, there in order.
    owner = np.repeat(np.arange(len(patches.triangle_start) - 1), np.diff(patches.triangle_start))
    for lists, starts, width in ((known, patches.edge_start, 2), (patches.vertices[:, None], patches.vertex_start, 1)):
        for patch, (start, end) in enumerate(pairwise(starts)):
            for item in lists[start:end]:
                assert owner[(np.isin(patches.triangles, item).sum(axis=0) >= width).argmax()] == patch
            assert lists[start:end].tolist() == sorted(lists[start:end].tolist())


def test_what_is_known_of_pairs_of_edges_is_kept_where_both_are_still_there():
    simulation = crumpled(GRID, self_contact=cape.SelfContact())
    layers = simulation.assembly.layers
    assert layers is not None
    pairs, edges, count = layers.edges, layers.patches.edges.copy(), 500
    first, second = np.random.default_rng(0).integers(0, layers.patches.edge_start[-1], (2, count))
    for values, known in ((pairs.first, first), (pairs.second, second), (pairs.due, np.arange(count))):
        values[:count] = known
    pairs.apart[:count], pairs.force[:count] = np.arange(count)[:, None], -np.arange(count)[:, None]
    pairs.counts[0] = count
    simulation.tear(ACROSS)
    there = set(map(tuple, layers.patches.edges[:, : layers.patches.edge_start[-1]].T.tolist()))
    kept = [k for k in range(count) if {tuple(edges[:, first[k]]), tuple(edges[:, second[k]])} <= there]
    assert 0 < len(kept) < count
    assert pairs.counts[0] == len(kept)
    for numbers, known in ((pairs.first, first), (pairs.second, second)):
        np.testing.assert_array_equal(layers.patches.edges[:, numbers[: len(kept)]], edges[:, known[kept]])
    np.testing.assert_array_equal(pairs.due[: len(kept)], kept)
    np.testing.assert_array_equal(pairs.apart[: len(kept), 2], kept)
    np.testing.assert_array_equal(pairs.force[: len(kept), 0], np.negative(kept))
