"""What fastens a garment at the neck: a boss on each of its two edges, and a cord between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.cloth.normals import vertex_normals
from cape.record.frames import Frames, send_once
from cape.record.poses import xyzw
from cape.results.kept import let_go
from motions import quaternions
from skeleton.shapes.revolved import AROUND, strips

if TYPE_CHECKING:
    import rerun as rr

    from cape.results.take import Take

FloatArray = NDArray[np.float64]

COLOR = (236, 196, 108)
BOSS = np.array([(0.020, -0.004), (0.020, 0.002), (0.0172, 0.0055), (0.0155, 0.0048), (0.011, 0.009), (0.0, 0.0108)])
"""Radius and height above the cloth along a boss, from its rim to its middle [m]."""
CORD = 0.004  # m, its radius
SAG = 0.25  # of its length, by which the cord hangs down
CORD_PARTS = 12


def log_clasp(stream: rr.RecordingStream, take: Take, frames: Frames, *, path: str = "/world/clasp") -> None:
    """Put the clasp of a cloth that has the region "clasp" on its path: both vertices carry it."""
    import rerun as rr

    if take.cloth is None or "clasp" not in take.cloth.regions:
        return
    middles, rotations, length = _carried(take, frames)
    if frames.begins:
        vertices, normals, triangles = clasp_mesh(length)
        mesh = rr.Mesh3D(
            vertex_positions=vertices,
            vertex_normals=normals,
            triangle_indices=triangles,
            albedo_factor=COLOR,
        )
        send_once(stream, path, mesh)
    columns = {"translation": middles[:, None].astype(np.float32), "quaternion": xyzw(rotations)[:, None]}
    frames.send(stream, path, rr.Transform3D, columns)


def clasp_mesh(length: float) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """A clasp between edges so far apart [m], along x, with y down and z out of the cloth.

    Returns:
        Vertices about its middle [m], shape (V, 3), unit normals, shape (V, 3), and triangles, shape (T, 3).
    """
    radii, heights = BOSS.T[:, :, None, None]
    rings = radii * AROUND + heights * [0.0, 0.0, 1.0]
    boss = rings.reshape(-1, 3)
    along = np.linspace(-1.0, 1.0, CORD_PARTS)
    middles = np.stack([along * length / 2.0, SAG * length * (1.0 - along**2), np.full(CORD_PARTS, CORD)], axis=1)
    ahead = np.gradient(middles, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    turns = quaternions.from_z_axis(ahead)
    cord = middles[:, None] + CORD * quaternions.rotate(turns[:, None], AROUND)
    end = np.array([length / 2.0, 0.0, 0.0])
    parts = [boss - end, boss + end, cord.reshape(-1, 3)]
    sides = [strips(len(BOSS)), strips(len(BOSS)), strips(CORD_PARTS)]
    first = np.cumsum([0, *(len(part) for part in parts)])
    vertices = np.concatenate(parts)
    triangles = np.concatenate([side + np.uint32(start) for side, start in zip(sides, first, strict=False)])
    return vertices.astype(np.float32), vertex_normals(vertices[None], triangles)[0], triangles


def _carried(take: Take, frames: Frames) -> tuple[FloatArray, FloatArray, float]:
    """Where the clasp's middle is in each frame [m] (F, 3), how it is turned wxyz (F, 4), and how long it is [m]."""
    assert take.cloth is not None
    ends = take.cloth.regions["clasp"]
    triangles = take.cloth.triangles  # as it was cut, also where it has torn since
    near = triangles[np.isin(triangles, ends).any(axis=1)]
    used, local = np.unique(near, return_inverse=True)
    places = np.empty((len(frames.numbers), len(used), 3))
    for block in frames.blocks(take.positions[0].nbytes):
        places[block] = take.positions[frames.numbers[block]][:, used]
        let_go(take.positions)
    normals = vertex_normals(places, local.reshape(near.shape)).astype(float)
    first, second = np.searchsorted(used, ends)
    across = places[:, second] - places[:, first]
    length = np.linalg.norm(across, axis=1, keepdims=True)
    x = across / np.maximum(length, 1e-9)
    out = normals[:, first] + normals[:, second]
    out -= np.sum(out * x, axis=1, keepdims=True) * x
    z = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    axes = np.stack([x, np.cross(z, x), z], axis=2)
    middles = (places[:, first] + places[:, second]) / 2.0
    return middles, quaternions.from_matrix(axes), float(length[0, 0])
