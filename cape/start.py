"""What overlaps before the first step: a cloth or what holds it in a collider, a collider in the floor."""

import numpy as np
from numpy.typing import NDArray

from cape.assembly import putting_on
from cape.scene.colliders import Collider, Plane
from cape.scene.poses import Pose, poses_of, read_pose
from cape.scene.scene import Scene
from motions import quaternions
from skeleton.checks.findings import Finding
from skeleton.shapes import Bounded
from skeleton.solid_measures import signed_distance
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

NOTEWORTHY = 0.001  # m; held points may lie on a collider's surface
IN_FLOOR = 0.02  # m that a capsule may be in the floor, on which feet stand that are flatter than their capsules


def check_start(scene: Scene, track: BoneTrack) -> tuple[Finding, ...]:
    """Find what overlaps where a scene starts, in the first frame of a motion; nothing is simulated.

    A cloth that starts in a collider is pushed out of it; what a bone holds there is held at the surface instead. What
    lies between a capsule and a plane that overlap has nowhere to go.

    Args:
        scene: cloth, attachments and colliders.
        track: poses of at least the bones that the scene uses.

    Returns:
        What was found: cloth, held points, floor, of each the deepest first.

    Raises:
        UnknownNameError: the scene uses a bone that the track has not.
        ValueRangeError: the cape can't be put on, or an attachment holds nothing.
    """
    first = track.first(1)
    pose = read_pose(poses_of(first, scene.bones)[0], scene.bones)
    pose = putting_on.dressing_pose(scene, pose)
    start = putting_on.placed(scene, pose)
    held = _held_points(scene, pose, start)
    loose = np.delete(start, np.concatenate([*(v for _, v, _ in held), np.empty(0, np.int64)]), axis=0)
    cloth, holds = [], []
    for collider in scene.colliders:
        cloth += _inside(scene, pose, collider, loose, "the cloth starts in", ())
        for bone, _, points in held:
            holds += _inside(scene, pose, collider, points, f"{bone} holds the cloth in", (bone,))
    return (*_deepest_first(cloth), *_deepest_first(holds), *_deepest_first(_in_planes(scene, first)))


def _held_points(scene: Scene, pose: Pose, start: FloatArray) -> list[tuple[str, NDArray[np.int64], FloatArray]]:
    """For each attachment the bone, the vertices, and where it holds them once the cloth is put on [m], (n, 3)."""
    worn = putting_on.places_lifted(scene, pose, start)
    held = []
    for attachment in scene.attachments:
        vertices = putting_on.held_by(scene, attachment, pose, start)
        points = worn[vertices]
        if attachment.points is not None:
            points = putting_on.from_bone(scene, attachment, pose)
        held.append((attachment.bone, vertices, points))
    return held


def _inside(
    scene: Scene, pose: Pose, collider: Collider, points: FloatArray, what: str, parts: tuple[str, ...]
) -> list[Finding]:
    """The finding that points in the world (n, 3) [m] are inside of a collider; none if they are not."""
    depths = -putting_on.distances_from(collider, scene, pose, points)
    count = int((depths > NOTEWORTHY).sum())
    if not count:
        return []
    deepest = float(depths.max())
    text = f"{what} {collider.name}: {count} of {len(points)} vertices, up to {1000 * deepest:.0f} mm deep"
    return [Finding("start", text, deepest, "m", (0, 0), (*parts, collider.name))]


def _in_planes(scene: Scene, first: BoneTrack) -> list[Finding]:
    """The solids that start in a plane that stands still."""
    solids = [c for c in scene.colliders if isinstance(c, Bounded) and c.bone is not None]
    found = []
    for plane in (c for c in scene.colliders if isinstance(c, Plane) and c.bone is None):
        for solid in solids:
            depth = _depth_behind(plane, solid, first)
            if depth > IN_FLOOR:
                text = f"{solid.name} starts in {plane.name} by {1000 * depth:.0f} mm"
                found.append(Finding("start", text, depth, "m", (0, 0), (solid.name, plane.name)))
    return found


def _depth_behind(plane: Plane, solid: Bounded, first: BoneTrack) -> float:
    """How far a solid gets behind a plane that stands still [m], negative where it is in front of it."""
    bone = first.index(solid.bone or "")
    into_bone = quaternions.conjugate(first.rotations_wxyz[0, bone])
    down = quaternions.rotate(into_bone, -plane.normal / np.linalg.norm(plane.normal))
    height = signed_distance(plane, first.positions[0, bone][None])[0]
    return float(solid.support(down[None])[0] - height)


def _deepest_first(findings: list[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: -finding.figure)
