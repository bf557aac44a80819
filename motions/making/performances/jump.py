"""A standing jump forwards: crouch, take-off, free flight of the centre of mass, landing on bent knees."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from motions.clip import Clip
from motions.curves import bridged, quintic
from motions.making.body import SIDES, Arm
from motions.making.figure import STANDING, Foot, Upper, arm, balanced, hanging, on_ground, spot, turned
from motions.making.score import FPS, Score, score

FloatArray = NDArray[np.float64]

GRAVITY = 9.81

# State of the centre of mass in flight: heights at take-off and touch-down, speed at take-off, distance covered.
OFF_HEIGHT, ON_HEIGHT = STANDING + 0.04, STANDING - 0.05
RISE_SPEED = 2.75
FLIGHT = (RISE_SPEED + np.sqrt(RISE_SPEED**2 + 2 * GRAVITY * (OFF_HEIGHT - ON_HEIGHT))) / GRAVITY
FLIGHT_LENGTH = 0.40
LENGTH = 0.56

OFF = 1.30
ON = OFF + FLIGHT


def jump() -> Clip:
    """A jump of 0.56 m."""
    moments = score(
        3.9,
        ready=0.30, begin=0.45, back=0.92, low=1.02, heels=1.08, drive=OFF - 0.10,
        off=OFF, rise=OFF + 0.08, loose=OFF + 0.13, top=OFF + FLIGHT / 2, near=ON - 0.07,
        on=ON, heels_down=ON + 0.09, dip=ON + 0.30, up=ON + 1.15, rest=ON + 1.35,
    )  # fmt: skip
    upper = Upper(
        pelvis=turned(pitch=moments(begin=1, low=34, off=-3, top=14, on=8, dip=28, up=1)),
        chest=turned(pitch=moments(begin=2, low=42, off=0, top=10, on=12, dip=36, up=2)),
        head=turned(pitch=moments(begin=3, low=16, off=2, top=5, on=6, dip=14, up=3)),
        # One arm is a little behind the other: nobody moves like a mirror.
        arms={"Left": _swinging(moments), "Right": _swinging(moments.later(0.03))},
    )
    pitch = moments.radians(heels=0, drive=-12, off=-56, rise=-70, near=-20, on=-16, heels_down=0)
    thigh = moments.radians(off=10, rise=-4, top=30, near=20, on=26)
    knee = moments.radians(off=36, rise=14, top=58, near=16, on=30)
    standing = {side: on_ground(side, _spots(moments, side), pitch=pitch) for side in SIDES}

    def feet(hips: dict[str, FloatArray]) -> dict[str, Foot]:
        placed = {}
        for side, foot in standing.items():
            free = hanging(hips[side], thigh, knee)
            ankle = bridged(moments.times, foot.ankle, free, leave=OFF, land=ON, fade=0.22, slope_fade=0.06)
            in_air = moments.share("off", "loose") * (1 - moments.share("near", "on"))
            placed[side] = replace(foot, ankle=ankle, toes=foot.toes * (1 - in_air))
        return placed

    return balanced(_center(moments), upper, feet).clip("jump", FPS)


def _swinging(moments: Score) -> Arm:
    """The arm swings back in the crouch, up with the take-off and down with the landing."""
    return arm(
        flexion=moments(ready=2, back=-56, off=128, top=122, on=66, dip=6, rest=2),
        abduction=moments(ready=5, low=14, off=18, on=30, dip=22, rest=5),
        twist=10,
        elbow=moments(ready=14, low=16, drive=42, rise=24, on=44, dip=50, up=14),
    )


def _spots(moments: Score, side: str) -> FloatArray:
    after = moments.times > moments.at["top"]
    return np.where(after[:, None], spot(side, LENGTH), spot(side))


def _center(moments: Score) -> FloatArray:
    """Path of the centre of mass [m], shape (F, 3): free fall, before and after it quintics that meet its ends."""
    begin, low, dip, up = (moments.at[name] for name in ("begin", "low", "dip", "up"))
    fall_speed = RISE_SPEED - GRAVITY * FLIGHT
    rest, crouch, landed = (STANDING, 0, 0), (STANDING - 0.33, 0, 9.0), (STANDING - 0.26, 0, 8.0)
    off, on = (OFF_HEIGHT, RISE_SPEED, -GRAVITY), (ON_HEIGHT, fall_speed, -GRAVITY)
    grounded = [(begin, low, rest, crouch), (low, OFF, crouch, off)]
    landing = [(ON, dip, on, landed), (dip, up, landed, rest)]
    height = _pieces(moments.times, [*grounded, (OFF, ON, off, on), *landing])
    speed = FLIGHT_LENGTH / FLIGHT
    still, there = (0.045, 0, 0), (LENGTH + 0.045, 0, 0)
    leaving, arriving = (0.10, speed, 0), (0.10 + FLIGHT_LENGTH, speed, 0)
    forward = _pieces(
        moments.times, [(begin, OFF, still, leaving), (OFF, ON, leaving, arriving), (ON, up, arriving, there)]
    )
    return np.column_stack([forward, np.zeros_like(height), height])


State = tuple[float, float, float]


def _pieces(t: FloatArray, pieces: Sequence[tuple[float, float, State, State]]) -> FloatArray:
    """Quintics one after the other: start, end, and value, speed and acceleration at both."""
    curve = np.full_like(t, pieces[0][2][0])
    for start, end, at_start, at_end in pieces:
        curve = np.where(t >= start, quintic(np.clip(t, start, end), start, end, at_start, at_end), curve)
    return curve
