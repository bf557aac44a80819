"""Cost of the grid's kernels, in nanoseconds per vertex and call, in single precision.

    python tests/bench/kernels.py

A cape of about 1,500 vertices; the minimum of 40 repeats of 100 calls each, inside one compiled loop.
"""

import time

import numpy as np
from numba import njit

from cape.cloth import Cloth
from cape.kernels import grid
from cape.springs import springs_of

CALLS, REPEATS = 100, 40


def nanoseconds(kernel, vertices: int, *arguments) -> float:
    """Least time of a call, per vertex [ns]."""

    @njit
    def repeat(calls, given):
        for _ in range(calls):
            kernel(*given)

    repeat(1, arguments)
    best = np.inf
    for _ in range(REPEATS):
        start = time.perf_counter()
        repeat(CALLS, arguments)
        best = min(best, time.perf_counter() - start)
    return best / CALLS / vertices * 1e9


def main() -> None:
    """Print a row a kernel, and what a substep of springs costs in all."""
    single = np.float32
    cloth = Cloth.cape()
    springs, n = springs_of(cloth), cloth.vertices
    random = np.random.default_rng(0)
    positions = [np.ascontiguousarray(p, dtype=single) for p in cloth.positions.T]
    velocities = [random.normal(0.0, 0.1, n).astype(single) for _ in range(3)]
    forces, room = ([np.zeros(n, single) for _ in range(3)] for _ in range(2))
    stiffness, rest = springs.stiffness.astype(single), springs.rest.astype(single)
    bend = springs.bend_stiffness.astype(single)
    costs = {"springs": 0.0, "sums of springs": 0.0, "bending": 0.0}
    for family, offset in enumerate(springs.offsets.tolist()):
        state = (*positions, *velocities, stiffness[family], rest[family])
        costs["springs"] += nanoseconds(
            grid.spring_forces, n, offset, *state, single(1e-5), single(1e-18), *room
        )  # fmt: skip
        costs["sums of springs"] += nanoseconds(grid.add_spring_forces, n, offset, *room, *forces)
    for family, offset in enumerate(springs.bend_offsets.tolist()):
        one = (positions[0], velocities[0], bend[family], single(2e-3), room[0], forces[0])
        costs["bending"] += 3.0 * nanoseconds(grid.add_bend_forces, n, offset, *one)
    still = (single(0.0), single(0.0), single(0.0), single(0.0))
    mass = np.ones(n, single)
    costs["advance"] = nanoseconds(grid.advance, n, *still, mass, *forces, *positions, *velocities)
    print(f"{n} vertices, ns per vertex and substep")
    for name, cost in costs.items():
        print(f"{name:16} {cost:6.2f}")
    print(f"{'in all':16} {sum(costs.values()):6.2f}")
    air_room = [np.zeros(n, single) for _ in range(6)]
    wind = (single(0.0), single(0.0), single(0.0), single(1.0 / 3.0), single(0.1), single(0.05), single(1e-12))
    cells = np.ones(n, single)
    air = nanoseconds(grid.air_forces, n, cloth.columns, *positions, *velocities, cells, *wind, *air_room)
    print(f"{'air':16} {air:6.2f}")


if __name__ == "__main__":
    main()
