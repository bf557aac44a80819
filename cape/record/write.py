"""Takes and characters to recording files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cape.colliders import Collider
from cape.record.blueprint import layout
from cape.record.contacts import BYTES_PER_CONTACT, log_contacts
from cape.record.file import recording_file
from cape.record.frames import Frames
from cape.record.layers import check_layers, log_cape, log_plots, log_skeleton
from cape.record.robot import log_robot
from cape.record.solids import log_hitboxes, log_shells
from cape.record.stage import log_character, log_floor, skeleton_height
from cape.scene import Scene
from motions.errors import ValueRangeError
from skeleton.geometry import LinkSurface
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    from cape.take import Take

BODY_LAYERS = ("robot", "skeleton", "hitboxes", "shells", "floor")
OVERHEAD = 4_000_000  # [bytes], more than all but the cloth takes in some minutes of motion


def save(
    take: Take,
    path: str | os.PathLike[str],
    *,
    layers: Iterable[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    tab: str = "cape",
) -> None:
    """Write a take as a recording for the Rerun viewer.

    Frames with a position that isn't finite are left out, with a warning. The file takes its name when it is complete;
    until then one that is there stays as it is.

    Args:
        take: what to write.
        path: the recording, by custom with the suffix .rrd.
        layers: which of `LAYERS` to write, None for all.
        surfaces: meshes that the bones carry, such as a robot's `skeleton.link_surfaces(body, "visual")`.
        tab: "cape" or "hitboxes", which of the two the viewer shows first.

    Raises:
        UnknownNameError: a layer, or a bone that a collider names, doesn't exist.
        ValueRangeError: no frame is finite.
        FileError: the file can't be written.
    """
    asked = _with_surfaces(check_layers(layers), surfaces)
    frames = _finite_frames(take.name, take.bones, take.positions)
    size = OVERHEAD + (2 * take.positions.nbytes if "cape" in asked else 0)
    if take.contacts is not None and "contacts" in asked:
        size += BYTES_PER_CONTACT * len(take.contacts.points)
    blueprint = layout(asked, skeleton_height(take.bones, frames), take.colliders, tab=tab)
    # The viewer keeps a layout for each application.
    application = "cape" if tab == "cape" else f"cape {tab}"
    with recording_file(path, application=application, name=take.name, blueprint=blueprint, size=size) as stream:
        log_character(stream, take.bones, frames)
        if "cape" in asked:
            log_cape(stream, take, frames)
        if "robot" in asked:
            log_robot(stream, take.bones, surfaces, frames)
        if "skeleton" in asked:
            log_skeleton(stream, take.bones, frames)
        if "hitboxes" in asked:
            log_hitboxes(stream, take.bones, take.colliders, frames, take.left_out)
        if "shells" in asked:
            log_shells(stream, take.bones, take.colliders, take.thicknesses, frames)
        if "contacts" in asked and take.contacts is not None:
            log_contacts(stream, take.contacts, take.colliders, take.thicknesses, frames)
        if "floor" in asked:
            log_floor(stream, take.bones, take.colliders, frames)
        if "plots" in asked:
            log_plots(stream, take, frames)


def save_hitboxes(
    bones: BoneTrack,
    colliders: Sequence[Collider],
    path: str | os.PathLike[str],
    *,
    name: str = "hitboxes",
    layers: Iterable[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    left_out: Collection[str] = (),
    thickness: float = Scene.thickness,
) -> None:
    """Write a moving skeleton and its colliders, without any cloth, as a recording for the Rerun viewer.

    Args:
        bones: the character's poses.
        colliders: what to draw around the bones.
        path: the recording, by custom with the suffix .rrd.
        name: what the viewer calls the recording.
        layers: which of "robot", "skeleton", "hitboxes", "shells" and "floor" to write, None for all.
        surfaces: meshes that the bones carry, such as a robot's `skeleton.link_surfaces(body, "visual")`.
        left_out: names of the colliders to mark as left out.
        thickness: of the colliders that have none of their own [m].

    Raises:
        UnknownNameError: a layer, or a bone that a collider names, doesn't exist.
        ValueRangeError: no frame is finite.
        FileError: the file can't be written.
    """
    asked = _with_surfaces(check_layers(layers, BODY_LAYERS), surfaces)
    frames = _finite_frames(name, bones)
    blueprint = layout(asked, skeleton_height(bones, frames), colliders, tab="hitboxes")
    with recording_file(path, application="cape hitboxes", name=name, blueprint=blueprint, size=OVERHEAD) as stream:
        log_character(stream, bones, frames)
        if "robot" in asked:
            log_robot(stream, bones, surfaces, frames)
        if "skeleton" in asked:
            log_skeleton(stream, bones, frames)
        if "hitboxes" in asked:
            log_hitboxes(stream, bones, colliders, frames, left_out)
        if "shells" in asked:
            thicknesses = [thickness if c.thickness is None else c.thickness for c in colliders]
            log_shells(stream, bones, colliders, thicknesses, frames)
        if "floor" in asked:
            log_floor(stream, bones, colliders, frames)


def _with_surfaces(asked: Sequence[str], surfaces: Sequence[LinkSurface]) -> tuple[str, ...]:
    """The asked layers, without the robot's where there is nothing to draw."""
    return tuple(layer for layer in asked if layer != "robot" or surfaces)


def _finite_frames(name: str, bones: BoneTrack, positions: np.ndarray | None = None) -> Frames:
    """The frames in which all positions are finite; warns of the others."""
    finite = np.ones(len(bones.times), bool)
    for values in (bones.positions, bones.rotations_wxyz, positions):
        if values is not None:
            finite &= np.isfinite(values).all(axis=(1, 2))
    if not finite.any():
        raise ValueRangeError(f"nothing to record: none of the {len(finite)} frames of {name!r} is finite")
    if not finite.all():
        bad = np.flatnonzero(~finite)
        warnings.warn(
            f"left {len(bad)} of {len(finite)} frames out of the recording of {name!r}: "
            f"positions aren't finite from frame {bad[0]}",
            stacklevel=3,
        )
    return Frames(np.flatnonzero(finite), bones.times[finite])
