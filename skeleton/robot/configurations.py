"""A robot's motion from a file: rows of configurations, checked against the robot."""

# pyright: reportMissingImports=false

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError, ValueRangeError
from skeleton.model import Skeleton
from skeleton.rest import missing_roles
from skeleton.robot_motion import RobotMotion

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]

SUFFIXES = (".csv", ".npz")
"""Of files that hold configurations."""
USUAL_FPS = 60.0
"""Frames per second of a file that names neither times nor a rate."""

_TIME_NAMES = ("time", "times", "t", "timestamp", "seconds")
_BETWEEN_CELLS = re.compile(r"\s*[,;\t]\s*|\s+")
_UNIT_LENGTH = 1e-3  # by which a quaternion's length may be off before it is told of
_NO_QUATERNION = 0.5  # by which it can't be one
_SLACK = 1e-3  # [rad] or [m] beyond a joint's limit that rounding explains
_FASTEST_ROOT = (12.0, 30.0)  # m/s, a sprinter's; rad/s, five turns a second
_NO_LIMIT = 1e3  # a speed above which a limit is none
_NAMED = 4  # joints that a sentence names


def load_configurations(path: str | PathLike[str], body: Skeleton, *, fps: float | None = None) -> RobotMotion:
    """Read a robot's motion: a CSV file with a configuration in each row, or an NPZ file with the array `q`.

    A CSV file may begin with a row of names, in any order where it names `column_names(body)`, and with a column of
    times [s]; an NPZ file may hold `times` [s] or `fps`. Quaternions are brought to unit length.

    Args:
        path: the file.
        body: the robot.
        fps: frames per second where the file holds no times; None for 60.

    Raises:
        FileError: the file is missing, unreadable or malformed; names the line.
        ValueRangeError: the configurations don't fit the robot, or the body is none.
    """
    path = Path(path)
    if not body.is_robot:
        raise ValueRangeError(f"{path} holds a robot's configurations, but the body is that of a clip")
    if fps is not None and not (np.isfinite(fps) and fps > 0.0):
        raise ValueRangeError(f"the frame rate must be positive, got {fps}")
    try:
        rows, times, rate, decisions = _read_npz(path) if path.suffix.lower() == ".npz" else _read_csv(path, body)
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror or error}") from None
    expected = column_names(body)
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
    rows, lengths = _unit_quaternions(path, rows, body.model)
    motion = RobotMotion(path.stem, rows, times)
    decisions += [*lengths, *_doubts(motion, body)]
    return RobotMotion(path.stem, rows, times, tuple(decisions))


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


_Table = tuple[FloatArray, FloatArray | None, float | None, list[str]]
"""Configurations, times, frames per second as far as they are known, and what was decided."""


def _read_npz(path: Path) -> _Table:
    try:
        with np.load(path, allow_pickle=False) as file:
            if "q" not in file:
                raise FileError(f"{path} holds no array 'q'; its arrays: {', '.join(file.files) or 'none'}")
            rows = np.asarray(file["q"], dtype=float)
            times = np.asarray(file["times"], dtype=float) if "times" in file else None
            fps = float(file["fps"]) if "fps" in file else None
    except (ValueError, TypeError, EOFError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path} can't be read as NPZ: {error}") from None
    if fps is not None and not (np.isfinite(fps) and fps > 0.0):
        raise FileError(f"{path}: fps must be positive, got {fps:g}")
    return rows, times, fps, []


def _read_csv(path: Path, body: Skeleton) -> _Table:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileError(f"{path} is no text file") from None
    cells = [(number, _BETWEEN_CELLS.split(line.strip())) for number, line in enumerate(lines, 1) if line.strip()]
    if not cells:
        raise FileError(f"{path} is empty")
    header = None
    if any(not _is_number(cell) for cell in cells[0][1]):
        header, cells = [cell.strip("\"'") for cell in cells[0][1]], cells[1:]
    rows = []
    width = len(header) if header is not None else len(cells[0][1])
    for number, row in cells:
        if len(row) != width:
            raise FileError(f"{path}, line {number}: {len(row)} numbers, but {width} in the line before")
        if wrong := [cell for cell in row if not _is_number(cell)]:
            raise FileError(f"{path}, line {number}: {wrong[0]!r} is no number")
        rows.append([float(cell) for cell in row])
    table = np.array(rows, dtype=float).reshape(len(rows), width)
    if header is None:
        return table, None, None, []
    return _named_columns(table, header, column_names(body))


def _named_columns(table: FloatArray, header: Sequence[str], expected: Sequence[str]) -> _Table:
    """Take the times out, and put columns that name the robot's joints into its order."""
    places = {name.lower(): place for place, name in enumerate(header)}
    time = next((places.pop(name) for name in _TIME_NAMES if name in places), None)
    times = None if time is None else table[:, time]
    kept = [place for place in range(len(header)) if place != time]
    wanted = [name.lower() for name in expected]
    if set(wanted) == set(places):
        order = [places[name] for name in wanted]
        moved = ["columns put into the robot's order by their names"] if order != kept else []
        return table[:, order], times, None, moved
    return table[:, kept], times, None, ["names of the columns aren't the robot's: taken to be in its order"]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


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


def _doubts(motion: RobotMotion, body: Skeleton) -> list[str]:
    """What looks wrong in a motion, a sentence each: limits, speeds, a body upside down."""
    sentences = [_beyond_limits(motion, body.model), _too_fast(motion, body.model), _not_upright(motion, body)]
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


def _not_upright(motion: RobotMotion, body: Skeleton) -> str | None:
    """A body that lies or stands on its head in most frames: its quaternions may have another order."""
    arms_and_legs = [f"{side}_{limb}" for side in ("left", "right") for limb in ("upper_arm", "thigh")]
    if body.model.nqs[1] != 7 or missing_roles(body.rest, arms_and_legs):
        return None
    track = body.track(motion, bones=arms_and_legs)
    arms, legs = ([track.index(f"{side}_{limb}") for side in ("left", "right")] for limb in ("upper_arm", "thigh"))
    rise = track.positions[:, arms, 2].mean(axis=1) - track.positions[:, legs, 2].mean(axis=1)
    if np.median(rise) > 0.0:
        return None
    return (
        "the trunk hangs head down in most frames: a quaternion is x, y, z, w here, w comes last, and the world is "
        "Z up unless said otherwise"
    )


def _sentence(problem: str, found: list[tuple[float, str]]) -> str | None:
    """The worst of what was found, in one sentence."""
    if not found:
        return None
    found.sort(key=lambda item: -item[0])
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return f"{problem}: {'; '.join(text for _, text in found[:_NAMED])}{more}"
