"""Putting a cape on: where the wearer's frame is, and what holds the neckline."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cape.cloth.normals import vertex_normals
from cape.kernels.solve.attachments import Attached
from cape.scene.colliders import Collider
from cape.scene.holding.attachments import Attachment
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from motions import quaternions
from motions.errors import ValueRangeError
from skeleton.solid_measures import signed_distance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HIGHEST_LIFT = 0.15  # m that a neckline is raised at most to clear the shoulders
LIFT_STEP = 0.002  # m
FARTHEST = 0.3  # m that it is raised and moved back at most where its wearer's trunk is in the way
FAR_STEP = 0.01  # m
BACK_COST = 0.6  # of a metre back in metres up: a cape may hang lower down the back, but not stand beside the head


def wearer_to_world(left: FloatArray, right: FloatArray, pelvis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give the wearer's frame from the shoulder joints and the pelvis in the world [m], each of shape (3,).

    Returns:
        The rotation wearer_to_world, shape (3, 3), and the origin between the shoulders [m], shape (3,): x forward,
        y from the right shoulder to the left, z up the trunk.

    Raises:
        ValueRangeError: the three points lie on a line.
    """
    origin = (left + right) / 2.0
    lateral, trunk = left - right, origin - pelvis
    forward = np.cross(lateral, trunk)
    if np.linalg.norm(forward) < 1e-6:
        raise ValueRangeError("the shoulder joints and the pelvis lie on a line: the cape can't be put on")
    y = lateral / np.linalg.norm(lateral)
    x = forward / np.linalg.norm(forward)
    return np.stack([x, y, np.cross(x, y)], axis=1), origin


def dressing_pose(scene: Scene, pose: Pose) -> Pose:
    """The pose of the bones, and of the world as the last, in which a cloth is put on, for a motion from a pose on."""
    if scene.dressing is None:
        return pose
    rotation, origin = _wearer(scene, pose)
    origins, turns = (np.array(parts) for parts in zip(*(scene.dressing[bone] for bone in scene.bones), strict=True))
    positions = origin + origins @ rotation.T
    turns = quaternions.multiply(quaternions.from_matrix(rotation), turns)
    return Pose(np.concatenate([positions, pose.positions[-1:]]), np.concatenate([turns, pose.rotations_wxyz[-1:]]))


def placed(scene: Scene, pose: Pose) -> FloatArray:
    """Positions of the vertices in the world where the cloth starts [m], shape (V, 3)."""
    cloth = scene.cloth
    if cloth.frame == "world":
        return cloth.positions
    rotation, origin = _wearer(scene, pose)
    return origin + cloth.positions @ rotation.T


def held_by(scene: Scene, attachment: Attachment, pose: Pose, positions: FloatArray) -> IntArray:
    """Vertices that an attachment holds of a cloth that is placed at positions in the world [m], shape (V, 3).

    Raises:
        ValueRangeError: none is near enough.
    """
    if attachment.within is None:
        return attachment.vertices
    bone = pose.positions[scene.bones.index(attachment.bone)]
    off = np.linalg.norm(places_worn(scene, pose, positions)[attachment.vertices] - bone, axis=1)
    near = attachment.vertices[off <= attachment.within]
    if near.size == 0:
        raise ValueRangeError(
            f"no vertex is within {attachment.within} m of {attachment.bone!r}; the closest is {off.min():.3f} m off"
        )
    return near


def places_worn(scene: Scene, pose: Pose, positions: FloatArray) -> FloatArray:
    """Where the vertices would be held, with nothing in the way [m]: the neckline for the top row, else their start."""
    cloth = scene.cloth
    if cloth.neckline is None:
        return positions
    rotation, origin = _wearer(scene, pose)
    worn = positions.copy()
    worn[: len(cloth.neckline)] = origin + cloth.neckline @ rotation.T
    return worn


def places_lifted(scene: Scene, pose: Pose, positions: FloatArray) -> FloatArray:
    """The same with the neckline raised as far as it takes to clear the colliders [m], shape (V, 3)."""
    worn = places_worn(scene, pose, positions)
    if scene.cloth.neckline is not None:
        neckline = worn[: len(scene.cloth.neckline)]
        neckline += _lift(scene, pose, neckline)
    return worn


def hold_points(
    scene: Scene,
    attached: Attached,
    held: list[tuple[Attachment, IntArray]],
    pose: Pose,
    positions: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Points at which bones hold vertices, in the bones' frames [m], (m, 3): where they are worn, where they start.

    `held` are the attachments with their vertices, `positions` where the cloth is placed in the world [m], shape
    (V, 3).
    """
    chosen = np.concatenate([vertices for _, vertices in held])
    worn, spread = places_lifted(scene, pose, positions)[chosen], positions[chosen]
    first = 0
    for attachment, vertices in held:
        if attachment.points is not None:
            worn[first : first + len(vertices)] = from_bone(scene, attachment, pose)
        first += len(vertices)
    worn, spread = in_bones(attached, pose, worn), in_bones(attached, pose, spread)
    return worn, worn if scene.cloth.frame == "world" else spread


def normals_in_bones(
    scene: Scene,
    attached: Attached,
    held: list[tuple[Attachment, IntArray]],
    pose: Pose,
    positions: FloatArray,
) -> FloatArray:
    """The cloth's normals where it is worn, in the frames of bones that carry vertices, (m, 3); see `hold_points`."""
    worn = places_lifted(scene, pose, positions)
    normals = vertex_normals(worn[None], scene.cloth.triangles)[0].astype(float)
    normals = normals[np.concatenate([vertices for _, vertices in held])]
    turn = quaternions.conjugate(pose.rotations_wxyz[attached.bones])
    return quaternions.rotate(turn, _by_bone(attached, normals))


def from_bone(scene: Scene, attachment: Attachment, pose: Pose) -> FloatArray:
    """Where an attachment's points, which must be given, are in the world [m], shape (n, 3)."""
    assert attachment.points is not None
    bone = scene.bones.index(attachment.bone)
    return pose.positions[bone] + quaternions.rotate(pose.rotations_wxyz[bone], attachment.points)


def in_bones(attached: Attached, pose: Pose, points: FloatArray) -> FloatArray:
    """Points of the world [m], shape (n, 3), in the frames of the bones that hold n vertices, each of (m, 3)."""
    turn = quaternions.conjugate(pose.rotations_wxyz[attached.bones])
    return quaternions.rotate(turn, _by_bone(attached, points) - pose.positions[attached.bones])


def _by_bone(attached: Attached, values: FloatArray) -> FloatArray:
    """Rows of n vertices, shape (n, 3), once for each bone that holds them, shape (m, 3)."""
    return values if attached.blend is None else np.repeat(values, np.diff(attached.blend.starts), axis=0)


def heaviest(attached: Attached) -> IntArray:
    """The bone that has the most weight in holding each vertex, shape (n,)."""
    return attached.bones if attached.blend is None else attached.bones[attached.blend.starts[:-1]]


def carried_points(attached: Attached, pose: Pose) -> FloatArray:
    """Where bones carry n vertices in the world [m], shape (n, 3), were they held off by nothing."""
    places = pose.positions[attached.bones] + quaternions.rotate(pose.rotations_wxyz[attached.bones], attached.points)
    if attached.blend is None:
        return places
    return np.add.reduceat(attached.blend.weights[:, None] * places, attached.blend.starts[:-1], axis=0)


def held_points(attached: Attached, pose: Pose) -> FloatArray:
    """Where bones hold n vertices in the world [m], shape (n, 3)."""
    lift = quaternions.rotate(pose.rotations_wxyz[heaviest(attached)], attached.lift)
    return carried_points(attached, pose) + lift


def lift_to(attached: Attached, pose: Pose, places: FloatArray) -> None:
    """Have n vertices held off to places in the world [m], shape (n, 3)."""
    away = places - carried_points(attached, pose)
    attached.lift[:] = quaternions.rotate(quaternions.conjugate(pose.rotations_wxyz[heaviest(attached)]), away)


def _wearer(scene: Scene, pose: Pose) -> tuple[FloatArray, FloatArray]:
    left, right, pelvis = (pose.positions[scene.bones.index(role)] for role in scene.wearer)
    return wearer_to_world(left, right, pelvis)


def _lift(scene: Scene, pose: Pose, neckline: FloatArray) -> FloatArray:
    """The least way up the wearer's trunk that takes the neckline clear of all colliders [m], shape (3,).

    Where that would be too far, as for a robot whose shoulders lie deep in its trunk, it goes back as well.
    """
    rotation = _wearer(scene, pose)[0]
    forward, up = rotation[:, 0], rotation[:, 2]
    for height in np.arange(0.0, HIGHEST_LIFT, LIFT_STEP):
        if not touches(scene, pose, neckline + height * up):
            return height * up
    heights, ways = (axis.ravel() for axis in np.mgrid[0:FARTHEST:FAR_STEP, 0:FARTHEST:FAR_STEP])
    for k in np.argsort(np.hypot(heights, BACK_COST * ways), kind="stable"):
        shift = heights[k] * up - ways[k] * forward
        if not touches(scene, pose, neckline + shift):
            return shift
    return np.zeros(3)


def touches(scene: Scene, pose: Pose, points: FloatArray) -> bool:
    """Tell whether one of the points in the world [m], shape (n, 3), is within the scene's thickness of a collider."""
    if not len(points):
        return False
    return any((distances < scene.thickness).any() for distances in _distances(scene, pose, points, scene.thickness))


def depth_in_colliders(scene: Scene, pose: Pose, points: FloatArray) -> float:
    """How deep the deepest of some points in the world [m], shape (n, 3), is in any collider [m], zero outside."""
    return max((0.0, *(-float(distances.min()) for distances in _distances(scene, pose, points, 0.0))))


def _distances(scene: Scene, pose: Pose, points: FloatArray, within: float) -> Iterator[FloatArray]:
    """Of points in the world [m], (n, 3), from each collider that may be so near [m], negative within, shape (n,)."""
    near = scene.enclosing.near(pose, points, within)
    return (distances_from(scene.colliders[c], scene, pose, points) for c in near)


def distances_from(collider: Collider, scene: Scene, pose: Pose, points: FloatArray) -> FloatArray:
    """Of points in the world [m], shape (n, 3), from a collider [m], negative within, shape (n,).

    The pose is of the scene's bones, and of the world as the last.
    """
    bone = len(scene.bones) if collider.bone is None else scene.bones.index(collider.bone)
    in_bone = (points - pose.positions[bone]) @ quaternions.to_matrix(pose.rotations_wxyz[bone])
    return signed_distance(collider, in_bone)
