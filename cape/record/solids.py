"""Colliders of a recording: the hitboxes, and the shells in which they keep the cloth off."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.record.frames import Frames, send_once
from cape.record.poses import bone_poses, xyzw
from cape.scene.colliders import Collider
from motions import quaternions
from motions.limits import MOST_DRAWN
from skeleton.shapes import Capsule, require_known
from skeleton.shapes.outlines import (
    BoxOutline,
    CapsuleOutline,
    EllipsoidOutline,
    MeshOutline,
    Outline,
    PatchOutline,
)
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int] | tuple[int, int, int, int]

LEFT_COLOR, RIGHT_COLOR, MIDDLE_COLOR = (70, 170, 255), (255, 150, 60), (190, 200, 215)
LEFT_OUT_COLOR = (126, 128, 134)
SHELL_OPACITY = 40  # of 255
SHELL_COLOR = (90, 230, 190, SHELL_OPACITY)
MESH_OPACITY = 80  # of 255: about that of Rerun's own translucent fill
PLANE_MARGIN = 0.5  # [m] that a drawn plane goes on beyond what stands on it
LABEL_RADIUS = 0.001  # [m] of the point that carries the name of a mesh, which has none itself


def drawable(colliders: Sequence[Collider]) -> list[Collider]:
    """Those that a recording has room for: all capsules, and the first of all others; warns of the rest."""
    others = [collider for collider in colliders if not isinstance(collider, Capsule)]
    if len(others) <= MOST_DRAWN:
        return list(colliders)
    warnings.warn(
        f"{MOST_DRAWN} of {len(others)} colliders that are no capsules are drawn: a recording holds no more",
        stacklevel=4,
    )
    left_out = {id(collider) for collider in others[MOST_DRAWN:]}
    return [collider for collider in colliders if id(collider) not in left_out]


def log_hitboxes(
    stream: rr.RecordingStream,
    bones: BoneTrack,
    colliders: Sequence[Collider],
    frames: Frames,
    left_out: Collection[str] = (),
) -> None:
    """Put the capsules on `/world/hitboxes`, all other shapes on `/world/colliders/<name>`.

    Raises:
        UnknownNameError: a collider is of no shape in `skeleton.shapes.SHAPES`.
    """
    _Drawing(stream, bones, frames, "/world/hitboxes", ("world", "colliders"), left_out).draw(colliders)


def log_shells(
    stream: rr.RecordingStream,
    bones: BoneTrack,
    colliders: Sequence[Collider],
    thicknesses: Sequence[float] | FloatArray,
    frames: Frames,
) -> None:
    """Put the same shapes, grown by the thickness [m] of each, on `/world/shells` and `/world/shells/<name>`.

    Raises:
        UnknownNameError: a collider is of no shape in `skeleton.shapes.SHAPES`.
    """
    require_known(colliders)
    shells = [collider.grown(float(t)) for collider, t in zip(colliders, thicknesses, strict=True)]
    _Drawing(stream, bones, frames, "/world/shells", ("world", "shells"), None).draw(shells)


def labelled(colliders: Sequence[Collider]) -> dict[str, list[Any]]:
    """For each entity of `log_hitboxes` what draws it with its names, for a blueprint's overrides."""
    import rerun as rr

    named: dict[str, list[Any]] = {"/world/hitboxes": [rr.Capsules3D.from_fields(show_labels=True).visualizer()]}
    for collider, outline in zip(colliders, _outlines(colliders), strict=True):
        path = rr.new_entity_path(["world", "colliders", collider.name])
        if isinstance(outline, MeshOutline):
            label = rr.Points3D.from_fields(show_labels=True)
            named[path] = [rr.Mesh3D.from_fields().visualizer(), label.visualizer()]
        elif isinstance(outline, EllipsoidOutline):
            named[path] = [rr.Ellipsoids3D.from_fields(show_labels=True).visualizer()]
        elif not isinstance(outline, CapsuleOutline):
            named[path] = [rr.Boxes3D.from_fields(show_labels=True).visualizer()]
    return named


def plane_paths(colliders: Sequence[Collider]) -> list[str]:
    """Entities of `log_hitboxes` that a drawn floor makes superfluous."""
    import rerun as rr

    flat = [c for c, outline in zip(colliders, _outlines(colliders), strict=True) if isinstance(outline, PatchOutline)]
    return [rr.new_entity_path(["world", "colliders", c.name]) for c in flat]


def _outlines(colliders: Sequence[Collider]) -> list[Outline]:
    """How each collider looks.

    Raises:
        UnknownNameError: a collider is of no shape in `skeleton.shapes.SHAPES`.
    """
    require_known(colliders)
    return [collider.outline() for collider in colliders]


@dataclass(frozen=True, eq=False)
class _Drawing:
    """What all colliders of a layer are drawn with.

    Attributes:
        stream: where to.
        bones: that carry them.
        frames: to draw.
        capsules: path of the capsules.
        others: parts of the path of all else.
        left_out: names of those that the cloth can't reach; None for shells, which are nameless and of one colour.
    """

    stream: rr.RecordingStream
    bones: BoneTrack
    frames: Frames
    capsules: str
    others: tuple[str, ...]
    left_out: Collection[str] | None

    def draw(self, colliders: Sequence[Collider]) -> None:
        """Put all colliders where they belong."""
        import rerun as rr

        outlines = list(zip(colliders, _outlines(colliders), strict=True))
        capsules = [(collider, outline) for collider, outline in outlines if isinstance(outline, CapsuleOutline)]
        if capsules:
            self._capsules([collider for collider, _ in capsules], [outline for _, outline in capsules])
        for collider, outline in outlines:
            if isinstance(outline, BoxOutline):
                self._solid(rr.Boxes3D, collider, outline)
            elif isinstance(outline, EllipsoidOutline):
                self._solid(rr.Ellipsoids3D, collider, outline)
            elif isinstance(outline, PatchOutline):
                self._solid(rr.Boxes3D, collider, self._patch(collider.bone, outline), flat=True)
            elif isinstance(outline, MeshOutline):
                self._mesh(collider, outline)

    def _color(self, collider: Collider) -> Color:
        if self.left_out is None:
            return SHELL_COLOR
        if collider.name in self.left_out:
            return LEFT_OUT_COLOR
        lowered = collider.name.lower()
        if "left" in lowered:
            return LEFT_COLOR
        return RIGHT_COLOR if "right" in lowered else MIDDLE_COLOR

    def _names(self, colliders: Sequence[Collider]) -> dict[str, Any]:
        if self.left_out is None:
            return {}
        names = [f"{c.name} (left out)" if c.name in self.left_out else c.name for c in colliders]
        return {"labels": names, "show_labels": False}

    def _path(self, collider: Collider) -> str:
        import rerun as rr

        return rr.new_entity_path([*self.others, collider.name])

    def _capsules(self, colliders: Sequence[Collider], capsules: Sequence[CapsuleOutline]) -> None:
        import rerun as rr

        axes = np.array([capsule.end - capsule.start for capsule in capsules])
        if self.frames.begins:
            send_once(
                self.stream,
                self.capsules,
                rr.Capsules3D.from_fields(
                    lengths=np.linalg.norm(axes, axis=-1),
                    radii=[capsule.radius for capsule in capsules],
                    colors=[self._color(collider) for collider in colliders],
                    fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
                    **self._names(colliders),
                ),
            )
        positions, rotations = bone_poses(self.bones, [collider.bone for collider in colliders], self.frames)
        starts = np.array([capsule.start for capsule in capsules])
        translations = positions + quaternions.rotate(rotations, starts)
        turned = quaternions.multiply(rotations, quaternions.from_z_axis(axes))
        columns = {"translations": translations.astype(np.float32), "quaternions": xyzw(turned)}
        self.frames.send(self.stream, self.capsules, rr.Capsules3D, columns)

    def _solid(
        self, archetype: Any, collider: Collider, outline: BoxOutline | EllipsoidOutline, *, flat: bool = False
    ) -> None:
        """A shape with a centre and half sizes, turned in its bone's frame; only its edges where it is `flat`."""
        import rerun as rr

        path = self._path(collider)
        modes = rr.components.FillMode
        fill_mode = modes.MajorWireframe if flat else modes.TransparentFillMajorWireframe
        shape = {"half_sizes": [outline.half_sizes], "colors": [self._color(collider)], "fill_mode": fill_mode}
        if self.frames.begins:
            send_once(self.stream, path, archetype.from_fields(**shape, **self._names([collider])))
        positions, rotations = bone_poses(self.bones, [collider.bone], self.frames)
        centers = (positions + quaternions.rotate(rotations, outline.center)).astype(np.float32)
        turned = xyzw(quaternions.multiply(rotations, outline.rotation_wxyz))
        if collider.bone is None:
            if self.frames.begins:
                send_once(self.stream, path, archetype.from_fields(centers=centers[0], quaternions=turned[0]))
        else:
            self.frames.send(self.stream, path, archetype, {"centers": centers, "quaternions": turned})

    def _patch(self, bone: str | None, plane: PatchOutline) -> BoxOutline:
        """The part of a plane, in its bone's frame, that is under all bones."""
        turn = quaternions.from_z_axis(plane.normal)
        positions = self.bones.positions[self.frames.numbers]
        if bone is not None:
            own, turns = bone_poses(self.bones, [bone], self.frames)
            positions = quaternions.rotate(quaternions.conjugate(turns), positions - own)
        flat = quaternions.rotate(quaternions.conjugate(turn), positions - plane.point)[..., :2].reshape(-1, 2)
        low, high = flat.min(axis=0), flat.max(axis=0)
        center = plane.point + quaternions.rotate(turn, np.array([*(low + high) / 2.0, 0.0]))
        return BoxOutline(center, np.array([*(high - low) / 2.0 + PLANE_MARGIN, 0.0]), turn)

    def _mesh(self, collider: Collider, outline: MeshOutline) -> None:
        """A mesh that is made once and moved."""
        import rerun as rr

        path = self._path(collider)
        if self.frames.begins:
            self._send_mesh(path, collider, outline)
        positions, rotations = bone_poses(self.bones, [collider.bone], self.frames)
        columns = {
            "translation": (positions + quaternions.rotate(rotations, outline.origin)).astype(np.float32),
            "quaternion": xyzw(quaternions.multiply(rotations, outline.rotation_wxyz)),
        }
        self.frames.send(self.stream, path, rr.Transform3D, columns)

    def _send_mesh(self, path: str, collider: Collider, outline: MeshOutline) -> None:
        """The mesh itself, and its name."""
        import rerun as rr

        mesh = rr.Mesh3D(
            vertex_positions=outline.vertices,
            vertex_normals=outline.normals,
            triangle_indices=outline.triangles,
            albedo_factor=[*self._color(collider)[:3], SHELL_OPACITY if self.left_out is None else MESH_OPACITY],
        )
        send_once(self.stream, path, mesh)
        if names := self._names([collider]):
            color = self._color(collider)
            send_once(self.stream, path, rr.Points3D([outline.middle], radii=LABEL_RADIUS, colors=color, **names))
