"""Cost of the grid's forces in nanoseconds per vertex and substep, beside the two yardsticks, in both precisions.

    python -m tests.bench.kernels

The minimum of 30 repeats inside one compiled loop, all kernels taking turns, since the clock of a machine wanders. The
yardsticks include moving the vertices, and so does `grid + advance`.
"""

import time

import numpy as np

from cape.assembly.springs import springs_of
from cape.cloth.cloth import GridCloth
from cape.kernels.calling import Bound
from cape.kernels.cloth import baselines, grid
from cape.kernels.cloth.grid import GridAir, GridAirForces, GridForces, GridSprings
from cape.kernels.jit import routine
from cape.kernels.solve import euler
from cape.kernels.state import State

REPEATS, VERTICES_A_REPEAT = 30, 100_000
STRANGERS = 256  # vertices of the limit's rows, in the first cache
SIZES = ((58, 26), (125, 80), (250, 200), (500, 400))


@routine
def repeat_grid(times, group, n):
    """Springs and bending."""
    for _ in range(times):
        grid.grid_forces(group, 0, n)


@routine
def repeat_air(times, group, n):
    """Air alone."""
    for _ in range(times):
        grid.grid_air_forces(group, 0, n)


@routine
def repeat_step(times, dt, gx, gy, gz, weight, fx, fy, fz, x, y, z, vx, vy, vz):
    """Vertices alone."""
    for _ in range(times):
        euler.step_all(dt, gx, gy, gz, weight, fx, fy, fz, x, y, z, vx, vy, vz)


def rows_of(rows: int, columns: int, dtype: type) -> dict[str, float]:
    """Nanoseconds per vertex and substep of every kernel."""
    cloth = GridCloth.rectangle(width=0.024 * (columns - 1), height=0.024 * (rows - 1), spacing=0.024)
    springs, n = springs_of(cloth), cloth.vertices
    families = springs.families
    assert families is not None
    random = np.random.default_rng(0)
    positions = cloth.positions + random.normal(0.0, 0.001, (n, 3))
    state = State(*(np.array(c, dtype) for c in (*positions.T, *random.normal(0.0, 0.1, (3, n)))))
    forces, room = np.zeros((3, n), dtype), grid.grid_room(dtype)
    stretch = GridSprings(families.offsets, families.stiffness.astype(dtype), families.rest.astype(dtype))
    bends = grid.grid_bends(families.bend_stiffness, families.twist_stiffness, columns, dtype)
    cells = np.zeros((rows, columns), dtype)
    cells[:-1, :-1] = 1
    air = GridAir(np.zeros(3), 0.1, 0.05, cells.ravel(), columns)
    still, weight = (dtype(0),) * 4, np.ones(n, dtype)
    # No time passes: the state stays as it is, whatever the number of repeats.
    stiffness, rest, bent = (a.astype(dtype) for a in (springs.stiffness, springs.rest, springs.bend_stiffness))
    coefficients = springs.bend_coefficients.astype(dtype)
    scalar = (
        dtype(0), weight, springs.first, springs.second, stiffness, rest, dtype(1e-5),
        springs.bend_vertices, coefficients, bent, dtype(2e-3), *np.zeros((3, n), dtype), *(c.copy() for c in state),
    )  # fmt: skip
    strangers = np.stack([np.stack(state)[:, :STRANGERS]] * 4)
    strangers[1:] += dtype(0.01)
    limit = (
        dtype(0), weight, stiffness, rest, dtype(1e-5), np.ascontiguousarray(coefficients.T), bent, dtype(2e-3),
        np.zeros((4, 3, STRANGERS), dtype), strangers,
    )  # fmt: skip
    times = max(1, VERTICES_A_REPEAT // n)
    both = GridForces(state, stretch, bends, 1e-5, 2e-3, forces, room)
    kernels = {
        "springs + bends": Bound(repeat_grid, times, both, n),
        "springs": Bound(repeat_grid, times, both._replace(bends=None, bend_damping=None), n),
        "air": Bound(repeat_air, times, GridAirForces(state, air, forces, room), n),
        "advance": Bound(repeat_step, times, *still, weight, *forces, *state),
        "scalar": Bound(baselines.scalar_step, times, *scalar),
        "limit": Bound(baselines.limit_step, times, *limit),
    }
    best = dict.fromkeys(kernels, np.inf)
    for run in kernels.values():
        run()
    for _ in range(REPEATS):
        for name, run in kernels.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], (time.perf_counter() - start) / times / n * 1e9)
    return best


def main() -> None:
    """Print a row a size and precision."""
    heads = ("springs + bends", "springs", "air", "advance", "scalar", "limit")
    print(f"{'':6} {'vertices':>8}", *(f"{h:>15}" for h in (*heads, "scalar / grid", "grid / limit")))
    for dtype in (np.float32, np.float64):
        for rows, columns in SIZES:
            cost = rows_of(rows, columns, dtype)
            mine = cost["springs + bends"] + cost["advance"]
            figures = (*(cost[h] for h in heads), cost["scalar"] / mine, mine / cost["limit"])
            name = "single" if dtype is np.float32 else "double"
            print(f"{name:6} {rows * columns:8}", *(f"{f:15.2f}" for f in figures), flush=True)


if __name__ == "__main__":
    main()
