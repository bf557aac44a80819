"""Cost of a mesh's forces in nanoseconds per vertex and substep: springs, bending, a membrane, and the air.

    python -m tests.bench.mesh [--double]

Grids of cells split along random diagonals, inner vertices moved by up to 0.3 of a cell, vertices numbered at random
and then by `locality_order`; one thread. Springs are those nearest to the fabric, though a membrane takes their place
on such a mesh; "split" is the bending of the same mesh with no vertex moved. Springs are also taken by the scalar loop
that anybody would write. The variants take turns in bursts of about a millisecond, of which the fastest counts.
"""

import sys
import time
from typing import Any

import numpy as np

from cape.assembly.mesh import springs as fitting
from cape.assembly.mesh.links import mesh_air_record, mesh_bends_record, mesh_membrane_record, mesh_springs_record
from cape.assembly.mesh.springs import mesh_springs
from cape.cloth.cloth import MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import locality_order, reordered
from cape.kernels.calling import Bound
from cape.kernels.cloth.baselines import move, scalar_step
from cape.kernels.cloth.membrane import MembraneForces, mesh_membrane
from cape.kernels.cloth.mesh import MeshAirForces, MeshForces, mesh_air
from cape.kernels.cloth.mesh import mesh_springs as pull_links
from cape.kernels.cloth.mesh_bending import MeshBendForces, mesh_bends
from cape.kernels.jit import Function, kernel, routine
from cape.kernels.state import State
from cape.kernels.team import Team
from tests.support.scenes import grid_cloth, irregular

SIZES, BURST, REPEATS = (1_500, 5_000, 10_000), 1e-3, 300
STEP, DAMPING, BEND_DAMPING = 1e-9, 1e-5, 2e-3  # so short a step that nothing moves


def irregular_sheet(vertices: int, moved: float = 0.3) -> MeshCloth:
    """About so many vertices in a square, the inner ones moved by up to so much of a cell."""
    rng, threads = np.random.default_rng(0), 0.03 * np.arange(round(vertices**0.5))
    cloth = irregular(grid_cloth(threads, threads, Fabric(), right=(0.0, -1.0, 0.0)), rng, moved)
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
def by_membrane(calls, group, team):
    """The forces of a membrane."""
    for _ in range(calls):
        mesh_membrane(group, team, 0, 1, 0.0)


@routine
def by_bends(calls, group, team):
    """The forces of bending."""
    for _ in range(calls):
        mesh_bends(group, team, 0, 1, 0.0)


@routine
def air_alone(calls, group, team):
    """The air's forces."""
    for _ in range(calls):
        mesh_air(group, team, 0, 1, 0.0)


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
    sheet, missed = mesh_springs(cloth), fitting.MISSED
    fitting.MISSED = np.inf
    springs = mesh_springs(cloth)
    fitting.MISSED = missed
    split = mesh_springs(irregular_sheet(vertices, moved=0.0))
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
    forces, state = arrays()
    variants: dict[str, Any] = {"scalar": (scalar_step, (dtype(STEP), weights, *plain, *(None,) * 4, *forces, *state))}
    forces, state = arrays()
    group = MeshForces(state, mesh_springs_record(springs, n, dtype), DAMPING, forces)
    variants["springs"] = (by_links, (group, team, dtype(STEP), weights))
    assert sheet.membrane is not None
    forces, state = arrays()
    triangles = MembraneForces(state, mesh_membrane_record(sheet.membrane, n, dtype), DAMPING, forces)
    variants["membrane"] = (by_membrane, (triangles, team))
    for name, of in (("bends", sheet), ("split", split)):
        forces, state = arrays()
        bending = MeshBendForces(state, mesh_bends_record(of, n, dtype), BEND_DAMPING, forces)
        variants[name] = (by_bends, (bending, team))
    forces, state = arrays()
    blown = MeshAirForces(state, mesh_air_record(cloth, np.zeros(3), 0.1, 0.05, dtype), forces)
    variants["air"] = (air_alone, (blown, team))
    return fastest(variants, n)


def main() -> None:
    """Print a row a size."""
    dtype = np.float64 if "--double" in sys.argv else np.float32
    print("vertices  springs, scalar  springs  membrane  bending  bending, split  air")
    for vertices in SIZES:
        t = measure(vertices, dtype)
        print(
            f"{round(vertices**0.5) ** 2:8} {t['scalar']:16.1f} {t['springs']:8.1f} {t['membrane']:9.1f} "
            f"{t['bends']:8.1f} {t['split']:15.1f} {t['air']:4.1f}"
        )


if __name__ == "__main__":
    main()
