"""Tables of a robot's configurations as people save them: rows of text, or arrays by whatever names."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motions.arrays import read_arrays
from motions.errors import FileError
from motions.files import printable, read_bytes
from motions.limits import LARGEST_NUMBER
from skeleton.robot.columns import TIME_NAMES, Numbers, counts_rows, order_of, seconds_in

FloatArray = NDArray[np.float64]

_RATE_NAMES = ("fps", "rate", "frequency", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate")
_PLACES = ("root_pos", "root_position", "root_trans", "root_trans_offset", "base_pos", "root_translation")
_TURNS = ("root_rot", "root_quat", "root_rotation", "root_orientation", "base_quat", "base_rot")
_JOINTS = ("dof_pos", "joint_pos", "dof", "joints", "joint_positions", "dof_positions")
_BODIES = (("body_pos_w", "body_quat_w"), ("body_positions", "body_rotations"))  # of Isaac Lab, the root's first
_JOINT_NAMES = ("dof_names", "joint_names")


class Table(NamedTuple):
    """A table of configurations.

    Attributes:
        rows: as they are in the file, in the robot's order, shape (frames, columns).
        times: of the frames [s], None where the file tells none.
        rate: frames per second, None where the file tells none.
        w_first: whether the root's quaternion begins with w; None where neither names nor the format tell.
        decisions: what was decided, a sentence each.
    """

    rows: FloatArray
    times: FloatArray | None = None
    rate: float | None = None
    w_first: bool | None = None
    decisions: tuple[str, ...] = ()


def read_npz(path: Path, numbers: Numbers) -> Table:
    """The arrays of an NPZ file: `q` in Pinocchio's order, `qpos` in MuJoCo's, or root and joints apart.

    Of Isaac Lab's places and quaternions (w first) of all bodies the first is the root's; its joints need names.

    Raises:
        FileError: it can't be read, or holds no such arrays.
    """
    arrays = read_arrays(path)
    rate = next((_number(path, name, arrays[name]) for name in _RATE_NAMES if name in arrays), None)
    times = next((_numbers(path, name, arrays[name]) for name in TIME_NAMES if name in arrays), None)
    if rate is not None and not rate > 0.0:
        raise FileError(f"{path}: fps must be positive, got {rate:g}")
    if "q" in arrays:
        return Table(_numbers(path, "q", arrays["q"]), times, rate, w_first=False)
    if "qpos" in arrays:
        told = "array qpos: w is taken to come first in quaternions, as in MuJoCo"
        return Table(_numbers(path, "qpos", arrays["qpos"]), times, rate, w_first=True, decisions=(told,))
    place, turn, joints = (next((n for n in names if n in arrays), None) for names in (_PLACES, _TURNS, _JOINTS))
    bodies = next((pair for pair in _BODIES if set(pair) <= set(arrays)), None)
    of_bodies = bodies is not None and not (place and turn)
    if bodies is not None and of_bodies:
        place, turn = bodies
    if place and turn and joints:
        parts = [_numbers(path, name, arrays[name]) for name in (place, turn, joints)]
        parts = [part[:, 0] if of_bodies and k < 2 and part.ndim == 3 else part for k, part in enumerate(parts)]
        parts[2] = parts[2][..., 0] if parts[2].ndim == 3 and parts[2].shape[2] == 1 else parts[2]
        if any(part.ndim != 2 or len(part) != len(parts[0]) for part in parts):
            shapes = ", ".join(f"{n} {p.shape}" for n, p in zip((place, turn, joints), parts, strict=True))
            raise FileError(f"{path}: root and joints must have as many frames, got {shapes}")
        names = next((arrays[name] for name in _JOINT_NAMES if name in arrays), None)
        expected = numbers.of_width(7 + parts[2].shape[1])
        order, told = np.arange(parts[2].shape[1]), "are taken to be in the robot's order"
        if names is not None:
            found = order_of([*expected[:7], *map(str, names.ravel())], expected, str(path)).places
            order, told = np.array(found[7:]) - 7, "are put into the robot's order by their names"
        elif of_bodies:
            raise FileError(
                f"{path} holds joints in a simulator's order: add an array joint_names, in the order of {joints}"
            )
        rows = np.hstack([parts[0], parts[1], parts[2][:, order]])
        w_first = True if of_bodies else None
        return Table(rows, times, rate, w_first, (f"arrays {place}, {turn}, {joints}: joints {told}",))
    rows = [name for name, array in arrays.items() if array.ndim == 2 and array.shape[1] in numbers.widths]
    if len(rows) == 1:
        told = f"array {printable(rows[0])}, which is as wide as the robot's configurations, is taken for them"
        return Table(_numbers(path, rows[0], arrays[rows[0]]), times, rate, decisions=(told,))
    held = ", ".join(map(printable, arrays)) or "none"
    if {"poses", "trans"} <= set(arrays):
        raise FileError(f"{path} holds a person's body (AMASS), not a robot's configurations; its arrays: {held}")
    raise FileError(
        f"{path} holds no array 'q', nor 'qpos', nor root_pos, root_rot and dof_pos together; its arrays: {held}"
    )


def _numbers(path: Path, name: str, array: NDArray[np.generic]) -> FloatArray:
    if array.dtype.kind not in "fiu":
        raise FileError(f"{path}: array {name!r} is of {array.dtype}, not of numbers")
    numbers = array.astype(float)
    if not (np.abs(numbers) <= LARGEST_NUMBER).all():
        raise FileError(f"{path}: array {name!r} holds a number that is not finite, or too large to be meant")
    return numbers


def _number(path: Path, name: str, array: NDArray[np.generic]) -> float:
    if array.size != 1:
        raise FileError(f"{path}: {name} must be one number, got an array of the shape {array.shape}")
    return float(_numbers(path, name, array).ravel()[0])


def read_csv(path: Path, numbers: Numbers) -> Table:
    """The rows of a text file, with or without a row of names and a column of times.

    Raises:
        FileError: it can't be read, or a row or its names don't fit; names the line.
    """
    try:
        lines = read_bytes(path).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileError(f"{path} is no text file") from None
    kept = [number for number, line in enumerate(lines) if line.strip()]
    if not kept:
        raise FileError(f"{path} is empty")
    header = _cells(lines[kept[0]])
    named = any(_is_text(cell) for cell in header)
    table = _rows(path, lines, kept[1:] if named else kept, len(header))
    if not named:
        return Table(table)
    header = [printable(cell.strip("\"'")) for cell in header]
    units = {k: unit for k, name in enumerate(header) if (unit := seconds_in(name)) is not None}
    time = next(iter(units), None)
    counting = [k for k, name in enumerate(header) if counts_rows(name, table[:, k])]
    others = [k for k in range(len(header)) if k != time and k not in counting]
    expected = numbers.of_width(len(others))
    order = order_of([header[k] for k in others], expected, f"{path}, line {kept[0] + 1}")
    rows, degrees = table[:, [others[k] for k in order.places]], order.degrees
    decisions = [f"column {header[k]!r} is left out: it counts the frames" for k in counting]
    if order.places != sorted(order.places):
        decisions.append("columns put into the robot's order by their names")
    if degrees.any():
        rows[:, degrees] = np.deg2rad(rows[:, degrees])
        decisions.append(f"{int(degrees.sum())} columns are in degrees by their names: turned into radians")
    times = None if time is None else table[:, time] * units[time]
    return Table(rows, times, w_first=False if order.by_name else None, decisions=tuple(decisions))


def _cells(line: str) -> list[str]:
    """The cells of a line, between commas, semicolons or tabs, or where there are none between blanks."""
    return re.split(r"\s*[,;\t]\s*", line.strip()) if re.search(r"[,;\t]", line.strip()) else line.split()


def _rows(path: Path, lines: list[str], kept: list[int], width: int) -> FloatArray:
    """The numbers of some lines, all at once where they are sound, else one by one up to what is wrong."""
    texts = [re.sub(r"[,;\t]", " ", lines[number]) for number in kept]
    if not kept or not any(map(str.strip, texts)):
        return np.zeros((0, width))
    try:
        table = np.loadtxt(texts, ndmin=2, comments=None).reshape(len(kept), -1)
        if table.shape[1] == width and (np.abs(table) <= LARGEST_NUMBER).all():
            return table
    except ValueError:
        pass
    rows = []
    for number in kept:
        cells = _cells(lines[number])
        if len(cells) != width:
            raise FileError(f"{path}, line {number + 1}: {len(cells)} numbers, but {width} in the line before")
        values = [_as_number(cell) for cell in cells]
        if None in values:
            wrong = cells[values.index(None)]
            raise FileError(f"{path}, line {number + 1}: {wrong[:40]!r} is no number, or too large to be one")
        rows.append(values)
    return np.array(rows, dtype=float).reshape(len(rows), width)


def _is_text(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return True
    return False


def _as_number(cell: str) -> float | None:
    number = np.inf if _is_text(cell) else float(cell)
    return number if abs(number) <= LARGEST_NUMBER else None
