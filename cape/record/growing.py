"""Recordings that grow as a cloth is simulated: to a viewer or into a file, the cloth frame by frame."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.outfits.apart import takes_apart
from cape.outfits.combined import Outfit
from cape.record.blueprint import layout
from cape.record.contacts import BYTES_PER_CONTACT
from cape.record.files.recording import RecordingFile, recording_file
from cape.record.frames import BYTES_PER_CHUNK, Frames
from cape.record.layers import LAYERS, check_layers
from cape.record.solids import drawable
from cape.record.stage import figure_height
from cape.record.worn import ClothEntity, entities_of, worn_of
from cape.record.write import (
    OVERHEAD,
    cloth_layout,
    finite_frames,
    frames_of,
    log_cloth,
    log_figure,
    require_recorder,
    skin_size,
    with_surfaces,
)
from cape.results.so_far import SoFar, StopRun
from cape.results.take import Take
from cape.scene.scene import Scene
from motions.errors import FileError
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

BYTES_PER_VERTEX = 24  # in each frame: place and normal
BYTES_PER_TEXCOORD = 8
BYTES_PER_BONE = 120  # the same of a bone or a collider, at most: in all layers


def parts_of(name: str, cloth: Cloth) -> list[tuple[str, Cloth]]:
    """The cloths that are drawn for one that is simulated, the outermost first, and what they are called."""
    return [(part.name, part.cloth) for part in reversed(cloth.parts)] if isinstance(cloth, Outfit) else [(name, cloth)]


class GrowingCloth:
    """Sends the frames of a cloth to a stream as they come."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        asked: Collection[str],
        entities: Sequence[ClothEntity],
        *,
        may_tear: bool = False,
    ) -> None:
        """A cloth of which nothing has been sent yet.

        Args:
            stream: where to.
            asked: layers.
            entities: where it stands, or each of those that it is made of.
            may_tear: whether its triangles may change from frame to frame.
        """
        self._stream, self._asked, self._entities, self._may_tear = stream, asked, entities, may_tear
        self._triangles: list[NDArray[np.int32] | None] = [None] * len(entities)  # of the last frame that was sent
        self._finite: list[NDArray[np.bool_]] = []

    @property
    def sent(self) -> int:
        """How many frames have been gone through."""
        return sum(map(len, self._finite))

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Which of these were sent, shape (F,): one with a position that isn't finite is left out."""
        return np.concatenate([np.zeros(0, bool), *self._finite])

    def add(self, part: Take) -> None:
        """Send the frames of a take that begins where those before have ended."""
        finite = np.asarray(np.isfinite(part.positions).all(axis=(1, 2)))
        rows, begins = np.flatnonzero(finite), not any(before.any() for before in self._finite)
        if len(rows):
            frames = Frames(rows, part.bones.times[rows], begins=begins, before=self.sent)
            takes = takes_apart(part)
            for take, entity, known in zip(takes, self._entities, self._triangles, strict=True):
                log_cloth(self._stream, self._asked, take, entity, frames, may_tear=self._may_tear, known=known)
            self._triangles = [take.triangles_at(int(rows[-1])) for take in takes]
        self._finite.append(finite)


class GrowingRecording:
    """Sends all layers of `cape.record` to a stream.

    Attributes:
        blueprint: the layout that the recording opens with.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        scene: Scene,
        track: BoneTrack,
        *,
        left_out: Collection[str] = (),
        surfaces: Sequence[LinkSurface] = (),
        skin: Skin | None = None,
        notes: str | None = None,
    ) -> None:
        """Send the whole motion with its colliders and its ground.

        Args:
            stream: where to.
            scene: what is going to be simulated.
            track: the motion.
            left_out: names of colliders that the cloth can't reach.
            surfaces: meshes that the bones carry.
            skin: mesh that the bones move.
            notes: path of an entity with text, that the layout is to show; None for none.

        Raises:
            ValueRangeError: no frame of the motion is finite.
        """
        asked, skin = with_surfaces(LAYERS, surfaces), skin or track.skin
        entities = entities_of(parts_of("cape", scene.cloth))
        self._cloth = GrowingCloth(stream, asked, entities, may_tear=scene.tearing is not None)
        frames = finite_frames("the motion", track)
        colliders = drawable(scene.colliders)
        height = figure_height(track, frames, surfaces, skin)
        linings = {cloth.path: cloth.look.lining for cloth in entities}
        self.blueprint: rrb.Blueprint = layout(
            asked, height, colliders, linings=linings, notes=notes, skinned=skin is not None
        )
        thicknesses = [scene.thickness if c.thickness is None else c.thickness for c in colliders]
        log_figure(
            stream, asked, track, colliders, thicknesses, frames, left_out=left_out, surfaces=surfaces, skin=skin
        )

    def add(self, done: int, so_far: SoFar) -> None:
        """Send what is new of so many frames of a run; one with a position that isn't finite is left out."""
        if done > self._cloth.sent:
            self._cloth.add(so_far(self._cloth.sent))


class GrowingFile:
    """A recording in a file, whose cloth is written while it is simulated: chunk by chunk, and who moves at the end.

    Of a loop, whose frames are known at the end only, all is written then, in the same chunks.

    Attributes:
        full: why it ends before the run does, a sentence; None while it need not.
    """

    def __init__(
        self,
        file: RecordingFile,
        asked: Collection[str],
        surfaces: Sequence[LinkSurface],
        skin: Skin | None,
        *,
        cloth: Callable[[], GrowingCloth],
        frame_bytes: int,
        figure_bytes: int,
    ) -> None:
        """A file in which nothing is yet.

        Args:
            file: that is open.
            asked: layers.
            surfaces: meshes that the bones carry.
            skin: mesh that the bones move.
            cloth: begins to send one to the file.
            frame_bytes: what a frame of the cloth takes while it is whole, but for its contacts.
            figure_bytes: what a frame of all else takes, at most.
        """
        self._file, self._asked, self._surfaces, self._skin, self._begin = file, asked, surfaces, skin, cloth
        self._frame_bytes, self._figure_bytes = frame_bytes, figure_bytes
        self._sent = 0
        self.full: str | None = None

    @cached_property
    def _cloth(self) -> GrowingCloth:
        return self._begin()

    def note(self, done: int, so_far: SoFar) -> None:
        """Take notice of frames that are done, as the `on_frame` of `cape.simulate`.

        Raises:
            StopRun: there is no room for more.
            FileError: the file can't be written.
        """
        if self._frame_bytes * (done - self._sent) >= BYTES_PER_CHUNK:
            self._write(so_far(self._sent))
        if self.full is not None:
            raise StopRun(self.full)

    def finish(self, take: Take) -> None:
        """Write what is left of the cloth of a run that has ended in a take, and who moves, as far as the cloth goes.

        Raises:
            ValueRangeError: no frame is finite.
            FileError: the file can't be written, or has no room for any frame.
        """
        together, frames = max(1, BYTES_PER_CHUNK // self._frame_bytes), len(take.positions)
        while self.full is None and self._sent < frames:
            self._write(take.part(self._sent, min(self._sent + together, frames)))
        if not self._sent:
            raise FileError(f"can't write {self._file.path}: {self.full}")
        worn = worn_of([take])
        bones = worn.bones.first(self._sent)
        log_figure(
            self._file.stream, self._asked, bones, worn.colliders, worn.thicknesses,
            frames_of(take.name, self._cloth.finite, bones), left_out=worn.left_out,
            travel=worn.travel if self.full is None else None, surfaces=self._surfaces, skin=self._skin,
        )  # fmt: skip

    def _write(self, part: Take) -> None:
        """Write the frames of a take that begins where those before have ended, or as many as there is room for."""
        self._file.check()
        room, frames = self._file.room, len(part.positions)
        while frames and self._needed(part, frames) > room:
            frames //= 2
        if frames:
            self._cloth.add(part.part(0, frames))
            self._sent = self._cloth.sent
        if frames < len(part.positions):
            self.full = f"{room / 1e6:.3g} MB are free, too little for more than {self._sent} frames"

    def _needed(self, part: Take, frames: int) -> int:
        """What so many of the first frames of a take need, and all that is still to come but for more of them."""
        contacts = 0 if part.contacts is None else int(part.contacts.starts[frames] - part.contacts.starts[0])
        needed = self._frame_bytes * frames + BYTES_PER_CONTACT * contacts + OVERHEAD
        needed += self._figure_bytes * (self._sent + frames)
        if part.tears:
            needed += BYTES_PER_VERTEX * part.positions.shape[1] * frames
            shapes = [each for each in part.topologies if each.frame < frames]
            needed += sum(each.triangles.nbytes + BYTES_PER_TEXCOORD * len(each.parents) for each in shapes)
        return needed


@contextmanager
def growing_file(
    path: str | os.PathLike[str],
    scene: Scene,
    track: BoneTrack,
    *,
    name: str,
    layers: Iterable[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    skin: Skin | None = None,
    tab: str = "cape",
    whole: bool = True,
) -> Iterator[GrowingFile]:
    """Open a recording of what is going to be simulated, which holds in the end what `cape.record.save` writes.

    It takes its name when the block ends, and vanishes when the block fails.

    Args:
        path: the recording.
        scene: what is simulated.
        track: the motion.
        name: of the take.
        layers: which of `LAYERS` to write, None for all.
        surfaces: meshes that the bones carry.
        skin: mesh that the bones move, drawn in place of a body by proportions; None for the bones' own, if any.
        tab: "cape" or "hitboxes", which of the two the viewer shows first.
        whole: begin only where there is room for all frames.

    Raises:
        MissingPackageError: rerun-sdk isn't installed.
        UnknownNameError: a layer doesn't exist.
        FileError: the file can't be written.
    """
    require_recorder()
    asked = with_surfaces(check_layers(layers), surfaces)
    skin = (skin or track.skin) if "body" in asked else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # told at the end, when they are in the recording
        colliders, frames = drawable(scene.colliders), finite_frames(name, track)
    parts = parts_of(name, scene.cloth)

    def opening() -> tuple[str, rrb.Blueprint]:
        linings = {
            entity.path: None if cloth.textures is not None else entity.look.lining
            for entity, (_, cloth) in zip(entities_of(parts), parts, strict=True)
        }
        height = figure_height(track, frames, surfaces if "robot" in asked else (), skin)
        return cloth_layout(asked, linings, colliders=colliders, tab=tab, skinned=skin is not None, height=height)

    drawn = sum(cloth.vertices if cloth.visual is None else len(cloth.visual.corners) for _, cloth in parts)
    each = BYTES_PER_VERTEX * drawn if "cape" in asked else BYTES_PER_BONE
    with recording_file(
        path, name=" and ".join(name for name, _ in parts), opening=opening,
        size=OVERHEAD + each * track.frames + skin_size(skin, track.frames) if whole else 0,
    ) as file:  # fmt: skip

        def cloth() -> GrowingCloth:
            return GrowingCloth(file.stream, asked, entities_of(parts), may_tear=scene.tearing is not None)

        figure = BYTES_PER_BONE * (len(track.names) + len(colliders)) + skin_size(skin, 1)
        yield GrowingFile(file, asked, surfaces, skin, cloth=cloth, frame_bytes=each, figure_bytes=figure)
