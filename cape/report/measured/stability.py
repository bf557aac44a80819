"""Every stress case times every solver: passes, degrades or fails, and by how much.

What is too much has a reason: no penetration, energy or time that a user would mind, and no more strain than a user
would take for cloth (`Case.stretch`), or else 1.1 times what symplectic Euler reaches in double precision in a quarter
of the steps' length that it needs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from cape.bench.figures import Figures
from cape.measure.hinges import hinges
from cape.report.cases import Case
from cape.report.measured.clock import Clock
from cape.run.simulation import Simulation
from cape.run.whereabouts import Diverged
from cape.scene.poses import Pose, poses_of
from cape.scene.standard_scenes import StandardScene
from cape.solvers import SOLVERS, Solver, SymplecticEuler

PENETRATION = 0.002  # m that is no fault
GROWTH = 0.01  # of the scale of a case's energy, that is no fault
PATIENCE = 30.0  # s of CPU time for a single run, which does not depend on what else the machine does
DUE = 1.1  # of the strain that a converged run reaches, which is no fault
FINER = (2, 4)  # times as many steps as are needed: the two runs of a reference, which are to agree
SCATTER = 0.1  # of the largest strain, by which repeats that are not chaotic differ at most
USUAL = "what a user would take for cloth"
ROUNDING = 1e-9  # of the mass of a cloth, by which sums over all that it has split into may differ
TORN = (
    "it tears, as it can't bear what falls on it; keeps its mass, as a tear only shares that out; and no fold hangs by "
    "a vertex, as no thread would hold it"
)
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
        stretch_limit: strain that is no fault.
        limit: why so much and no more.
        stretch_least: what `stretch_max` is in the repeat where it is least.
        chaotic: whether repeats differ by more than `SCATTER` in strain, or in what became of them.
        tears: edges that have parted, the least.
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
    stretch_limit: float = math.nan
    limit: str = ""
    stretch_least: float = math.nan
    chaotic: bool = False
    tears: int = 0


@dataclass(frozen=True)
class _Run:
    """One repeat; `broke` tells why it ended early, empty where it did not. Of a cloth that may tear `tears` are edges
    that have parted, and `ill` what is wrong with how it did."""

    stretch: float
    penetration: float
    growth: float
    clock: Clock
    retaken: int
    broke: str = ""
    tears: int = 0
    ill: tuple[str, ...] = ()


def stress(case: Case, solver: str, *, repeats: int) -> Outcome:
    """Run a case at a solver's default settings, from jittered starts, and judge it.

    It fails where it breaks off or a number is not finite, and degrades where strain, penetration or energy are more
    than the case allows for, or a run takes over `PATIENCE`.
    """
    standard = case.build()
    runs: list[_Run] = []
    for repeat in range(repeats):
        runs.append(_run(case, standard, SOLVERS[solver](), np.random.default_rng(repeat)))
        if runs[-1].clock.cpu > PATIENCE:
            break
    most, least = max(run.stretch for run in runs), min(run.stretch for run in runs)
    limit = limit_of(case, most)
    faults = [_faults(run, limit.strain) for run in runs]
    broken = [f"repeat {k}: {run.broke}" for k, run in enumerate(runs) if run.broke]
    results = [FAILS if run.broke else DEGRADES if found else PASSES for run, found in zip(runs, faults, strict=True)]
    return Outcome(
        case=case.name,
        solver=solver,
        repeats=len(runs),
        result=max(results, key=[PASSES, DEGRADES, FAILS].index),
        why="; ".join([*broken[:1], *dict.fromkeys(text for found in faults for text in found)]),
        stretch_max=most,
        penetration_max_mm=1e3 * max(run.penetration for run in runs),
        energy_growth=max(run.growth for run in runs),
        seconds=min(run.clock.wall for run in runs),
        cpu_seconds=min(run.clock.cpu for run in runs),
        retaken=max(run.retaken for run in runs),
        stretch_limit=limit.strain,
        limit=limit.reason if standard.scene.tearing is None else f"{limit.reason}; {TORN}",
        stretch_least=least,
        chaotic=len(set(results)) > 1 or most - least > SCATTER * most,
        tears=min(run.tears for run in runs),
    )


def _faults(run: _Run, strain: float) -> list[str]:
    """What is wrong with a run in which so much strain is no fault."""
    checks = (
        (run.stretch > strain, f"strain above {strain:.2g}"),
        (run.penetration > PENETRATION, f"deeper than {1e3 * PENETRATION:g} mm"),
        (run.growth > GROWTH, "gains energy"),
        (run.clock.cpu > PATIENCE, f"stopped after {run.clock.cpu:.0f} s"),
    )
    return [*(text for fault, text in checks if fault), *run.ill]


class Limit(NamedTuple):
    """Strain of a thread that is no fault [1], and why."""

    strain: float
    reason: str


def limit_of(case: Case, reached: float) -> Limit:
    """What strain is no fault in a case; the reference is run only if more than the usual was `reached`."""
    if case.reason or reached <= case.stretch:
        return Limit(case.stretch, case.reason or USUAL)
    coarse, fine = reference_strains(case)
    due = DUE * max(coarse, fine)
    if due <= case.stretch:
        return Limit(case.stretch, USUAL)
    return Limit(due, f"{DUE:g} times the {fine:.1%} of a converged run ({coarse:.1%} in steps twice as long)")


@cache
def reference_strains(case: Case) -> tuple[float, float]:
    """Largest strains of a thread by symplectic Euler in double precision, at each of `FINER`."""
    standard = case.build()
    poses = poses_of(standard.track, Simulation(standard.scene).bones)
    needed = simulation_of(case, standard, SymplecticEuler())
    _begin(case, standard, needed, poses[0], np.random.default_rng(0))
    substeps = needed.forecast(_frame(standard)).substeps
    coarse, fine = (
        _run(case, standard, SymplecticEuler(precision="double", substeps=times * substeps), np.random.default_rng(0))
        for times in FINER
    )
    return coarse.stretch, fine.stretch


def _run(case: Case, standard: StandardScene, solver: Solver, rng: np.random.Generator) -> _Run:
    """Take a case's motion once."""
    scene, track = standard.scene, standard.track
    simulation = simulation_of(case, standard, solver)
    poses = poses_of(track, simulation.bones)
    scale = float(np.linalg.norm(scene.gravity)) * float(np.ptp(scene.cloth.pattern, axis=0).max())
    still = still_from(poses) if scene.wind is None or not np.any(scene.wind.velocity) else track.frames
    stretch, penetration, clock = 0.0, 0.0, Clock()
    growth, rested, broke, ill = math.nan, math.nan, "", ()
    try:
        _begin(case, standard, simulation, poses[0], rng)
        meter, tears = simulation.meter(), _Tears(simulation)
        for frame in range(1, track.frames):
            with clock.running():
                simulation.step(poses[frame], float(track.times[frame] - track.times[frame - 1]))
            if not np.isfinite(simulation.positions).all():
                broke = f"a position is not finite at frame {frame}"
                break
            reading, ill = simulation.read(meter), tears.look()
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
    return _Run(stretch, penetration, growth, clock, retaken, broke, simulation.tears, ill)


class _Tears:
    """Watches how the cloth of a simulation tears."""

    def __init__(self, simulation: Simulation) -> None:
        """Begin with a cloth that is whole."""
        self._simulation, self._mass = simulation, simulation.mass
        self._seen, self._hinged = 0, False

    def look(self) -> tuple[str, ...]:
        """What is wrong with the tears until now."""
        simulation = self._simulation
        if simulation.scene.tearing is None:
            return ()
        if simulation.tears > self._seen:
            self._seen = simulation.tears
            self._hinged |= hinges(simulation.topology.triangles) > 0
        checks = (
            (self._seen == 0, "does not tear"),
            (abs(simulation.mass - self._mass) > ROUNDING * self._mass, "its mass changes"),
            (self._hinged, "a fold hangs by a vertex"),
        )
        return tuple(text for fault, text in checks if fault)


def simulation_of(case: Case, standard: StandardScene, solver: Solver) -> Simulation:
    """A simulation of a case's scene with a solver."""
    return Simulation(standard.scene, solver=solver, threads=1, cuts=case.cuts)


def _begin(case: Case, standard: StandardScene, simulation: Simulation, pose: Pose, rng: np.random.Generator) -> None:
    """Put the cloth on, disturb it, and compile."""
    simulation.start(pose)
    simulation.disturb(case.disturb(rng, simulation.positions))
    simulation.forecast(_frame(standard))


def _frame(standard: StandardScene) -> float:
    """Length of the first frame [s]."""
    return float(standard.track.times[1] - standard.track.times[0])


def still_from(poses: Sequence[Pose]) -> int:
    """The first frame after the bones' last motion, 1 at least; the number of frames where they move to the end."""
    for frame in range(len(poses) - 1, 0, -1):
        if any(not np.array_equal(a, b) for a, b in zip(poses[frame], poses[frame - 1], strict=True)):
            return frame + 1
    return 1
