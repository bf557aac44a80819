"""Takes and characters to recording files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.looks.look import Color
from cape.outfits.apart import takes_apart
from cape.record.blueprint import layout
from cape.record.contacts import BYTES_PER_CONTACT, log_contacts
from cape.record.figure.body import log_body
from cape.record.figure.clasp import log_clasp
from cape.record.figure.robot import log_robot
from cape.record.figure.skin import log_skin
from cape.record.files.recording import recording_file
from cape.record.frames import Frames
from cape.record.layers import check_layers, log_cape, log_plots, log_skeleton
from cape.record.solids import drawable, log_hitboxes, log_shells
from cape.record.stage import figure_height, log_character, log_floor
from cape.record.worn import ClothEntity, worn_of
from cape.results.kept import blocks
from cape.results.take import Take
from cape.scene.colliders import Collider
from cape.scene.loops import Travel
from cape.scene.scene import Scene
from motions.errors import ValueRangeError, require_package
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

BODY_LAYERS = ("robot", "skeleton", "hitboxes", "shells", "floor")
OVERHEAD = 4_000_000  # [bytes], more than all but the cloth takes in some minutes of motion


def save(
    take: Take | Sequence[Take],
    path: str | os.PathLike[str],
    *,
    layers: Iterable[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    skin: Skin | None = None,
    tab: str = "cape",
) -> None:
    """Write a take, or several of one motion, as a recording for the Rerun viewer.

    Frames with a position that isn't finite are left out, with a warning. The file takes its name when it is complete;
    until then one that is there stays as it is. Of garments that are worn together each is a cloth of its own.

    Args:
        take: what to write; or takes of different names, of cloths that hang on the same bones. These end with the
            shortest of them. Of colliders with one name the first is drawn.
        path: the recording, by custom with the suffix .rrd.
        layers: which of `LAYERS` to write, None for all.
        surfaces: meshes that the bones carry, such as a robot's `skeleton.link_surfaces(body, "visual")`.
        skin: mesh that the bones move, drawn in place of a body by proportions; None for the bones' own, if any.
        tab: "cape" or "hitboxes", which of the two the viewer shows first.

    Raises:
        MissingPackageError: rerun-sdk isn't installed.
        UnknownNameError: a layer, or a bone that a collider names, doesn't exist.
        ValueRangeError: no frame is finite, or the takes share a name or differ in their bones' motion.
        FileError: the file can't be written.
    """
    require_recorder()
    recording = recording_of(take, layers=layers, surfaces=surfaces, skin=skin, tab=tab)
    with recording_file(
        path, name=recording.name, opening=lambda: (recording.application, recording.blueprint), size=recording.size
    ) as file:
        recording.log(file.stream)


class Recording(NamedTuple):
    """Takes as they are to be recorded, wherever to.

    Attributes:
        application: Rerun's application id, under which the viewer keeps its layout.
        name: what the viewer calls it.
        blueprint: the layout that it opens with.
        size: how large it will be, roughly [bytes].
        log: sends all of it to a stream.
    """

    application: str
    name: str
    blueprint: rrb.Blueprint
    size: int
    log: Callable[[rr.RecordingStream], None]


def recording_of(
    take: Take | Sequence[Take],
    *,
    layers: Iterable[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    skin: Skin | None = None,
    tab: str = "cape",
) -> Recording:
    """What `save` writes, to go wherever a stream does; arguments and errors are the same."""
    asked = with_surfaces(check_layers(layers), surfaces)
    worn = worn_of([part for one in ([take] if isinstance(take, Take) else take) for part in takes_apart(one)])
    frames = finite_frames(worn.name, worn.bones, worn.positions)
    size = OVERHEAD + (sum(2 * each.nbytes for each in worn.positions) if "cape" in asked else 0)
    if "contacts" in asked:
        size += BYTES_PER_CONTACT * sum(len(one.contacts.points) for one in worn.takes if one.contacts is not None)
    skin = (skin or worn.bones.skin) if "body" in asked else None
    size += skin_size(skin, len(frames.numbers))
    height = figure_height(worn.bones, frames, surfaces if "robot" in asked else (), skin)
    linings = {
        cloth.path: None if one.cloth is not None and one.cloth.textures is not None else cloth.look.lining
        for one, cloth in zip(worn.takes, worn.cloths, strict=True)
    }
    application, blueprint = cloth_layout(
        asked, linings, height=height, colliders=worn.colliders, tab=tab, skinned=skin is not None
    )

    def log(stream: rr.RecordingStream) -> None:
        for one, cloth in zip(worn.takes, worn.cloths, strict=True):
            log_cloth(stream, asked, one, cloth, frames)
        log_figure(
            stream, asked, worn.bones, worn.colliders, worn.thicknesses, frames, left_out=worn.left_out,
            travel=worn.travel, surfaces=surfaces, skin=skin,
        )  # fmt: skip

    return Recording(application, worn.name, blueprint, size, log)


def save_hitboxes(
    bones: BoneTrack,
    colliders: Sequence[Collider],
    path: str | os.PathLike[str],
    *,
    name: str = "hitboxes",
    layers: Iterable[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    skin: Skin | None = None,
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
        skin: mesh that the bones move, in the layer "body"; None for the bones' own, if any.
        left_out: names of the colliders to mark as left out.
        thickness: of the colliders that have none of their own [m].

    Raises:
        MissingPackageError: rerun-sdk isn't installed.
        UnknownNameError: a layer, or a bone that a collider names, doesn't exist.
        ValueRangeError: no frame is finite.
        FileError: the file can't be written.
    """
    require_recorder()
    skin = skin or bones.skin
    asked = with_surfaces(check_layers(layers, BODY_LAYERS if skin is None else (*BODY_LAYERS, "body")), surfaces)
    frames = finite_frames(name, bones)
    colliders = drawable(colliders)
    thicknesses = [thickness if c.thickness is None else c.thickness for c in colliders]
    skin = skin if "body" in asked else None
    blueprint = layout(asked, figure_height(bones, frames, surfaces, skin), colliders, tab="hitboxes")
    size = OVERHEAD + skin_size(skin, len(frames.numbers))
    with recording_file(path, name=name, opening=lambda: ("cape hitboxes", blueprint), size=size) as file:
        log_figure(
            file.stream, asked, bones, colliders, thicknesses, frames, left_out=left_out, surfaces=surfaces, skin=skin
        )


def cloth_layout(
    asked: Collection[str],
    linings: Mapping[str, Color | None],
    *,
    height: float,
    colliders: Sequence[Collider],
    tab: str,
    skinned: bool,
) -> tuple[str, rrb.Blueprint]:
    """The application id and the layout of a recording of cloths.

    Args:
        asked: layers.
        linings: colours of the cloths' insides by the cloths' paths, None for that of the outside.
        height: of the figure [m].
        colliders: as far as they are drawn.
        tab: which is in front.
        skinned: whether a mesh that the bones move is drawn.
    """
    # The viewer keeps a layout for each application.
    application = " ".join(["cape"] + ([tab] if tab != "cape" else []) + (["cloths"] if len(linings) > 1 else []))
    return application, layout(asked, height, colliders, tab=tab, linings=linings, skinned=skinned)


def log_cloth(
    stream: rr.RecordingStream,
    asked: Collection[str],
    take: Take,
    cloth: ClothEntity,
    frames: Frames,
    *,
    may_tear: bool = False,
    known: NDArray[np.int32] | None = None,
) -> None:
    """Put what is known of a cloth when it has been simulated on its paths, of the asked layers.

    `may_tear` and `known` are those of `log_cape`.
    """
    if "cape" in asked:
        log_cape(stream, take, frames, path=cloth.path, look=cloth.look, may_tear=may_tear, known=known)
        log_clasp(stream, take, frames, path=cloth.clasp)
    if "contacts" in asked and take.contacts is not None:
        log_contacts(stream, take.contacts, take.colliders, take.thicknesses, frames, path=cloth.contacts)
    if "plots" in asked:
        log_plots(stream, take, frames, cloth=cloth.name, cloth_color=cloth.look.color)


def log_figure(
    stream: rr.RecordingStream,
    asked: Collection[str],
    bones: BoneTrack,
    colliders: Sequence[Collider],
    thicknesses: Sequence[float] | NDArray[np.float64],
    frames: Frames,
    *,
    left_out: Collection[str] = (),
    travel: Travel | None = None,
    surfaces: Sequence[LinkSurface] = (),
    skin: Skin | None = None,
) -> None:
    """Put what is known before any simulation on its paths: who moves, around what, and on which ground.

    Args:
        stream: where to.
        asked: layers.
        bones: the motion.
        colliders: as far as they are drawn.
        thicknesses: at which each stops cloth [m].
        frames: of the motion, that are sent.
        left_out: names of colliders that no cloth reaches.
        travel: how far the motion gets in a round, where it loops.
        surfaces: meshes that the bones carry.
        skin: mesh that the bones move, in place of a body.
    """
    log_character(stream, bones, frames, travel)
    if "robot" in asked:
        log_robot(stream, bones, surfaces, frames)
    if "body" in asked and skin is not None:
        log_skin(stream, bones, skin, frames)
    elif "body" in asked:
        log_body(stream, bones, colliders, frames)
    if "skeleton" in asked:
        log_skeleton(stream, bones, frames)
    if "hitboxes" in asked:
        log_hitboxes(stream, bones, colliders, frames, left_out)
    if "shells" in asked:
        log_shells(stream, bones, colliders, thicknesses, frames)
    if "floor" in asked:
        log_floor(stream, bones, colliders, frames, travel)


def require_recorder() -> None:
    """Check that what writes recordings is installed.

    Raises:
        MissingPackageError: it isn't.
    """
    require_package("rerun", "a recording", instead="-o NAME.npz, take.keep and exports need nothing")


def skin_size(skin: Skin | None, frames: int) -> int:
    """About how many bytes a mesh takes in so many frames: places and normals."""
    return 0 if skin is None else 24 * skin.vertices * frames


def with_surfaces(asked: Sequence[str], surfaces: Sequence[LinkSurface]) -> tuple[str, ...]:
    """The asked layers, without the robot's where there is nothing to draw, or the body's where there is a robot."""
    return tuple(layer for layer in asked if layer != ("body" if surfaces else "robot"))


def finite_frames(name: str, bones: BoneTrack, positions: Sequence[np.ndarray] = ()) -> Frames:
    """The frames in which all positions are finite; warns of the others."""
    finite = np.ones(len(bones.times), bool)
    for values in (bones.positions, bones.rotations_wxyz, *positions):
        for block in blocks(values):
            finite[block] &= np.isfinite(values[block]).all(axis=(1, 2))
    return frames_of(name, finite, bones)


def frames_of(name: str, finite: NDArray[np.bool_], bones: BoneTrack) -> Frames:
    """The frames that are finite, of F; warns of the others."""
    if not finite.any():
        raise ValueRangeError(f"nothing to record: none of the {len(finite)} frames of {name!r} is finite")
    if not finite.all():
        bad = np.flatnonzero(~finite)
        warnings.warn(
            f"left {len(bad)} of {len(finite)} frames out of the recording of {name!r}: "
            f"positions aren't finite from frame {bad[0]}",
            stacklevel=4,
        )
    return Frames(np.flatnonzero(finite), bones.times[finite])
