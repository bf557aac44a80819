"""The layers of a recording: what each puts on its entities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.looks.look import Color, Look
from cape.cloth.looks.registry import LOOKS
from cape.record.frames import Frames, send_once
from cape.record.surfaces.drawn import Drawn, drawn_of, texture_drawn
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
    may_tear: bool = False,
    known: NDArray[np.int32] | None = None,
) -> None:
    """Put the cloth on its path: the texture of its outside on both sides; the blueprint draws the lining.

    Triangles hold at all times, but of a cloth that tears, or may do so in frames to come: these are sent where they
    change. `known` are those that the frames before have ended with.
    """
    import rerun as rr

    changing, stages = may_tear or take.tears > 0, _stages(take, frames.numbers)
    if frames.begins:
        always = {} if changing else _shape(stages[0].drawn)
        send_once(stream, path, rr.Mesh3D.from_fields(**always, **albedo(texture_drawn(take, look))))
    for stage in stages if changing else []:
        if stage.triangles is not known:
            columns = {name: values[None] for name, values in _shape(stage.drawn).items()}
            frames.send(stream, path, rr.Mesh3D, columns, block=slice(stage.first, stage.first + 1))
    for block in frames.blocks(2 * 12 * max(stage.drawn.vertices for stage in stages)):
        found, counts = [], []
        for stage in stages:
            numbers = frames.numbers[max(block.start, stage.first) : min(block.stop, stage.end)]
            if len(numbers):
                found.append([each.reshape(-1, 3) for each in stage.drawn.at(take.positions[numbers])])
                counts += [stage.drawn.vertices] * len(numbers)
        positions, normals = (np.concatenate(each) for each in zip(*found, strict=True))
        columns = {"vertex_positions": positions, "vertex_normals": normals}
        frames.send(stream, path, rr.Mesh3D, columns, block=block, counts=np.array(counts))
        let_go(take.positions)


class _Stage(NamedTuple):
    """What is drawn from one of the frames that are sent up to another, for which triangles of the cloth."""

    triangles: NDArray[np.int32]
    drawn: Drawn
    first: int
    end: int


def _stages(take: Take, numbers: NDArray[np.int64]) -> list[_Stage]:
    """What is drawn in frames with increasing numbers, one after the other."""
    if not take.tears:
        return [_Stage(take.triangles, drawn_of(take), 0, len(numbers))]
    starts = [int(np.searchsorted(numbers, topology.frame)) for topology in take.topologies]
    spans = zip(take.topologies, starts, [*starts[1:], len(numbers)], strict=True)
    return [_Stage(t.triangles, drawn_of(take, t), first, end) for t, first, end in spans if end > first]


def _shape(drawn: Drawn) -> dict[str, NDArray[Any]]:
    """The components of what is drawn that stay as long as its triangles do."""
    return {"triangle_indices": drawn.triangles, "vertex_texcoords": drawn.texcoords}


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
