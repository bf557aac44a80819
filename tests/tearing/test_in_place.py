"""A mesh whose arrays follow tears in place, against the same mesh assembled wholly anew."""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

import cape
from cape.assembly import assemble
from cape.assembly.chains import chain_of
from cape.assembly.mesh import following, split_springs
from cape.assembly.mesh import springs as springs_of_meshes
from cape.assembly.mesh.links import bend_matrix
from cape.assembly.mesh.places import NoRoom
from cape.assembly.mesh.split_springs import Changed, SplitMeshSprings, follow_split, split_mesh_springs
from cape.assembly.mesh.split_stability import steps_near
from cape.assembly.mesh.springs import mesh_springs
from cape.assembly.springs import Springs
from cape.assembly.stability import largest_step
from cape.cloth.split_mesh import SplitMesh
from cape.cloth.triangle_mesh import locality_order
from cape.kernels.cloth.slopes import USUAL
from cape.kernels.xpbd.membrane import NUMBERS
from cape.kernels.xpbd.mesh import MeshConstraints
from cape.kernels.xpbd.packed import LANES, SIDE
from cape.run.tearing import refit_mesh
from cape.run.tearing.sheets import sheet_of
from cape.scene.standard_scenes import SHEET
from cape.solvers import xpbd_splits
from cape.solvers.xpbd import _patches, step_of
from tests.tearing.to_tear import FABRIC, mesh_of, still

GRID = cape.Cloth.rectangle(width=0.4, height=0.5, spacing=0.04, fabric=FABRIC)
STIFF = cape.Cloth.rectangle(width=0.4, height=0.5, spacing=0.04, fabric=SHEET)
# Springs do as well as a membrane on cells split along diagonals, and not elsewhere.
MESHES = {"springs": mesh_of(GRID), "membrane": mesh_of(GRID, jitter=0.008), "stiff": mesh_of(STIFF)}
KINDS = list(MESHES)
TEARS = 8

Follow = tuple[SplitMesh, SplitMeshSprings, Changed, NDArray[np.float64]]


def inverse_mass(mesh: cape.MeshCloth) -> NDArray[np.float64]:
    mass = mesh.masses()
    return np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0)


def torn_at_random(mesh: cape.MeshCloth, seed: int) -> Iterator[Follow]:
    """The mesh after each of some tears along ways of a few edges, and its springs, which followed it from the first.

    Then what that changed, and where the vertices are, which have been pushed about.
    """
    rng = np.random.default_rng(seed)
    sheet = sheet_of(mesh, np.zeros(mesh.vertices, bool))
    split = SplitMesh.of(mesh, locality_order(mesh.faces, mesh.positions), 10 * TEARS)
    springs = split_mesh_springs(split)
    positions = split.positions + rng.normal(scale=2e-3, size=split.positions.shape)
    made = 0
    while made < TEARS:
        way = [int(rng.integers(sheet.vertices))]
        for _ in range(int(rng.integers(2, 5))):
            way.append(int(rng.choice(sorted(sheet.edges_at(way[-1])))))
        parted, copies = sheet.split([(min(a, b), max(a, b)) for a, b in pairwise(way)])
        if not len(copies):
            continue
        copied = np.append(np.argsort(split.order), np.arange(mesh.vertices, sheet.vertices))[copies]
        positions[sheet.vertices : parted.vertices] = positions[copied]
        sheet, split, made = parted, split.split(parted.cells, parted.parents), made + 1
        springs, changed = follow_split(springs, split, copied, positions)
        yield split, springs, changed, positions


def in_order(springs: Springs) -> list[NDArray[np.float64]]:
    """Ends, rest lengths, whether stretch is measured, stiffness, and stiffness of those that precondition."""
    columns = [springs.first, springs.second, springs.rest, springs.measured, springs.stiffness]
    columns += [] if springs.nearest is None else [springs.nearest]
    order = np.lexsort((springs.measured, springs.rest.round(9), springs.second, springs.first))
    return [np.asarray(column[order], dtype=float) for column in columns]


def energy(springs: Springs, positions: NDArray[np.float64]) -> float:
    lengths = np.linalg.norm(positions[springs.second] - positions[springs.first], axis=1)
    bent = np.einsum("km,kmc->kc", springs.bend_coefficients, positions[springs.bend_vertices])
    total = 0.5 * springs.stiffness @ (lengths - springs.rest) ** 2 + 0.5 * springs.bend_stiffness @ (bent**2).sum(
        axis=1
    )
    return float(total) + (0.0 if springs.membrane is None else springs.membrane.energy(positions))


@pytest.mark.parametrize("kind", KINDS)
def test_springs_that_followed_several_tears_are_those_of_the_mesh_as_it_is(kind, monkeypatch):
    # Triangles that hang by one edge are fitted so badly that a small torn mesh would get a membrane by itself.
    monkeypatch.setattr(springs_of_meshes, "MISSED", 0.0 if kind == "membrane" else np.inf)
    for seed in range(3):
        for split, springs, _, _ in torn_at_random(MESHES[kind], seed):
            anew = mesh_springs(split)
            for followed, wanted in zip(in_order(springs.acting), in_order(anew), strict=True):
                assert np.allclose(followed, wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
            one, other = (bend_matrix(each, split.vertices) for each in (springs.acting, anew))
            assert abs(one - other).max() < 1e-12 * abs(other).max()
            assert (springs.membrane is None) == (anew.membrane is None) == (kind != "membrane")
            if springs.membrane is not None and anew.membrane is not None:
                for name in ("faces", "slopes", "area", "neighbours", "own", "share"):
                    assert np.allclose(getattr(springs.membrane, name), getattr(anew.membrane, name), rtol=1e-12), name


def test_bends_of_a_torn_mesh_find_room_however_little_there_was(monkeypatch):
    """Around borders slopes are fitted on more vertices than within."""
    wanted = [springs.acting for _, springs, _, _ in torn_at_random(MESHES["membrane"], seed=5)]
    monkeypatch.setattr(following, "ROOM", USUAL)
    monkeypatch.setattr(following, "WIDER", 1)
    for (_, springs, _, _), usual in zip(torn_at_random(MESHES["membrane"], seed=5), wanted, strict=True):
        width = usual.bend_vertices.shape[1]
        assert springs.acting.bend_vertices.shape[1] <= width
        for of in ("bend_coefficients", "bend_stiffness"):
            found, known = getattr(springs.acting, of), getattr(usual, of)
            assert np.array_equal(found, known[:, : found.shape[1]] if known.ndim == 2 else known)
            assert known.ndim == 1 or not known[:, found.shape[1] :].any()


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_tear_releases_is_by_how_much_less_is_stored(kind):
    before = np.nan
    for _, springs, changed, positions in torn_at_random(MESHES[kind], seed=3):
        stored = energy(springs, positions)
        if not np.isnan(before):
            # Copies lie where their vertices do, so that nothing else stores more or less.
            assert before - stored == pytest.approx(changed.released, rel=1e-6, abs=1e-9 * stored)
        before = stored


FINE = mesh_of(cape.Cloth.rectangle(width=0.3, height=0.3, spacing=0.02, fabric=SHEET), jitter=0.004)  # bending counts


@pytest.mark.parametrize("kind", [*KINDS, "fine"])
def test_steps_are_as_short_as_the_torn_mesh_needs(kind):
    mesh = {**MESHES, "fine": FINE}[kind]
    fabric = mesh.fabric
    for seed in range(2):
        whole, light = split_mesh_springs(SplitMesh.of(mesh, np.arange(mesh.vertices), 0)).acting, inverse_mass(mesh)
        usual = np.array([largest_step(whole, fabric, light, places) for places in (mesh.positions, None)])
        steps = usual
        for split, springs, changed, _ in torn_at_random(mesh, seed):
            near = steps_near(springs, changed, fabric, inverse_mass(split), split.positions)
            steps = np.minimum(steps, near)
            light = inverse_mass(split)
            needed = [largest_step(springs.acting, fabric, light, places) for places in (split.positions, None)]
            # A tenth less than what is stable is used; once short, steps stay so.
            assert (steps <= 1.015 * np.array(needed)).all()
            assert (steps >= 0.9 * np.minimum(needed, usual)).all()


EULER = cape.SymplecticEuler(substeps=1, precision="double")


def crumpled(mesh: cape.MeshCloth, solver: cape.Solver = EULER, **scene) -> cape.Simulation:
    """A free mesh, its vertices a little off their places, each with a velocity of its own, in double precision."""
    wind = cape.Wind(velocity=(3.0, 1.0, 0.5), viscous=0.01)
    scene = cape.Scene(mesh, gravity=(0.0, 0.0, 0.0), tearing=cape.Tearing(strain=1e3), **{"wind": wind, **scene})
    simulation = cape.Simulation(scene, solver=solver, threads=2)
    simulation.start({})
    rng = np.random.default_rng(4)
    places = simulation.positions + rng.normal(scale=2e-3, size=(mesh.vertices, 3))
    simulation.draw(places, rng.normal(scale=0.1, size=places.shape), 1.0)
    return simulation


ROWS = [k * GRID.columns + np.arange(GRID.columns) for k in (5, 8)]
SLITS = [np.arange(3) * GRID.columns + 3, 6 * GRID.columns + np.arange(2, 5), 6 * GRID.columns + np.arange(4, 7)]
WAYS = [ROWS[0], *SLITS, ROWS[1]]  # through both borders, from one, within, onwards, and through again


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("anew", ["laid out", "without spare vertices", "wholly"])
def test_it_moves_as_one_that_is_anew_after_each_tear(kind, anew, monkeypatch):
    runs = []
    monkeypatch.setattr(assemble, "FEWEST", 40)
    for in_place in (True, False):
        if not in_place and anew != "laid out":
            monkeypatch.setattr(cape.SymplecticEuler, "splits", False)
        simulation = crumpled(MESHES[kind])
        ranks = simulation.assembly.ranks
        if not in_place:
            monkeypatch.setattr(refit_mesh, "_fill", no_room)
        if not in_place and anew == "wholly":
            monkeypatch.setattr(split_springs, "MISSED", 0.0 if kind == "membrane" else np.inf)
            monkeypatch.setattr(refit_mesh, "follow_split", fitted_anew)
        for way in WAYS:
            assert simulation.tear(way) == len(way) - 1
            for _ in range(5):
                simulation.step({}, 2e-5)
        assert (simulation.assembly.ranks is ranks) == in_place
        runs.append((simulation.positions, simulation.velocities, simulation.released, simulation.energy.elastic))
    for followed, wanted in zip(*runs, strict=True):
        assert np.allclose(followed, wanted, rtol=1e-10, atol=1e-11 * np.abs(wanted).max())


def laid_out(constraints: MeshConstraints) -> list[list[tuple[float, ...]]]:
    """What there is of each kind, as numbers in order, each colour of which has been seen to share no vertex."""
    springs, membrane, bends, kinds = constraints.springs, constraints.membrane, constraints.bends, []
    nobody = len(constraints.packed) // SIDE - 1
    if springs is not None:
        ends = springs.ends.reshape(-1, 2, LANES).swapaxes(1, 2)
        used = LANES * springs.starts[-1]
        numbers = np.stack([np.reshape(of[:used], (-1, LANES)) for of in springs.stretch[:3] if of is not None], axis=2)
        kinds.append(in_blocks(ends, numbers, springs.starts, nobody))
    if membrane is not None:
        vertices = membrane.vertices.reshape(-1, 4, LANES).swapaxes(1, 2)
        numbers = membrane.numbers.reshape(-1, NUMBERS, LANES).swapaxes(1, 2)
        kinds.append(in_blocks(vertices, numbers, membrane.starts, nobody))
    if bends is not None:
        found = []
        for start, end in pairwise(bends.starts.tolist()):
            members = bends.members[bends.first[start] : bends.first[end]]
            assert len(np.unique(members)) == len(members)
            for k in range(start, end):
                own, three = slice(bends.first[k], bends.first[k + 1]), slice(3 * k, 3 * k + 3)
                coefficients = bends.coefficients[3 * own.start : 3 * own.stop]
                numbers = bends.mixed[k], bends.bend.stiffness[three], bends.bend.mobility[three]
                found.append((*bends.members[own].tolist(), *np.concatenate([coefficients, *numbers]).tolist()))
        assert not bends.bend.stiffness[3 * bends.starts[-1] :].any()
        kinds.append(sorted(found))
    return kinds


def in_blocks(
    vertices: NDArray[np.uint32], numbers: NDArray[np.floating], starts: NDArray[np.int64], nobody: int
) -> list[tuple[float, ...]]:
    """The same of constraints in blocks: their vertices (B, LANES, m), and numbers (B, LANES, n)."""
    found = []
    for start, end in pairwise(starts.tolist()):
        met = vertices[start:end]
        met = met[met != nobody]
        assert len(np.unique(met)) == len(met)
        acts = vertices[start:end, :, 0] != nobody
        assert not numbers[start:end][~acts].any()
        both = zip(vertices[start:end][acts].tolist(), numbers[start:end][acts].tolist(), strict=True)
        found += [(*own, *of) for own, of in both]
    return sorted(found)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("iterations", [1, 3])
def test_xpbd_follows_in_place_with_the_constraints_that_are_laid_out_anew(kind, iterations, monkeypatch):
    solver = cape.XPBD(iterations=iterations)
    monkeypatch.setattr(assemble, "FEWEST", 40)
    simulation = crumpled(MESHES[kind], solver, wind=None)
    assembly, ranks = simulation.assembly, simulation.assembly.ranks
    for way in WAYS:
        assert simulation.tear(way) == len(way) - 1
        assembly, running = simulation.assembly, simulation._started.running
        anew = solver.init(assembly, running.state)
        assert laid_out(running.arrays.constraints) == laid_out(anew.arrays.constraints)
        assert simulation.own_substeps(1.0) == solver.choose_substeps(anew, 1.0)
        simulation.step({}, 1e-3)
    assert assembly.ranks is ranks


@pytest.mark.parametrize("kind", KINDS)
def test_xpbd_goes_on_where_constraints_had_no_more_room(kind, monkeypatch):
    monkeypatch.setattr(assemble, "FEWEST", 40)
    monkeypatch.setattr(xpbd_splits, "COLOURS", 0)
    monkeypatch.setattr(xpbd_splits, "FEW", 0)
    monkeypatch.setattr(xpbd_splits, "MORE", 0.0)
    simulation = crumpled(MESHES[kind], cape.XPBD(), wind=None)
    ranks = simulation.assembly.ranks
    for way in WAYS:
        simulation.tear(way)
        running = simulation._started.running
        anew = cape.XPBD().init(simulation.assembly, running.state)
        assert laid_out(running.arrays.constraints) == laid_out(anew.arrays.constraints)
    assert simulation.assembly.ranks is not ranks


def test_patches_of_xpbd_bend_as_springs_do_some_of_which_are_idle():
    for split, springs, _, _ in torn_at_random(MESHES["springs"], seed=1):
        springs.bend_stiffness[::7] = 0.0  # as of a fabric that only warp threads stiffen
        vertices, coefficients, stiffness = _patches(springs)
        matrix = np.zeros((split.vertices, split.vertices))
        for members, rows, k in zip(vertices, coefficients, stiffness, strict=True):
            np.add.at(matrix, (members[:, None], members), rows.T @ (k[:, None] * rows))
        wanted = bend_matrix(springs.acting, split.vertices).toarray()
        assert np.abs(matrix - wanted).max() < 1e-12 * np.abs(wanted).max()
        # What is idle does not have a vertex move with others either.
        assert (coefficients[stiffness == 0.0] == 0.0).all()


@pytest.mark.parametrize("held", [["top"], []])
def test_steps_of_xpbd_are_those_of_the_chains_that_are_left(held):
    """The way to what hangs below a slit leads around it; of what nothing holds spare vertices hold nothing."""
    mesh = MESHES["springs"]
    holds = [cape.attach(mesh, "rod", name) for name in held]
    scene = cape.Scene(mesh, holds, gravity=(0.0, 0.0, -2000.0), tearing=cape.Tearing(strain=1e3))
    simulation = cape.Simulation(scene, solver=cape.XPBD(), threads=1)
    simulation.start(still(*simulation.bones))
    before = simulation.own_substeps(1.0)
    simulation.tear((GRID.rows - 3) * GRID.columns + np.arange(GRID.columns - 1))
    assert simulation.own_substeps(1.0) == math.ceil(1.0 / step_of(chain_of(simulation.assembly)))
    assert simulation.own_substeps(1.0) > before > 2400


def no_room(*_: object) -> None:
    raise NoRoom


def fitted_anew(
    springs: SplitMeshSprings, split: SplitMesh, _: NDArray[np.int64], positions: NDArray[np.float64]
) -> tuple[SplitMeshSprings, Changed]:
    """What `follow_split` gives, of springs that are derived from the mesh as it is, and nothing else."""
    fitted, nothing = split_mesh_springs(split), np.zeros(0, np.int64)
    released = energy(springs, positions) - energy(fitted, positions)
    return fitted, Changed(nothing, nothing, nothing, nothing, nothing, released)


def test_a_mesh_gets_more_room_when_its_spare_vertices_are_used_up():
    mesh = MESHES["membrane"]
    simulation = crumpled(mesh)
    spare = simulation.assembly.cloth.vertices - mesh.vertices
    for row in range(1, GRID.rows - 1):
        simulation.tear(row * GRID.columns + np.arange(GRID.columns))
    assert len(simulation.positions) == mesh.vertices + GRID.columns * (GRID.rows - 2) > mesh.vertices + spare
    assert simulation.mass == pytest.approx(mesh.masses().sum(), rel=1e-12)
    mass = simulation.assembly.outwards(simulation.assembly.mass)
    assert (mass > 0.0).all()
    before = simulation.positions
    simulation.step({}, 1e-5)
    assert np.abs(simulation.positions - before).max() < 1e-3


def test_a_torn_mesh_goes_on_with_another_solver_that_steps_spare_vertices():
    simulation = crumpled(MESHES["springs"])
    simulation.tear(WAYS[1])
    before, room, energy = simulation.positions, simulation.assembly.cloth.vertices, simulation.energy
    simulation.change_solver(cape.XPBD())
    assert simulation.assembly.cloth.vertices == room
    assert np.allclose(simulation.positions, before, atol=1e-6)
    assert simulation.energy.elastic == pytest.approx(energy.elastic, rel=1e-4)
    ranks = simulation.assembly.ranks
    simulation.tear(WAYS[2])
    assert simulation.assembly.ranks is ranks
    simulation.step({}, 1e-4)
    assert np.abs(simulation.positions[: len(before)] - before).max() < 1e-3


def test_a_torn_mesh_goes_on_with_a_solver_that_steps_no_spare_vertices():
    simulation = crumpled(MESHES["springs"])
    simulation.tear(WAYS[1])
    before, energy = simulation.positions, simulation.energy
    simulation.change_solver(cape.BackwardEuler())
    assert simulation.assembly.cloth.vertices == len(before)
    assert np.allclose(simulation.positions, before, atol=1e-6)
    assert simulation.energy.elastic == pytest.approx(energy.elastic, rel=1e-4)
    simulation.tear(WAYS[2])
    simulation.step({}, 1e-4)
    assert np.isfinite(simulation.positions).all()
