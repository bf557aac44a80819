"""What resolution buys: one cape at several spacings, the shape in which it rests and the period at which it swings.

Errors elsewhere in the report are those of the time step, on one mesh. Here the mesh changes, and nothing else:
pattern, fabric and what holds the sheet are the same. The spacing's own error shows in two figures: where a gathered
sheet comes to rest, compared with the finest one, and how long a flat one takes to swing, next to a hanging chain.

Measured are symplectic Euler, which has no error of the time step to speak of, and XPBD, whose error of the time step
grows as cells get smaller. The implicit solvers come to rest as Euler does, swing with the error of their step, and
take minutes for the finest sheet.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cape.bench.figures import Figures
from cape.cloth.cloth import GridCloth
from cape.report.measured.braking import brake
from cape.report.measured.clock import Clock, Timing, quickest
from cape.run.simulation import Simulation
from cape.run.step_error import distance
from cape.run.whereabouts import Diverged
from cape.scene.poses import Pose, poses_of
from cape.scene.scene import Scene
from cape.scene.standard_scenes import FPS, StandardScene, curtain
from cape.solvers import SOLVERS

FloatArray = NDArray[np.float64]

MEASURED = ("euler", "xpbd")
REFERENCE = "euler"  # its steps are so short that they add nothing to what the spacing gets wrong
CALMED = 0.9  # share of the velocity left after each frame, which brings the slowest swing to rest soonest
RESTING = 0.5  # s, in which a cloth at rest moves
REST = 1e-6  # m at most, as a root mean square
PATIENCE = 20.0  # s of motion to come to rest
SAMPLES = 21, 13  # points down and across the pattern, 6 cm apart: vertices of all sheets of the full report
RELEASE = 0.01  # m, at the hem; small, so that the period does not depend on it
J01 = 2.404825557695773  # first zero of the Bessel function J0


@dataclass(frozen=True, eq=False)
class Measured:
    """A solver at one spacing.

    Attributes:
        solver: its name.
        spacing: of the vertices [m].
        vertices: of the sheet.
        substeps: steps in a frame.
        shape: where points of the pattern come to rest [m], shape (P, 3), the same points at any spacing.
        hem_height: mean height of the hem at rest [m]; the top edge is at 1.5 m.
        hem_width: distance of its ends [m].
        period: of the swing [s].
        chain_period: the same of an inextensible chain as long [s].
        seconds: wall time per second of the swing, of the quickest repeat [s].
        result: "finished", or why there are no figures, or none that hold.
        cpu_seconds: CPU time of that repeat, as `seconds` [s].
        disturbed: whether something else had the processor in all repeats.
    """

    solver: str
    spacing: float
    vertices: int
    substeps: int
    shape: FloatArray
    hem_height: float
    hem_width: float
    period: float
    chain_period: float
    seconds: float
    result: str = "finished"
    cpu_seconds: float = math.nan
    disturbed: bool = False

    def as_json(self) -> dict[str, Any]:
        """What was measured, for a JSON object."""
        return {**asdict(self), "shape": self.shape.tolist()}

    @classmethod
    def from_json(cls, fields: dict[str, Any]) -> "Measured":
        """What `as_json` gave."""
        return cls(**{**fields, "shape": np.array(fields["shape"])})


@dataclass(frozen=True)
class Row(Figures):
    """One spacing in figures; those that were not come to are not a number.

    An order p tells that an error shrinks as spacing^p: it is the logarithm to base 2 of how many times less a figure
    changes from the spacing before to this one than it did from the one before that, each being half the last.

    Attributes:
        solver: its name.
        spacing_m: of the vertices [m].
        vertices: of the sheet.
        substeps: steps in a frame.
        hem_height_m: mean height of the hem at rest [m]; the top edge is at 1.5 m.
        hem_width_m: distance of its ends [m].
        shape_mm: root mean square of the distances from the finest sheet by symplectic Euler, both at rest [mm].
        shape_order: observed order of the resting shape.
        period_s: of the swing [s].
        period_error: the same against the closed form of an inextensible chain (`chain_period`), as a share of it.
        period_order: observed order of the period.
        seconds_per_second: wall time per second of the swing; 1 is real time.
        result: "finished", or why there are no figures, or none that hold.
        cpu_seconds_per_second: CPU time per second of the swing.
        disturbed: whether something else had the processor in all repeats.
    """

    solver: str
    spacing_m: float
    vertices: int
    substeps: int
    hem_height_m: float
    hem_width_m: float
    shape_mm: float
    shape_order: float
    period_s: float
    period_error: float
    period_order: float
    seconds_per_second: float
    result: str
    cpu_seconds_per_second: float = math.nan
    disturbed: bool = False


def measure(solver: str, spacing: float, *, repeats: int = 1) -> Measured:
    """Let the gathered sheet come to rest and the flat one swing, with a solver at its default settings.

    Args:
        solver: its name.
        spacing: of the vertices [m].
        repeats: times that the swing is taken; the quickest counts.
    """
    standard = curtain(spacing=spacing)
    cloth = cast(GridCloth, standard.scene.cloth)
    shape, place, result = np.full((math.prod(SAMPLES), 3), math.nan), cloth.positions * math.nan, "finished"
    period, substeps, timing = math.nan, 0, Timing(math.nan, math.nan, False, 0.0)
    try:
        simulation, pose = _started(standard, solver)
        rested = come_to_rest(simulation, pose)
        place = simulation.positions
        shape = sampled(cloth, place)
        simulation, pose = _started(curtain(spacing=spacing, gather=0.0), solver)
        rested = come_to_rest(simulation, pose) and rested
        period, timing = _swing(simulation, pose, repeats)
        substeps = simulation.substeps
        if not rested:
            result = f"not at rest after {PATIENCE:g} s"
    except Diverged as error:
        result = f"diverged: {error}"
    hem = place.reshape(cloth.rows, cloth.columns, 3)[-1]
    return Measured(
        solver, spacing, cloth.vertices, substeps, shape, float(hem[:, 2].mean()),
        float(np.linalg.norm(hem[-1] - hem[0])), period, _chain_period_of(standard.scene), timing.wall, result,
        timing.cpu, timing.disturbed,
    )  # fmt: skip


def rows_of(found: Sequence[Measured], reference: Measured) -> list[Row]:
    """Give every spacing's figures, those of a solver from wide to narrow one after another, against a reference."""
    rows = []
    for k, this in enumerate(found):
        before = [other for other in found[max(k - 2, 0) : k] if other.solver == this.solver]
        shapes, periods = [m.shape for m in (*before, this)], [m.period for m in (*before, this)]
        rows.append(
            Row(
                solver=this.solver,
                spacing_m=this.spacing,
                vertices=this.vertices,
                substeps=this.substeps,
                hem_height_m=this.hem_height,
                hem_width_m=this.hem_width,
                shape_mm=math.nan if this is reference else 1e3 * distance(this.shape, reference.shape),
                shape_order=order([distance(a, b) for a, b in itertools.pairwise(shapes)]),
                period_s=this.period,
                period_error=this.period / this.chain_period - 1.0,
                period_order=order([abs(b - a) for a, b in itertools.pairwise(periods)]),
                seconds_per_second=this.seconds,
                result=this.result,
                cpu_seconds_per_second=this.cpu_seconds,
                disturbed=this.disturbed,
            )
        )
    return rows


def order(changes: Sequence[float]) -> float:
    """Order of convergence from two changes of a figure, by one halving of the spacing and the next."""
    if len(changes) < 2 or not min(changes) > 0.0:
        return math.nan
    return math.log2(changes[0] / changes[1])


def sampled(cloth: GridCloth, positions: FloatArray) -> FloatArray:
    """Where `SAMPLES` points of the pattern of an even grid are, bilinear between vertices at (V, 3) [m]."""
    result = positions.reshape(cloth.rows, cloth.columns, 3)
    for axis, (lines, count) in enumerate(zip((cloth.rows, cloth.columns), SAMPLES, strict=True)):
        places = np.linspace(0.0, lines - 1.0, count)
        first = np.minimum(places.astype(np.int64), lines - 2)
        share = (places - first).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        result = (1.0 - share) * result.take(first, axis) + share * result.take(first + 1, axis)
    return result.reshape(-1, 3)


def come_to_rest(simulation: Simulation, pose: Pose) -> bool:
    """Step a cloth on bones that stand still, braked after each frame, and tell whether it came to rest in time.

    Raises:
        Diverged: it explodes.
    """
    last = simulation.positions
    for _ in range(round(PATIENCE / RESTING)):
        for _ in range(round(RESTING * FPS)):
            simulation.step(pose, 1.0 / FPS)
            brake(simulation, CALMED)
        now = simulation.positions
        if distance(now, last) < REST:
            return True
        last = now
    return False


def chain_period(length: float, gravity: float) -> float:
    """Longest period [s] of small swings of an inextensible chain of a length [m], under gravity [m/s2].

    A chain that hangs from its top end swings as x = J0(2 w sqrt(s / g)) cos(w t), s the distance from its free end
    (D. Bernoulli 1738; Routh 1905, Advanced Rigid Dynamics, art. 610); it is held where that is zero, so that
    w = j01 / 2 sqrt(g / L). Threads that stretch by a share e under their own weight swing slower, by about e / 2.
    """
    return 4.0 * math.pi / J01 * math.sqrt(length / gravity)


def _chain_period_of(scene: Scene) -> float:
    return chain_period(float(scene.cloth.pattern[:, 1].max()), float(np.linalg.norm(scene.gravity)))


def first_mode(heights: FloatArray) -> FloatArray:
    """Shape of the slowest swing of a chain, 1 at its free end, at heights above that as shares of its length, (N,)."""
    # The series of J0: the sum of (-1)^k (x / 2)^2k / k!^2, whose terms beyond the 14th are below 1e-19 for x < j01.
    quarter = J01**2 / 4.0 * heights
    term = total = np.ones_like(heights)
    for k in range(1, 15):
        term = -term * quarter / k**2
        total = total + term
    return total


def _started(standard: StandardScene, solver: str) -> tuple[Simulation, Pose]:
    simulation = Simulation(standard.scene, solver=SOLVERS[solver](), threads=1)
    pose = poses_of(standard.track, simulation.bones)[0]
    simulation.start(pose)
    return simulation, pose


def _swing(simulation: Simulation, pose: Pose, repeats: int) -> tuple[float, Timing]:
    """Release a flat sheet at rest in its slowest swing; period [s], and times per second of motion [s]."""
    cloth = simulation.scene.cloth
    down = cloth.pattern[:, 1]
    mode = first_mode(1.0 - down / down.max())
    simulation.disturb(RELEASE * mode[:, None] * np.array([1.0, 0.0, 0.0]))
    brake(simulation, 0.0)
    start = simulation.snapshot()
    # It passes the middle after a quarter, three and five quarters of a period.
    frames = math.ceil(1.4 * _chain_period_of(simulation.scene) * FPS)
    weights = cloth.masses() * mode
    swung = np.zeros(frames + 1)

    def once() -> Clock:
        clock = Clock()
        simulation.start_from(start)
        swung[0] = weights @ simulation.positions[:, 0]
        for frame in range(frames):
            with clock.running():
                simulation.step(pose, 1.0 / FPS)
            swung[frame + 1] = weights @ simulation.positions[:, 0]
        return clock

    timing, per_second = quickest(once, repeats=repeats), FPS / frames
    return period_of(swung), timing._replace(wall=timing.wall * per_second, cpu=timing.cpu * per_second)


def period_of(swung: FloatArray) -> float:
    """Period [s] of what swings about zero, from its zero crossings, at `FPS`; not a number for fewer than three.

    A sine is straight where it is zero, so that lines between frames find its crossings to third order.
    """
    before = np.flatnonzero(swung[:-1] * swung[1:] < 0.0)
    if len(before) < 3:
        return math.nan
    crossings = (before + swung[before] / (swung[before] - swung[before + 1])) / FPS
    return 2.0 * float(crossings[-1] - crossings[0]) / (len(crossings) - 1)
