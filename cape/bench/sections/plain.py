"""The plain-arrays scene as other engines are measured on it: 32 x 48 vertices, six moving capsules, 10 s."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cape.bench.figures import Figures
from cape.bench.plan import Plan
from cape.run.simulation import Simulation
from cape.run.whereabouts import Diverged
from cape.scene.poses import Pose
from cape.scene.standard_scenes import FPS, plain
from cape.solvers import SOLVERS

AIM_MS = 1.6  # per frame, at 4 % stretch or less and no penetration
PASSES = 3  # with symplectic Euler; every frame counts at its fastest


@dataclass(frozen=True)
class Plain(Figures):
    """How a solver at its default settings does on one core.

    Attributes:
        solver: its name.
        frames: of the motion that were stepped.
        vertices: of the cape.
        substeps: in each frame.
        ms_per_frame: mean wall time of `Simulation.step` [ms], of each frame the fastest of all passes.
        stretch_max: largest strain along the threads of any frame.
        penetration_max_mm: deepest penetration of any frame [mm].
        compile_s: to compile, or to load from the cache [s].
        result: "finished", or at which frame it diverged.
    """

    solver: str
    frames: int
    vertices: int
    substeps: int
    ms_per_frame: float
    stretch_max: float
    penetration_max_mm: float
    compile_s: float
    result: str


def measure_plain(plan: Plan, done: Callable[[], None]) -> list[Plain]:
    """Step the scene with every solver."""
    results = []
    for solver in plan.solvers:
        seconds, passes = (plan.seconds, PASSES) if solver == "euler" else (plan.other_seconds, 1)
        results.append(_step(solver, seconds, passes))
        done()
    return results


def _step(solver: str, seconds: float, passes: int) -> Plain:
    standard = plain(seconds=seconds)
    track = standard.track
    simulation = Simulation(standard.scene, solver=SOLVERS[solver](), threads=1)
    chosen = [track.index(bone) for bone in simulation.bones]
    poses = [Pose(track.positions[f, chosen], track.rotations_wxyz[f, chosen]) for f in range(track.frames)]
    begun = time.perf_counter()
    simulation.compile(poses[0])
    compile_s = time.perf_counter() - begun
    least = np.full(len(poses) - 1, np.inf)
    stretch = penetration = 0.0
    result = "finished"
    for _ in range(passes):
        simulation.start(poses[0], velocity=(track.positions[1, chosen[0]] - track.positions[0, chosen[0]]) * FPS)
        meter = simulation.meter()
        for frame in range(1, len(poses)):
            begun = time.perf_counter()
            try:
                simulation.step(poses[frame], 1.0 / FPS)
            except Diverged:
                result = f"diverged at frame {frame}"
                break
            least[frame - 1] = min(least[frame - 1], time.perf_counter() - begun)
            reading = simulation.read(meter)
            stretch, penetration = max(stretch, reading.stretch), max(penetration, reading.penetration)
    done = least[np.isfinite(least)]
    return Plain(
        solver=solver,
        frames=len(done),
        vertices=standard.scene.cloth.vertices,
        substeps=simulation.substeps,
        ms_per_frame=1e3 * float(done.mean()) if done.size else float("nan"),
        stretch_max=stretch,
        penetration_max_mm=1e3 * penetration,
        compile_s=compile_s,
        result=result,
    )
