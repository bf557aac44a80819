"""The layers of a recording: what each puts on its entities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.colliders import Box, Collider, Sphere
from cape.normals import vertex_normals
from cape.record.frames import Frames, send_once
from cape.record.poses import bone_poses, from_z_axis, xyzw
from cape.record.textures import albedo, woven
from motions import quaternions
from motions.errors import UnknownNameError
from skeleton.capsules import Capsule
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

    from cape.take import Take

FloatArray = NDArray[np.float64]

LAYERS = ("cape", "skeleton", "hitboxes", "floor", "plots")
CLOTH_COLOR = (190, 22, 48)
BONE_COLOR = (225, 230, 238)
LEFT_COLOR, RIGHT_COLOR, MIDDLE_COLOR = (70, 170, 255), (255, 150, 60), (190, 200, 215)
BONE_RADIUS = 0.012  # [m], thin enough to be seen as a line inside a forearm's capsule


def check_layers(layers: Iterable[str] | None, available: Sequence[str] = LAYERS) -> tuple[str, ...]:
    """The asked layers, all of the available ones for None; raises UnknownNameError for one that isn't there."""
    if layers is None:
        return tuple(available)
    asked = [layers] if isinstance(layers, str) else list(layers)
    for layer in asked:
        if layer not in available:
            raise UnknownNameError("layer", layer, available)
    return tuple(layer for layer in available if layer in asked)


def log_cape(stream: rr.RecordingStream, take: Take, frames: Frames) -> None:
    """Put the cloth on `/world/cape`: the texture of its outside on both sides; the blueprint draws the lining."""
    import rerun as rr

    send_once(
        stream,
        "/world/cape",
        rr.Mesh3D.from_fields(
            triangle_indices=take.triangles, vertex_texcoords=take.texcoords, **albedo(woven(CLOTH_COLOR))
        ),
    )
    for block in frames.blocks(2 * take.positions[0].nbytes):
        positions = take.positions[frames.numbers[block]]
        normals = vertex_normals(positions, take.triangles)
        frames.send(
            stream,
            "/world/cape",
            rr.Mesh3D,
            {"vertex_positions": positions, "vertex_normals": normals},
            block=block,
        )


def log_skeleton(stream: rr.RecordingStream, bones: BoneTrack, frames: Frames) -> None:
    """Put a line from each bone's parent to the bone on `/world/skeleton`."""
    import rerun as rr

    links = drawn_links(bones)
    send_once(stream, "/world/skeleton", rr.LineStrips3D.from_fields(radii=BONE_RADIUS, colors=BONE_COLOR))
    ends = bones.positions[frames.numbers][:, links]
    frames.send(stream, "/world/skeleton", rr.LineStrips3D, {"strips": ends.astype(np.float32)})


def drawn_links(bones: BoneTrack) -> NDArray[np.int64]:
    """Pairs of a parent and a bone to draw a line between, shape (L, 2).

    Left out are pairs at one place in every frame, and what lies above the pelvis: those place the character in the
    world (a root's offset can be metres) and are no bones of it.
    """
    if bones.parents is None:
        return np.empty((0, 2), np.int64)
    above = set()
    pelvis = bones.roles.get("pelvis")
    bone = bones.names.index(pelvis) if pelvis in bones.names else -1
    while bone >= 0:
        above.add(bone)
        bone = int(bones.parents[bone])
    links = [(parent, bone) for bone, parent in enumerate(bones.parents) if parent >= 0 and bone not in above]
    pairs = np.array(links, np.int64).reshape(-1, 2)
    lengths = np.linalg.norm(bones.positions[:, pairs[:, 1]] - bones.positions[:, pairs[:, 0]], axis=-1)
    return pairs[np.nanmax(lengths, axis=0, initial=0.0) > 1e-6]


def log_hitboxes(stream: rr.RecordingStream, bones: BoneTrack, colliders: Sequence[Collider], frames: Frames) -> None:
    """Put the capsules on `/world/hitboxes`, spheres and boxes on `/world/colliders/<name>`; planes are the floor."""
    capsules = [collider for collider in colliders if isinstance(collider, Capsule)]
    if capsules:
        _log_capsules(stream, bones, capsules, frames)
    for collider in colliders:
        if isinstance(collider, Sphere | Box):
            _log_solid(stream, bones, collider, frames)


def _log_capsules(stream: rr.RecordingStream, bones: BoneTrack, capsules: Sequence[Capsule], frames: Frames) -> None:
    import rerun as rr

    axes = np.array([capsule.end - capsule.start for capsule in capsules])
    send_once(
        stream,
        "/world/hitboxes",
        rr.Capsules3D.from_fields(
            lengths=np.linalg.norm(axes, axis=-1),
            radii=[capsule.radius for capsule in capsules],
            colors=[_side_color(capsule.name) for capsule in capsules],
            labels=[capsule.name for capsule in capsules],
            show_labels=False,
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
        ),
    )
    positions, rotations = bone_poses(bones, [capsule.bone for capsule in capsules], frames)
    starts = np.array([capsule.start for capsule in capsules])
    translations = positions + quaternions.rotate(rotations, starts)
    turned = quaternions.multiply(rotations, from_z_axis(axes))
    frames.send(
        stream,
        "/world/hitboxes",
        rr.Capsules3D,
        {"translations": translations.astype(np.float32), "quaternions": xyzw(turned)},
    )


def _log_solid(stream: rr.RecordingStream, bones: BoneTrack, collider: Sphere | Box, frames: Frames) -> None:
    import rerun as rr

    path = rr.new_entity_path(["world", "colliders", collider.name])
    fill_mode = rr.components.FillMode.TransparentFillMajorWireframe
    if isinstance(collider, Box):
        archetype, half_sizes, rotation = rr.Boxes3D, collider.half_sizes, collider.rotation_wxyz
    else:
        archetype, half_sizes, rotation = rr.Ellipsoids3D, np.full(3, collider.radius), np.array([1.0, 0.0, 0.0, 0.0])
    shape = {"half_sizes": [half_sizes], "colors": [MIDDLE_COLOR], "labels": [collider.name]}
    send_once(stream, path, archetype.from_fields(**shape, show_labels=False, fill_mode=fill_mode))
    positions, rotations = bone_poses(bones, [collider.bone], frames)
    centers = (positions + quaternions.rotate(rotations, collider.center)).astype(np.float32)
    turned = xyzw(quaternions.multiply(rotations, rotation))
    if collider.bone is None:
        send_once(stream, path, archetype.from_fields(centers=centers[0], quaternions=turned[0]))
    else:
        frames.send(stream, path, archetype, {"centers": centers, "quaternions": turned})


def _side_color(name: str) -> tuple[int, int, int]:
    lowered = name.lower()
    if "left" in lowered:
        return LEFT_COLOR
    return RIGHT_COLOR if "right" in lowered else MIDDLE_COLOR


def log_plots(stream: rr.RecordingStream, take: Take, frames: Frames) -> None:
    """Put the curves of a take under `/plots`."""
    import rerun as rr

    curves: list[tuple[str, str, tuple[int, int, int], Any]] = [
        ("stretch", "largest stretch [%]", (240, 80, 100), take.stretch_max * 100),
        ("penetration", "deepest penetration [mm]", (255, 180, 70), take.penetration * 1000),
        ("kinetic_energy", "kinetic energy [J]", (100, 180, 255), take.kinetic_energy),
    ]
    for entity, name, color, values in curves:
        path = f"/plots/{entity}"
        send_once(stream, path, rr.SeriesLines(names=name, colors=color, widths=2.0))
        frames.send(stream, path, rr.Scalars, {"scalars": values[frames.numbers][:, None]})
