"""Idle, jump, kick and spin, composed from kinematics: feet that stand where they stand, a centre of mass that obeys.

Each performance says where its feet are, how trunk and arms turn and where the centre of mass goes; `figure` does the
rest. Times [s], angles [degrees] and places [m] were chosen and then judged by eye; the jump's flight is free fall.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions
from motions.body import BALL, SHIN, SIDES, THIGH, Arm, about, oriented
from motions.clip import Clip
from motions.curves import bridged, keyed, quintic, step
from motions.figure import TOE_OUT, Foot, Upper, balanced, on_ground, spot

FloatArray = NDArray[np.float64]

FPS = 60.0
GRAVITY = 9.81
STANDING = 1.026


def idle() -> Clip:
    """Standing at ease: two breaths while the weight goes from one leg to the other; continues into itself."""
    duration = 6.0
    t = np.arange(round(duration * FPS)) / FPS
    weight, breath = 2 * np.pi * t / duration, 4 * np.pi * t / duration
    shift = np.sin(weight) - 0.12 * np.sin(3 * weight)
    inhaled = 0.5 - 0.5 * np.cos(breath - 0.6 * np.sin(breath))
    look = 7.0 * np.sin(weight - 0.9) + 2.0 * np.sin(2 * weight)
    sway = 1.5 * np.sin(weight - 0.8)
    upper = Upper(
        pelvis=_turned(1.5 * shift, 2.2 * shift, 1.0 + 0.3 * np.sin(weight + 1.0)),
        chest=_turned(-1.0 * shift, -1.4 * shift, 2.5 - 2.2 * inhaled),
        head=_turned(look, -0.6 * shift, 3.0 - 0.8 * inhaled + 1.2 * np.cos(weight)),
        arms={
            side: _arm(2 + sway, 5 + 1.0 * inhaled + sign * 0.8 * shift, 10, 14 + 1.5 * np.sin(weight - 1.2))
            for side, sign in SIDES.items()
        },
    )
    center = np.column_stack(
        [0.045 + 0.005 * np.sin(2 * weight + 0.5), 0.030 * shift, STANDING + 0.002 * inhaled - 0.004 * shift**2]
    )
    still = {side: on_ground(side, np.tile(spot(side), (len(t), 1))) for side in SIDES}
    return balanced(center, upper, lambda hips: still).clip("idle", FPS)


def jump() -> Clip:
    """A standing jump forwards: crouch, take-off, free flight of the centre of mass, landing on bent knees."""
    t = _times(3.9)
    begin, lowest, off, rise_speed = 0.45, 1.02, 1.30, 2.75
    off_height, land_height, travel = STANDING + 0.09, STANDING - 0.01, 0.40
    on = off + (rise_speed + np.sqrt(rise_speed**2 + 2 * GRAVITY * (off_height - land_height))) / GRAVITY
    settled, up = on + 0.30, on + 1.15
    fall_speed = rise_speed - GRAVITY * (on - off)
    rest, bottom, dip = (STANDING, 0.0, 0.0), (STANDING - 0.33, 0.0, 9.0), (STANDING - 0.30, 0.0, 8.0)
    flight_start, flight_end = (off_height, rise_speed, -GRAVITY), (land_height, fall_speed, -GRAVITY)
    parts = [
        (begin, lowest, rest, bottom),
        (lowest, off, bottom, flight_start),
        (off, on, flight_start, flight_end),
        (on, settled, flight_end, dip),
        (settled, up, dip, rest),
    ]
    height = _joined(t, STANDING, parts)
    cruise = travel / (on - off)
    lean, fore = 0.045, 0.10
    forward = _joined(
        t,
        lean,
        [
            (begin, off, (lean, 0.0, 0.0), (fore, cruise, 0.0)),
            (off, on, (fore, cruise, 0.0), (fore + travel, cruise, 0.0)),
            (on, up, (fore + travel, cruise, 0.0), (lean + 0.56, 0.0, 0.0)),
        ],
    )
    center = np.column_stack([forward, np.zeros_like(t), height])
    trunk = _keys(t, (begin, 2), (lowest, 42), (off, 0), ((off + on) / 2, 10), (on, 12), (settled, 36), (up, 2))
    pelvis = _keys(t, (begin, 1), (lowest, 34), (off, -3), ((off + on) / 2, 14), (on, 8), (settled, 28), (up, 1))
    swing = _keys(
        t, (0.3, 2), (lowest - 0.08, -58), (off, 132), ((off + on) / 2, 125), (on, 70), (settled, 8), (up + 0.2, 2)
    )
    elbow = _keys(t, (0.3, 14), (lowest, 18), (off - 0.1, 40), (off, 22), (on, 45), (settled, 50), (up + 0.2, 14))
    out = _keys(t, (0.3, 5), (lowest, 14), (off, 16), (on, 30), (settled, 26), (up + 0.2, 5))
    upper = Upper(
        pelvis=_turned(0, 0, pelvis),
        chest=_turned(0, 0, trunk),
        head=_turned(0, 0, 0.35 * trunk + 2),
        arms={side: _arm(swing, out, 10, elbow) for side in SIDES},
    )
    pitch = np.radians(
        _keys(
            t,
            (lowest + 0.06, 0),
            (off - 0.10, -14),
            (off, -52),
            (off + 0.10, -64),
            (on - 0.12, -20),
            (on, -16),
            (on + 0.09, 0),
        )
    )
    far = 0.56

    def feet(hips: dict[str, FloatArray]) -> dict[str, Foot]:
        placed = {}
        for side in SIDES:
            spots = np.where((t < (off + on) / 2)[:, None], spot(side), spot(side, far))
            foot = on_ground(side, spots, pitch=pitch)
            knee = np.radians(_keys(t, (off, 14), (off + 0.26, 62), (on, 22)))
            thigh = np.radians(_keys(t, (off, -2), (off + 0.26, 34), (on, 22)))
            free = _hanging(hips[side], thigh, knee, 0.0)
            ankle = bridged(t, foot.ankle, free, leave=off, land=on, fade=0.22, slope_fade=0.06)
            toes = foot.toes * (1 - step(t, off, off + 0.10))
            placed[side] = Foot(ankle=ankle, pitch=foot.pitch, yaw=foot.yaw, toes=toes, knee_out=foot.knee_out)
        return placed

    return balanced(center, upper, feet).clip("jump", FPS)


def kick() -> Clip:
    """A step onto the left foot and a high front kick with the right one, which is then set down beside it."""
    t = _times(3.7)
    stride, step_off, step_on = 0.48, 0.38, 0.82
    leave, chamber, impact, back, land = 0.98, 1.30, 1.42, 1.66, 2.16
    settled = 2.9
    upper = Upper(
        pelvis=_turned(
            _keys(t, (0.2, 0), (0.8, -16), (impact, 22), (back, 10), (land, -4), (settled, 0)),
            _keys(t, (0.5, 0), (leave, 2), (impact, -5), (land, 1), (settled, 0)),
            _keys(t, (0.2, 1), (0.8, 6), (chamber, -4), (impact, -24), (back, -8), (land, 8), (settled, 1)),
        ),
        chest=_turned(
            _keys(t, (0.2, 0), (0.8, 10), (impact, -12), (back, -4), (land, 6), (settled, 0)),
            0,
            _keys(t, (0.2, 2), (0.8, 8), (chamber, 2), (impact, -16), (back, 4), (land, 14), (settled, 2)),
        ),
        head=_turned(0, 0, _keys(t, (0.2, 3), (impact, 2), (land, 6), (settled, 3))),
        arms={
            "Left": _arm(
                _keys(t, (0.15, 2), (0.75, 42), (chamber, 48), (impact, 38), (back, 46), (land, 40), (settled, 2)),
                _keys(t, (0.15, 5), (0.75, 22), (impact, 38), (land, 22), (settled, 5)),
                _keys(t, (0.15, 10), (0.75, 26), (land, 26), (settled, 10)),
                _keys(t, (0.15, 14), (0.75, 92), (impact, 70), (land, 88), (settled, 14)),
            ),
            "Right": _arm(
                _keys(t, (0.15, 2), (0.75, 36), (chamber, 20), (impact, -34), (back, 12), (land, 38), (settled, 2)),
                _keys(t, (0.15, 5), (0.75, 20), (impact, 34), (land, 20), (settled, 5)),
                _keys(t, (0.15, 10), (0.75, 26), (impact, 10), (land, 24), (settled, 10)),
                _keys(t, (0.15, 14), (0.75, 98), (chamber, 84), (impact, 34), (land, 88), (settled, 14)),
            ),
        },
    )
    center = np.column_stack(
        [
            _keys(
                t,
                (0.2, 0.045),
                (step_on, 0.33),
                (leave, 0.49),
                (impact, stride + 0.06),
                (land, stride + 0.06),
                (settled, stride + 0.045),
            ),
            _keys(
                t,
                (0.1, 0.0),
                (step_off, -0.055),
                (leave, 0.07),
                (impact, 0.085),
                (back, 0.08),
                (land, 0.03),
                (settled, 0.0),
            ),
            STANDING + _keys(t, (0.2, 0), (0.7, -0.045), (chamber, 0.0), (impact, 0.045), (land, -0.05), (settled, 0)),
        ]
    )
    moved = step(t, step_off, step_on)[:, None]
    left = on_ground(
        "Left",
        spot("Left") + moved * [stride, 0.0, 0.0] + _hump(t, step_off, step_on) * [0.0, 0.0, 0.07],
        pitch=np.radians(
            _keys(
                t,
                (step_off - 0.12, 0),
                (step_off + 0.12, -24),
                (step_on, 16),
                (step_on + 0.12, 0),
                (chamber, 0),
                (impact, -14),
                (back, 0),
            )
        ),
    )
    # The ankle's angle in the air, from the lifted heel over the flexed foot behind the ball to the landing.
    thigh = np.radians(_keys(t, (leave, -16), (chamber, 98), (impact, 116), (back - 0.08, 100), (land - 0.08, 14)))
    knee = np.radians(
        _keys(t, (leave, 34), (chamber - 0.10, 112), (chamber, 116), (impact, 8), (back - 0.06, 108), (land - 0.08, 22))
    )
    flexed = np.radians(_keys(t, (leave, -20), (chamber, 4), (impact, -16), (back, 4), (land, 4)))
    after = step(t, chamber, back)[:, None]
    planted = on_ground(
        "Right",
        spot("Right") + after * [stride, 0.0, 0.0],
        pitch=np.radians(
            _keys(t, (step_on - 0.10, 0), (leave, -46), (chamber, 0), (land - 0.1, 8), (land, 6), (land + 0.12, 0))
        ),
    )
    reach_in = 0.055 * step(t, leave, chamber) * (1 - step(t, back, land))

    def feet(hips: dict[str, FloatArray]) -> dict[str, Foot]:
        free = _hanging(hips["Right"], thigh, knee, reach_in)
        ankle = bridged(t, planted.ankle, free, leave=leave, land=land, fade=0.25, slope_fade=0.10)
        pitch = bridged(t, planted.pitch, thigh - knee + flexed, leave=leave, land=land, fade=0.25, slope_fade=0.10)
        toes = planted.toes * (1 - step(t, leave, leave + 0.15))
        right = Foot(ankle=ankle, pitch=pitch, yaw=planted.yaw, toes=toes, knee_out=planted.knee_out)
        return {"Left": left, "Right": right}

    return balanced(center, upper, feet).clip("kick", FPS)


def spin() -> Clip:
    """A pirouette: two turns to the right on the ball of the left foot, arms drawn in, wound up before and settled after."""
    t = _times(4.8)
    wind, push, up, down, closed, settled = 0.95, 1.25, 1.50, 2.95, 3.45, 4.2
    turn = -720.0 * _ramp(t, push, closed - 0.10, 0.30)
    wound = _keys(t, (0.3, 0), (wind, 22), (push, 20), (push + 0.35, 0))
    facing = turn + wound
    # The head stays with the front as long as it can and is there again first.
    spotting = 38.0 * np.sin(np.radians(-turn)) * step(t, push, up) * (1 - step(t, down, closed))
    upper = Upper(
        pelvis=_turned(
            facing,
            _keys(t, (push, 0), (up, -3), (down, -3), (closed, 0)),
            _keys(t, (0.3, 1), (wind, 4), (up, 0), (down, 0), (closed, 5), (settled, 1)),
        ),
        chest=_turned(
            facing
            + _keys(t, (0.3, 0), (wind, 10), (push + 0.1, -14), (up + 0.1, 0), (down, 0), (closed, 6), (settled, 0)),
            0,
            _keys(t, (0.3, 2), (wind, 5), (up, -1), (down, -1), (closed, 6), (settled, 2)),
        ),
        head=_turned(turn + 0.2 * wound + spotting, 0, 1.0),
        arms={
            "Left": _arm(
                _keys(t, (0.2, 2), (wind, 22), (up, 58), (down, 58), (closed, 24), (settled, 2)),
                _keys(t, (0.2, 5), (wind, 74), (push, 76), (up + 0.08, 22), (down, 22), (closed, 58), (settled, 5)),
                _keys(t, (0.2, 10), (wind, 10), (up, 48), (down, 48), (closed, 12), (settled, 10)),
                _keys(t, (0.2, 14), (wind, 26), (up, 92), (down, 92), (closed, 24), (settled, 14)),
            ),
            "Right": _arm(
                _keys(
                    t,
                    (0.2, 2),
                    (wind, 58),
                    (push, 52),
                    (push + 0.14, 40),
                    (up, 58),
                    (down, 58),
                    (closed, 24),
                    (settled, 2),
                ),
                _keys(
                    t, (0.2, 5), (wind, 18), (push + 0.14, 62), (up + 0.14, 22), (down, 22), (closed, 58), (settled, 5)
                ),
                _keys(t, (0.2, 10), (wind, 46), (push + 0.14, 14), (up, 48), (down, 48), (closed, 12), (settled, 10)),
                _keys(
                    t, (0.2, 14), (wind, 78), (push + 0.14, 30), (up + 0.1, 92), (down, 92), (closed, 24), (settled, 14)
                ),
            ),
        },
    )
    turning = np.radians(turn)
    ball = spot("Left") + quaternions.rotate(about("z", TOE_OUT), BALL * [1, 1, 0])
    pitch = np.radians(_keys(t, (push - 0.05, 0), (up, -38), (down + 0.05, -38), (closed - 0.02, 0)))
    left = on_ground(
        "Left",
        ball - quaternions.rotate(about("z", TOE_OUT + turning), BALL * [1, 1, 0]),
        pitch=pitch,
        turn=turning,
    )
    behind = np.array([-0.26, -0.02, 0.0])
    beside = spot("Right")
    center = np.column_stack(
        [
            _keys(
                t,
                (0.2, 0.045),
                (wind, -0.04),
                (push, 0.02),
                (up, ball[0]),
                (down, ball[0]),
                (closed, 0.05),
                (settled, 0.045),
            ),
            _keys(
                t, (0.2, 0.0), (0.5, 0.05), (wind, 0.02), (up, ball[1]), (down, ball[1]), (closed, 0.03), (settled, 0.0)
            ),
            STANDING
            + _keys(
                t, (0.3, 0), (wind, -0.10), (push, -0.09), (up, 0.085), (down, 0.085), (closed, -0.06), (settled, 0)
            ),
        ]
    )
    stepping = step(t, 0.40, 0.80)[:, None]
    planted = on_ground(
        "Right",
        beside
        + np.where(
            (t < (up + down) / 2)[:, None], stepping * behind + _hump(t, 0.40, 0.80) * [0, 0, 0.05], [-0.03, -0.02, 0.0]
        ),
        pitch=np.radians(
            _keys(
                t,
                (0.34, 0),
                (0.55, -30),
                (0.80, -24),
                (wind, -26),
                (push + 0.08, -48),
                (up, -30),
                (down, -20),
                (closed - 0.06, -22),
                (closed + 0.12, 0),
            )
        ),
    )
    leave, land = push + 0.06, closed
    raised = np.radians(-58.0 + 0 * t)

    def feet(hips: dict[str, FloatArray]) -> dict[str, Foot]:
        middle = (hips["Left"] + hips["Right"]) / 2
        free = middle + quaternions.rotate(about("z", np.radians(facing)), [0.15, -0.01, -0.42])
        ankle = bridged(t, planted.ankle, free, leave=leave, land=land, fade=0.30, slope_fade=0.10)
        foot_pitch = bridged(t, planted.pitch, raised, leave=leave, land=land, fade=0.25, slope_fade=0.10)
        out = 1.0 * step(t, push, up) * (1 - step(t, down, closed))
        yaw = planted.yaw + turning - 0.5 * out
        toes = planted.toes * (1 - step(t, leave, leave + 0.12) * (1 - step(t, land - 0.1, land)))
        return {"Left": left, "Right": Foot(ankle=ankle, pitch=foot_pitch, yaw=yaw, toes=toes, knee_out=-out)}

    return balanced(center, upper, feet).clip("spin", FPS)


def _hump(t: FloatArray, start: float, end: float) -> FloatArray:
    """0 up to `start` and from `end` on, 1 half way, shape (F, 1)."""
    middle = (start + end) / 2
    return (step(t, start, middle) * (1 - step(t, middle, end)))[:, None]


def _ramp(t: FloatArray, start: float, end: float, ease: float) -> FloatArray:
    """From 0 to 1 at constant speed but for the times `ease` after `start` and before `end`."""
    fine = np.linspace(start, end, 2001)
    speed = step(fine, start, start + ease) * (1 - step(fine, end - ease, end))
    area = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    return np.interp(t, fine, area / area[-1])


def _times(duration: float) -> FloatArray:
    return np.arange(round(duration * FPS) + 1) / FPS


def _turned(yaw: ArrayLike, roll: ArrayLike, pitch: ArrayLike) -> FloatArray:
    """`oriented` with angles in degrees, at least one of them an array."""
    return oriented(*np.broadcast_arrays(*(np.radians(angle) for angle in (yaw, roll, pitch))))


def _arm(flexion: ArrayLike, abduction: ArrayLike, twist: ArrayLike, elbow: ArrayLike) -> Arm:
    """An arm with angles in degrees."""
    flexion, abduction, twist, elbow = (np.radians(angle) for angle in (flexion, abduction, twist, elbow))
    return Arm(flexion=flexion, abduction=abduction, twist=twist, elbow=elbow)


def _keys(t: FloatArray, *keys: tuple[float, float]) -> FloatArray:
    return keyed(t, *keys)


def _joined(t: FloatArray, rest: float, parts: list) -> FloatArray:
    """Quintics one after the other: (start, end, state at the start, state at the end) each."""
    curve = np.full_like(t, rest)
    for start, end, at_start, at_end in parts:
        curve = np.where(t >= start, quintic(np.clip(t, start, end), start, end, at_start, at_end), curve)
    return curve


def _hanging(hip: FloatArray, thigh: FloatArray, knee: FloatArray, inwards: ArrayLike) -> FloatArray:
    """World positions of the ankle [m] of a leg in the plane of travel: thigh forwards by `thigh`, knee bent [rad]."""
    shin = thigh - knee
    x = THIGH * np.sin(thigh) + SHIN * np.sin(shin)
    z = -THIGH * np.cos(thigh) - SHIN * np.cos(shin)
    return hip + np.column_stack([x, np.broadcast_to(inwards, x.shape), z])
