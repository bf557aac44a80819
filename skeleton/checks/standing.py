"""What the ground and gravity tell of a motion: feet under or off the floor, a body of a doubtful size or scale."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skeleton.checks.findings import Finding, in_frames, run_of, runs
from skeleton.placed_solids import floor_level, lowest_points
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

NEVER_DOWN = 0.05  # m above the floor: a foot that stays higher never stands
HEIGHTS = (1.4, 2.1)  # m, between which most adults are
FREE_FALL = 9.81  # m/s2
CLEAR_OF_FLOOR = 0.12  # m under all of a body in flight: soles of feet that stand are up to 0.1 m above toes' lowest
SHORTEST_FLIGHT = 0.1  # s
PLAUSIBLE_FALL = (6.0, 14.0)  # m/s2: trunks of jumpers and runners, whose limbs swing, fall at 8.7 to 10.5


def feet(track: BoneTrack, capsules: Sequence[Capsule]) -> list[Finding]:
    """Find feet that sink into the floor by more than their own radius, the deepest first, or that never touch it.

    The floor is that under the motion (`placed_solids.floor_level`), which feet may sink into in rare frames. A foot
    is one capsule from ankle to toes, which doesn't bend: on tiptoe its end is under the floor where toes are not.
    """
    soles = [c for c in capsules if c.bone in {track.roles.get("left_foot"), track.roles.get("right_foot")} - {None}]
    level = floor_level(capsules, track)
    if level is None or not soles:
        return []
    found = []
    for sole, height in zip(soles, (lowest_points(soles, track) - level).T, strict=True):
        if height.min() > NEVER_DOWN:
            text = f"{sole.name} never comes nearer to the floor than {1000 * height.min():.0f} mm"
            found.append(Finding("floor", text, float(height.min()), "m", None, (sole.name,)))
        elif height.min() < -sole.radius:
            run, others = run_of(height < -sole.radius, int(height.argmin()))
            text = f"{sole.name} is under the floor by up to {-1000 * height.min():.0f} mm {in_frames(run, others)}"
            found.append(Finding("floor", text, float(-height.min()), "m", run, (sole.name,)))
    return sorted(found, key=lambda finding: -finding.figure)


def scale_doubts(track: BoneTrack, capsules: Sequence[Capsule], *, height: float | None = None) -> list[Finding]:
    """Find signs of a wrong unit or frame rate: a body of unusual height [m], a fall at another rate than gravity's."""
    found = []
    if height is not None and not HEIGHTS[0] <= height <= HEIGHTS[1]:
        text = f"the body is {height:.2f} m tall, most are {HEIGHTS[0]} to {HEIGHTS[1]} m: is the unit right?"
        found.append(Finding("unit", text, height, "m", None, ()))
    falls = _falls(track, capsules)
    if falls and not PLAUSIBLE_FALL[0] <= (fall := float(np.median([f for f, _ in falls]))) <= PLAUSIBLE_FALL[1]:
        longest = max((run for _, run in falls), key=lambda run: run[1] - run[0])
        text = (
            f"in flight the body falls at {fall:.1f} m/s2 {in_frames(longest, len(falls) - 1)}, gravity is "
            f"{FREE_FALL}: is the unit right (one {FREE_FALL / fall:.2f} times as large falls so), or the frame rate?"
        )
        found.append(Finding("unit", text, fall, "m/s2", longest, ()))
    return found


def _falls(track: BoneTrack, capsules: Sequence[Capsule]) -> list[tuple[float, tuple[int, int]]]:
    """Downward acceleration of the trunk [m/s2] in each flight, fitted by a parabola, and the flight's frames."""
    trunk = [track.index(role) for role in ("pelvis", "chest") if role in track.roles]
    level = floor_level(capsules, track)
    if level is None or not trunk:
        return []
    moving = [capsule for capsule in capsules if capsule.bone is not None]
    clear = lowest_points(moving, track).min(axis=1) > level + CLEAR_OF_FLOOR
    heights = track.positions[:, trunk, 2].mean(axis=1)
    falls = []
    for first, last in runs(clear):
        times = track.times[first : last + 1] - track.times[first]
        if times[-1] >= SHORTEST_FLIGHT and len(times) > 4:
            falls.append((float(-2.0 * np.polyfit(times, heights[first : last + 1], 2)[0]), (first, last)))
    return falls
