"""The robot itself: meshes that are logged once, and moved by the transforms of the bones that carry them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.record.frames import Frames, send_once
from cape.record.poses import bone_poses, xyzw
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

ROBOT = "/world/robot"
SHARP = np.radians(30.0)  # faces that meet at more than this are parted by an edge, others shaded as one surface
PLAIN_RGBA = (0.78, 0.79, 0.82, 1.0)  # of surfaces without a colour of their own
DARKEST = 0.28  # what is black otherwise shows no shape


def log_robot(stream: rr.RecordingStream, bones: BoneTrack, surfaces: Sequence[LinkSurface], frames: Frames) -> None:
    """Put each bone's transform on `/world/robot/<bone>`, and what it carries below; what stands still on `world`."""
    import rerun as rr

    carriers = list(dict.fromkeys(surface.bone for surface in surfaces))
    origins, rotations = bone_poses(bones, carriers, frames)
    for place, bone in enumerate(carriers):
        if bone is None:
            continue
        columns = {
            "translation": origins[:, [place]].astype(np.float32),
            "quaternion": xyzw(rotations[:, [place]]),
        }
        frames.send(stream, rr.new_entity_path(["world", "robot", bone]), rr.Transform3D, columns)
    if not frames.begins:
        return
    for surface in surfaces:
        path = rr.new_entity_path(["world", "robot", surface.bone or "world", surface.name])
        positions, normals, triangles = shaded(surface)
        rgba = np.array(PLAIN_RGBA if surface.rgba is None else surface.rgba)
        rgba[:3] = np.maximum(rgba[:3], DARKEST)
        send_once(
            stream,
            path,
            rr.Mesh3D(
                vertex_positions=positions,
                vertex_normals=normals,
                triangle_indices=triangles,
                albedo_factor=rgba,
            ),
        )


def shaded(surface: LinkSurface) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """A surface whose sharp edges stay sharp when it is lit: their vertices are doubled.

    Returns:
        Vertices in the bone's frame [m], shape (N, 3), unit normals, shape (N, 3), and triangles, shape (T, 3).
    """
    import trimesh

    mesh = trimesh.Trimesh(surface.vertices, surface.triangles)
    smooth = trimesh.graph.smooth_shade(mesh, angle=SHARP, facet_minarea=None)
    return (
        np.asarray(smooth.vertices, dtype=np.float32),
        np.asarray(smooth.vertex_normals, dtype=np.float32),
        np.asarray(smooth.faces, dtype=np.uint32),
    )
