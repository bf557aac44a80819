"""Clips back to BVH text."""

import io
import re
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions import conventions, quaternions
from motions.border import checked
from motions.clip import Clip
from motions.errors import UnknownNameError, ValueRangeError
from motions.files import write_text

FloatArray = NDArray[np.float64]

_ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")


@checked
def save(
    clip: Clip,
    path: str | PathLike[str],
    *,
    unit: str | float = "cm",
    up: str = "y",
    order: str = "zxy",
    digits: int = 12,
) -> None:
    """Write a clip as a BVH file; read back, it is the same clip.

    The file appears under its name only when it is complete.

    Args:
        clip: what to write; its joints come out depth first.
        path: the file, replaced where it exists.
        unit: of the file, as in `motions.load`.
        up: the file's axis that points up, as in `motions.load`.
        order: the three rotation channels in their order, such as "zxy".
        digits: significant digits of each number.

    Raises:
        FileError: the file can't be written.
        UnknownNameError: no such unit, axis or order.
        ValueRangeError: `digits` isn't 1 to 17, or a joint's name can't stand in a BVH file.
    """
    if order.lower() not in _ORDERS:
        raise UnknownNameError("order of rotations", order, _ORDERS)
    if not 1 <= digits <= 17:
        raise ValueRangeError(f"digits must be 1 to 17, not {digits}")
    for joint in clip.joints:
        if re.search(r"[{}]", joint) or joint != " ".join(joint.split()):
            raise ValueRangeError(f"a BVH file can't hold the joint name {joint!r}")
    text = _format(clip, conventions.meters_per_unit(unit), conventions.to_z_up(up).T, order.lower(), digits)
    write_text(Path(path), text, newline="\n")


def _format(clip: Clip, meters: float, turn: FloatArray, order: str, digits: int) -> str:
    """The whole text; `turn` is world_to_file."""
    offsets = clip.offsets @ turn.T / meters
    end_offsets = clip.end_offsets @ turn.T / meters
    rotations = clip.rotations_wxyz.copy()
    rotations[..., 1:] = rotations[..., 1:] @ turn.T
    angles = np.rad2deg(quaternions.to_euler(rotations, order))
    moving = _moving(clip)

    lines, columns = ["HIERARCHY"], []
    # Closing braces wait on the same stack as what they close.
    todo: list[tuple[str, int, int]] = [("joint", 0, 0)]
    while todo:
        kind, index, depth = todo.pop()
        indent = "\t" * depth
        if kind == "brace":
            lines.append(f"{indent}}}")
            continue
        offset = end_offsets[index] if kind == "end" else offsets[index]
        title = "End Site" if kind == "end" else f"{'JOINT' if depth else 'ROOT'} {clip.joints[index]}"
        numbers = " ".join(f"{number:.{digits}g}" for number in offset)
        lines += [f"{indent}{title}", f"{indent}{{", f"{indent}\tOFFSET {numbers}"]
        todo.append(("brace", index, depth))
        if kind == "joint":
            names = [f"{axis}rotation" for axis in order.upper()]
            if index in moving:
                names = ["Xposition", "Yposition", "Zposition", *names]
                columns.append(moving[index] @ turn.T / meters)
            columns.append(angles[:, index])
            lines.append(f"{indent}\tCHANNELS {len(names)} {' '.join(names)}")
            todo += [("end", int(end), depth + 1) for end in np.flatnonzero(clip.end_parents == index)[::-1]]
            todo += [("joint", int(child), depth + 1) for child in np.flatnonzero(clip.parents == index)[::-1]]
    lines += ["MOTION", f"Frames: {clip.frames}", f"Frame Time: {1 / clip.fps!r}", ""]
    rows = io.StringIO()
    np.savetxt(rows, np.concatenate(columns, axis=1), fmt=f"%.{digits}g")
    return "\n".join(lines) + rows.getvalue()


def _moving(clip: Clip) -> dict[int, FloatArray]:
    """Positions [m] of the joints that need position channels, the root always among them."""
    moving = {0: clip.root_positions}
    if clip.local_positions is not None:
        for joint in range(1, len(clip.joints)):
            if np.any(clip.local_positions[:, joint] != clip.offsets[joint]):
                moving[joint] = clip.local_positions[:, joint]
    return moving
