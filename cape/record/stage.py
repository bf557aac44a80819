"""Where the figure stands: the place that the camera follows, and the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.record.figure.skin import skin_height
from cape.record.frames import Frames, send_once
from cape.record.layers import drawn_links
from cape.record.surfaces.light import linear, srgb
from cape.scene.colliders import Collider, Plane
from cape.scene.floor import floor_under
from cape.scene.loops import Travel
from motions import quaternions
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

FloatArray = NDArray[np.float64]

SMOOTHING = 1.0  # [s], about a stride: the camera glides instead of bobbing with every step
TILE = 0.5  # [m]
MARGIN = 6.0  # [m] of ground around the path
LEAST_TRAVEL = 0.25  # [m] from which on a loop's floor must look alike at both ends
MOST_TILES = 200  # along a side of the path's bounds; beyond it the tiles grow
BACKGROUND = (216, 206, 192)  # bright and warm: red cloth and dark robots stand out alike
DARK_BACKGROUND = (30, 33, 40)  # for what is translucent, or tells by its colour
TILE_COLORS = ((172, 158, 141), (190, 177, 160))


def log_character(stream: rr.RecordingStream, bones: BoneTrack, frames: Frames, travel: Travel | None = None) -> None:
    """Put the frame that the camera follows on `/world/character`: X where the figure faces at first, Z up.

    In a loop it turns evenly by what the figure has turned at the end, so that it sees no seam.
    """
    import rerun as rr

    send_once(stream, "/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    turned = 0.0 if travel is None or not travel.loops else travel.yaw
    half = (heading(bones, frames) + turned * frames.numbers / bones.frames) / 2
    places = smoothed_path(bones, frames, travel).astype(np.float32)
    turns = np.stack([np.zeros_like(half), np.zeros_like(half), np.sin(half), np.cos(half)], axis=1).astype(np.float32)
    # Both in each row: a row of a transform replaces all of the one before, also what was sent once.
    frames.send(
        stream, "/world/character", rr.Transform3D, {"translation": places[:, None], "quaternion": turns[:, None]}
    )


def smoothed_path(bones: BoneTrack, frames: Frames, travel: Travel | None = None) -> FloatArray:
    """The pelvis (or the first bone) averaged over a second around each frame [m], shape (F, 3).

    Of a loop, which travels so far, the rounds before and after count.
    """
    pelvis = bones.roles.get("pelvis")
    root = bones.names.index(pelvis) if pelvis in bones.names else 0
    path = bones.positions[frames.numbers, root]
    steps = np.diff(frames.times)
    half = round(SMOOTHING / 2 / np.median(steps)) if len(steps) else 0
    if travel is not None and travel.loops:
        half = min(half, len(path))
        padded = np.concatenate([travel.back(path[len(path) - half :]), path, travel.forth(path[:half])])
    else:
        # Continued beyond its ends by point reflection, so that a steady walk neither starts nor ends off centre.
        padded = np.pad(path, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    sums = np.cumsum(np.concatenate([np.zeros((1, 3)), padded]), axis=0)
    return (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)


def heading(bones: BoneTrack, frames: Frames) -> float:
    """Angle from +X about +Z of where the figure faces in the first frame [rad].

    It faces at right angles to the line between a pair of limbs; without such a pair it is taken to face where it goes,
    and +X where it goes nowhere.
    """
    first = bones.positions[frames.numbers[0]]
    for role in ("upper_arm", "thigh", "shoulder"):
        left, right = (bones.roles.get(f"{side}_{role}") for side in ("left", "right"))
        if left in bones.names and right in bones.names:
            to_left = first[bones.names.index(left)] - first[bones.names.index(right)]
            if np.hypot(to_left[0], to_left[1]) > 1e-3:
                return float(np.arctan2(-to_left[0], to_left[1]))
    way = bones.positions[frames.numbers[-1], 0] - first[0]
    return float(np.arctan2(way[1], way[0])) if np.hypot(way[0], way[1]) > 1e-3 else 0.0


def skeleton_height(bones: BoneTrack, frames: Frames) -> float:
    """From the lowest joint to the highest [m] in half of the frames or more, 1 m for a skeleton without any height."""
    drawn = drawn_links(bones).ravel()
    heights = bones.positions[frames.numbers][:, drawn if len(drawn) else slice(None), 2]
    return float(np.median(np.ptp(heights, axis=1))) or 1.0


def figure_height(
    bones: BoneTrack, frames: Frames, surfaces: Sequence[LinkSurface] = (), skin: Skin | None = None
) -> float:
    """Height of what there is to see [m]: of the skeleton, or of the meshes that it carries in the first frame."""
    if skin is not None:
        return max(skeleton_height(bones, frames), skin_height(bones, skin, int(frames.numbers[0])))
    carried = [surface for surface in surfaces if surface.bone is not None]
    if not carried:
        return skeleton_height(bones, frames)
    first = frames.numbers[0]
    places = [bones.index(surface.bone) for surface in carried if surface.bone is not None]
    heights = np.concatenate(
        [
            quaternions.rotate(bones.rotations_wxyz[first, place], surface.vertices)[:, 2]
            + bones.positions[first, place, 2]
            for place, surface in zip(places, carried, strict=True)
        ]
    )
    return max(skeleton_height(bones, frames), float(np.ptp(heights)))


def log_floor(
    stream: rr.RecordingStream,
    bones: BoneTrack,
    colliders: Sequence[Collider],
    frames: Frames,
    travel: Travel | None = None,
) -> None:
    """Put a chequered ground on `/world/floor`: the first plane that stands still, or else under the body's feet.

    Of a loop it goes on to both sides, with as many tiles in a round as it takes to look alike at both ends.
    """
    import rerun as rr

    planes = [collider for collider in colliders if isinstance(collider, Plane) and collider.bone is None]
    plane, places = planes[0] if planes else floor_under(colliders, bones), bones.positions[frames.numbers]
    if travel is None or not travel.loops or np.linalg.norm(travel.shift) < LEAST_TRAVEL:
        vertices, triangles, colors = ground(places, plane)
    else:
        places = np.concatenate([travel.back(places), places, travel.forth(places)])
        vertices, triangles, colors = ground(places, plane, travel.shift)
    # Without normals a mesh isn't lit, so that the ground's rim is exactly the background's colour.
    floor = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, vertex_colors=colors)
    send_once(stream, "/world/floor", floor)


def darkened_floor() -> dict[Any, Any]:
    """Overrides of a layout that draw the floor on the dark background: its rim stays exactly that colour."""
    import rerun as rr

    # Colours are multiplied as light, not as the numbers of sRGB.
    light, dark = (linear(np.array(color) / 255.0) for color in (BACKGROUND, DARK_BACKGROUND))
    factor = (*(np.rint(255.0 * srgb(dark / light)).astype(int)), 255)
    return {"/world/floor": [rr.Mesh3D.from_fields(albedo_factor=factor).visualizer()]}


def ground(
    positions: FloatArray, plane: Plane, period: FloatArray | None = None
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.uint8]]:
    """A chequered mesh on a plane, under the way of a motion and a margin around it, that fades into the background.

    Args:
        positions: what is to stand on it, in the world [m], shape (..., 3).
        plane: where it lies, in the world.
        period: a way after which it looks the same [m], shape (3,); None for any.

    Returns:
        Vertices of the tiles in the world [m], shape (4 N, 3), triangles, shape (2 N, 3), and colours, shape (4 N, 3).
    """
    plane_to_world = quaternions.from_z_axis(plane.normal)
    if period is not None:
        way = quaternions.rotate(quaternions.conjugate(plane_to_world), period)
        along = np.arctan2(way[1], way[0]) / 2.0
        plane_to_world = quaternions.multiply(plane_to_world, np.array([np.cos(along), 0.0, 0.0, np.sin(along)]))
    flat = quaternions.rotate(quaternions.conjugate(plane_to_world), positions.reshape(-1, 3) - plane.point)[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    tile = TILE * max(1, np.ceil((high - low).max() / (TILE * MOST_TILES)))
    if period is not None:
        length = float(np.linalg.norm(period))
        tile = length / (2.0 * max(1, round(length / (2.0 * tile))))
    first, last = np.floor((low - MARGIN) / tile), np.ceil((high + MARGIN) / tile)
    columns, rows = (axis.ravel() for axis in np.meshgrid(*(np.arange(a, b) for a, b in zip(first, last, strict=True))))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    points = tile * (np.stack([columns, rows], axis=-1)[:, None] + corners)
    off = np.linalg.norm(np.maximum(0.0, np.maximum(low - points, points - high)), axis=-1)
    fade = np.clip(off / (MARGIN - tile), 0.0, 1.0)[..., None]
    light = np.where((columns + rows) % 2 == 0, 1, 0)
    colors = (1 - fade) * np.array(TILE_COLORS)[light][:, None] + fade * np.array(BACKGROUND)
    vertices = np.concatenate([points, np.zeros_like(points[..., :1])], axis=-1).reshape(-1, 3)
    vertices = quaternions.rotate(plane_to_world, vertices) + plane.point
    triangles = 4 * np.arange(len(columns))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return (
        vertices.astype(np.float32),
        triangles.reshape(-1, 3).astype(np.uint32),
        colors.reshape(-1, 3).astype(np.uint8),
    )
