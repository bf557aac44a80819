"""The body of a clip as it is drawn: softer than the capsules that stop the cloth, and nowhere outside of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.record.frames import Frames, send_once
from cape.record.poses import bone_poses, xyzw
from cape.scene.colliders import Collider
from skeleton.shapes import Capsule
from skeleton.shapes.revolved import AROUND, strips
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

FloatArray = NDArray[np.float64]

BODY = "/world/body"
BODY_COLOR = (176, 165, 152)
SHAPES: dict[str, tuple[tuple[float, float], ...]] = {
    "head": ((0.0, 0.86), (1.0, 1.0)),
    "upper_arm": ((0.0, 1.0), (0.4, 0.97), (1.0, 0.84)),
    "forearm": ((0.0, 0.9), (0.25, 1.0), (1.0, 0.64)),
    "hand": ((0.0, 0.8), (0.5, 0.95), (1.0, 0.7)),
    "thigh": ((0.0, 1.0), (0.4, 0.96), (1.0, 0.72)),
    "shin": ((0.0, 0.92), (0.28, 1.0), (1.0, 0.62)),
    "foot": ((0.0, 0.9), (1.0, 1.0)),
}
"""How thick parts are along their capsules, from 0 to 1 of the axis, as a share of the capsule's radius, by kind."""
CHEST = 0.93
"""The same of the chest, which is drawn as one: within the grooves between its capsules, 0.06 radii deep."""
LATITUDES = 11  # of the directions in which a limb's surface is sampled
FINE = 25  # the same of the chest, whose balls lie far apart

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
    if not frames.begins:
        return
    for name, (bone, balls) in parts.items():
        vertices, normals, triangles = hull_of_balls(balls)
        mesh = rr.Mesh3D(
            vertex_positions=vertices, vertex_normals=normals, triangle_indices=triangles, albedo_factor=BODY_COLOR
        )
        send_once(stream, rr.new_entity_path(["world", "body", bone, name]), mesh)


def body_parts(colliders: Sequence[Collider]) -> dict[str, tuple[str, Balls]]:
    """The bone and the shape of each part by its name, made of the capsules that bones carry.

    Limbs and head are as thick along them as `SHAPES` tells, and both halves of the chest are one.
    """
    parts: dict[str, tuple[str, Balls]] = {}
    for capsule in colliders:
        if not isinstance(capsule, Capsule) or capsule.bone is None:
            continue
        kind = capsule.name.removeprefix("left_").removeprefix("right_")
        balls = [
            (capsule.start + way * (capsule.end - capsule.start), share * capsule.radius)
            for way, share in SHAPES.get(kind, ((0.0, 1.0), (1.0, 1.0)))
        ]
        if kind == "head":  # the chin stays where it is
            balls[0] = _lowered(*balls[0], balls[1][0], capsule.radius)
        parts[capsule.name] = capsule.bone, balls
    left, right = parts.get("left_chest"), parts.get("right_chest")
    if left is not None and right is not None and left[0] == right[0]:
        parts["chest"] = left[0], [(center, CHEST * radius) for center, radius in left[1] + right[1]]
        del parts["left_chest"], parts["right_chest"]
    return parts


def _lowered(center: FloatArray, radius: float, crown: FloatArray, reach: float) -> tuple[FloatArray, float]:
    """A ball moved away from the crown as far as one around the same centre would reach [m]."""
    away = center - crown
    return center + (reach - radius) * away / max(float(np.linalg.norm(away)), 1e-9), radius


def hull_of_balls(balls: Balls) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """The convex hull of balls: in each direction n the farthest point of theirs, c + r n with the largest c n + r.

    Returns:
        Vertices [m] and unit normals, shape (V, 3), and triangles, counter-clockwise from outside, shape (T, 3).
    """
    count = LATITUDES if len(balls) < 4 else FINE
    latitudes = np.linspace(-np.pi / 2.0, np.pi / 2.0, count)
    across, up = (each(latitudes)[:, None, None] for each in (np.cos, np.sin))
    normals = (across * AROUND + up * np.array([0.0, 0.0, 1.0])).reshape(-1, 3)
    centers, radii = np.array([center for center, _ in balls]), np.array([radius for _, radius in balls])
    farthest = np.argmax(normals @ centers.T + radii, axis=1)
    vertices = centers[farthest] + radii[farthest, None] * normals
    return vertices.astype(np.float32), normals.astype(np.float32), strips(count)
