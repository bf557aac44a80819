"""What there is to see on the page: the cloth, the body or the objects that it touches, and the ground."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cape.cloth.looks.registry import look_of
from cape.live.feed.mailbox import LiveFrame
from cape.live.page.grips import Grips
from cape.live.page.objects import Mesh, mesh_of
from cape.live.page.objects import handle as handle_mesh
from cape.record.figure.body import BODY_COLOR, body_parts, hull_of_balls
from cape.record.moments import GLIDE, Shown
from cape.scene.colliders import Collider
from skeleton.shapes import Capsule

EYE = (-1.2, -0.7, 0.35)  # from the middle of the cloth, in sizes of it
MOVES_COLOR = (230, 170, 60)
VIEWED = ("middle", "low")  # bones of named scenes that only tell cameras where to look


class _Part(NamedTuple):
    """A mesh that a bone carries, or that stands in the world; one that moves can be taken by hand."""

    bone: str | None
    mesh: Mesh
    moves: bool = False

    def is_as(self, other: "_Part") -> bool:
        """Whether it looks the same and is carried alike."""
        alike = self.bone == other.bone and self.moves == other.moves
        return alike and all(np.array_equal(a, b) for a, b in zip(self.mesh, other.mesh, strict=True))


class Stage:
    """Shows set-ups and frames on a page.

    What stays the same from one set-up to the next is left where it is: a drag ends with what is dragged, and to take
    hold of the cloth makes another set-up.

    Attributes:
        setup: number of the one that is shown, -1 before the first.
    """

    def __init__(self, server: Any, grips: Grips) -> None:
        """Show ground; `server` is viser's."""
        self._server, self._grips = server, grips
        self.setup = -1
        self._cloth: Any = None
        self._parts: dict[str, tuple[_Part, Any]] = {}
        self._bones: dict[str, int] = {}
        self._root: int | None = None
        self._eye: tuple[float, np.ndarray] | None = None  # when [s], where [m]
        server.scene.set_up_direction("+z")
        self._ground = server.scene.add_frame("/ground", show_axes=False)
        server.scene.add_grid("/ground/floor", infinite_grid=True, cell_size=0.5)

    def begin(self, shown: Shown, frame: LiveFrame) -> None:
        """Show another set-up."""
        self.setup = frame.setup
        self._bones = {name: place for place, name in enumerate(shown.bones)}
        self._bones |= {role: self._bones[bone] for role, bone in shown.roles.items() if bone in self._bones}
        self._root = self._bones.get("pelvis", 0) if shown.roles else None
        with self._server.atomic():
            self._lay_out(shown, frame)
        self._look_at(frame)

    def show(self, frame: LiveFrame) -> None:
        """Show a frame."""
        offset, positions = self._placed(frame)
        with self._server.atomic():
            self._ground.position = offset
            self._cloth.vertices = positions
            for part, handle in self._parts.values():
                if part.bone is None:
                    handle.position = offset
                else:
                    handle.position = frame.bone_positions[self._bones[part.bone]] + offset
                    handle.wxyz = frame.rotations_wxyz[self._bones[part.bone]]
        self._grips.show(positions, offset)

    def _lay_out(self, shown: Shown, frame: LiveFrame) -> None:
        triangles = shown.cloth.triangles if shown.topology is None else shown.topology.triangles
        triangles, color = np.asarray(triangles, np.uint32), look_of(shown.cloth.fabric).color
        _, positions = self._placed(frame)
        if self._cloth is None:
            self._cloth = self._server.scene.add_mesh_simple("/cape", positions, triangles, color=color, side="double")
            self._cloth.on_drag(in_turn(self._grips.cloth))
        else:
            self._cloth.vertices, self._cloth.color = positions, color
            if not np.array_equal(self._cloth.faces, triangles):
                self._cloth.faces = triangles
        wanted = _parts(shown)
        for path in [path for path, (part, _) in self._parts.items() if not _has(wanted, path, part)]:
            self._parts.pop(path)[1].remove()
        for path, part in wanted.items():
            if path not in self._parts:
                self._parts[path] = part, self._added(path, part)

    def _added(self, path: str, part: _Part) -> Any:
        """Add what a bone carries."""
        color = MOVES_COLOR if part.moves else BODY_COLOR
        handle = self._server.scene.add_mesh_simple(path, *part.mesh, color=color)
        bone = part.bone
        if part.moves and bone is not None:
            handle.on_drag(in_turn(lambda drag: self._grips.object(bone, drag)))
        return handle

    def _look_at(self, frame: LiveFrame) -> None:
        """Have those who come stand behind and above it."""
        _, positions = self._placed(frame)
        low, high = positions.min(axis=0), positions.max(axis=0)
        middle, size = (low + high) / 2.0, float(np.linalg.norm(high - low))
        self._server.initial_camera.look_at = middle
        self._server.initial_camera.position = middle + size * np.array(EYE)

    def _placed(self, frame: LiveFrame) -> tuple[np.ndarray, np.ndarray]:
        """By how much a frame is shown elsewhere [m], and where its vertices are on the page, shape (V, 3)."""
        offset = self._offset(frame)
        return offset, frame.positions + offset.astype(np.float32)

    def _offset(self, frame: LiveFrame) -> np.ndarray:
        """From the world to the page: the ground glides by under who walks, and whoever looks stays."""
        if self._root is None:
            return np.zeros(3)
        there = frame.bone_positions[self._root] * np.array([1.0, 1.0, 0.0])
        if self._eye is None or frame.time < self._eye[0]:
            self._eye = frame.time, there
        before, place = self._eye
        place = place + (there - place) * (1.0 - np.exp((before - frame.time) / GLIDE))
        self._eye = frame.time, place
        return -place


def in_turn(act: Callable[[Any], object]) -> Callable[[Any], Any]:
    """What viser calls for one event after the other: plain functions run in threads, which overtake each other."""

    async def called(event: Any) -> None:
        act(event)

    return called


def _parts(shown: Shown) -> dict[str, _Part]:
    """The meshes beside the cloth, by where they are on the page."""
    drawn = body_parts(shown.colliders) if shown.roles else {}
    parts: dict[str, _Part] = {}
    for name, (bone, balls) in drawn.items():
        vertices, _, faces = hull_of_balls(balls)
        parts[f"/body/{name}"] = _Part(bone, (vertices, faces))
    known = {*shown.bones, *shown.roles}
    for collider in shown.colliders:
        if collider.name not in drawn and not _is_chest(collider) and (mesh := mesh_of(collider)) is not None:
            bone = collider.bone if collider.bone in known else None
            parts[f"/objects/{collider.name}"] = _Part(bone, mesh, moves=bone is not None and not shown.roles)
    if not shown.roles:
        carrying = {collider.bone for collider in shown.colliders}
        parts |= {
            f"/bones/{bone}": _Part(bone, handle_mesh(), moves=True)
            for bone in shown.bones
            if bone not in carrying and bone not in VIEWED
        }
    return {path: part if part.bone in known else part._replace(bone=None) for path, part in parts.items()}


def _has(parts: dict[str, _Part], path: str, part: _Part) -> bool:
    return path in parts and parts[path].is_as(part)


def _is_chest(collider: Collider) -> bool:
    """Whether it is one of the halves of a chest, which are drawn as one."""
    return isinstance(collider, Capsule) and collider.bone is not None and "chest" in collider.name
