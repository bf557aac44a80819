"""A sequence of binary PLY files, one for each frame: WALK_0000.ply, WALK_0001.ply and so on.

PLY states no axes; these are Z up, in metres, as a comment in each file says with its time. Texture coordinates are the
vertices' `s` and `t`, which begin at the texture's lower left corner.
"""

import re
import warnings
from pathlib import Path

import numpy as np

from cape.exports.moving_mesh import MovingMesh
from motions.files import whole_file

HEAD = """\
ply
format binary_little_endian 1.0
comment metres, Z up; frame {frame} of {frames}, at {time:.6f} s
element vertex {vertices}
property float x
property float y
property float z
property float s
property float t
element face {triangles}
property list uchar int vertex_indices
end_header
"""


def write(mesh: MovingMesh, path: Path) -> tuple[Path, ...]:
    """Write a file for each frame; gives all of them.

    Raises:
        FileError: one can't be written.
    """
    frames, vertices = mesh.positions.shape[:2]
    rows = np.concatenate([np.zeros((vertices, 3)), mesh.bottom_up], axis=1).astype("<f4")
    faces = np.empty(len(mesh.triangles), [("corners", "u1"), ("vertices", "<i4", 3)])
    faces["corners"], faces["vertices"] = 3, mesh.triangles
    digits, files = max(4, len(str(frames - 1))), []
    for frame, time in enumerate(mesh.times):
        head = HEAD.format(frame=frame, frames=frames, time=time, vertices=vertices, triangles=len(faces))
        rows[:, :3] = mesh.positions[frame]
        files.append(path.with_name(f"{path.stem}_{frame:0{digits}}{path.suffix}"))
        with whole_file(files[-1]) as partial:
            partial.write_bytes(head.encode() + rows.tobytes() + faces.tobytes())
    if others := _others(path, files):
        warnings.warn(
            f"{len(others)} more files are called so, {others[0].name} to {others[-1].name}: a program that reads the "
            "sequence takes them for its end",
            stacklevel=4,
        )
    return tuple(files)


def _others(path: Path, files: list[Path]) -> list[Path]:
    """Files that are named as one of the sequence, and are none."""
    written = {file.name for file in files}
    called = re.compile(rf"{re.escape(path.stem)}_\d+{re.escape(path.suffix)}")
    return sorted(each for each in path.parent.iterdir() if called.fullmatch(each.name) and each.name not in written)
