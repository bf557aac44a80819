"""Runs arrangements, and judges whether anything stays inside of a collider, tears or explodes.

    python -m tests.support.contact_judge [NUMBER ...] [--solver NAME]

runs the arrangements of those numbers, or all, and prints what went wrong.

A vertex is stuck in a collider while it is deeper than 2 mm and has a way out. It has one if the nearest place outside,
by the scene's thickness off the surface,

- is out of all other colliders by the thickness, where they are now and where they will be a frame later;
- is not overrun by the collider itself: its surface does not come after it at more than 3 m/s;
- has no other collider in between, neither on the way there nor across the threads to the neighbours, there and on the
  way, which leave with it where they are deep, too: cloth that hooks around one solid is held in another;
- can be reached: the cloth between it and each vertex that is held is long enough, at 5 % of strain.

What is deep without a way out is pinched, and counted apart. So is all of a `contrary` arrangement, of which only the
numbers must stay sound.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

import cape
from cape import Diverged, Pose, Simulation, Solver
from cape.cloth.triangle_mesh import edges_of
from motions import quaternions
from skeleton.solid_measures import signed_distance
from tests.support.arrangements import COUNT, FPS, NUDGE, Arrangement, arrangement

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

DEEP = 0.002  # m
PATIENCE = 10  # frames
SWEPT = 3.0  # m/s
STRAIN = 0.05
SAMPLES = 12  # of a way
THREADED = (0.25, 0.5, 0.75, 1.0)  # shares of it at which the threads are looked at
CLEAR = 1e-4  # m: what lacks less of the thickness lacks nothing
# A thread strained by e snaps back at e c, where c = sqrt(stretch / density) is 100 m/s for the default fabric. Cloth
# may snap at the strain that was seen, from 30 % up to what it takes to span the girth of a solid with one spring, and
# its ends be whipped to some times the speed of a collider and of its own fall. Where things contradict each other the
# ends of a spring of 3 cm may be led out opposite ways at 3 m/s, and snap in the same frame: nobody sees that strain.
SNAP, UNSEEN = 0.3, 3.3
GIRTH = 15.0
WHIP = 5.0


@dataclass
class Outcome:
    """How a run went.

    Attributes:
        number: of the arrangement.
        start: how the cloth starts.
        diverged: what the simulation said when it gave up, empty otherwise.
        finite: all positions and velocities were.
        fastest: largest speed of a vertex [m/s], of the frame in which it was most as against `allowed`.
        allowed: speed beyond which a cloth so strained among such colliders is out of bounds then [m/s].
        strain: largest of any spring.
        stuck: a sentence for each vertex and collider that were stuck for more than 10 frames.
        pinched: pairs of vertex and collider that were deep without a way out for more than 10 frames.
    """

    number: int
    start: str
    diverged: str = ""
    finite: bool = True
    fastest: float = 0.0
    allowed: float = np.inf
    strain: float = 0.0
    stuck: list[str] = field(default_factory=list)
    pinched: int = 0

    @property
    def faults(self) -> list[str]:
        """What must not be, a sentence each."""
        found = [self.diverged] if self.diverged else []
        if not self.finite:
            found.append("not finite")
        if self.fastest > self.allowed:
            found.append(f"{self.fastest:.0f} m/s where {self.allowed:.0f} are much")
        if self.start != "contrary":
            found += self.stuck
        return [f"{self.start} arrangement {self.number}: {text}" for text in found]


def run(given: Arrangement, solver: Solver | None = None) -> Outcome:
    """Simulate an arrangement and judge every frame."""
    unseen = UNSEEN if given.start == "contrary" else 0.0
    fabric, pattern = given.scene.cloth.fabric, given.scene.cloth.pattern
    sound = np.sqrt(max(fabric.stretch_warp, fabric.stretch_weft) / fabric.density)
    fall = np.sqrt(2.0 * 9.81 * np.linalg.norm(np.ptp(pattern, axis=0)))
    outcome = Outcome(given.number, given.start)
    simulation = Simulation(given.scene, solver=solver, threads=1)
    track = given.track
    chosen = [track.index(bone) for bone in simulation.bones]
    poses = [Pose(track.positions[f, chosen], track.rotations_wxyz[f, chosen]) for f in range(track.frames)]
    judge = Judge(given)
    simulation.start(poses[0])
    for frame in range(1, track.frames):
        try:
            simulation.step(poses[frame], 1.0 / FPS)
        except Diverged as error:
            outcome.diverged = f"frame {frame}: {error}"
            break
        positions, velocities = simulation.positions, simulation.velocities
        if not (np.isfinite(positions).all() and np.isfinite(velocities).all()):
            outcome.finite = False
            break
        outcome.strain = max(outcome.strain, judge.strain(positions))
        speed = float(np.linalg.norm(velocities, axis=1).max())
        allowed = sound * min(max(outcome.strain + unseen, SNAP), GIRTH) + WHIP * (given.fastest + fall)
        if speed * outcome.allowed > outcome.fastest * allowed or outcome.fastest == 0.0:
            outcome.fastest, outcome.allowed = speed, float(allowed)
        judge.see(frame, positions)
    outcome.stuck, outcome.pinched = judge.verdict()
    return outcome


class Judge:
    """Looks for vertices that stay inside of colliders."""

    def __init__(self, given: Arrangement) -> None:
        """Find what of the cloth is free, and how far from what is held it may get."""
        scene, self._track = given.scene, given.track
        self._solids = list(scene.colliders[: given.present])
        bones = [self._track.index(str(solid.bone)) for solid in self._solids]
        self._places = self._track.positions[:, bones]
        self._turns = quaternions.to_matrix(self._track.rotations_wxyz[:, bones])
        self._thickness = scene.thickness
        (attachment,) = scene.attachments
        self._held = attachment.vertices
        self._free = np.ones(scene.cloth.vertices, dtype=bool)
        self._free[self._held] = False
        pattern = scene.cloth.pattern
        away = np.linalg.norm(pattern[:, None] - pattern[None, self._held], axis=2)
        self._leash = (1.0 + STRAIN) * away
        self._edges = edges_of(scene.cloth.triangles).vertices
        self._rest = self._lengths(pattern, self._edges)
        shape = (given.present, scene.cloth.vertices)
        self._streak, self._pinched = np.zeros(shape, int), np.zeros(shape, int)
        self._longest, self._longest_pinched = np.zeros(shape, int), np.zeros(shape, int)
        self._deepest, self._last = np.zeros(shape), np.zeros(shape, int)

    def strain(self, positions: FloatArray) -> float:
        """Largest strain of a spring, with vertices at positions (V, 3) [m]."""
        return float((self._lengths(positions, self._edges) / self._rest).max()) - 1.0

    def _lengths(self, points: FloatArray, edges: NDArray[np.integer]) -> FloatArray:
        first, second = edges.T
        return np.linalg.norm(points[second] - points[first], axis=1)

    def see(self, frame: int, positions: FloatArray) -> None:
        """Look at positions (V, 3) [m] at the end of a frame."""
        distances = [self._distance(c, frame, positions) for c in range(len(self._solids))]
        for c, distance in enumerate(distances):
            depth = -distance
            deep = (depth > DEEP) & self._free
            stuck = np.zeros_like(deep)
            if deep.any():
                stuck[deep] = self._has_way_out(c, frame, positions, np.flatnonzero(deep), distances)
            self._streak[c] = np.where(stuck, self._streak[c] + 1, 0)
            self._pinched[c] = np.where(deep & ~stuck, self._pinched[c] + 1, 0)
            longer = self._streak[c] > self._longest[c]
            self._last[c, longer] = frame
            self._longest[c] = np.maximum(self._longest[c], self._streak[c])
            self._longest_pinched[c] = np.maximum(self._longest_pinched[c], self._pinched[c])
            self._deepest[c] = np.maximum(self._deepest[c], np.where(stuck, depth, 0.0))

    def verdict(self) -> tuple[list[str], int]:
        """Tell of all that was stuck for long, and how much was pinched for long."""
        texts = [
            f"vertex {v} stuck in {self._solids[c].name} for {self._longest[c, v]} frames up to {self._last[c, v]}, "
            f"by up to {1e3 * self._deepest[c, v]:.1f} mm"
            for c, v in np.argwhere(self._longest > PATIENCE)
        ]
        return texts, int((self._longest_pinched > PATIENCE).sum())

    def _distance(self, collider: int, frame: int, points: FloatArray) -> FloatArray:
        """Signed distances of points in the world (N, 3) from a collider at a frame [m], shape (N,)."""
        local = (points - self._places[frame, collider]) @ self._turns[frame, collider]
        return signed_distance(self._solids[collider], local)

    def _has_way_out(
        self, collider: int, frame: int, positions: FloatArray, deep: NDArray[np.int64], distances: list[FloatArray]
    ) -> BoolArray:
        """Which of the deep vertices have one; with distances of all vertices from all colliders."""
        following = min(frame + 1, self._track.frames - 1)
        distance = partial(self._distance, collider, frame)
        exits = positions[deep]
        for _ in range(3):
            # Twice more where the nearest surface is not straight ahead, as in the corner of a box.
            exits = exits + (self._thickness - distance(exits))[:, None] * _slope(distance, exits)
        clear, reached = self._thickness - CLEAR, distance(exits)
        # Where a vertex is in the middle of a solid there is no nearest place outside.
        way_out = reached > clear
        way_out &= (reached - self._distance(collider, following, exits)) * FPS < SWEPT
        others = [other for other in range(len(self._solids)) if other != collider]
        for other in others:
            for when in (frame, following):
                way_out &= self._distance(other, when, exits) > clear
        if not way_out.any():
            return way_out
        going = np.zeros(len(positions), dtype=bool)
        going[deep[way_out]] = True
        threads = self._edges[going[self._edges].any(axis=1)]
        # A distance changes no faster than the place: what is far from all places that are looked at bars nothing.
        span = 2.0 * np.linalg.norm(exits - positions[deep], axis=1).max() + self._lengths(positions, threads).max() / 2
        others = [other for other in others if distances[other][threads].min() < span]
        way_out &= self._is_open(others, frame, positions[deep], exits)
        leaving = np.repeat(positions[None], len(THREADED), axis=0)
        for moved, share in zip(leaving, THREADED, strict=True):
            moved[deep] = positions[deep] + share * (exits - positions[deep])
        first, second = leaving[:, threads[:, 0]], leaving[:, threads[:, 1]]
        is_open = self._is_open(others, frame, first.reshape(-1, 3), second.reshape(-1, 3))
        barred = np.zeros(len(positions), dtype=bool)
        barred[threads[~is_open.reshape(len(THREADED), -1).all(axis=0)]] = True
        way_out &= ~barred[deep]
        away = np.linalg.norm(exits[:, None] - positions[None, self._held], axis=2)
        return way_out & (away < self._leash[deep]).all(axis=1)

    def _is_open(self, others: list[int], frame: int, start: FloatArray, end: FloatArray) -> BoolArray:
        """Tell which of the straight ways between points (N, 3) [m] run through none of the other colliders."""
        ways = start[:, None] + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (end - start)[:, None]
        free = np.ones(len(start), dtype=bool)
        for other in others:
            through = self._distance(other, frame, ways.reshape(-1, 3)).reshape(ways.shape[:2])
            free &= (through > -DEEP).all(axis=1)
        return free


def _slope(distance: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    """Directions in which a distance grows, of length one, at points (N, 3) [m]."""
    steps = NUDGE * np.concatenate([np.eye(3), -np.eye(3)])
    around = distance((points + steps[:, None]).reshape(-1, 3)).reshape(2, 3, -1)
    slope = (around[0] - around[1]).T
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    return slope / np.maximum(length, 1e-300)


def main() -> None:
    """Run the arrangements asked for and print what went wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("numbers", nargs="*", type=int, default=range(COUNT))
    parser.add_argument("--solver", choices=cape.SOLVERS, default="euler")
    arguments = parser.parse_args()
    outcomes = [run(arrangement(number), cape.solver(arguments.solver)) for number in arguments.numbers]
    for outcome in outcomes:
        print("\n".join(outcome.faults), end="\n" if outcome.faults else "")
    bad, pinched = sum(bool(o.faults) for o in outcomes), sum(o.pinched > 0 for o in outcomes)
    print(f"{len(outcomes)} arrangements, {bad} with faults, {pinched} with pinched vertices")


if __name__ == "__main__":
    main()
