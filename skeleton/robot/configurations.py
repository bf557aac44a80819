"""A robot's motion from a file: rows of configurations, checked against the robot."""

# pyright: reportMissingImports=false

from collections.abc import Iterable
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motions.border import checked
from motions.errors import ValueRangeError
from motions.files import text_of
from skeleton.model import Skeleton
from skeleton.rest import FRAME_ROLES, missing_roles
from skeleton.robot.columns import Numbers
from skeleton.robot.motion_tables import Table, read_csv, read_npz
from skeleton.robot_motion import RobotMotion
from skeleton.urdf.mimics import followed

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]

SUFFIXES = (".csv", ".npz")
"""Of files that hold configurations."""
USUAL_FPS = 60.0
"""Frames per second of a file that names neither times nor a rate."""

_TRUNK = [f"{side}_{limb}" for side in ("left", "right") for limb in ("upper_arm", "thigh")]
_LOOKED_AT = 200  # frames in which it is seen which way up a body is
_UPRIGHT, _CLEARLY = 0.95, 0.15  # what tells an order of numbers with which a trunk is upright from one where it is not
_MANY = 0.3  # share of the joints that are beyond their limits where degrees are taken for radians
_UNIT_LENGTH = 1e-3  # by which a quaternion's length may be off before it is told of
_NO_QUATERNION = 0.5  # by which it can't be one
_SLACK = 1e-3  # [rad] or [m] beyond a joint's limit that rounding explains
_FASTEST_ROOT = (12.0, 30.0)  # m/s, a sprinter's; rad/s, five turns a second
_NO_LIMIT = 1e3  # a speed above which a limit is none
_HIGH_UP = 10.0  # of its heights that no body is above the floor throughout
_NAMED = 4  # joints that a sentence names


@checked
def load_configurations(path: str | PathLike[str], body: Skeleton, *, fps: float | None = None) -> RobotMotion:
    """Read a robot's motion: a CSV file with a configuration in each row, or an NPZ file of arrays.

    A CSV file may begin with a row of names, `column_names(body)` in any order, with or without a prefix and units, and
    with a column of times, [s] unless its name ends in another unit, and one that counts frames. Joints that follow
    others (`mimic`) may be left out, and are where those take them. An NPZ file holds `q` like such rows; or `qpos` as
    MuJoCo has it, w first; or `root_pos`, `root_rot` and `dof_pos` apart; and `times` [s] or `fps`. Where nothing tells
    whether a root's quaternion begins or ends with w, it does so that the head is above the feet. Quaternions are
    brought to unit length.

    Args:
        path: the file.
        body: the robot.
        fps: frames per second where the file holds no times; None for 60.

    Raises:
        FileError: the file is missing, unreadable or malformed; names the line.
        ValueRangeError: the configurations don't fit the robot, hold it head down throughout, or the body is none.
    """
    path = Path(path)
    if not body.is_robot:
        raise ValueRangeError(f"{path} holds a robot's configurations, but the body is that of a clip")
    if fps is not None and not (np.isfinite(fps) and fps > 0.0):
        raise ValueRangeError(f"the frame rate must be positive, got {fps}")
    expected = column_names(body)
    following = [mimic.joint + part for mimic in body.mimics for part in ("", "_cos", "_sin")]
    numbers = Numbers(expected, frozenset(following) & frozenset(expected))
    table = read_npz(path, numbers) if path.suffix.lower() == ".npz" else read_csv(path, numbers)
    table = table._replace(rows=numbers.filled(table.rows))
    rows, times, rate, decisions = table.rows, table.times, table.rate, list(table.decisions)
    if rows.ndim != 2 or rows.shape[1] != len(expected) or not len(rows):
        raise ValueRangeError(
            f"{path}: configurations of this robot have the shape (frames, {len(expected)}), got {rows.shape}; "
            f"their numbers: {', '.join(expected)}"
        )
    if times is None:
        fps = fps or rate or USUAL_FPS
        decisions.append(f"{fps:g} frames a second" + ("" if rate or fps != USUAL_FPS else ", as the file tells none"))
        times = np.arange(len(rows)) / fps
    elif fps is not None:
        raise ValueRangeError(f"{path} holds the times of its frames: leave the frame rate out")
    rows, order = _with_w_last(table, body)
    rows, unit = _in_radians(rows, body.model)
    rows, lengths = _unit_quaternions(path, rows, body.model)
    rows = followed(rows, body.mimics, body.model)
    motion = RobotMotion(text_of(path.stem), rows, times)
    decisions += [*order, *unit, *lengths, *_doubts(path, motion, body)]
    return RobotMotion(text_of(path.stem), rows, times, tuple(decisions))


@checked
def column_names(body: Skeleton) -> tuple[str, ...]:
    """What each number of a robot's configuration is: x, y, z, qx, qy, qz, qw of the root, then the joints."""
    names = []
    for joint, start, size, axes in _joints(body.model):
        if size == 7:
            before = "" if start == 0 else f"{joint}_"
            names += [before + part for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        elif size == 1:
            names.append(joint)
        elif size == 2 and axes == 1:
            names += [f"{joint}_cos", f"{joint}_sin"]
        else:
            names += [f"{joint}_{number}" for number in range(size)]
    return tuple(names)


def _joints(model: "pinocchio.Model") -> Iterable[tuple[str, int, int, int]]:
    """Name, first number, how many numbers and how many axes of each joint."""
    sizes = (model.idx_qs.tolist()[1:], model.nqs.tolist()[1:], model.nvs.tolist()[1:])
    return zip(tuple(model.names)[1:], *sizes, strict=True)


def _with_w_last(table: Table, body: Skeleton) -> tuple[FloatArray, list[str]]:
    """Rows with the root's quaternion as Pinocchio has it; where nothing tells its order, the motion does."""
    rows, free = table.rows, body.model.nqs[1] == 7
    if not free or table.w_first is False:
        return rows, []
    turned = rows[:, [0, 1, 2, 4, 5, 6, 3, *range(7, rows.shape[1])]]
    if table.w_first:
        return turned, []
    rise, other = _rise(rows, body), _rise(turned, body)
    if rise is None or other is None or np.median(other) < max(_UPRIGHT, np.median(rise) + _CLEARLY):
        return rows, []
    return turned, ["quaternions: w is taken to come first, as then the trunk is upright, and otherwise it is not"]


def _rise(rows: FloatArray, body: Skeleton) -> FloatArray | None:
    """How upright a body's trunk is in some frames: 1 is upright, -1 head down; None where it lacks limbs."""
    if missing_roles(body.rest, _TRUNK):
        return None
    few = rows[np.unique(np.linspace(0, len(rows) - 1, _LOOKED_AT).astype(int))].copy()
    lengths = np.linalg.norm(few[:, 3:7], axis=1)
    if (lengths == 0.0).any():
        return None
    few[:, 3:7] /= lengths[:, None]
    track = body.track(RobotMotion("", few, np.arange(len(few), dtype=float)), bones=_TRUNK)
    arms, legs = ([track.index(f"{side}_{limb}") for side in ("left", "right")] for limb in ("upper_arm", "thigh"))
    trunk = track.positions[:, arms].mean(axis=1) - track.positions[:, legs].mean(axis=1)
    return trunk[:, 2] / np.linalg.norm(trunk, axis=1)


def _in_radians(rows: FloatArray, model: "pinocchio.Model") -> tuple[FloatArray, list[str]]:
    """Angles of joints in radians: those of which many are beyond their limits, and few as degrees, are degrees."""
    turning = [start for joint, start, size, _ in _joints(model) if size == 1 and _is_revolute(model, joint)]
    if not turning:
        return rows, []
    angles = rows[:, turning]
    low, high = model.lowerPositionLimit[turning], model.upperPositionLimit[turning]

    def beyond(values: FloatArray) -> float:
        return float(((values < low - _SLACK) | (values > high + _SLACK)).any(axis=0).mean())

    share = beyond(angles)
    if share < _MANY or beyond(np.deg2rad(angles)) > share / 3.0 or np.abs(angles).max() < 2.0 * np.pi:
        return rows, []
    rows = rows.copy()
    rows[:, turning] = np.deg2rad(angles)
    return rows, ["angles of joints are taken to be in degrees: as radians most would be beyond the joints' limits"]


def _is_revolute(model: "pinocchio.Model", joint: str) -> bool:
    return "R" in model.joints[model.getJointId(joint)].shortname()


def _unit_quaternions(path: Path, rows: FloatArray, model: "pinocchio.Model") -> tuple[FloatArray, list[str]]:
    """Bring the quaternions of all frames to unit length, and tell how far they were from it."""
    rows, sentences = rows.copy(), []
    for joint, start, size, _ in _joints(model):
        if size not in (4, 7):
            continue
        part = rows[:, start + size - 4 : start + size]
        lengths = np.linalg.norm(part, axis=1)
        off = np.abs(lengths - 1.0)
        worst = int(np.nanargmax(off)) if np.isfinite(off).any() else 0
        if off[worst] > _NO_QUATERNION:
            raise ValueRangeError(
                f"{path}: numbers {start + size - 3} to {start + size} of a row must be the quaternion of {joint}, "
                f"but have the length {lengths[worst]:.3g} in frame {worst}"
            )
        if off[worst] > _UNIT_LENGTH:
            sentences.append(f"quaternions of {joint} are off unit length by up to {off[worst]:.2g}: normalised")
        part /= lengths[:, None]
    return rows, sentences


def _doubts(path: Path, motion: RobotMotion, body: Skeleton) -> list[str]:
    """What looks wrong in a motion, a sentence each: limits, speeds, a body upside down."""
    sentences = [
        _beyond_limits(motion, body.model), _too_fast(motion, body.model), _not_upright(path, motion, body),
        _never_near_the_floor(motion, body),
    ]  # fmt: skip
    return [sentence for sentence in sentences if sentence is not None]


def _beyond_limits(motion: RobotMotion, model: "pinocchio.Model") -> str | None:
    q = motion.configurations
    beyond = np.maximum(model.lowerPositionLimit - q, q - model.upperPositionLimit)
    found = []
    for joint, start, size, _ in _joints(model):
        over = beyond[:, start]
        if size == 1 and over.max() > _SLACK:
            frames = int((over > _SLACK).sum())
            found.append((over.max(), f"{joint} by up to {over.max():.2g} in {frames} frames"))
    return _sentence("beyond the joints' limits", found)


def _too_fast(motion: RobotMotion, model: "pinocchio.Model") -> str | None:
    """Joints that are faster from one frame to the next than the robot can turn them."""
    import pinocchio as pin

    if motion.frames < 2:
        return None
    q = motion.configurations
    steps = np.array([pin.difference(model, before, after) for before, after in pairwise(q)])
    speeds = np.abs(steps) / np.diff(motion.times)[:, None]
    found = []
    for joint, start, axes in zip(
        tuple(model.names)[1:], model.idx_vs.tolist()[1:], model.nvs.tolist()[1:], strict=True
    ):
        limits = np.array(model.velocityLimit[start : start + axes])
        if axes == 6:
            limits = np.repeat(_FASTEST_ROOT, 3)
        limited = (limits > 0.0) & (limits < _NO_LIMIT)
        over = np.where(limited, speeds[:, start : start + axes] / np.where(limited, limits, 1.0), 0.0)
        frame, axis = np.unravel_index(int(over.argmax()), over.shape)
        if over[frame, axis] > 1.0:
            speed = speeds[frame, start + axis]
            text = f"{joint} {speed:.3g} instead of {limits[axis]:.3g} a second at frame {frame + 1}"
            found.append((over[frame, axis], text))
    return _sentence("faster than the joints can turn", found)


def _not_upright(path: Path, motion: RobotMotion, body: Skeleton) -> str | None:
    """A body that lies or stands on its head in most frames.

    Raises:
        ValueRangeError: it does so throughout.
    """
    rise = _rise(motion.configurations, body) if body.model.nqs[1] == 7 else None
    if rise is None or np.median(rise) > 0.0:
        return None
    words = "a quaternion is x, y, z, w here, w comes last, and the world is Z up unless said otherwise"
    if motion.frames > 1 and (rise < 0.0).all():
        raise ValueRangeError(f"{path}: the trunk hangs head down throughout: {words}")
    return f"the trunk hangs head down in most frames: {words}"


def _never_near_the_floor(motion: RobotMotion, body: Skeleton) -> str | None:
    """A body that is many of its heights up throughout, as where places are not in metres."""
    if body.model.nqs[1] != 7 or missing_roles(body.rest, FRAME_ROLES):
        return None
    lowest = float(motion.configurations[:, 2].min())
    if lowest < _HIGH_UP * body.rest.height:
        return None
    return f"the body is {lowest:.3g} m above the floor or more throughout: places are taken to be in metres"


def _sentence(problem: str, found: list[tuple[float, str]]) -> str | None:
    """The worst of what was found, in one sentence."""
    if not found:
        return None
    found.sort(key=lambda item: -item[0])
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return f"{problem}: {'; '.join(text for _, text in found[:_NAMED])}{more}"
