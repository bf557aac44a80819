"""OBJ with its material, and the motion of its vertices as point caches: PC2, which 3ds Max and Blender read, and MDD.

All are Y up, in metres. The OBJ is the first frame, whose vertices the caches have in the same order.

PC2, little-endian: 12 bytes `POINTCACHE2` and a zero, int32 version 1, int32 vertices, float32 first frame, float32
step in frames, int32 frames; then float32 x, y, z, vertex after vertex, frame after frame. It tells no frame rate.

MDD, big-endian: int32 frames, int32 vertices, float32 time of each frame [s]; then as PC2.
"""

import struct
from pathlib import Path

import numpy as np

from cape.exports.moving_mesh import MovingMesh, y_up
from motions.files import printable, whole_file, write_text

Paths = tuple[Path, ...]


def write(mesh: MovingMesh, path: Path) -> Paths:
    """Write the OBJ and both caches; gives all files.

    Raises:
        FileError: one can't be written.
    """
    return (*_obj(mesh, path), *_pc2(mesh, path.with_suffix(".pc2")), *_mdd(mesh, path.with_suffix(".mdd")))


def write_pc2(mesh: MovingMesh, path: Path) -> Paths:
    """Write the OBJ and a PC2; gives all files.

    Raises:
        FileError: one can't be written.
    """
    return (*_pc2(mesh, path), *_obj(mesh, path.with_suffix(".obj")))


def write_mdd(mesh: MovingMesh, path: Path) -> Paths:
    """Write the OBJ and an MDD; gives all files.

    Raises:
        FileError: one can't be written.
    """
    return (*_mdd(mesh, path), *_obj(mesh, path.with_suffix(".obj")))


def _obj(mesh: MovingMesh, path: Path) -> Paths:
    picture, material = mesh.write_texture(path), path.with_suffix(".mtl")
    write_text(material, f"newmtl cape\nKd 1 1 1\nKs 0 0 0\nmap_Kd {picture.name}\n")
    rows = [f"# {printable(mesh.name)}: metres, Y up; frame 0 of {len(mesh.times)} at {mesh.fps:g} frames per second"]
    rows += [f"mtllib {material.name}", "o cape"]
    rows += ["v {!r} {!r} {!r}".format(*place) for place in y_up(mesh.positions[0]).astype(float).tolist()]
    rows += ["vt {:.7g} {:.7g}".format(*place) for place in mesh.bottom_up.tolist()]
    rows.append("usemtl cape")
    rows += ["f {0}/{0} {1}/{1} {2}/{2}".format(*corners) for corners in (mesh.triangles + 1).tolist()]
    write_text(path, "\n".join(rows) + "\n")
    return path, material, picture


def _pc2(mesh: MovingMesh, path: Path) -> Paths:
    frames, vertices = mesh.positions.shape[:2]
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, vertices, 0.0, 1.0, frames)
    _write(path, head, mesh, "<f4")
    return (path,)


def _mdd(mesh: MovingMesh, path: Path) -> Paths:
    frames, vertices = mesh.positions.shape[:2]
    _write(path, struct.pack(">ii", frames, vertices) + mesh.times.astype(">f4").tobytes(), mesh, ">f4")
    return (path,)


def _write(path: Path, head: bytes, mesh: MovingMesh, number: str) -> None:
    with whole_file(path) as partial, partial.open("wb") as file:
        file.write(head)
        for places in mesh.positions:
            file.write(np.ascontiguousarray(y_up(places), number).tobytes())
