"""The layers of a recording: what each puts on its entities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.looks.look import Color, Look
from cape.cloth.looks.registry import LOOKS
from cape.record.frames import Frames, send_once
from cape.record.surfaces.drawn import drawn_of, texture_drawn
from cape.record.surfaces.textures import albedo
from cape.results.kept import let_go
from motions.errors import UnknownNameError
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

    from cape.results.take import Take

FloatArray = NDArray[np.float64]

LAYERS = ("cape", "robot", "body", "skeleton", "hitboxes", "shells", "contacts", "floor", "plots")
BONE_COLOR = (225, 230, 238)
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


def log_cape(
    stream: rr.RecordingStream,
    take: Take,
    frames: Frames,
    *,
    path: str = "/world/cape",
    look: Look = LOOKS["cape"],
) -> None:
    """Put the cloth on its path: the texture of its outside on both sides; the blueprint draws the lining."""
    import rerun as rr

    drawn = drawn_of(take)
    changes = {} if take.tears == 0 else {t.frame: t.triangles for t in take.topologies}
    if frames.begins:
        always = {} if changes else {"triangle_indices": drawn.triangles}
        mesh = {"vertex_texcoords": drawn.texcoords, **always, **albedo(texture_drawn(take, look))}
        send_once(stream, path, rr.Mesh3D.from_fields(**mesh))
    for block in frames.blocks(2 * 12 * drawn.vertices):
        numbers = frames.numbers[block]
        found = take.positions[numbers]
        parts = [drawn.at(found[same], triangles) for triangles, same in _alike(take, numbers)]
        positions, normals = (np.concatenate(each) for each in zip(*parts, strict=True))
        frames.send(stream, path, rr.Mesh3D, {"vertex_positions": positions, "vertex_normals": normals}, block=block)
        let_go(take.positions)
    for first, triangles in changes.items():
        later = np.searchsorted(frames.numbers, first)
        if later < len(frames.numbers):
            frames.send(stream, path, rr.Mesh3D, {"triangle_indices": triangles[None]}, block=slice(later, later + 1))


def _alike(take: Take, numbers: NDArray[np.int64]) -> list[tuple[NDArray[np.int32], slice]]:
    """The triangles of frames with increasing numbers, and which of these have the same."""
    starts = [int(np.searchsorted(numbers, topology.frame)) for topology in take.topologies] or [0]
    triangles = [topology.triangles for topology in take.topologies] or [take.triangles]
    ends = [*starts[1:], len(numbers)]
    return [(one, slice(start, end)) for one, start, end in zip(triangles, starts, ends, strict=True) if end > start]


def log_skeleton(stream: rr.RecordingStream, bones: BoneTrack, frames: Frames) -> None:
    """Put a line from each bone's parent to the bone on `/world/skeleton`."""
    import rerun as rr

    links = drawn_links(bones)
    if frames.begins:
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


def log_plots(
    stream: rr.RecordingStream,
    take: Take,
    frames: Frames,
    *,
    cloth: str | None = None,
    cloth_color: Color = LOOKS["cape"].color,
) -> None:
    """Put the curves of a take under `/plots`; of one of several cloths below its name, in its colour."""
    import rerun as rr

    curves: list[tuple[str, str, tuple[int, int, int], Any]] = [
        ("stretch", "largest stretch [%]", (240, 80, 100), take.stretch_max * 100),
        ("penetration", "deepest penetration [mm]", (255, 180, 70), take.penetration * 1000),
        ("kinetic_energy", "kinetic energy [J]", (100, 180, 255), take.kinetic_energy),
    ]
    for entity, name, color, values in curves:
        path = rr.new_entity_path(["plots", entity] + ([] if cloth is None else [cloth]))
        shown = {"names": name, "colors": color} if cloth is None else {"names": cloth, "colors": cloth_color}
        if frames.begins:
            send_once(stream, path, rr.SeriesLines(**shown, widths=2.0))
        frames.send(stream, path, rr.Scalars, {"scalars": values[frames.numbers][:, None]})
