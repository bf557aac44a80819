"""From a scene and a track to a take."""

import time
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.kernels.store import Request
from cape.measure.contact_points import ContactPoints
from cape.measure.ledger import Ledger
from cape.reach import reach_of
from cape.results.take import Take
from cape.results.verdict import warnings_of
from cape.run.auto import Auto, AutoSimulation
from cape.run.simulation import DEFAULT_CUTS, Diverged, Simulation
from cape.run.step_error import Watch
from cape.scene.jumps import Cuts
from cape.scene.poses import Bones, poses_of
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions import quaternions
from motions.errors import ValueRangeError
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

CHECKED = 0.5  # s between the parts of a motion whose error is measured
MISSED = 1.5  # of the error that was allowed, which is told of
SLOW = 20.0  # s of estimated run time that nobody needs to be warned of
NAMED_JUMPS = 5
SLOW_FACTOR = 4.0  # times the length of the motion, the same


class SlowWarning(UserWarning):
    """A simulation will take long."""


def simulate(
    scene: Scene,
    track: BoneTrack,
    *,
    solver: Solver | Auto | None = None,
    threads: int | None = None,
    fps: float | None = None,
    settle: float | None = None,
    cull: bool = True,
    cuts: Cuts | None = DEFAULT_CUTS,
    check_steps: bool = False,
    ledger: Ledger | None = None,
    name: str = "take",
    progress: Callable[[int, int], None] | None = None,
) -> Take:
    """Simulate a cloth along a motion.

    Args:
        scene: cloth, attachments, colliders, forces.
        track: poses of at least the bones that the scene uses.
        solver: None for symplectic Euler with the step that the scene needs; an `Auto` to have it chosen.
        threads: how many share the cloth, None for as many as pay off; the results are the same.
        fps: frames per second of the take; None for the track's own.
        settle: time to let the cloth come to rest in the first pose [s]; None for as long as it needs.
        cull: leave out the colliders that the cloth can't reach (`cape.reach`); penetration is measured in all.
        cuts: what counts as a jump of the bones, and what becomes of the cloth; None to take all as motion.
        check_steps: measure what the time step costs in accuracy, once in `CHECKED` seconds.
        ledger: to account for the energy of the run; None for none.
        name: what the take is called.
        progress: called after each frame with the number of frames done and of all.

    Returns:
        The take. When the cloth diverges, or the user interrupts, it ends with the last good frame and says so.

    Warns:
        SlowWarning: before the first frame, with the estimated time, when that is long.

    Raises:
        UnknownNameError: the scene uses a bone that the track has not.
        ValueRangeError: the track has a single frame, the cloth can't be put on, or a ledger is given with an `Auto`.
        Diverged: the cloth explodes before the first frame.
    """
    if track.frames < 2:
        raise ValueRangeError("a motion of one frame can't be simulated: at least two are needed")
    if fps is not None:
        track = track.resample(fps)
    reach = reach_of(scene, track) if cull else None
    simulation = _simulation_of(scene if reach is None else reach.cull(scene), solver, threads, cuts, ledger)
    poses, all_poses = poses_of(track, simulation.bones), poses_of(track, scene.bones)
    steps = np.diff(track.times)

    started = time.perf_counter()
    simulation.compile(poses[0], measured=scene)
    compiled = time.perf_counter()
    velocity, spin = _first_motion(scene, track)
    simulation.start(poses[0], settle=settle, velocity=velocity, spin=spin)
    settled = time.perf_counter()
    _forewarn(simulation, steps)

    meter = simulation.meter(scene)
    positions = [simulation.positions.astype(np.float32)]
    readings = [simulation.read(meter, all_poses[0])]
    solve_s, result, notes, jumps = 0.0, "finished", [], []
    watch = _Checks(simulation) if check_steps and not isinstance(simulation, AutoSimulation) else None
    try:
        for frame in range(1, track.frames):
            begun = time.perf_counter()
            simulation.step(poses[frame], float(steps[frame - 1]))
            solve_s += time.perf_counter() - begun
            if watch is not None:
                watch.note(poses[frame], float(steps[frame - 1]))
            if simulation.jumps > len(jumps):
                jumps.append(frame)
            readings.append(simulation.read(meter, all_poses[frame]))
            positions.append(simulation.positions.astype(np.float32))
            if progress is not None:
                progress(frame + 1, track.frames)
    except Diverged as error:
        result = f"diverged at frame {len(positions)}"
        notes.append(str(error))
    except KeyboardInterrupt:
        result = f"stopped at frame {len(positions)}"
    frames = min(len(positions), len(readings))
    readings = readings[:frames]
    take = Take(
        name=name,
        bones=track.first(frames),
        colliders=tuple(scene.colliders),
        triangles=scene.cloth.triangles,
        texcoords=scene.cloth.texcoords,
        positions=np.stack(positions[:frames]),
        stretch_max=np.array([r.stretch for r in readings]),
        stretch_p99=meter.stretch_quantile(0.99),
        penetration=np.array([r.penetration for r in readings]),
        penetrated=np.array([r.collider for r in readings]),
        kinetic_energy=np.array([r.kinetic_energy for r in readings]),
        solver=simulation.solver.name,
        substeps=simulation.substeps,
        compile_s=compiled - started,
        settle_s=settled - compiled,
        solve_s=solve_s,
        thickness=scene.thickness,
        held=np.flatnonzero(simulation.assembly.outwards(simulation.assembly.inverse_mass) == 0.0),
        left_out={} if reach is None else reach.left_out,
        contacts=ContactPoints.joined([r.contacts for r in readings]),
        jumps=tuple(frame for frame in jumps if frame < frames),
        step_errors=tuple(
            simulation.errors if isinstance(simulation, AutoSimulation) else watch.errors if watch else ()
        ),
    )
    notes += (
        _notes_on_steps(simulation) + _notes_on_errors(simulation) + _notes_on_jumps(take, cuts) + warnings_of(take)
    )
    if notes and result == "finished":
        result = "finished with warnings"
    return replace(take, result=result, warnings=tuple(notes))


def requests_of(
    scene: Scene,
    track: BoneTrack,
    *,
    solver: Solver | Auto | None = None,
    threads: int | None = None,
    cull: bool = True,
) -> list[Request]:
    """The code that `simulate` needs for the same arguments, to be compiled ahead by `kernels.store.prepare`.

    Raises:
        UnknownNameError: the scene uses a bone that the track has not.
        ValueRangeError: the cloth can't be put on.
    """
    in_reach = reach_of(scene, track).cull(scene) if cull else scene
    simulation = _simulation_of(in_reach, solver, threads, DEFAULT_CUTS, None)
    return simulation.requests(poses_of(track.first(1), simulation.bones)[0], measured=scene)


def _simulation_of(
    scene: Scene, solver: Solver | Auto | None, threads: int | None, cuts: Cuts | None, ledger: Ledger | None
) -> Simulation:
    if not isinstance(solver, Auto):
        return Simulation(scene, solver=solver, threads=threads, cuts=cuts, ledger=ledger)
    if ledger is not None:
        raise ValueRangeError("a ledger keeps the accounts of one solver: give that, not a tolerance or a budget")
    return AutoSimulation(scene, solver, threads=threads, cuts=cuts)


class _Checks(Watch):
    """A watch over one part of the motion in `CHECKED` seconds."""

    def __init__(self, run: Simulation) -> None:
        super().__init__(run)
        self._due = 0.0
        self.begin()

    def note(self, bones: Bones, dt: float) -> None:
        super().note(bones, dt)
        self._due += dt
        if self.full:
            self.end()
        if not self.watching and self._due >= CHECKED:
            self._due = 0.0
            self.begin()


def _notes_on_steps(simulation: Simulation) -> list[str]:
    """Tell of frames that did not come out as the solver had expected."""
    notes = []
    if simulation.retried:
        notes.append(f"{simulation.retried} frames needed a smaller step than estimated")
    if simulation.refined:
        notes.append(
            f"{simulation.refined} frames were taken in shorter steps: they would not converge, or parts whirled"
        )
    if simulation.unconverged:
        notes.append(
            f"{simulation.unconverged} frames did not reach the solver's tolerance in shorter steps either: "
            "ask for more substeps or a larger tolerance, or look whether limbs pinch the cloth"
        )
    return notes


def _notes_on_errors(simulation: Simulation) -> list[str]:
    """Tell where errors remained larger than was asked for."""
    if not isinstance(simulation, AutoSimulation) or not simulation.errors:
        return []
    reached = float(np.sqrt(np.mean([error.rms**2 for error in simulation.errors])))
    if reached <= MISSED * simulation.allowed:
        return []
    return [
        f"the time step's error was {1e3 * reached:.2g} mm in the parts that were measured, more than "
        f"{1e3 * simulation.allowed:.2g} mm: contact or buckling magnify what any step leaves"
    ]


def _notes_on_jumps(take: Take, cuts: Cuts | None) -> list[str]:
    """Tell when the bones jumped, how far, and what became of the cloth."""
    if not take.jumps or cuts is None:
        return []
    ways = [
        float(np.linalg.norm(take.bones.positions[f] - take.bones.positions[f - 1], axis=1).max()) for f in take.jumps
    ]
    named = ", ".join(f"{frame} ({way:.2f} m)" for frame, way in zip(take.jumps[:NAMED_JUMPS], ways, strict=False))
    more = f" and {len(ways) - NAMED_JUMPS} more" if len(ways) > NAMED_JUMPS else ""
    done = "carried along as a whole" if cuts.then == "carry" else "put on anew"
    return [f"the bones jump at frame {named}{more}: the cape was {done}"]


def _forewarn(simulation: Simulation, steps: FloatArray) -> None:
    """Warn when the whole motion, with frames of the given lengths [s], will take long."""
    forecast = simulation.forecast(float(steps.max()))
    seconds = forecast.seconds * len(steps)
    if seconds > SLOW and seconds > SLOW_FACTOR * float(steps.sum()):
        span = f"{seconds / 60.0:.0f} minutes" if seconds > 120.0 else f"{seconds:.0f} s"
        warnings.warn(
            f"{simulation.solver.name} takes {forecast.substeps} steps a frame here, about {span} for "
            f"{len(steps)} frames; a softer fabric or a wider spacing needs fewer, and another solver may be faster",
            SlowWarning,
            stacklevel=3,
        )


def _first_motion(scene: Scene, track: BoneTrack) -> tuple[FloatArray, FloatArray]:
    """Mean velocity [m/s] and spin [rad/s] at the start of the bones that hold the cloth, each of shape (3,)."""
    held = [track.index(a.bone) for a in scene.attachments]
    if not held:
        return np.zeros(3), np.zeros(3)
    step = track.times[1] - track.times[0]
    velocity = (track.positions[1, held] - track.positions[0, held]).mean(axis=0) / step
    before, after = track.rotations_wxyz[0, held], track.rotations_wxyz[1, held]
    turns = quaternions.to_rotation_vector(quaternions.multiply(after, quaternions.conjugate(before)))
    return velocity, turns.mean(axis=0) / step
