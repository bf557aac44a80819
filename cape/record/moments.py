"""A recording of what moves as it is seen: frames come one at a time, and nobody knows what comes next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.record.blueprint import layout
from cape.record.figure.body import log_body
from cape.record.figure.clasp import log_clasp
from cape.record.figure.robot import log_robot
from cape.record.figure.skin import log_skin
from cape.record.frames import Frames, send_once
from cape.record.layers import log_cape, log_skeleton
from cape.record.poses import xyzw
from cape.record.solids import drawable, log_hitboxes
from cape.record.stage import figure_height, heading, log_floor
from cape.record.worn import entities_of
from cape.record.write import with_surfaces
from cape.results.take import Take
from cape.results.topology import Topology
from cape.scene.colliders import Collider, Plane
from cape.scene.floor import floor_under
from motions import quaternions
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import BoneTrack, worn_by

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

FloatArray = NDArray[np.float64]

LAYERS = ("cape", "robot", "body", "skeleton", "hitboxes", "floor")  # what is sent with each frame, to a viewer
GLIDE = 0.4  # [s] by which the camera lags behind the figure, so that it does not bob with every step
SWING = 1.2  # [s] by which it lags behind where the figure faces
STEPS_OFF = 2.5  # [m] that the figure may get from the middle of the ground before ground is laid under it


@dataclass(frozen=True, eq=False)
class Shown:
    """What there is to see that stays from frame to frame.

    Attributes:
        name: of the recording.
        cloth: as it is drawn.
        colliders: shapes on bones or in the world.
        thickness: of the colliders that have none of their own [m].
        bones: names of the B bones.
        parents: index of each bone's parent, -1 for none; None where that is not known.
        roles: name of the bone that plays each role.
        surfaces: meshes that the bones carry.
        topology: which vertices the triangles have, where the cloth has torn.
        tears: how many edges have parted.
        skin: mesh that the bones move, drawn in place of a body by proportions; None for none.
    """

    name: str
    cloth: Cloth
    colliders: Sequence[Collider]
    thickness: float
    bones: tuple[str, ...]
    parents: tuple[int, ...] | None = None
    roles: dict[str, str] = field(default_factory=dict)
    surfaces: Sequence[LinkSurface] = ()
    topology: Topology | None = None
    tears: int = 0
    skin: Skin | None = None

    def track(
        self, time: float, positions: FloatArray, rotations_wxyz: FloatArray, morphs: FloatArray | None = None
    ) -> BoneTrack:
        """The bones at a time [s], as a motion of one frame: origins [m] (B, 3), quaternions bone_to_world (B, 4), and
        the weights of the skin's morphs (M,), None for 0."""
        parents = None if self.parents is None else np.array(self.parents)
        worn = worn_by(self.bones, self.skin, None if morphs is None or not len(morphs) else morphs[None])
        return BoneTrack(
            self.bones, np.array([time]), positions[None], rotations_wxyz[None], parents, self.roles, **worn
        )

    def take(self, bones: BoneTrack, positions: NDArray[np.float32]) -> Take:
        """The cloth on a motion of one frame; vertices in the world [m], shape (V, 3)."""
        topology, nothing = self.topology, np.zeros(1)
        texcoords = self.cloth.texcoords if topology is None else self.cloth.texcoords[topology.parents]
        return Take(
            name=self.name,
            bones=bones,
            colliders=self.colliders,
            triangles=self.cloth.triangles if topology is None else topology.triangles,
            texcoords=texcoords,
            positions=positions[None],
            stretch_max=nothing,
            stretch_p99=0.0,
            penetration=nothing,
            penetrated=np.full(1, -1),
            kinetic_energy=nothing,
            solver="",
            substeps=0,
            compile_s=0.0,
            settle_s=0.0,
            solve_s=0.0,
            thickness=self.thickness,
            cloth=self.cloth,
        )


class MomentRecording:
    """Sends frames to a stream, each when it comes."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        """Nothing is sent yet."""
        self._stream = stream
        self._shown: Shown | None = None
        self._asked: tuple[str, ...] = LAYERS
        self._colliders: list[Collider] = []
        self._floor: Plane | None = None
        self._middle = np.zeros(3)
        self._eye: tuple[float, FloatArray, float] | None = None  # when [s], where [m], which way [rad]

    def begin(self, shown: Shown, track: BoneTrack) -> rrb.Blueprint:
        """Take what is shown from now on, and give the layout for it; `track` is a motion of one frame."""
        self._shown = shown
        self._asked = with_surfaces(LAYERS, shown.surfaces)
        self._colliders = drawable(shown.colliders)
        standing = [c for c in self._colliders if isinstance(c, Plane) and c.bone is None]
        self._floor = self._floor or (standing[0] if standing else floor_under(self._colliders, track))
        self._begins = True
        height = figure_height(track, Frames(np.zeros(1, np.int64), track.times), shown.surfaces, shown.skin)
        linings = {c.path: c.look.lining for c in entities_of([(shown.name, shown.cloth)])}
        skinned = shown.skin is not None
        return layout(self._asked, height, self._colliders, linings=linings, follow=True, skinned=skinned)

    def add(self, number: int, track: BoneTrack, positions: NDArray[np.float32]) -> None:
        """Send a frame: its number, the bones as a motion of one frame, the cloth's vertices [m], shape (V, 3)."""
        shown, stream = self._shown, self._stream
        if shown is None or not np.isfinite(positions).all():
            return
        frames = Frames(np.zeros(1, np.int64), track.times, begins=self._begins, before=number)
        cloth = entities_of([(shown.name, shown.cloth)])[0]
        take = shown.take(track, positions)
        log_cape(stream, take, frames, path=cloth.path, look=cloth.look)
        log_clasp(stream, take, frames, path=cloth.clasp)
        if "robot" in self._asked:
            log_robot(stream, track, shown.surfaces, frames)
        if shown.skin is not None:
            log_skin(stream, track, shown.skin, frames)
        elif "body" in self._asked:
            log_body(stream, track, self._colliders, frames)
        log_skeleton(stream, track, frames)
        log_hitboxes(stream, track, self._colliders, frames)
        self._log_eye(track, frames)
        self._log_floor(track, frames)
        self._begins = False

    def _log_eye(self, track: BoneTrack, frames: Frames) -> None:
        """Put the frame that the camera follows on `/world/character`: it glides after the figure."""
        import rerun as rr

        if frames.begins:
            send_once(self._stream, "/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        time = float(track.times[0])
        pelvis = track.roles.get("pelvis")
        there = track.positions[0, track.names.index(pelvis) if pelvis in track.names else 0]
        way = heading(track, Frames(np.zeros(1, np.int64), track.times))
        if self._eye is None or time < self._eye[0]:
            self._eye = time, there, way
        before, place, facing = self._eye
        place = place + (there - place) * (1.0 - np.exp((before - time) / GLIDE))
        off = (way - facing + np.pi) % (2.0 * np.pi) - np.pi
        facing = facing + off * (1.0 - np.exp((before - time) / SWING))
        self._eye = time, place, facing
        turn = quaternions.from_rotation_vector(np.array([0.0, 0.0, facing]))
        columns = {"translation": place[None, None].astype(np.float32), "quaternion": xyzw(turn)[None, None]}
        frames.send(self._stream, "/world/character", rr.Transform3D, columns)

    def _log_floor(self, track: BoneTrack, frames: Frames) -> None:
        """Lay ground under the figure, also where it has walked off what there was."""
        here = track.positions[0].mean(axis=0)
        if self._floor is not None and (frames.begins or np.linalg.norm((here - self._middle)[:2]) > STEPS_OFF):
            self._middle = here
            log_floor(self._stream, track, [self._floor], frames)
