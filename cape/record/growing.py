"""A recording that grows as a cloth is simulated: who moves is sent at once, the cloth frame by frame."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cape.record.blueprint import layout
from cape.record.frames import Frames
from cape.record.layers import LAYERS
from cape.record.solids import drawable
from cape.record.stage import figure_height
from cape.record.worn import ClothEntity, entities_of
from cape.record.write import finite_frames, log_cloth, log_figure, with_surfaces
from cape.results.take import Take
from cape.scene.scene import Scene
from motions.skin import Skin
from skeleton.robot.link_surfaces import LinkSurface
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb


class GrowingRecording:
    """Sends all layers of `cape.record` to a stream.

    Attributes:
        blueprint: the layout that the recording opens with.
        sent: how many frames of the cloth have been gone through.
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
        self._stream, self._asked = stream, with_surfaces(LAYERS, surfaces)
        self.sent = 0
        self._cloth: ClothEntity | None = None
        frames = finite_frames("the motion", track)
        colliders = drawable(scene.colliders)
        height = figure_height(track, frames, surfaces, skin)
        linings = {cloth.path: cloth.look.lining for cloth in entities_of([("cape", scene.cloth)])}
        self.blueprint: rrb.Blueprint = layout(
            self._asked, height, colliders, linings=linings, notes=notes, skinned=skin is not None
        )
        thicknesses = [scene.thickness if c.thickness is None else c.thickness for c in colliders]
        log_figure(
            stream, self._asked, track, colliders, thicknesses, frames, left_out=left_out, surfaces=surfaces, skin=skin
        )

    def add(self, take: Take) -> None:
        """Send those of a take's frames that are new; one with a position that isn't finite is left out."""
        new = np.arange(self.sent, len(take.positions))
        numbers = new[np.isfinite(take.positions[self.sent :]).all(axis=(1, 2))]
        self.sent = len(take.positions)
        if not len(numbers):
            return
        begins = self._cloth is None
        if self._cloth is None:
            self._cloth = entities_of([(take.name, take.cloth)])[0]
        frames = Frames(numbers, take.bones.times[numbers], begins=begins)
        log_cloth(self._stream, self._asked, take, self._cloth, frames)
