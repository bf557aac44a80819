"""The body of a clip as it is drawn: softer than the capsules that stop the cloth, and nowhere outside of them but in
the groove between both halves of the chest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.record.frames import Frames, send_once
from cape.record.poses import bone_poses, xyzw
from cape.scene.colliders import Collider
from skeleton.rest import NEXT_ROLE
from skeleton.shapes import Capsule
from skeleton.shapes.revolved import AROUND, strips
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

FloatArray = NDArray[np.float64]

BODY = "/world/body"
BODY_COLOR = (150, 148, 146)
CHIN = 0.8  # radius of a head at its chin, in that at its crown
LATITUDES = 13  # of the directions in which a part's surface is sampled

Balls = list[tuple[FloatArray, float]]
"""Centres in a bone's frame [m], shape (3,), and radii [m]: a part of the body is their convex hull."""


def log_body(stream: rr.RecordingStream, bones: BoneTrack, colliders: Sequence[Collider], frames: Frames) -> None:
    """Put each bone's transform on `/world/body/<bone>`, and the parts that it carries below."""
    import rerun as rr

    parts = body_parts(colliders)
    carriers = list(dict.fromkeys(bone for bone, _ in parts.values()))
    origins, rotations = bone_poses(bones, carriers, frames)
    for place, bone in enumerate(carriers):
        columns = {
            "translation": origins[:, [place]].astype(np.float32),
            "quaternion": xyzw(rotations[:, [place]]),
        }
        frames.send(stream, rr.new_entity_path(["world", "body", bone]), rr.Transform3D, columns)
    for name, (bone, balls) in parts.items():
        vertices, normals, triangles = hull_of_balls(balls)
        mesh = rr.Mesh3D(
            vertex_positions=vertices, vertex_normals=normals, triangle_indices=triangles, albedo_factor=BODY_COLOR
        )
        send_once(stream, rr.new_entity_path(["world", "body", bone, name]), mesh)


def body_parts(colliders: Sequence[Collider]) -> dict[str, tuple[str, Balls]]:
    """The bone and the shape of each part by its name, made of the capsules that bones carry.

    A limb is as thin at its end as the next one begins, a head thinner at the chin, and both halves of the chest are
    one.
    """
    capsules = {c.name: c for c in colliders if isinstance(c, Capsule) and c.bone is not None}
    parts: dict[str, tuple[str, Balls]] = {}
    for name, capsule in capsules.items():
        start, end, radius = capsule.start, capsule.end, capsule.radius
        following = capsules.get(NEXT_ROLE.get(name, ""))
        if name == "head":
            ahead = (start - end) / max(float(np.linalg.norm(start - end)), 1e-9)
            balls = [(start + (1.0 - CHIN) * radius * ahead, CHIN * radius), (end, radius)]
        elif following is not None:
            balls = [(start, radius), (end, min(radius, following.radius))]
        else:
            balls = [(start, radius), (end, radius)]
        parts[name] = str(capsule.bone), balls
    left, right = parts.get("left_chest"), parts.get("right_chest")
    if left is not None and right is not None and left[0] == right[0]:
        parts["chest"] = left[0], left[1] + right[1]
        del parts["left_chest"], parts["right_chest"]
    return parts


def hull_of_balls(balls: Balls) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """The convex hull of balls: in each direction n the farthest point of theirs, c + r n with the largest c n + r.

    Returns:
        Vertices [m] and unit normals, shape (V, 3), and triangles, counter-clockwise from outside, shape (T, 3).
    """
    latitudes = np.linspace(-np.pi / 2.0, np.pi / 2.0, LATITUDES)
    across, up = (each(latitudes)[:, None, None] for each in (np.cos, np.sin))
    normals = (across * AROUND + up * np.array([0.0, 0.0, 1.0])).reshape(-1, 3)
    centers, radii = np.array([center for center, _ in balls]), np.array([radius for _, radius in balls])
    farthest = np.argmax(normals @ centers.T + radii, axis=1)
    vertices = centers[farthest] + radii[farthest, None] * normals
    return vertices.astype(np.float32), normals.astype(np.float32), strips(LATITUDES)
