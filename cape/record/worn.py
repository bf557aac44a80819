"""What a character wears in a recording: one cloth or several, each a take of the same motion."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.cloth.looks.look import Look
from cape.cloth.looks.registry import LOOKS, look_of
from cape.record.solids import drawable
from cape.results.take import Take
from cape.scene.colliders import Collider
from cape.scene.loops import Travel
from motions.errors import ValueRangeError
from skeleton.track import BoneTrack

OTHER_COLORS = ((38, 84, 148), (52, 120, 76), (150, 96, 30), (104, 58, 132))  # of more cloths of one look
SAME = 1e-9  # m and parts of a quaternion by which takes of one motion may differ


@dataclass(frozen=True)
class ClothEntity:
    """Where one cloth stands in a recording.

    Attributes:
        name: of the cloth, None where it is the only one.
        path: of its mesh.
        contacts: path above its contacts.
        clasp: path of what fastens it.
        look: how it is drawn.
    """

    name: str | None
    path: str
    contacts: str
    clasp: str
    look: Look


@dataclass(frozen=True, eq=False)
class Worn:
    """Takes of one motion, all as long as the shortest.

    Attributes:
        name: of the recording.
        takes: one for each cloth.
        cloths: where these stand.
        bones: the motion, F frames.
        positions: of the vertices of each cloth [m], shape (F, V, 3).
        colliders: of all takes, those of one name once, as far as they are drawn.
        thicknesses: at which each stops the cloth [m], shape (C,).
        left_out: names of the colliders that no cloth can reach.
        travel: how far the motion gets in a round, where a take loops; None where none does.
    """

    name: str
    takes: Sequence[Take]
    cloths: Sequence[ClothEntity]
    bones: BoneTrack
    positions: Sequence[NDArray[np.float32]]
    colliders: Sequence[Collider]
    thicknesses: NDArray[np.float64]
    left_out: Collection[str]
    travel: Travel | None


def worn_of(takes: Sequence[Take]) -> Worn:
    """Bring takes together.

    Raises:
        ValueRangeError: there is none, two share a name, or the motions of their bones differ.
    """
    if not takes:
        raise ValueRangeError("there is no take to record")
    names = [take.name for take in takes]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise ValueRangeError(f"takes of one recording need different names; given twice: {', '.join(doubled)}")
    frames = min(len(take.positions) for take in takes)
    bones = takes[0].bones.first(frames)
    for take in takes[1:]:
        _require_same_motion(bones, take.bones.first(frames), takes[0].name, take.name)
    first_of: dict[str, tuple[Collider, float]] = {}
    for take in takes:
        for collider, thickness in zip(take.colliders, take.thicknesses, strict=True):
            first_of.setdefault(collider.name, (collider, float(thickness)))
    drawn = {collider.name for collider in drawable([collider for collider, _ in first_of.values()])}
    first_of = {name: both for name, both in first_of.items() if name in drawn}
    reached = {c.name for take in takes for c in take.colliders if c.name not in take.left_out}
    return Worn(
        name=" and ".join(names),
        takes=takes,
        cloths=entities_of([(take.name, take.cloth) for take in takes]),
        bones=bones,
        positions=[take.positions[:frames] for take in takes],
        colliders=[collider for collider, _ in first_of.values()],
        thicknesses=np.array([thickness for _, thickness in first_of.values()], dtype=float),
        left_out=set(first_of) - reached,
        travel=next((take.loop.travel for take in takes if take.loop is not None), None),
    )


def entities_of(cloths: Sequence[tuple[str, Cloth | None]]) -> list[ClothEntity]:
    """Where cloths stand, from their names and themselves, as far as they are known: a look for each."""
    import rerun as rr

    looks: list[Look] = []
    dyes = cycle(OTHER_COLORS)
    for _, cloth in cloths:
        look = LOOKS["cape"] if cloth is None else look_of(cloth.fabric)
        looks.append(replace(look, color=next(dyes), weft=None) if look in looks else look)
    if len(cloths) == 1:
        return [ClothEntity(None, "/world/cape", "/world/contacts", "/world/clasp", looks[0])]
    entities = []
    for (name, _), look in zip(cloths, looks, strict=True):
        paths = [rr.new_entity_path(["world", kind, name]) for kind in ("cloths", "contacts", "clasps")]
        entities.append(ClothEntity(name, paths[0], paths[1], paths[2], look))
    return entities


def _require_same_motion(first: BoneTrack, other: BoneTrack, name: str, other_name: str) -> None:
    same = first.names == other.names and all(
        np.allclose(a, b, rtol=0.0, atol=SAME)
        for a, b in [
            (first.times, other.times),
            (first.positions, other.positions),
            (first.rotations_wxyz, other.rotations_wxyz),
        ]
    )
    if not same:
        raise ValueRangeError(
            f"the takes {name!r} and {other_name!r} are of different motions: they need one recording each"
        )
