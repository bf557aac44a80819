"""From a scene and a track to a take."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.kernels.store import Request
from cape.measure.ledger import Ledger
from cape.reach import reach_of
from cape.results.so_far import SoFar, StopRun
from cape.results.take import Take
from cape.results.verdict import warnings_of
from cape.run.auto import Auto, AutoSimulation
from cape.run.frames import Frames, Times
from cape.run.looping import Laps
from cape.run.notes import MANY, SlowWarning, forewarn, notes_on
from cape.run.simulation import DEFAULT_CUTS, Simulation
from cape.run.whereabouts import Diverged
from cape.scene.jumps import Cuts
from cape.scene.loops import round_of
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions import quaternions
from motions.border import checked_first
from motions.errors import ValueRangeError
from skeleton.track import BoneTrack

__all__ = ["SlowWarning", "requests_of", "simulate"]

FloatArray = NDArray[np.float64]


@checked_first
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
    loop: bool = False,
    name: str = "take",
    progress: Callable[[int, int], None] | None = None,
    on_frame: Callable[[int, SoFar], None] | None = None,
) -> Take:
    """Simulate a cloth along a motion.

    Args:
        scene: cloth, attachments, colliders, forces.
        track: poses of at least the bones that the scene uses.
        solver: None for symplectic Euler with the step that the scene needs; an `Auto` to have it chosen.
        threads: how many share the cloth, None for as many as pay off; the results are the same.
        fps: frames per second of the take; None for the track's own.
        settle: time to let the cloth come to rest in the first pose [s]; None for as long as it needs.
        cull: leave out the colliders that the cloth can't reach (`cape.reach`); penetration is measured in all. None
            are left out of the way of a cloth that may tear.
        cuts: what counts as a jump of the bones, and what becomes of the cloth; None to take all as motion.
        check_steps: measure what the time step costs in accuracy, in parts of the motion.
        ledger: to account for the energy of the run; None for none.
        loop: go on, round after round, until the cloth repeats as the motion does, and give a round that leads from its
            last frame into its first (`Take.loop` tells how well). A last frame that is the first once more is left
            out, `check_steps` measures the first round, and the rounds before the one that is given count as settling.
            An interrupt in a later round leaves the one before, passed over as it may be.
        name: what the take is called.
        progress: called after each frame with the number of frames done and of all.
        on_frame: called with the number of frames done, from the first one on, before any other is computed, and with
            what gives a take of these. What it raises ends the run; `StopRun` leaves what is done.

    Returns:
        The take. When the cloth diverges, or the user interrupts, it ends with the last good frame and says so.

    Warns:
        SlowWarning: before the first frame, with the estimated time, when that is long.

    Raises:
        UnknownNameError: the scene uses a bone that the track has not.
        ValueRangeError: the track has a single frame, the cloth can't be put on, a ledger is given with an `Auto` or
            for a loop, `on_frame` is for a loop, or a cloth that may tear is to repeat, to be checked, or to have its
            solver chosen.
        Diverged: the cloth explodes before the first frame.
    """
    if track.frames < 2:
        raise ValueRangeError("a motion of one frame can't be simulated: at least two are needed")
    if loop and ledger is not None:
        raise ValueRangeError("a ledger keeps the accounts of one run from its start: leave it out of a loop")
    if scene.tearing is not None and loop:
        raise ValueRangeError("what has torn is never again as it was, so that no round repeats: leave out the loop")
    if scene.tearing is not None and check_steps:
        raise ValueRangeError("no cloth tears twice alike, so that no second run tells its error: leave out the check")
    if loop and on_frame is not None:
        raise ValueRangeError("frames of a loop are known when its last round is: leave on_frame out of a loop")
    if fps is not None:
        track = track.resample(fps)
        if track.frames < 2:
            raise ValueRangeError(f"{fps:g} frames per second leave one frame of the motion: at least two are needed")
    travel = None
    if loop:
        track, travel = round_of(track)
    # What has come off gets anywhere.
    reach = reach_of(scene, track) if cull and scene.tearing is None else None
    simulation = _simulation_of(scene if reach is None else reach.cull(scene), solver, threads, cuts, ledger)
    first_pose = poses_of(track.first(1), simulation.bones)[0]

    started = time.perf_counter()
    simulation.compile(first_pose, measured=scene)
    compiled = time.perf_counter()
    velocity, spin = first_motion(scene, track, cuts)
    warned = simulation.substeps > MANY and forewarn(simulation, np.diff(track.times), first_pose)
    simulation.start(first_pose, settle=settle, velocity=velocity, spin=spin)
    times = Times(compiled - started, time.perf_counter() - compiled)
    if not warned:
        forewarn(simulation, np.diff(track.times))
    if isinstance(simulation, AutoSimulation):
        simulation.expect(poses_of(track, simulation.bones)[1:], np.diff(track.times))

    frames, looped = Frames(simulation, scene, track, check_steps=check_steps), None
    result, trouble = "finished", []

    def tell(done: int) -> None:
        if progress is not None and done > 1:
            progress(done, track.frames)
        if on_frame is not None:
            on_frame(done, lambda first=0: frames.take(name, times, reach, first))

    try:
        tell(frames.count)
        frames.run(tell)
        if travel is not None:
            looped = Laps(simulation, scene, track, travel).run(frames, progress)
            result = f"stopped at frame {frames.count}" if looped.stopped else result
    except Diverged as error:
        result, trouble = f"diverged at frame {frames.count}", [str(error)]
    except KeyboardInterrupt:
        result = f"stopped at frame {frames.count}"
    except StopRun as reason:
        result, trouble = f"stopped at frame {frames.count}", [str(reason)]

    if looped is None:
        take = frames.take(name, times, reach)
    else:
        times = replace(times, settle_s=times.settle_s + looped.other_s)
        take = replace(looped.frames.take(name, times, reach), step_errors=frames.step_errors, loop=looped.loop)
    notes = trouble + notes_on(simulation, take, cuts) + warnings_of(take)
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
    hands: int = 0,
) -> list[Request]:
    """The code that `simulate` needs for the same arguments, to be compiled ahead by `kernels.store.prepare`.

    With `hands` also what a live run needs, in which some may take hold of the cloth.

    Raises:
        UnknownNameError: the scene uses a bone that the track has not.
        ValueRangeError: the cloth can't be put on.
    """
    in_reach = reach_of(scene, track).cull(scene) if cull and scene.tearing is None else scene
    simulation = _simulation_of(in_reach, solver, threads, DEFAULT_CUTS, None, hands)
    return simulation.requests(poses_of(track.first(1), simulation.bones)[0], measured=scene)


def _simulation_of(
    scene: Scene,
    solver: Solver | Auto | None,
    threads: int | None,
    cuts: Cuts | None,
    ledger: Ledger | None,
    hands: int = 0,
) -> Simulation:
    if not isinstance(solver, Auto):
        return Simulation(scene, solver=solver, threads=threads, cuts=cuts, ledger=ledger, hands=hands)
    if ledger is not None:
        raise ValueRangeError("a ledger keeps the accounts of one solver: give that, not a tolerance or a budget")
    return AutoSimulation(scene, solver, threads=threads, cuts=cuts)


def first_motion(scene: Scene, track: BoneTrack, cuts: Cuts | None) -> tuple[FloatArray, FloatArray]:
    """Mean velocity [m/s] and spin [rad/s] at the start of the bones that hold the cloth, each of shape (3,).

    None where the bones jump away from the first frame.
    """
    holding = [bone for a in scene.attachments for bone in a.bones]
    held = [track.index(bone) for bone in holding]
    if not held or (cuts is not None and cuts.frames(track.first(2), holding)):
        return np.zeros(3), np.zeros(3)
    step = track.times[1] - track.times[0]
    velocity = (track.positions[1, held] - track.positions[0, held]).mean(axis=0) / step
    before, after = track.rotations_wxyz[0, held], track.rotations_wxyz[1, held]
    turns = quaternions.to_rotation_vector(quaternions.multiply(after, quaternions.conjugate(before)))
    return velocity, turns.mean(axis=0) / step
