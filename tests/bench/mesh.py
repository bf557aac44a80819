"""Cost of a mesh's forces against the scalar loop over its springs, in nanoseconds per vertex and substep.

    python -m tests.bench.mesh [--double]

Grids of cells split along random diagonals, inner vertices moved by up to 0.3 of a cell, vertices numbered at random
and then by `locality_order`; one thread. Both sides take symplectic Euler steps on the same springs. The variants take
turns in bursts of about a millisecond, of which the fastest counts.
"""

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

from cape.assembly.mesh_links import mesh_air_record, mesh_bends_record, mesh_springs_record
from cape.assembly.mesh_springs import mesh_springs
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth, MeshCloth
from cape.cloth.triangle_mesh import locality_order, reordered
from cape.kernels.calling import Bound
from cape.kernels.cloth.baselines import move, scalar_step
from cape.kernels.cloth.mesh import MeshAirForces, MeshForces, mesh_air
from cape.kernels.cloth.mesh import mesh_springs as pull_links
from cape.kernels.jit import Function, kernel, routine
from cape.kernels.state import State
from cape.kernels.team import Team

SIZES, BURST, REPEATS = (1_500, 5_000, 10_000), 1e-3, 300
STEP, DAMPING, BEND_DAMPING = 1e-9, 1e-5, 2e-3  # so short a step that nothing moves


def irregular_sheet(vertices: int, seed: int = 0) -> MeshCloth:
    """About so many vertices in a square."""
    rng, side = np.random.default_rng(seed), round(vertices**0.5)
    y, x = np.divmod(np.arange(side * side), side)
    flat = np.stack([x, y], axis=1) * 0.03
    inner = (x > 0) & (x < side - 1) & (y > 0) & (y < side - 1)
    flat[inner] += 0.009 * rng.uniform(-1, 1, (inner.sum(), 2))
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    b, c, d = a + 1, a + side, a + side + 1
    flip = rng.random(len(a))[:, None] < 0.5
    one = np.where(flip, np.stack([a, c, d], axis=1), np.stack([a, c, b], axis=1))
    two = np.where(flip, np.stack([a, d, b], axis=1), np.stack([d, b, c], axis=1))
    places = np.stack([0 * flat[:, 0], -flat[:, 0], -flat[:, 1]], axis=1)
    cloth = Cloth.from_mesh(places, np.concatenate([one, two]), pattern=flat)
    cloth = reordered(cloth, rng.permutation(cloth.vertices))
    return reordered(cloth, locality_order(cloth.faces, cloth.positions))


@kernel
def advance(step, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz):
    """The step of the scalar loop."""
    move(step, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz)


@routine
def by_links(calls, group, team, step, inverse_mass):
    """The same substeps with the forces of `cape.kernels.cloth.mesh`."""
    s, f = group.state, group.forces
    for _ in range(calls):
        pull_links(group, team, 0, 1, 0.0)
        advance(step, inverse_mass, f[0], f[1], f[2], s.x, s.y, s.z, s.vx, s.vy, s.vz)


@routine
def air_alone(calls, group, team):
    """The air's forces."""
    for _ in range(calls):
        mesh_air(group, team, 0, 1, 0.0)


def without_bending(springs: Springs) -> Springs:
    """The same without hinges."""
    return replace(
        springs,
        bend_vertices=springs.bend_vertices[:0],
        bend_coefficients=springs.bend_coefficients[:0],
        bend_stiffness=springs.bend_stiffness[:0],
    )


def fastest(variants: dict[str, tuple[Function, tuple[Any, ...]]], vertices: int) -> dict[str, float]:
    """Least time of a substep, per vertex [ns]."""
    calls = max(1, int(BURST / (20e-9 * vertices)))
    bound = {name: Bound(function, calls, *arguments) for name, (function, arguments) in variants.items()}
    best = dict.fromkeys(variants, np.inf)
    for act in bound.values():
        act()
    for _ in range(REPEATS):
        for name, act in bound.items():
            start = time.perf_counter()
            act()
            best[name] = min(best[name], time.perf_counter() - start)
    return {name: seconds / calls / vertices * 1e9 for name, seconds in best.items()}


def measure(vertices: int, dtype: type[np.floating]) -> dict[str, float]:
    """Times of all variants at about so many vertices [ns per vertex and substep]."""
    cloth = irregular_sheet(vertices)
    n, rng = cloth.vertices, np.random.default_rng(1)
    springs = mesh_springs(cloth)
    moved = cloth.positions + rng.normal(0.0, 0.002, cloth.positions.shape)
    motion = (*moved.T, *rng.normal(0.0, 0.1, (3, n)))

    team = Team.alone(n)

    def arrays() -> tuple[np.ndarray, State]:
        return np.zeros((3, n), dtype), State(*(np.ascontiguousarray(a, dtype) for a in motion))

    weights, ends = (
        (1.0 / cloth.masses()).astype(dtype),
        (springs.first.astype(np.uint32), springs.second.astype(np.uint32)),
    )
    plain = (*ends, springs.stiffness.astype(dtype), springs.rest.astype(dtype), dtype(DAMPING))
    hinges = (
        springs.bend_vertices.astype(np.uint32),
        springs.bend_coefficients.astype(dtype),
        springs.bend_stiffness.astype(dtype),
        dtype(BEND_DAMPING),
    )
    variants: dict[str, Any] = {}
    for name, links, bending in (("springs", without_bending(springs), False), ("with bending", springs, True)):
        forces, state = arrays()
        given = (dtype(STEP), weights, *plain, *(hinges if bending else (None,) * 4), *forces, *state)
        variants[f"{name}, scalar"] = (scalar_step, given)
        forces, state = arrays()
        bends = mesh_bends_record(links, n, dtype) if bending else None
        damping = (DAMPING, BEND_DAMPING if bending else None)
        group = MeshForces(state, mesh_springs_record(links, n, dtype), bends, *damping, forces)
        variants[f"{name}, links"] = (by_links, (group, team, dtype(STEP), weights))
    forces, state = arrays()
    blown = MeshAirForces(state, mesh_air_record(cloth, np.zeros(3), 0.1, 0.05, dtype), forces)
    variants["air"] = (air_alone, (blown, team))
    return fastest(variants, n)


def main() -> None:
    """Print a row a size."""
    dtype = np.float64 if "--double" in sys.argv else np.float32
    print("              springs                    with bending               air")
    print("vertices   scalar    links  ratio     scalar    links  ratio    links")
    for vertices in SIZES:
        t = measure(vertices, dtype)
        plain, links = t["springs, scalar"], t["springs, links"]
        bent, bent_links = t["with bending, scalar"], t["with bending, links"]
        print(
            f"{round(vertices**0.5) ** 2:8} {plain:8.1f} {links:8.1f} {plain / links:6.2f}   "
            f"{bent:8.1f} {bent_links:8.1f} {bent / bent_links:6.2f} {t['air']:8.1f}"
        )


if __name__ == "__main__":
    main()
