"""A mesh is the fabric, whatever its triangles: what it does at rest under load, against closed forms and references.

The solver is backward Euler, and all four in the last test, with vertices' motion damped away.
"""

import numpy as np
import pytest
from scipy.sparse import csr_array, kron
from scipy.sparse.linalg import splu

from cape import TRBDF2, XPBD, BackwardEuler, Cloth, Fabric, Scene, SymplecticEuler, attach
from cape.assembly.membrane import FAR_STRETCH, USUAL_STRETCH
from cape.assembly.mesh.links import mesh_membrane_record
from cape.assembly.springs import springs_of
from cape.assembly.stability import largest_frequency
from cape.cloth.cloth import MeshCloth
from cape.forces.elastic import Elastic
from cape.kernels.cloth.membrane import MembraneForces, mesh_membrane
from cape.kernels.state import State
from cape.kernels.team import Team
from cape.solvers import Solver
from tests.support.scenes import Run

CELLS = 19  # along a piece: 20 vertices
HELD = 3  # vertices from the border: as far as curvatures reach


def meshed(kind: str, columns: int, rows: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 2) in units of a cell, and triangles (T, 3), of a piece of `columns` x `rows` cells."""
    rng = np.random.default_rng(seed)
    across = columns + 1
    y, x = np.divmod(np.arange(across * (rows + 1)), across)
    flat = np.stack([x, y], axis=1).astype(float)
    a = (np.arange(rows)[:, None] * across + np.arange(columns)).ravel()
    b, c, d = a + 1, a + across, a + across + 1
    flip = np.zeros(len(a), dtype=bool)
    if kind == "equilateral":
        flat[:, 0] += 0.5 * (y % 2)
        flat[:, 1] *= 3**0.5 / 2
        flip = a // across % 2 == 1
    elif kind == "random":
        inner = (x > 0) & (x < columns) & (y > 0) & (y < rows)
        flat[inner] += 0.3 * rng.uniform(-1, 1, (inner.sum(), 2))
        flip = rng.random(len(a)) < 0.5
    one = np.where(flip[:, None], np.stack([a, c, d], axis=1), np.stack([a, c, b], axis=1))
    two = np.where(flip[:, None], np.stack([a, d, b], axis=1), np.stack([d, b, c], axis=1))
    return flat, np.concatenate([one, two])


def laid(flat: np.ndarray, triangles: np.ndarray, fabric: Fabric, *, turn: float = 0.0) -> MeshCloth:
    """A cloth in the world's x-y plane, its weft turned against x."""
    pattern = flat @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return Cloth.from_mesh(np.insert(flat, 2, 0.0, axis=1), triangles, pattern=pattern, fabric=fabric)


def steps_from_border(triangles: np.ndarray, count: int) -> np.ndarray:
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    sides, times = np.unique(sides, axis=0, return_counts=True)
    away = np.full(count, 99)
    away[sides[times == 1]] = 0
    for _ in range(HELD):
        for a, b in (sides.T, sides.T[::-1]):
            np.minimum.at(away, a, away[b] + 1)
    return away


@pytest.mark.parametrize("bend", [0.01, (0.02, 0.005)], ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize("kind", ["one way", "equilateral", "random"])
def test_a_plate_under_load_is_as_stiff_in_eight_directions_as_the_fabric(kind: str, bend: float | tuple[float, float]):
    """The border is held on the cylinder w = q t^4 / 24 D, D w'''' = q, with t along one direction after another."""
    size, load, density = 0.5, 1e-3, 0.1
    flat, triangles = meshed(kind, CELLS, CELLS)
    flat *= size / CELLS
    away = steps_from_border(triangles, len(flat))
    held, free = np.flatnonzero(away < HELD), np.flatnonzero(away >= HELD)
    fabric = Fabric(density=density, stretch=100.0, shear=10.0, bend=bend, damping_time=0.0, bend_damping_time=1e-3)
    cloth = laid(flat, triangles, fabric)
    run = Run(Scene(cloth, [attach(cloth, "hand", held)], gravity=(0, 0, -load / density)), BackwardEuler())
    sag = _rest(run, np.zeros(len(flat)))[free]
    for angle in np.arange(8) * np.pi / 8:
        stiffness = float(fabric.bend_along(np.cos(angle) ** 2))
        along = (flat - flat.mean(axis=0)) @ [np.cos(angle), np.sin(angle)]
        expected = -load * along**4 / (24.0 * stiffness)
        # Were the plate stiffer everything but its border's shape would be the less high: the part of the error that
        # looks like the sag of the same plate with a flat border.
        share = (_rest(run, expected) - expected)[free] @ sag / (sag @ sag)
        assert abs(share) < 0.03, (np.rad2deg(angle), share)


def _rest(run: Run, height: np.ndarray) -> np.ndarray:
    """Heights [m] at which a plate comes to rest whose held vertices are at the given ones."""
    assert run.assembly.attached is not None
    start = np.column_stack([run.scene.cloth.positions[:, :2], height])
    start = run.assembly.inwards(start)
    run.assembly.attached.points[:] = start[run.assembly.attached.vertices]
    for place, values in zip(run.state[:3], start.T, strict=True):
        place[:] = values
    for _ in range(4):
        for velocity in run.state[3:]:
            velocity[:] = 0.0
        run.step(50.0, 1)
    return run.positions[:, 2]


@pytest.mark.parametrize("kind", ["one way", "equilateral", "random"])
def test_a_strip_with_free_edges_bends_as_a_beam(kind: str):
    """Three rows are held where a clamped beam under its weight is; isotropic sheets need no other moments."""
    length, load, density, bend = 0.5, 1e-3, 0.1, 0.01
    flat, triangles = meshed(kind, CELLS, 8)
    flat *= length / CELLS
    x = flat[:, 0]
    held = np.flatnonzero(x < x.min() + 2.8 * length / CELLS)
    fabric = Fabric(density=density, stretch=100.0, shear=10.0, bend=bend, damping_time=0.0, bend_damping_time=1e-3)
    cloth = laid(flat, triangles, fabric)
    run = Run(Scene(cloth, [attach(cloth, "hand", held)], gravity=(0, 0, -load / density)), BackwardEuler())
    height = -load * x**2 * (6.0 * length**2 - 4.0 * length * x + x**2) / (24.0 * bend)
    tip = x > length - 1e-9
    found = _rest(run, height)
    # Beyond the clamps, of a beam that is as much shorter.
    assert found[tip].mean() == pytest.approx(height[tip].mean(), rel=0.03)


def plain_triangles_force(flat: np.ndarray, triangles: np.ndarray, stiffness: np.ndarray, strain: float) -> float:
    """Force [N] on the clamped ends of a strip at 45 degrees to its threads, stretched along x in its plane.

    Newton's method on Saint Venant and Kirchhoff's energy, each triangle with its own strain.
    """
    count, size = len(flat), len(triangles)
    root = np.sqrt(0.5)
    pattern = flat @ np.array([[root, -root], [root, root]])
    corners = pattern[triangles]
    slopes = np.linalg.inv(np.concatenate([corners, np.ones((size, 3, 1))], axis=2))[:, :2].transpose(0, 2, 1)
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / 2
    low, high = flat[:, 0].min(), flat[:, 0].max()
    right = flat[:, 0] > high - 1e-9
    free = np.flatnonzero(np.repeat(~(right | (flat[:, 0] < low + 1e-9)), 2))
    x = flat * [1.0 + strain, 1.0]
    rows = np.repeat(np.arange(3 * size), 6)
    columns = np.repeat((2 * triangles[:, :, None] + np.arange(2)).reshape(size, 1, 6), 3, axis=1).ravel()
    elastic = csr_array(kron(csr_array((area, (range(size), range(size)))), stiffness))
    for _ in range(30):
        gradient = np.einsum("tad,tai->tid", x[triangles], slopes)
        u, v = gradient[:, 0], gradient[:, 1]
        strains = np.stack([((u * u).sum(1) - 1) / 2, ((v * v).sum(1) - 1) / 2, (u * v).sum(1)], axis=1)
        change = np.stack(
            [
                slopes[:, :, :1] * u[:, None],
                slopes[:, :, 1:] * v[:, None],
                slopes[:, :, :1] * v[:, None] + slopes[:, :, 1:] * u[:, None],
            ],
            axis=1,
        )
        derivative = csr_array((change.ravel(), (rows, columns)), (3 * size, 2 * count))
        tension = elastic @ strains.ravel()
        pull = derivative.T @ tension
        if np.abs(pull[free]).max() < 1e-8 * np.abs(pull).max():
            return float(pull.reshape(-1, 2)[right, 0].sum())
        s = tension.reshape(-1, 3)
        plane = np.stack([np.stack([s[:, 0], s[:, 2]], 1), np.stack([s[:, 2], s[:, 1]], 1)], 1)
        pairs = np.einsum("tai,tij,tbj->tab", slopes, plane, slopes)
        places = (np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, (1, 3)).ravel())
        geometric = kron(csr_array((pairs.ravel(), places), (count, count)), np.eye(2))
        matrix = csr_array(derivative.T @ elastic @ derivative + geometric)[free][:, free].tocsc()
        x.reshape(-1)[free] -= splu(matrix).solve(pull[free])
    raise AssertionError("Newton's method has not found the rest")


def test_a_bias_strip_between_clamps_does_not_lock():
    """Twice as long as wide, shear a hundredth of stretch, against plain triangles on a mesh four times as fine.

    The reference is stiffer than the limit by what its own triangles lock, so that the mesh comes off too well by that:
    by some 3 %, as its triangles are 25 % too stiff where they are four times as large.
    """
    strain, width, fabric = 0.1, 0.1, Fabric(stretch=1000.0, shear=10.0, bend=0.0, damping_time=1e-3)
    forces = []
    stiffness = np.array([[1000.0, 10.0, 0.0], [10.0, 1000.0, 0.0], [0.0, 0.0, 10.0]])
    for cells in (10, 40):
        flat, triangles = meshed("random", 2 * cells, cells, seed=1)
        forces.append(plain_triangles_force(flat * width / cells, triangles, stiffness, strain))
    # That the tested mesh is one on which triangles lock.
    assert forces[0] > 1.18 * forces[1]

    flat, triangles = meshed("random", 20, 10, seed=1)
    cloth = laid(flat * width / 10, triangles, fabric, turn=np.pi / 4)
    ends = np.flatnonzero((flat[:, 0] < 1e-9) | (flat[:, 0] > 20 - 1e-9))
    stretched = cloth.positions * [1.0 + strain, 1.0, 1.0]
    moved = Cloth.from_mesh(stretched, triangles, pattern=cloth.pattern, fabric=fabric)
    run = Run(Scene(moved, [attach(moved, "hand", ends)], gravity=(0, 0, 0)), BackwardEuler(tolerance=1e-9))
    for _ in range(30):
        run.step(0.1, 1)
    right = flat[:, 0] > 20 - 1e-9
    force = _slope(run, np.outer(right, [1.0, 0.0, 0.0]))
    assert force == pytest.approx(forces[1], rel=0.15)


def _slope(run: Run, way: np.ndarray, h: float = 1e-7) -> float:
    """Change of the elastic energy when vertices are moved that way."""
    x, step = run.positions, h * way
    energies = [Elastic.energy(run.assembly, run.assembly.inwards(x + sign * step)) for sign in (1.0, -1.0)]
    return (energies[0] - energies[1]) / (2.0 * h)


def test_the_largest_step_is_for_a_membrane_as_far_as_it_is_strained():
    """Against the derivative of the forces, by differences, of a membrane without bending."""
    fabric = Fabric(density=0.1, stretch=(900.0, 300.0), shear=20.0, bend=0.0, damping_time=0.0)
    flat, triangles = meshed("random", 5, 4)
    cloth = laid(flat * 0.05, triangles, fabric, turn=0.3)
    springs, weights = springs_of(cloth), 1.0 / cloth.masses()
    assert springs.membrane is not None
    record = mesh_membrane_record(springs.membrane, cloth.vertices, np.float64)

    def forces(places: np.ndarray) -> np.ndarray:
        found, state = np.zeros((3, cloth.vertices)), State.at_rest(places, np.float64)
        mesh_membrane(MembraneForces(state, record, None, found), Team.alone(cloth.vertices), 0, 1, 0.0)
        return found.T.ravel()

    def frequency(places: np.ndarray) -> float:
        steps = 1e-6 * np.eye(3 * cloth.vertices).reshape(-1, cloth.vertices, 3)
        matrix = np.stack([(forces(places - s) - forces(places + s)) / 2e-6 for s in steps])
        root = np.sqrt(np.repeat(weights, 3))
        return float(np.sqrt(np.linalg.eigvalsh(root[:, None] * 0.5 * (matrix + matrix.T) * root).max()))

    usual, far = (largest_frequency(springs, weights, places) for places in (cloth.positions, None))
    rest, spread = frequency(cloth.positions), [s * cloth.positions for s in (USUAL_STRETCH, FAR_STRETCH)]
    # A thread at a stretch L is (3 L^2 - 1) / 2 times as stiff.
    assert usual == pytest.approx(rest * np.sqrt(1.66), rel=2e-3)
    assert frequency(cloth.positions * [USUAL_STRETCH, 1.0, 1.0]) < usual
    # Stretched along both threads at once it is a little stiffer yet; that is what the margin is for.
    assert frequency(spread[0]) < usual / 0.9
    assert 0.4 * far < frequency(spread[1]) < far


def hanging(kind: str) -> tuple[MeshCloth, Scene]:
    fabric = Fabric(
        density=0.1, stretch=(300.0, 100.0), shear=5.0, bend=(1e-3, 4e-3), damping_time=1e-3, bend_damping_time=1e-2
    )
    flat, triangles = meshed(kind, 7, 6)
    cloth = laid(flat * 0.03, triangles, fabric, turn=0.3)
    top = np.flatnonzero(flat[:, 1] < 1e-9)[[0, 1, -2, -1]]
    return cloth, Scene(cloth, [attach(cloth, "hand", top)], gravity=(1.0, 5.0, -3.0))


@pytest.mark.parametrize(
    ("solver", "steps", "tolerance"),
    [
        (SymplecticEuler(precision="double"), 0, 1e-6),
        (XPBD(precision="double"), 300, 1e-5),
        (XPBD(precision="double", iterations=3), 200, 1e-5),
        (BackwardEuler(tolerance=1e-9), 4, 1e-6),
        (TRBDF2(tolerance=1e-9), 8, 1e-6),
    ],
    ids=["euler", "xpbd", "xpbd, sweeps", "backward Euler", "TR-BDF2"],
)
def test_all_solvers_find_where_the_energy_is_least(solver: Solver, steps: int, tolerance: float):
    """At rest elastic forces, as differences of the energy, and weight are in balance; so is every solver's state."""
    cloth, scene = hanging("random")
    reference = Run(scene, BackwardEuler(tolerance=1e-10))
    assert reference.assembly.springs.membrane is not None
    for _ in range(60):
        reference.step(0.5, 1)
    vertex, mass = cloth.vertices - 4, cloth.masses()[cloth.vertices - 4]
    for axis, way in enumerate(np.eye(3)):
        one = np.zeros((cloth.vertices, 3))
        one[vertex] = way
        assert _slope(reference, one) == pytest.approx(mass * scene.gravity[axis], abs=1e-4 * mass * 6.0)
    assert np.abs(reference.positions - cloth.positions).max() > 0.005

    run = Run(scene, solver)
    for mine, kept in zip(run.state[:3], reference.state[:3], strict=True):
        mine[:] = kept
    run.settle(30, steps or run.stable_substeps(), damping=0.7)
    # A hundredth of the weight would move it by some 1e-5 m. XPBD's single sweep leaves springs longer than they should
    # be, by a share that shrinks as the square of its step.
    np.testing.assert_allclose(run.positions, reference.positions, atol=tolerance)


@pytest.mark.parametrize(
    "solver",
    [SymplecticEuler(), XPBD(), XPBD(iterations=2), BackwardEuler(), TRBDF2()],
    ids=["euler", "xpbd", "xpbd, sweeps", "backward Euler", "TR-BDF2"],
)
@pytest.mark.few("euler", "xpbd, sweeps", "TR-BDF2")
def test_a_membrane_has_the_same_bits_on_any_number_of_threads(solver: Solver):
    fabric = Fabric(density=0.1, stretch=(300.0, 100.0), shear=5.0, bend=(1e-5, 4e-5), bend_damping_time=1e-2)
    flat, triangles = meshed("random", 18, 12)
    cloth = laid(flat * 0.03, triangles, fabric, turn=0.3)
    scene = Scene(cloth, [attach(cloth, "hand", np.arange(3))], gravity=(1.0, 5.0, -3.0))
    states = []
    for threads in (1, 2, 3):
        run = Run(scene, solver, threads=threads)
        for _ in range(3):
            run.step(1 / 60, run.stable_substeps() if isinstance(solver, SymplecticEuler) else 8)
        states.append(np.stack(run.state))
    assert np.abs(states[0][3:]).max() > 0.1
    for state in states[1:]:
        np.testing.assert_array_equal(state, states[0])
