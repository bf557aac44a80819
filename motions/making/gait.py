"""Walking and running: measured joint angles, corrected just enough that no foot slides.

1. The measured angles give the path of the ankle relative to the hips over one stride (forward kinematics).
2. In stance the foot rolls in place: on the heel, flat, on the ball. The stride's length, and bob, sway and surge of
   the hips as a few harmonics, are the least-squares solution of "measured path = path of a foot that stands".
3. What remains of the difference is kept in stance and faded out in the swing; inverse kinematics turns the ankles back
   into angles of hip and knee.

Angles of the legs and the pelvis, and those of the runner's shoulders and elbows, are measured (see `gait_data`). Those
of chest and head, of the walker's arms, and the direction of the feet are chosen to look right.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.clip import Clip
from motions.curves import bridged, periodic, step
from motions.making import gait_data
from motions.making.body import INDEX as JOINT
from motions.making.body import OFFSETS, SHIN, SIDES, THIGH, Arm, Posture, about, chain, hip_joints
from motions.making.legs import foot_rotation, leg, standing_ankle

FloatArray = NDArray[np.float64]

FPS = 60.0
GRAVITY = 9.81

# Of the Fourier series of a measured angle; more would follow the scatter of single trials.
HARMONICS = 9

# Share of a leg's length that a standing foot may ask of it. The hips sink by what is missing: 3 mm in the walk, whose
# subject stretched the knee to 1 degree, where the least error of a length would be a large one of the angle.
STRAIGHTEST = 0.998

# Weight of the equations that let the hips fall in flight, against those of stance, which are errors of the ankle's
# place in metres.
FALL_WEIGHT = 0.01

# Shares of a stride in which the swing forgets how far, and how fast, the standing foot was off its measured path.
FADE = 0.15
SLOPE_FADE = 0.06


@dataclass(frozen=True, kw_only=True)
class Gait:
    """What tells walking from running. Phases are shares of a stride, from the left foot's contact; angles in degrees.

    Attributes:
        angles: samples over one stride by name, as in `gait_data`; those of the arm are by its own side's foot.
        frames: length of a stride at `FPS`, even.
        strides: how many strides the clip has.
        start: phase of the clip's first frame: an arm's swing passes the trunk there.
        stance: phases between which the left foot stands: its heel has stopped, the ball of the foot not yet left.
        flat: phases at which the sole comes down, from first to full contact, and at which the heel rises.
        lean: of the pelvis, chest and head, forwards.
        counter: how far the chest turns against the pelvis.
        arm_out: abduction and inward twist of the upper arm.
        toe_out: how far the feet point outwards.
        spread: how much wider than measured the legs are held, so that these thighs pass each other.
        steadiness: weight of keeping surge and sway of the hips small, against an unchanged path of the ankle.
    """

    angles: dict[str, FloatArray]
    frames: int
    strides: int
    start: float
    stance: tuple[float, float]
    flat: tuple[float, float, float, float]
    lean: tuple[float, float, float]
    counter: float
    arm_out: tuple[float, float]
    toe_out: float
    spread: float
    steadiness: float


def _columns(names: tuple[str, ...], table: FloatArray) -> dict[str, FloatArray]:
    return {name: table[:, column] for column, name in enumerate(names)}


def _swing(middle: float, amplitude: float, foremost: float) -> FloatArray:
    phase = np.arange(8) / 8
    return middle + amplitude * np.cos(2 * np.pi * (phase - foremost))


WALK = Gait(
    angles=_columns(gait_data.WALK_COLUMNS, gait_data.WALK)
    | {"shoulder": _swing(-4.0, 18.0, 0.5), "elbow": _swing(22.0, 11.0, 0.56)},
    frames=2 * round(FPS / gait_data.WALK_STRIDES_PER_SECOND / 2),
    strides=4,
    start=0.25,
    stance=(0.05, 0.61),
    flat=(0.02, 0.13, 0.34, 0.50),
    lean=(0.0, 2.0, 3.0),
    counter=5.0,
    arm_out=(5.0, 10.0),
    toe_out=7.0,
    spread=0.0,
    steadiness=0.0,
)

RUN = Gait(
    angles=_columns(gait_data.RUN_COLUMNS, gait_data.RUN),
    frames=2 * round(FPS / gait_data.RUN_STRIDES_PER_SECOND / 2),
    strides=6,
    start=0.114,
    stance=(0.02, 0.29),
    flat=(0.0, 0.08, 0.16, 0.27),
    lean=(6.0, 9.0, 5.0),
    counter=10.0,
    arm_out=(18.0, 15.0),
    toe_out=5.0,
    spread=3.0,
    # Short stances alone would leave 18 cm of sway.
    steadiness=1.0,
)


def walk() -> Clip:
    """Walking along +x at a natural cadence, a whole number of strides that continues into itself."""
    return performed(WALK).clip("walk", FPS)


def run() -> Clip:
    """An easy run along +x, a whole number of strides that continues into itself."""
    return performed(RUN).clip("run", FPS)


def performed(gait: Gait) -> Posture:
    """A clip's worth of strides."""
    stride, length = one_stride(gait)
    count = gait.frames * gait.strides
    total = np.arange(count) + round(gait.start * gait.frames)
    index = total % gait.frames
    root = stride.root[index]
    root[:, 0] += length * (total - total[0]) / gait.frames - root[0, 0]
    return replace(stride.taken(index), root=root)


def one_stride(gait: Gait) -> tuple[Posture, float]:
    """The body over one stride from the left foot's contact, without its travel, and the stride's length [m]."""
    phase = np.arange(gait.frames) / gait.frames
    pelvis = _pelvis(gait, phase)
    thigh, shin, foot = _measured_leg(gait, pelvis, phase)
    hip = quaternions.rotate(pelvis, OFFSETS[JOINT["LeftUpLeg"]])
    measured = hip + quaternions.rotate(thigh, [0.0, 0.0, -THIGH]) + quaternions.rotate(shin, [0.0, 0.0, -SHIN])

    pitch = _foot_pitch(gait, foot, phase)
    yaw = np.radians(gait.toe_out)
    roll = standing_ankle(np.zeros(3), pitch, yaw)
    root, length, spot = _hips_path(gait, measured, roll, phase)

    planted = spot + roll - np.outer(phase, [length, 0.0, 0.0]) - root
    # The longest leg in stance decides how high the hips can be.
    stretch = np.linalg.norm(planted - hip, axis=1)[_standing(phase, gait.stance)].max()
    sunk = max(stretch - STRAIGHTEST * (THIGH + SHIN), 0.0)
    root[:, 2] -= sunk
    planted[:, 2] += sunk
    ankle = _swinging(gait, planted, measured)

    toes = np.maximum(-pitch, 0.0) * (1 - 0.6 * step(phase, gait.stance[1], gait.stance[1] + 0.18))
    hinge = quaternions.rotate(thigh, [0.0, 1.0, 0.0])
    half = gait.frames // 2
    mirror = np.array([1.0, -1.0, 1.0])
    hips = hip_joints(np.zeros_like(root), pelvis)
    legs = {
        "Left": leg(hips["Left"], ankle, foot_rotation(pitch, yaw), toes, hinge),
        "Right": leg(
            hips["Right"],
            np.roll(ankle * mirror, half, axis=0),
            np.roll(foot_rotation(pitch, -yaw), half, axis=0),
            np.roll(toes, half),
            np.roll(-hinge * mirror, half, axis=0),
        ),
    }
    return Posture(root=root, pelvis=pelvis, **_trunk(gait, phase), arms=_arms(gait, phase), legs=legs), length


def _swinging(gait: Gait, planted: FloatArray, measured: FloatArray) -> FloatArray:
    """The path of the foot that stands, in the swing continued by the measured one."""
    begin, leave = gait.stance
    twice = np.arange(2 * gait.frames) / gait.frames
    paths = [np.concatenate([path, path]) for path in (planted, measured)]
    joined = bridged(twice, *paths, leave=leave, land=1 + begin, fade=FADE, slope_fade=SLOPE_FADE)
    half = round(begin * gait.frames)
    return np.concatenate([joined[gait.frames : gait.frames + half + 1], joined[half + 1 : gait.frames]])


def _angle(gait: Gait, name: str, phase: FloatArray) -> FloatArray:
    return np.radians(periodic(phase, gait.angles[name], min(HARMONICS, (len(gait.angles[name]) - 1) // 2)))


def _pelvis(gait: Gait, phase: FloatArray) -> FloatArray:
    """Pelvis_to_world; the two sides' halves of the stride are averaged, so that left and right are alike."""
    tilt, obliquity, rotation = (
        (_angle(gait, name, phase) + sign * _angle(gait, name, phase + 0.5)) / 2
        for name, sign in (("tilt", 1), ("obliquity", -1), ("rotation", -1))
    )
    return chain(
        about("z", -rotation),
        about("x", obliquity),
        about("y", tilt - np.mean(tilt) + np.radians(gait.lean[0])),
    )


def _measured_leg(gait: Gait, pelvis: FloatArray, phase: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Segment_to_world of the left thigh, shin and foot by the measured angles alone, shapes (F, 4)."""
    # The clinical pelvis is tilted forwards when the body stands; here it leans by `lean`, the thighs stay as measured.
    at_rest = np.radians(np.mean(gait.angles["tilt"]) - gait.lean[0])
    hip, adduction = _angle(gait, "hip", phase) - at_rest, _angle(gait, "adduction", phase) - np.radians(gait.spread)
    thigh = chain(pelvis, about("y", -hip), about("x", -adduction))
    shin = chain(thigh, about("y", _angle(gait, "knee", phase)))
    return thigh, shin, chain(shin, about("y", -_angle(gait, "ankle", phase)))


def _foot_pitch(gait: Gait, foot: FloatArray, phase: FloatArray) -> FloatArray:
    """The measured pitch of the foot, toes up, levelled to zero while the sole is flat [rad]."""
    pitch = np.arcsin(quaternions.rotate(foot, [1.0, 0.0, 0.0])[:, 2])
    down, full, rising, risen = gait.flat
    flat = step(phase, down, full) - step(phase, rising, risen)
    level = np.sum(flat * pitch) / np.sum(flat)
    return (pitch - level) * (1 - flat)


def _hips_path(
    gait: Gait, measured: FloatArray, roll: FloatArray, phase: FloatArray
) -> tuple[FloatArray, float, FloatArray]:
    """Least-squares path of the hips about their steady travel, stride length and the left foot's spot on the floor."""
    stance = _standing(phase, gait.stance)
    one, none = np.ones_like(phase), np.zeros_like(phase)

    def waves(*harmonics: int) -> FloatArray:
        angles = 2 * np.pi * np.outer(phase, harmonics)
        return np.concatenate([np.cos(angles), np.sin(angles)], axis=1)

    def solved(rows: FloatArray, right: FloatArray) -> FloatArray:
        # The waves are the last four unknowns.
        pull = gait.steadiness * np.sqrt(len(right)) * np.eye(rows.shape[1])[-4:]
        rows, right = np.concatenate([rows, pull]), np.concatenate([right, np.zeros(4)])
        return np.linalg.lstsq(rows, right, rcond=None)[0].astype(np.float64)

    # In each axis: (travel) + waves + measured = spot + roll. Left and right steps are alike, which leaves even
    # harmonics of surge and bob, and odd ones of sway.
    even, odd = waves(2, 4), waves(1, 3)
    target = roll - measured
    surge = solved(np.column_stack([phase, -one, even])[stance], target[stance, 0])
    sway = solved(np.column_stack([-one, odd])[stance], target[stance, 1])

    rows, right = np.column_stack([one, even])[stance], target[stance, 2]
    flight = (phase > gait.stance[1]) & (phase < 0.5)
    if gait.stance[1] < 0.5:
        # No foot is down: the hips fall freely, z'' = -g, scaled to be lengths like the other equations.
        duration = gait.frames / FPS
        rates = (2 * np.pi * np.array([2, 4, 2, 4])) ** 2
        fall = np.column_stack([none, -rates * even])[flight]
        rows = np.concatenate([rows, FALL_WEIGHT * fall])
        right = np.concatenate([right, np.full(flight.sum(), -FALL_WEIGHT * GRAVITY * duration**2)])
    bob = np.linalg.lstsq(rows, right, rcond=None)[0]

    root = np.column_stack([even @ surge[2:], odd @ sway[1:], np.column_stack([one, even]) @ bob])
    return root, float(surge[0]), np.array([surge[1], sway[0], 0.0])


def _standing(phase: FloatArray, stance: tuple[float, float]) -> NDArray[np.bool_]:
    return (phase >= stance[0]) & (phase <= stance[1])


def _trunk(gait: Gait, phase: FloatArray) -> dict[str, FloatArray]:
    """Chest and head to world: the chest turns against the pelvis, the head stays nearly still."""
    _, chest_lean, head_lean = np.radians(gait.lean)
    turn = np.radians(gait.counter) * np.cos(2 * np.pi * (phase - 0.02))
    roll = np.radians(-1.0) * np.cos(2 * np.pi * (phase - 0.17))
    nod = np.radians(1.0) * np.cos(4 * np.pi * (phase - 0.06))
    return {
        "chest": chain(about("z", turn), about("x", roll), about("y", chest_lean + nod)),
        "head": chain(about("z", 0.2 * turn), about("x", 0.3 * roll), about("y", head_lean - 0.5 * nod)),
    }


def _arms(gait: Gait, phase: FloatArray) -> dict[str, Arm]:
    abduction, twist = np.radians(gait.arm_out)
    arms = {}
    for side, contact in zip(SIDES, (0.0, 0.5), strict=True):
        own = phase + contact
        arms[side] = Arm(
            flexion=_angle(gait, "shoulder", own),
            abduction=np.full_like(own, abduction),
            twist=np.full_like(own, twist),
            elbow=_angle(gait, "elbow", own),
        )
    return arms
