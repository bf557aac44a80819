"""What few who wear a cape do: a hand in the pelvis, a cartwheel, a back flip, a dash at 20 m/s."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import motions
from motions import quaternions
from skeleton import BoneTrack, Skeleton

FloatArray = NDArray[np.float64]

FPS = 60.0
PARTED = 1.0  # s at which the hand has left the pelvis
FORWARD, LEFT = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
STUNTS = ("hand in the pelvis", "cartwheel", "back flip", "dash")


def stunt(name: str) -> tuple[Skeleton, BoneTrack]:
    """A figure, and its motion in a stunt of that name."""
    first = motions.load("idle").trim(0.0, 0.02)
    body = Skeleton.from_clip(first)
    times = np.arange(round(1.4 * FPS)) / FPS
    roots = np.repeat(first.root_positions[:1], len(times), axis=0)
    turns = np.repeat(first.rotations_wxyz[:1], len(times), axis=0)

    def turn(role: str, axis: FloatArray, degrees: FloatArray) -> None:
        joint = first.joints.index(body.role(role))
        by = quaternions.from_rotation_vector(np.radians(degrees)[:, None] * axis)
        turns[:, joint] = quaternions.multiply(by, turns[:, joint])

    def both(part: str, axis: FloatArray, degrees: FloatArray, *, mirrored: bool = False) -> None:
        turn(f"left_{part}", axis, degrees)
        turn(f"right_{part}", axis, -degrees if mirrored else degrees)

    if name == "hand in the pelvis":
        inside = ramp(times, 0.2, 0.25) - ramp(times, PARTED - 0.15, 0.15)
        turn("left_upper_arm", FORWARD, 40.0 - 65.0 * inside)
    elif name == "cartwheel":
        spread = ramp(times, 0.0, 0.3) - ramp(times, 1.1, 0.3)
        both("upper_arm", FORWARD, 150.0 * spread, mirrored=True)
        both("thigh", FORWARD, 35.0 * spread, mirrored=True)
        share = ramp(times, 0.2, 1.0)
        roots += 2.0 * share[:, None] * LEFT
        turn("pelvis", FORWARD, -360.0 * share)
    elif name == "back flip":
        air, tucked = np.clip(times - 0.4, 0.0, 0.7), ramp(times, 0.45, 0.15) - ramp(times, 0.9, 0.2)
        roots[:, 2] += 0.5 * 9.81 * air * (0.7 - air)
        both("thigh", LEFT, -100.0 * tucked)
        both("shin", LEFT, 110.0 * tucked)
        both("upper_arm", LEFT, -100.0 * (ramp(times, 0.25, 0.15) - ramp(times, 0.95, 0.3)))
        turn("pelvis", LEFT, -360.0 * ramp(times, 0.4, 0.7))
    else:
        roots += 20.0 * np.clip(times - 0.3, 0.0, 0.25)[:, None] * FORWARD
    clip = replace(first, name=name, root_positions=roots, rotations_wxyz=turns)
    return body, body.track(clip)


def ramp(times: FloatArray, start: float, duration: float) -> FloatArray:
    """From 0 to 1 within a duration from a start on [s], without a jerk."""
    share = np.clip((times - start) / duration, 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)
