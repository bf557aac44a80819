"""What a run has to tell about itself: before it begins, and when it is over."""

import warnings

import numpy as np
from numpy.typing import NDArray

from cape.results.take import Take
from cape.run.attempts import SETTLING_FRAME, SETTLING_TIME
from cape.run.auto import AutoSimulation
from cape.run.simulation import Simulation
from cape.scene.jumps import Cuts
from cape.scene.poses import Pose

FloatArray = NDArray[np.float64]

MISSED = 1.5  # of the error that was allowed, which is told of
SLOW = 20.0  # s of estimated run time that nobody needs to be warned of
SLOW_FACTOR = 4.0  # times the length of the motion, the same
MANY = 2000  # steps in a frame, with which already putting the cloth on may take long
NAMED_JUMPS = 5


class SlowWarning(UserWarning):
    """A simulation will take long."""


def notes_on(simulation: Simulation, take: Take, cuts: Cuts | None) -> list[str]:
    """What to look at in a run, a sentence each: its steps, its errors, jumps of the bones."""
    return _on_steps(simulation) + _on_errors(simulation) + _on_jumps(take, cuts) + _on_loop(take)


def _on_steps(simulation: Simulation) -> list[str]:
    """Tell of frames that did not come out as the solver had expected."""
    notes = []
    if simulation.retried:
        notes.append(f"{simulation.retried} frames needed a smaller step than estimated")
    if simulation.troubled:
        notes.append(
            f"{simulation.troubled} frames were taken in shorter steps: they would not converge, or parts whirled"
        )
    if simulation.unconverged:
        notes.append(
            f"{simulation.unconverged} frames did not reach the solver's tolerance in shorter steps either: "
            "ask for more substeps or a larger tolerance, or look whether limbs pinch the cloth"
        )
    return notes


def _on_errors(simulation: Simulation) -> list[str]:
    """Tell where errors remained larger than was asked for."""
    if not isinstance(simulation, AutoSimulation) or not simulation.errors:
        return []
    reached = float(np.sqrt(np.mean([error.rms**2 for error in simulation.errors])))
    if reached <= MISSED * simulation.tolerance:
        return []
    return [
        f"the time step's error was {1e3 * reached:.2g} mm in the parts that were measured, more than "
        f"{1e3 * simulation.tolerance:.2g} mm: contact or buckling magnify what any step leaves"
    ]


def _on_jumps(take: Take, cuts: Cuts | None) -> list[str]:
    """Tell when the bones jumped, how far, and what became of the cloth."""
    if not take.jumps or cuts is None:
        return []
    ways = [
        float(np.linalg.norm(take.bones.positions[f] - take.bones.positions[f - 1], axis=1).max()) for f in take.jumps
    ]
    named = ", ".join(f"{frame} ({way:.2f} m)" for frame, way in zip(take.jumps[:NAMED_JUMPS], ways, strict=False))
    more = f" and {len(ways) - NAMED_JUMPS} more" if len(ways) > NAMED_JUMPS else ""
    anew = len(take.renewed)
    if anew == 0:
        done = "carried along as a whole"
    elif anew == len(take.jumps):
        done = "put on anew"
    else:
        done = (
            f"put on anew {anew} times, where limbs would have been in it or what holds it parted, else carried along"
        )
    return [f"the bones jump at frame {named}{more}: the cape was {done}"]


def _on_loop(take: Take) -> list[str]:
    """Tell where a motion does not begin again, or the cloth does not."""
    loop, notes = take.loop, []
    if loop is None:
        return []
    if not loop.travel.loops:
        notes.append(
            f"the clip doesn't loop: at its end {loop.travel.bone} is {loop.travel.gap:.2f} m from where it begins; "
            f"it jumps there, and the cape {'is put on anew' if loop.renewed else 'with it'}"
        )
    if not loop.repeats:
        way = "drawn back to where it was" if loop.drawn else "mixed with where it was"
        notes.append(
            f"the cape doesn't repeat within {1e3 * loop.bound:g} mm by itself in {loop.rounds} rounds: in frames "
            f"{loop.blended[0]} to {loop.blended[1]} it is {way} a round before, up to {1e3 * loop.gap:.0f} mm off"
        )
    return notes


def forewarn(simulation: Simulation, steps: FloatArray, bones: Pose | None = None) -> bool:
    """Warn when the whole motion, with frames of the given lengths [s], will take long; tell whether it will.

    With a first pose of the `bones`, before the simulation is started: then also the cloth is still to be put on.
    """
    forecast = simulation.forecast(float(steps.max()), bones)
    frames = len(steps) + (0 if bones is None else round(SETTLING_TIME / SETTLING_FRAME))
    seconds = forecast.seconds * frames
    if seconds <= SLOW or seconds <= SLOW_FACTOR * float(steps.sum()):
        return False
    span = f"{seconds / 60.0:.0f} minutes" if seconds > 120.0 else f"{seconds:.0f} s"
    if seconds > 7200.0:
        span = f"{seconds / 3600.0:.0f} hours"
    warnings.warn(
        f"{simulation.solver.name} takes {forecast.substeps} steps a frame here, about {span} for "
        f"{len(steps)} frames{'' if bones is None else ' and putting the cloth on'}; "
        "a softer fabric or a wider spacing needs fewer, and another solver may be faster",
        SlowWarning,
        stacklevel=3,
    )
    return True
