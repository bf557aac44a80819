"""The kernels of meshes against slow loops over their formulas, on random meshes and arrays.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import re
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from cape.assembly.membrane import Membrane, membrane_of
from cape.assembly.mesh import links as mesh_links
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth, MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import edges_of
from cape.kernels.cloth import membrane, mesh, mesh_bending
from cape.kernels.cloth.membrane import MembraneForces, MeshMembrane
from cape.kernels.cloth.mesh import MeshAir, MeshAirForces, MeshForces, MeshSprings
from cape.kernels.cloth.mesh_bending import MeshBendForces, MeshBends
from cape.kernels.state import State
from cape.kernels.team import Team
from tests.support.code import assembly, compiled_only

# A few dozen operations on numbers near one, and sums of some twenty of them.
ROUNDING = {np.float32: 2e-5, np.float64: 4e-14}
TAU, BEND_TAU = 0.1, 0.07


class Sheet(NamedTuple):
    """Random springs, hinges and motion on a mesh."""

    cloth: MeshCloth
    springs: Springs
    positions: np.ndarray
    velocities: np.ndarray

    def state(self, dtype: type) -> State:
        return State(*(np.ascontiguousarray(c, dtype) for c in (*self.positions.T, *self.velocities.T)))


def sheet(seed: int = 0, rows: int = 11, columns: int = 17) -> Sheet:
    """A grid of unit cells split along random diagonals, with a fan whose hub is the last vertex; crumpled."""
    rng = np.random.default_rng(seed)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + columns, corner + columns + 1
    flip = rng.random(len(a))[:, None] < 0.5
    halves = np.where(flip, np.stack([a, c, b], axis=1), np.stack([a, c, d], axis=1))
    others = np.where(flip, np.stack([d, b, c], axis=1), np.stack([d, b, a], axis=1))
    n = rows * columns
    rim = np.arange(n, n + 40)
    fan = np.stack([np.full(39, n + 40), rim[:-1], rim[1:]], axis=1)
    around = np.linspace(0.0, 6.0, 40)
    y, x = np.divmod(np.arange(float(n)), columns)
    flat = np.concatenate([np.stack([x, y], 1), 30 + 3 * np.stack([np.cos(around), np.sin(around)], 1), [[30.0, 30.0]]])
    triangles = rng.permutation(np.concatenate([halves, others, fan]))
    cloth = Cloth.from_mesh(np.stack([flat[:, 0], 0 * flat[:, 0], flat[:, 1]], axis=1), triangles, pattern=flat)
    hinges = np.stack([rng.choice(len(flat), 4, replace=False) for _ in range(150)])
    pairs = np.unique(np.sort(np.concatenate([triangles[:, :2], triangles[:, 1:], triangles[:, ::2]]), axis=1), axis=0)
    # One pair twice: two springs of different rest lengths between the same vertices.
    first, second = np.concatenate([pairs, pairs[:1]]).T
    coefficients = rng.standard_normal((len(hinges), 4))
    springs = Springs(
        first=first,
        second=second,
        stiffness=rng.uniform(1.0, 2.0, len(first)),
        rest=rng.uniform(0.5, 1.5, len(first)),
        measured=np.ones(len(first), bool),
        bend_vertices=hinges,
        bend_coefficients=coefficients - coefficients.mean(axis=1, keepdims=True),
        bend_stiffness=rng.uniform(0.1, 0.2, len(hinges)),
    )
    noise = rng.standard_normal((2, cloth.vertices, 3))
    return Sheet(cloth, springs, cloth.positions / 5 + 0.3 * noise[0], noise[1])


def spring_forces(s: Sheet, tau: float) -> np.ndarray:
    forces = np.zeros_like(s.positions)
    springs = s.springs
    for i, j, k, rest in zip(springs.first, springs.second, springs.stiffness, springs.rest, strict=True):
        d, u = s.positions[j] - s.positions[i], s.velocities[j] - s.velocities[i]
        length = np.linalg.norm(d)
        force = k * (length - rest + tau * (u @ d) / length) * d / length
        forces[i] += force
        forces[j] -= force
    return forces


def bend_forces(s: Sheet, tau: float) -> np.ndarray:
    forces = np.zeros_like(s.positions)
    moved = s.positions + tau * s.velocities
    hinges = zip(s.springs.bend_vertices, s.springs.bend_coefficients, s.springs.bend_stiffness, strict=True)
    for vertices, c, k in hinges:
        # E = 1/2 k |c p|^2, so f_a = -k c_a (c p), and the same of the velocities for damping.
        forces[vertices] -= k * c[:, None] * (c @ moved[vertices])
    return forces


def records(s: Sheet, dtype: type) -> tuple[MeshSprings, MeshBends]:
    n = s.cloth.vertices
    return mesh_links.mesh_springs_record(s.springs, n, dtype), mesh_links.mesh_bends_record(s.springs, n, dtype)


def computed(s: Sheet, dtype: type, *, bends: bool, damping: float | None, bend_damping: float | None) -> np.ndarray:
    springs, bending = records(s, dtype)
    forces = np.full((3, s.cloth.vertices), np.nan, dtype)
    state, alone = s.state(dtype), Team.alone(s.cloth.vertices)
    mesh.mesh_springs(MeshForces(state, springs, damping, forces), alone, 0, 1, 1.0)
    if bends:
        mesh_bending.mesh_bends(MeshBendForces(state, bending, bend_damping, forces), alone, 0, 1, 1.0)
    return forces.T


def stretched(s: Sheet) -> Membrane:
    """A membrane on the same triangles, with layers."""
    fabric = Fabric(stretch=(3.0, 1.0), shear=0.4)
    cloth = replace(s.cloth, fabric=fabric, layers=1.0 + np.arange(len(s.cloth.faces)) % 2)
    return membrane_of(cloth, edges_of(cloth.faces))


def membrane_forces(s: Sheet, m: Membrane, tau: float) -> np.ndarray:
    """Edge by edge, with each triangle's F from its own corners laid flat."""
    forces, area, corners = np.zeros_like(s.positions), m.area, s.cloth.corners
    sides: dict[tuple[int, int], list[int]] = {}
    for t, face in enumerate(s.cloth.faces):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            sides.setdefault((min(face[a], face[b]), max(face[a], face[b])), []).append(t)
    for triangles in sides.values():
        total = sum(area[t] for t in triangles)
        strain, derivatives = np.zeros(3), []
        for t in triangles:
            face, share = s.cloth.faces[t], area[t] / total
            flat = np.column_stack([corners[t], np.ones(3)])
            slopes = np.linalg.inv(flat)[:2].T  # of a function that is 1 at one corner, (3, 2)
            u, v = slopes.T @ s.positions[face]
            du, dv = slopes.T @ s.velocities[face]
            strain += share * np.array([(u @ u - 1) / 2 + tau * u @ du, (v @ v - 1) / 2 + tau * v @ dv,
                                        u @ v + tau * (u @ dv + v @ du)])  # fmt: skip
            for a in range(3):
                p, q = slopes[a]
                derivatives.append((face[a], share * np.array([p * u, q * v, p * v + q * u])))
        tension = total / 3 * m.stiffness @ strain
        for vertex, derivative in derivatives:
            forces[vertex] -= derivative.T @ tension
    return forces


@pytest.mark.parametrize(("dtype", "damping"), [(np.float32, TAU), (np.float64, None), (np.float64, TAU)])
def test_membrane(dtype: type, damping: float | None):
    s = sheet()
    m = stretched(s)
    expected = membrane_forces(s, m, damping or 0.0)
    forces = np.full((3, s.cloth.vertices), np.nan, dtype)
    record = mesh_links.mesh_membrane_record(m, s.cloth.vertices, dtype)
    membrane.mesh_membrane(
        MembraneForces(s.state(dtype), record, damping, forces), Team.alone(s.cloth.vertices), 0, 1, 1.0
    )
    np.testing.assert_allclose(forces.T, expected, atol=ROUNDING[dtype] * np.abs(expected).max())


def test_the_energy_of_a_membrane_is_what_its_forces_are_the_gradient_of():
    s = sheet(1)
    m = stretched(s)
    direction, h = np.random.default_rng(2).standard_normal(s.positions.shape), 1e-5
    change = (m.energy(s.positions + h * direction) - m.energy(s.positions - h * direction)) / (2 * h)
    # As below.
    assert change == pytest.approx(-np.sum(membrane_forces(s, m, 0.0) * direction), rel=1e-7)


@pytest.mark.parametrize(
    ("dtype", "bends", "damping", "bend_damping"),
    [
        (np.float32, False, None, None),
        (np.float32, False, TAU, None),
        (np.float32, True, TAU, BEND_TAU),
        (np.float64, True, None, None),
        (np.float64, True, TAU, None),
        (np.float64, True, None, BEND_TAU),
    ],
)
def test_springs_and_bending(dtype: type, bends: bool, damping: float | None, bend_damping: float | None):
    s = sheet()
    expected = spring_forces(s, damping or 0.0) + (bend_forces(s, bend_damping or 0.0) if bends else 0.0)
    forces = computed(s, dtype, bends=bends, damping=damping, bend_damping=bend_damping)
    np.testing.assert_allclose(forces, expected, atol=ROUNDING[dtype] * np.abs(expected).max())


def test_forces_are_minus_the_gradient_of_the_energy():
    s = sheet(1)
    springs = s.springs

    def energy(positions: np.ndarray) -> float:
        lengths = np.linalg.norm(positions[springs.second] - positions[springs.first], axis=1)
        bend = np.einsum("km,kmi->ki", springs.bend_coefficients, positions[springs.bend_vertices])
        return float(
            springs.stiffness @ (lengths - springs.rest) ** 2 / 2 + springs.bend_stiffness @ (bend**2).sum(axis=1) / 2
        )

    forces = computed(s, np.float64, bends=True, damping=None, bend_damping=None)
    direction, h = np.random.default_rng(2).standard_normal(s.positions.shape), 1e-5
    change = (energy(s.positions + h * direction) - energy(s.positions - h * direction)) / (2 * h)
    # Central difference: h^2 times a third derivative, and rounding of energies of some 1e3 over h.
    assert change == pytest.approx(-np.sum(forces * direction), rel=1e-7)


def test_inner_forces_have_no_sum_and_no_moment():
    s = sheet(3)
    forces = computed(s, np.float64, bends=True, damping=TAU, bend_damping=None)
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-11)
    np.testing.assert_allclose(np.cross(s.positions, forces).sum(axis=0), 0.0, atol=1e-11)


def air_record(s: Sheet, dtype: type) -> MeshAir:
    density, drag, lift = 1.2, 1.1, 0.6
    return mesh_links.mesh_air_record(
        s.cloth, np.array([1.0, -2.0, 0.5]), density * drag / 12, density * lift / 12, dtype
    )


def test_air():
    dtype = np.float64
    s = sheet()
    wind, density, drag, lift = np.array([1.0, -2.0, 0.5]), 1.2, 1.1, 0.6
    expected = np.full(s.positions.shape, 0.25)
    for corners in s.cloth.triangles:
        a, b, c = s.positions[corners]
        doubled = np.cross(b - a, c - a)
        area, n = np.linalg.norm(doubled) / 2, doubled / np.linalg.norm(doubled)
        u = wind - s.velocities[corners].mean(axis=0)
        n = n if n @ u > 0 else -n
        speed = np.linalg.norm(u)
        force = density / 2 * area * (n @ u) * (drag * u + lift * (speed * n - (n @ u) / speed * u))
        expected[corners] += force / 3
    forces = np.full((3, s.cloth.vertices), 0.25, dtype)
    group = MeshAirForces(s.state(dtype), air_record(s, dtype), forces)
    mesh.mesh_air(group, Team.alone(s.cloth.vertices), 0, 1, 1.0)
    np.testing.assert_allclose(forces.T, expected, atol=ROUNDING[dtype] * np.abs(expected).max())


class Spread(NamedTuple):
    """What the ranks of a team do one after the other: each phase for all before the next."""

    springs: MeshSprings
    membrane: MeshMembrane
    bends: MeshBends
    air: MeshAir
    state: State

    def forces(self, cuts: list[int]) -> np.ndarray:
        s, springs, count = self.state, self.springs, self.state.x.size
        forces = np.zeros((3, count), s.x.dtype)
        ranks = list(pairwise(cuts))
        group, m = MembraneForces(s, self.membrane, TAU, forces), self.membrane
        b, one, tau = self.bends, s.x.dtype.type(1.0), s.x.dtype.type(BEND_TAU)
        pulled = np.zeros_like(forces)
        air, (f, (wind_x, wind_y, wind_z)) = self.air, (s.x.dtype.type, self.air.wind)
        for lo, hi in ranks:
            mesh.pack(lo, hi, *s, springs.words)
            mesh.pack(lo, hi, *s, m.words)
            mesh.pack(lo, hi, *s, air.words)
            mesh_bending.pack_moved(lo, hi, *s, tau, b.packed)
        for lo, hi in ranks:
            mesh.pull_all(MeshForces(s, springs, TAU, pulled), TAU, lo, hi)
            membrane.find_strains(group, lo, hi)
        for lo, hi in ranks:
            membrane.pull_all(group, lo, hi)
        for lo, hi in ranks:
            mesh.collect(lo, hi, springs.sorted_vertices, springs.start, springs.incoming, springs.forces, *pulled)
            mesh.collect(lo, hi, m.sorted_vertices, m.start, m.incoming, m.forces, *forces)
            mesh_bending.add_rows(lo, hi, one, b.start, b.others, b.weight, b.packed, *forces)
        forces += pulled
        for lo, hi in ranks:
            mesh.push(
                lo, hi, *s, air.words, air.second, air.third, f(wind_x), f(wind_y), f(wind_z), f(1.0 / 3.0),
                f(air.drag), f(air.lift), air.room, air.forces, *forces,
            )  # fmt: skip
        for lo, hi in ranks:
            mesh.collect(lo, hi, air.sorted_vertices, air.start, air.incoming, air.forces, *forces)
        return forces


def test_the_same_bits_for_any_number_of_ranks():
    dtype = np.float32
    s = sheet(4, 20, 20)
    n = s.cloth.vertices
    springs, bends = records(s, dtype)
    triangles = mesh_links.mesh_membrane_record(stretched(s), n, dtype)
    spread = Spread(springs, triangles, bends, air_record(s, dtype), s.state(dtype))
    alone = spread.forces([0, n])
    assert np.abs(alone).max() > 0
    for cuts in ([0, 64, n], [0, 192, 256, n], [0, 128, 128, 384, n], [0, 64, 128, 192, 256, 320, 384, n, n]):
        np.testing.assert_array_equal(spread.forces(cuts), alone)
    together = np.zeros_like(alone)
    team, state, pulled = Team.alone(n), spread.state, np.zeros_like(alone)
    membrane.mesh_membrane(MembraneForces(state, triangles, TAU, together), team, 0, 1, 1.0)
    mesh_bending.mesh_bends(MeshBendForces(state, bends, BEND_TAU, together), team, 0, 1, 1.0)
    mesh.mesh_springs(MeshForces(state, springs, TAU, pulled), team, 0, 1, 1.0)
    together += pulled
    mesh.mesh_air(MeshAirForces(spread.state, spread.air, together), Team.alone(n), 0, 1, 1.0)
    np.testing.assert_array_equal(together, alone)


def test_links_are_shared_out_evenly():
    s = sheet(5, 30, 30)
    springs, _ = records(s, np.float64)
    n = s.cloth.vertices
    itself = np.arange(springs.second.size // springs.second.shape[1]).reshape(-1, 1, mesh.BLOCK)
    present = springs.second != np.where(itself < n, itself, 0)
    assert present.sum() == len(s.springs.first)
    # The hub of the fan has forty neighbours, who own its links.
    assert springs.second.shape[1] == -(-len(s.springs.first) // n)


def test_few_blocks_have_a_row_more_than_links_need():
    """Of springs by the thousand, 3.6 or 4.1 a vertex, the mean block has hardly a row more than that."""
    rng, rows, columns = np.random.default_rng(3), 40, 40
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    ways = [1, columns, columns + 1]
    pairs = np.concatenate([np.stack([corner, corner + way], axis=1) for way in ways])
    for more in (0.65, 1.2):
        extra = rng.choice(corner, round(more * len(corner)))
        first, second = np.concatenate([pairs, np.stack([extra, extra + rng.choice(ways, len(extra))], axis=1)]).T
        count, ones = rows * columns, np.ones(len(first))
        springs = Springs(
            first=first, second=second, stiffness=ones, rest=ones, measured=ones.astype(bool),
            bend_vertices=np.zeros((0, 4), dtype=np.int64), bend_coefficients=np.zeros((0, 4)),
            bend_stiffness=np.zeros(0),
        )  # fmt: skip
        record = mesh_links.mesh_springs_record(springs, count, np.float64)
        filled = record.stiffness > 0.0
        # Each stands once, in the rows that are used and from the first on.
        assert filled.sum() == len(first)
        owned = filled.sum(axis=1)
        np.testing.assert_array_equal(owned.max(axis=1), record.rows)
        np.testing.assert_array_equal(filled, np.arange(filled.shape[1])[:, None] < owned[:, None])
        assert record.rows.mean() < len(first) / count + 0.35 < filled.shape[1]


def pull_in_assembly(dtype: type[np.floating]) -> str:
    """What the compiler makes of the forces of springs, in some precision."""
    from numba import typeof

    s = sheet(0, 5, 5)
    springs, _ = records(s, dtype)
    state, one = s.state(dtype), dtype(1)
    given = (0, 64, *state, springs.words, springs.rows, springs.second, springs.stiffness, springs.rest, one, one)
    return assembly(
        mesh.pull, tuple(typeof(a) for a in (*given, springs.room, springs.forces, state.x, state.y, state.z))
    )


@compiled_only
def test_roots_are_taken_many_at_once():
    # x86-64 and AArch64: roots of several numbers.
    assert re.search(r"\bv?sqrtps\b|\bfsqrt\s+v\d+\.4s", pull_in_assembly(np.float32))


@compiled_only
def test_other_ends_are_loaded_one_by_one():
    assert not re.search(r"\bvp?gather", pull_in_assembly(np.float64))
