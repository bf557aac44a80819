"""Every stress case times every solver: passes, degrades or fails, and by how much."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cape.bench.figures import Figures
from cape.report.cases import Case
from cape.report.measured.clock import Clock
from cape.run.simulation import Diverged, Simulation
from cape.scene.poses import Pose, poses_of
from cape.scene.standard_scenes import StandardScene
from cape.solvers import SOLVERS

PENETRATION = 0.002  # m that is no fault
GROWTH = 0.01  # of the scale of a case's energy, that is no fault
PATIENCE = 30.0  # s of CPU time for a single run, which does not depend on what else the machine does
PASSES, DEGRADES, FAILS = "passes", "degrades", "fails"


@dataclass(frozen=True)
class Outcome(Figures):
    """What became of all repeats of a case with a solver; numbers are the worst of them.

    Attributes:
        case: its name.
        solver: its name.
        repeats: how often it was run, from jittered starts.
        result: "passes", "degrades" or "fails".
        why: what was wrong, empty where nothing was.
        stretch_max: largest strain of a thread once the case no longer asks for the impossible.
        penetration_max_mm: deepest penetration of a vertex from then on [mm].
        energy_growth: by how much the energy of the cloth rises above what it is when the bones have come to rest, as
            a share of the weight of the cloth times its size; not a number where they never do, or wind blows.
        seconds: wall time of a run, the least [s].
        retaken: frames that were taken again in shorter steps, or did not converge, the most.
        cpu_seconds: CPU time of a run, the least [s].
    """

    case: str
    solver: str
    repeats: int
    result: str
    why: str
    stretch_max: float
    penetration_max_mm: float
    energy_growth: float
    seconds: float
    retaken: int
    cpu_seconds: float = math.nan


@dataclass(frozen=True)
class _Run:
    """One repeat; `broke` tells why it ended early, empty where it did not."""

    stretch: float
    penetration: float
    growth: float
    clock: Clock
    retaken: int
    broke: str = ""


def stress(case: Case, solver: str, *, repeats: int) -> Outcome:
    """Run a case at a solver's default settings, from jittered starts, and judge it.

    It fails where it breaks off or a number is not finite, and degrades where strain, penetration or energy are more
    than the case allows for, or a run takes over `PATIENCE`.
    """
    standard = case.build()
    runs: list[_Run] = []
    for repeat in range(repeats):
        runs.append(_run(case, standard, solver, np.random.default_rng(repeat)))
        if runs[-1].clock.cpu > PATIENCE:
            break
    broken = [f"repeat {k}: {run.broke}" for k, run in enumerate(runs) if run.broke]
    stretch, penetration = max(run.stretch for run in runs), max(run.penetration for run in runs)
    growth, seconds = max(run.growth for run in runs), min(run.clock.cpu for run in runs)
    faults = [
        text
        for fault, text in (
            (stretch > case.stretch, f"strain above {case.stretch:.0%}"),
            (penetration > PENETRATION, f"deeper than {1e3 * PENETRATION:g} mm"),
            (growth > GROWTH, "gains energy"),
            (seconds > PATIENCE, f"stopped after {seconds:.0f} s"),
        )
        if fault
    ]
    return Outcome(
        case=case.name,
        solver=solver,
        repeats=len(runs),
        result=FAILS if broken else DEGRADES if faults else PASSES,
        why="; ".join([*broken[:1], *faults]),
        stretch_max=stretch,
        penetration_max_mm=1e3 * penetration,
        energy_growth=growth,
        seconds=min(run.clock.wall for run in runs),
        cpu_seconds=seconds,
        retaken=max(run.retaken for run in runs),
    )


def _run(case: Case, standard: StandardScene, solver: str, rng: np.random.Generator) -> _Run:
    """Take a case's motion once."""
    scene, track = standard.scene, standard.track
    simulation = simulation_of(case, standard, solver)
    poses = poses_of(track, simulation.bones)
    scale = float(np.linalg.norm(scene.gravity)) * float(np.ptp(scene.cloth.pattern, axis=0).max())
    still = still_from(poses) if scene.wind is None or not np.any(scene.wind.velocity) else track.frames
    stretch, penetration, clock = 0.0, 0.0, Clock()
    growth, rested, broke = math.nan, math.nan, ""
    try:
        _begin(case, standard, simulation, poses[0], rng)
        meter = simulation.meter()
        for frame in range(1, track.frames):
            with clock.running():
                simulation.step(poses[frame], float(track.times[frame] - track.times[frame - 1]))
            if not np.isfinite(simulation.positions).all():
                broke = f"a position is not finite at frame {frame}"
                break
            reading = simulation.read(meter)
            if track.times[frame] >= case.after:
                stretch, penetration = max(stretch, reading.stretch), max(penetration, reading.penetration)
            if frame >= still:
                total = simulation.energy.total / (scale * float(simulation.assembly.mass.sum()))
                rested = total if math.isnan(rested) else rested
                growth = max(0.0 if math.isnan(growth) else growth, total - rested)
            if clock.cpu > PATIENCE:
                break
    except Diverged as error:
        broke = str(error)
    retaken = simulation.retried + simulation.refined + simulation.unconverged
    return _Run(stretch, penetration, growth, clock, retaken, broke)


def simulation_of(case: Case, standard: StandardScene, solver: str) -> Simulation:
    """A simulation of a case's scene with the solver of that name."""
    return Simulation(standard.scene, solver=SOLVERS[solver](), threads=1, cuts=case.cuts)


def _begin(case: Case, standard: StandardScene, simulation: Simulation, pose: Pose, rng: np.random.Generator) -> None:
    """Put the cloth on, disturb it, and compile."""
    simulation.start(pose)
    simulation.disturb(case.disturb(rng, simulation.positions))
    simulation.forecast(float(standard.track.times[1] - standard.track.times[0]))


def still_from(poses: Sequence[Pose]) -> int:
    """The first frame after the bones' last motion, 1 at least; the number of frames where they move to the end."""
    for frame in range(len(poses) - 1, 0, -1):
        if any(not np.array_equal(a, b) for a, b in zip(poses[frame], poses[frame - 1], strict=True)):
            return frame + 1
    return 1
