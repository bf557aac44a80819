"""What a BVH file leaves open and its reader has to decide: the up axis, the unit, whether frame 0 belongs to it."""

import numpy as np
from numpy.typing import NDArray

from motions.bodies import stature
from motions.errors import UnknownNameError, ValueRangeError

FloatArray = NDArray[np.float64]

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": 0.0254 / 0.45}
"""Metres in a unit. CMU's files come in units of 1/0.45 inch (mocap.cs.cmu.edu, faq)."""

PLAUSIBLE = (1.4, 2.1)
"""Heights of people [m]: a body in this range needs no remark."""

POSSIBLE = (1.2, 2.4)
"""Heights of children and giants [m]: with no plausible unit, the one in this range is taken, with a remark. Neighbours
among the units differ by more than the ends of either range do, so at most one fits."""

_IN_METRES = (0.3, 5.0)
"""Heights [m] of characters, from a gnome to a giant, which are believed where a file states its unit."""

USUAL_HEIGHT = 1.7
"""What a body is scaled to [m] where no unit makes it possible."""

# A first step of this many body heights, and of this many times the largest of the next ten steps, is no motion: at 30
# frames a second a sprinter's foot covers 0.2 heights a frame, but does so frame after frame.
_JUMP, _JUMP_RATIO, JUMP_FRAMES = 0.2, 4.0, 12
# A first frame in which no joint is turned needs less of a ratio: it is that of the file's making.
_BARE_RATIO = 1.0
UNTURNED = float(np.cos(np.deg2rad(0.25)))  # |w| of a rotation by half a degree

# Mean of what is upwards from feet to head: above which there is no doubt, and below which a body turns over.
_UPRIGHT, _TURNED_OVER = 0.7, 0.35
# In body heights: how little the lowest point of a body that crawls rises, and how far it gets along its own length.
_FLOOR, _OFF_FLOOR = 0.15, 0.6

# to_z_up[axis] turns the file's axis to +z: rows are the axes of Z up in the file's.
_TO_Z_UP = {
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
}
UP_AXES = tuple(_TO_Z_UP)


def to_z_up(up: str) -> FloatArray:
    """Rotation matrix file_to_world that turns the up axis to +z; y up gives (x, y, z) -> (x, -z, y).

    Raises:
        UnknownNameError: `up` isn't one of `UP_AXES`.
    """
    axis = up.lower().removeprefix("+")
    if axis not in _TO_Z_UP:
        raise UnknownNameError("up axis", up, UP_AXES)
    return np.array(_TO_Z_UP[axis], dtype=float)


def meters_per_unit(unit: str | float) -> float:
    """Metres in a unit that is given by name or as the number itself.

    Raises:
        UnknownNameError: the name isn't one of `UNITS`.
        ValueRangeError: the number isn't above 0, or beyond any use.
    """
    if isinstance(unit, str) and unit.lower() in UNITS:
        return UNITS[unit.lower()]
    try:
        meters = float(unit)
    except ValueError:
        raise UnknownNameError("unit", str(unit), UNITS, "Or give the metres in a unit as a number") from None
    if not 1e-9 <= meters <= 1e9:
        raise ValueRangeError(f"a unit must be a number of metres above 0, not {meters:g}")
    return meters


def jumps_at_start(points: FloatArray, height: float, *, bare: bool = False) -> float | None:
    """Whether the first frame is foreign to the motion, as the T-pose in front of CMU's files.

    Args:
        points: positions at the first frames, at most `JUMP_FRAMES` of them, shape (F, N, 3).
        height: of the body, same unit.
        bare: whether no joint is turned in the first frame: a pose that bodies are made in, and few motions begin with.

    Returns:
        How far a point moves from the first frame to the second, in body heights, or None where it is no jump.
    """
    if len(points) < 3 or height <= 0:
        return None
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(axis=1) / height
    ratio = _BARE_RATIO if bare else _JUMP_RATIO
    return float(steps[0]) if steps[0] > _JUMP and steps[0] > ratio * steps[1:].max() else None


def choose_up(points: FloatArray, landmarks: stature.Landmarks | None, height: float) -> tuple[str, str]:
    """The axis that points up, Y or Z, and a sentence about the choice and what is doubtful about it.

    It is the one that the body stands along, on its feet or its hands; what turns over stands so at first. But where
    the other one is that of a floor, from which what crawls is never far while it moves along its own length, it is
    that.

    Args:
        points: positions of joints and end sites over some frames, shape (F, N, 3).
        landmarks: of the body, None where it has no known head and feet.
        height: of the body, same unit.
    """
    if landmarks is None:
        axis = "y" if np.ptp(points, axis=1).mean(axis=0).argmax() == 1 else "z"
        return axis, f"up: +{axis.upper()} axis, a guess, since no head and feet were found; give up to change it"
    direction = stature.upright_direction(points, landmarks)
    turns = np.abs(direction[1:]).max() < _TURNED_OVER
    if turns:
        direction = stature.upright_direction(points[:1], landmarks)
    along = dict(zip("yz", direction[1:], strict=True))
    axis = max(along, key=lambda name: abs(along[name]))
    other = "z" if axis == "y" else "y"
    lows = {name: float(np.ptp(points[..., "xyz".index(name)].min(axis=1))) for name in "yz"}
    if lows[other] < _FLOOR * height and lows[axis] > _OFF_FLOOR * height:
        return other, (
            f"up: +{other.upper()} axis, as the body stays on a floor across it while it moves along its own length; "
            "give up if it's wrong"
        )
    where = "along which the head is above the feet"
    if along[axis] < 0.0:
        where = "a convention, though the feet are above the head in most frames; give up if it's wrong"
    elif turns or along[axis] <= _UPRIGHT:
        where += "; the body is far from upright, give up if it's wrong"
    elif lows[axis] > max(_OFF_FLOOR * height, 2.0 * lows[other]):
        where += f"; the body gets {lows[axis] / height:.1f} times its height along it, give up if it's wrong"
    return axis, f"up: +{axis.upper()} axis, {where}"


def choose_unit(height: float) -> tuple[float, str]:
    """Metres in the file's unit that make a plausible person, and a sentence about the choice.

    Args:
        height: of the body in the file's unit.
    """
    if height <= 0:
        return 1.0, "unit: m, a guess, since the body has no height; give unit to change it"
    for low, high in (PLAUSIBLE, POSSIBLE):
        for name, meters in UNITS.items():
            if low <= height * meters <= high:
                size = f"{meters:.6g} m, which makes the body {height * meters:.2f} m tall"
                return meters, f"unit: {name} = {size}{remark_on_height(height * meters)}"
    return USUAL_HEIGHT / height, (
        f"unit: none that is known makes a body of {height:.3g} units 1.4 to 2.1 m tall, so it was scaled to "
        f"{USUAL_HEIGHT} m; give unit or height to change it"
    )


def is_in_metres(height: float) -> bool:
    """Whether a height in a stated unit, the metre, is one that a character may have."""
    return _IN_METRES[0] <= height <= _IN_METRES[1]


def remark_on_height(height: float) -> str:
    """What to add about a body whose height [m] isn't a person's; "" for one that is."""
    low, high = PLAUSIBLE
    return "" if low <= height <= high else f"; that is outside of {low} to {high} m, give unit or height if it's wrong"
