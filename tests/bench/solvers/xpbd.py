"""Cost of XPBD on a grid and on meshes, in nanoseconds per vertex and substep, beside a scalar loop.

    python -m tests.bench.solvers.xpbd

The scalar loop is the textbook's: positions as unknowns, one constraint after the other as they come, compiled with the
kernels' own options. All have springs and bending, both damped, and neither air nor contact; on the last mesh, an
irregular one, a membrane takes the place of the springs, which the scalar loop does not know. Least of many repeats,
interleaved; compiling is not counted.
"""

import math
import time
from collections.abc import Callable

import numpy as np

from cape.assembly.assemble import assemble
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth
from cape.kernels.bones import Motion
from cape.kernels.calling import Bound
from cape.kernels.jit import kernel, routine
from cape.kernels.state import State
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from cape.solvers import XPBD
from tests.support.scenes import irregular

FRAME, SUBSTEPS, REPEATS = 1.0 / 60.0, 40, 15
SHAPES = ((52, 29), (173, 116))


@kernel
def scalar_stretch(first, second, rest, compliance, weight, damping, step, x, y, z, ox, oy, oz):
    """Springs, one after the other."""
    for k in range(first.size):
        i, j = first[k], second[k]
        dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx / length, dy / length, dz / length
        alpha, gamma = compliance[k] / (step * step), damping / step
        moved = (
            dx * (x[j] - ox[j] - x[i] + ox[i]) + dy * (y[j] - oy[j] - y[i] + oy[i]) + dz * (z[j] - oz[j] - z[i] + oz[i])
        )
        change = (rest[k] - length - gamma * moved) / ((1 + gamma) * (weight[i] + weight[j]) + alpha)
        a, b = weight[i] * change, weight[j] * change
        x[i] -= a * dx
        y[i] -= a * dy
        z[i] -= a * dz
        x[j] += b * dx
        y[j] += b * dy
        z[j] += b * dz


@kernel
def scalar_bend(vertices, coefficients, compliance, weight, damping, step, p, o):
    """Bend springs along one coordinate, one after the other."""
    for k in range(compliance.size):
        bend = moved = total = weight[0] * 0
        for a in range(vertices.shape[0]):
            i, c = vertices[a, k], coefficients[a, k]
            bend += c * p[i]
            moved += c * (p[i] - o[i])
            total += c * c * weight[i]
        alpha, gamma = compliance[k] / (step * step), damping / step
        change = -(bend + gamma * moved) / ((1 + gamma) * total + alpha)
        for a in range(vertices.shape[0]):
            p[vertices[a, k]] += weight[vertices[a, k]] * coefficients[a, k] * change


@kernel
def scalar_begin(step, fall, weight, x, y, z, vx, vy, vz, ox, oy, oz):
    """Predict positions."""
    for i in range(x.size):
        ox[i], oy[i], oz[i] = x[i], y[i], z[i]
        if weight[i] > 0:
            vz[i] += fall
            x[i] += step * vx[i]
            y[i] += step * vy[i]
            z[i] += step * vz[i]


@kernel
def scalar_end(rate, x, y, z, vx, vy, vz, ox, oy, oz):
    """Velocities from positions."""
    for i in range(x.size):
        vx[i], vy[i], vz[i] = (x[i] - ox[i]) * rate, (y[i] - oy[i]) * rate, (z[i] - oz[i]) * rate


@routine
def scalar_frame(
    substeps, step, fall, first, second, rest, compliance, vertices, coefficients, bend_compliance, weight, damping,
    bend_damping, x, y, z, vx, vy, vz, ox, oy, oz,
):  # fmt: skip
    """A frame."""
    for _ in range(substeps):
        scalar_begin(step, fall, weight, x, y, z, vx, vy, vz, ox, oy, oz)
        scalar_stretch(first, second, rest, compliance, weight, damping, step, x, y, z, ox, oy, oz)
        scalar_bend(vertices, coefficients, bend_compliance, weight, bend_damping, step, x, ox)
        scalar_bend(vertices, coefficients, bend_compliance, weight, bend_damping, step, y, oy)
        scalar_bend(vertices, coefficients, bend_compliance, weight, bend_damping, step, z, oz)
        scalar_end(1 / step, x, y, z, vx, vy, vz, ox, oy, oz)


def crumpled(cloth: Cloth) -> np.ndarray:
    """Positions of a cloth in motion [m], (3, N): numbers that decay to nothing would be slow ones."""
    return (cloth.positions + np.random.default_rng(0).normal(0.0, 1e-3, cloth.positions.shape)).T


def scalar(cloth: Cloth, springs: Springs, inverse_mass: np.ndarray, dtype: type[np.floating]) -> Callable[[], None]:
    """A frame of the scalar loop."""
    given = (
        SUBSTEPS,
        dtype(FRAME / SUBSTEPS),
        dtype(-9.81 * FRAME / SUBSTEPS),
        springs.first,
        springs.second,
        springs.rest.astype(dtype),
        (1 / springs.stiffness).astype(dtype),
        np.ascontiguousarray(springs.bend_vertices.T),
        np.ascontiguousarray(springs.bend_coefficients.T.astype(dtype)),
        (1 / springs.bend_stiffness).astype(dtype),
        inverse_mass.astype(dtype),
        dtype(cloth.fabric.damping_time),
        dtype(cloth.fabric.bend_damping_time),
    )
    arrays = [np.array(p, dtype=dtype) for p in (*crumpled(cloth), *np.zeros((6, cloth.vertices)))]
    return Bound(scalar_frame, *given, *arrays)


def solver(scene: Scene, held: list[int], dtype: type[np.floating], threads: int, sweeps: int) -> Callable[[], None]:
    """A frame of XPBD."""
    description = XPBD(precision="single" if dtype is np.float32 else "double", iterations=sweeps)
    assembly = assemble(scene, [np.array(held)], threads=threads)
    start = (*crumpled(assembly.cloth), *np.zeros((3, len(assembly.mass))))
    state = State(*(np.array(component, dtype=dtype) for component in start))
    running = description.init(assembly, state)
    attached = assembly.attached
    assert attached is not None
    attached.points[:] = assembly.cloth.positions[attached.vertices]
    pose = (np.zeros((2, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))
    motion = Motion(*pose, *pose)

    def frame() -> None:
        description.step(running, motion, duration=FRAME, substeps=SUBSTEPS, threads=threads)

    return frame


def measure(frames: dict[str, Callable[[], None]], vertices: int) -> dict[str, float]:
    """Least time of each, per vertex and substep [ns]."""
    best = dict.fromkeys(frames, math.inf)
    for _ in range(REPEATS):
        for name, frame in frames.items():
            start = time.perf_counter()
            frame()
            best[name] = min(best[name], (time.perf_counter() - start) / SUBSTEPS / vertices * 1e9)
    return best


def main() -> None:
    """Print a row for each layout, precision and size."""
    print(
        f"{'layout':8} {'precision':9} {'vertices':>8} {'scalar':>7} {'1 thread':>9} {'2 threads':>9} {'3 sweeps':>9}"
    )
    for rows, columns in SHAPES:
        grid = Cloth.rectangle(width=0.025 * (columns - 1), height=0.025 * (rows - 1), spacing=0.025)
        mesh = Cloth.from_mesh(grid.positions, grid.triangles)
        uneven = irregular(grid, np.random.default_rng(0))
        for layout, cloth in (("grid", grid), ("mesh", mesh), ("membrane", uneven)):
            held = list(range(columns))
            scene = Scene(cloth, [attach(cloth, "hand", held)])
            assembly = assemble(scene, [np.array(held)])
            for dtype in (np.float32, np.float64):
                frames = {
                    "1 thread": solver(scene, held, dtype, 1, 1),
                    "2 threads": solver(scene, held, dtype, 2, 1),
                    "3 sweeps": solver(scene, held, dtype, 1, 3),
                }
                if assembly.springs.membrane is None:
                    frames["scalar"] = scalar(assembly.cloth, assembly.springs, assembly.inverse_mass, dtype)
                for frame in frames.values():  # compiles
                    frame()
                best = measure(frames, cloth.vertices)
                beside = f"{best['scalar']:7.1f}" if "scalar" in best else f"{'':7}"
                costs = " ".join(f"{best[name]:9.1f}" for name in ("1 thread", "2 threads", "3 sweeps"))
                print(f"{layout:8} {dtype.__name__:9} {cloth.vertices:8} {beside} {costs}", flush=True)


if __name__ == "__main__":
    main()
