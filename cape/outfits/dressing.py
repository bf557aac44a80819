"""Several garments put on a body, one over the other: each comes to rest around those below it, then they meet.

Each is fitted to a body that is as much thicker as there are garments below it. While it is put on, boxes around these
keep it off them, band for band; what hangs wider than its waistband is gathered first, see `girding`. So it lies
outside of all that is below it when they are made one cloth, whose layers self-contact keeps apart from then on, as it
began: on which side of a cloth another one is never changes.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.garments.registry import garment
from cape.measure.self_crossings import self_crossings
from cape.outfits.combined import Outfit, Part, combined, started_at
from cape.outfits.girding import WAIST, Band, bulges, gathered, hangs_out, upright_box
from cape.run.simulation import Simulation
from cape.run.whereabouts import Diverged
from cape.scene.colliders import Box, Ellipsoid
from cape.scene.dress import dress, fabric_of_each
from cape.scene.holding.attachments import Attachment
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from cape.scene.self_contact import SelfContact
from motions import quaternions
from motions.errors import ValueRangeError
from skeleton.shapes import Bounded
from skeleton.solid_measures import signed_distance
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    from skeleton.model import Skeleton

FloatArray = NDArray[np.float64]

ROOM = 0.008  # m from a garment to the one below it as it is put on: more than layers are kept apart
GATHERED = 2  # times as much of it, where one is gathered below a band
MOST = 5  # garments
STAGES = 12  # in which boxes widen
STAGE, LAST = 0.1, 0.5  # s that a cloth is given to settle in each, and in the last
DEEP = 0.02  # m in boxes, from which on these fling a cloth out, or through those below: a tabard starts 3 cm deep
BAND = 0.06  # m that a box around a garment is high; where what is outside of it is held there is none


def dress_in(body: "Skeleton", track: BoneTrack, garments: Sequence[str], **options: Any) -> Scene:
    """Put several garments on a body, and build the scene in which they meet.

    Args:
        body: the character.
        track: its motion, of all bones.
        garments: which of `GARMENTS`, the outermost first: a cape, over a skirt.
        options: as of `dress`; length, flare and hold are those of the outermost, self-contact is always on.

    Returns:
        The scene of an `Outfit`, which starts as its parts have come to rest at the first frame.

    Raises:
        ValueRangeError: garments are none, too many or worn twice, or one cannot be put on over the others.
        UnknownNameError: as of `dress`.
    """
    if not 0 < len(garments) <= MOST or len(set(garments)) < len(garments):
        raise ValueRangeError(f"garments are 1 to {MOST}, each worn once, not {', '.join(garments) or 'none'}")
    names = tuple(reversed(garments))
    contact = options.pop("self_contact", None)
    contact = contact if isinstance(contact, SelfContact) else SelfContact()
    own = {name: options.pop(name, None) for name in ("length", "flare", "hold")}
    skin = options.pop("colliders", None) or body.capsules()
    fabrics = fabric_of_each(options.pop("fabric", None), garments)
    if options.get("under_arms") is None:
        options["under_arms"] = all(garment(name).under_arms for name in garments)
    tearing, limited = options.pop("tearing", None), options.get("strain_limit")

    def cut(level: int, room: float) -> Scene:
        colliders = [solid.grown(room) if isinstance(solid, Bounded) else solid for solid in skin]
        more = own if level == len(names) - 1 else {}
        return dress(
            body, track, garment=names[level], fabric=fabrics[names[level]], colliders=colliders, self_contact=contact,
            **options, **more,
        )  # fmt: skip

    scenes = [cut(level, level * ROOM) for level in range(len(names))]
    thickness = max(scene.thickness for scene in scenes)
    resting: list[FloatArray] = []
    gathers = False
    for level in range(len(scenes)):
        wider = [inner for inner in range(level) if hangs_out(resting[inner], _bands(scenes[level], track, ROOM))]
        if wider:
            scenes[level], gathers = cut(level, GATHERED * level * ROOM), True
        rounded: list[Ellipsoid] = []
        try:
            for inner in wider:
                (band,) = _bands(scenes[level], track, (GATHERED * level - inner) * ROOM)
                inside, go_on = replace(scenes[inner], thickness=thickness), partial(_go_on, track, STAGE)
                scenes[inner], resting[inner] = gathered(inside, resting[inner], band, track, go_on)
                rounded += bulges(names[inner], resting[inner], band)
            flat = [inner for inner in range(level) if inner not in wider]
            below = [box for inner in flat for box in _stand_in(names[inner], scenes[inner].cloth, resting[inner])]
            heights = _places_held(scenes[level], track)[:, 2]
            around = [box for box in below if not np.any(np.abs(heights - box.center[2]) < BAND)]
            scene = replace(scenes[level], thickness=thickness, colliders=(*scenes[level].colliders, *rounded))
            resting.append(_come_to_rest(scene, around, track))
        except Diverged as error:
            raise _cannot(names[level], names[:level], "it is too narrow") from error
    outfit = combined(names, [scene.cloth for scene in scenes], resting)
    _require_apart(outfit)
    parts = list(zip(outfit.parts, scenes, strict=True))
    worn = replace(
        scenes[0],
        cloth=outfit,
        attachments=[_of_all(held, part, outfit) for part, scene in parts for held in scene.attachments],
        confinements=[
            replace(kept, animated=_of_all(kept.animated, part, outfit))
            for part, scene in parts
            for kept in scene.confinements
        ],
        thickness=thickness,
        dressing=None,
        strain_limit=all(scene.strain_limit for scene in scenes) and outfit.has_threads,
    )
    if gathers:  # what was held together springs out, as far as it may
        worn = replace(worn, cloth=replace(outfit, positions=_settled(worn, track, STAGE)))
    if tearing is None:
        return worn
    return replace(worn, tearing=tearing, strain_limit=worn.strain_limit and bool(limited))


def _of_all(held: Attachment, part: Part, outfit: Outfit) -> Attachment:
    """What holds a part, as it holds the outfit."""
    return replace(held, vertices=held.vertices + part.start, cloth_vertices=outfit.vertices)


def _bands(scene: Scene, track: BoneTrack, room: float) -> list[Band]:
    """The waistband of a garment that has one, which leaves some room [m] to what is below it."""
    if WAIST not in scene.cloth.regions:
        return []
    return [Band(scene.attachments[0].bone, _places_held(scene, track), room)]


def _places_held(scene: Scene, track: BoneTrack) -> FloatArray:
    """Where bones hold vertices at the first frame [m], shape (n, 3)."""
    origins, rotations = track.at(0)
    places = [np.zeros((0, 3))]
    for held in scene.attachments:
        if held.points is not None:
            bone = track.index(held.bone)
            places.append(origins[bone] + quaternions.rotate(rotations[bone], held.points))
    return np.concatenate(places)


def _come_to_rest(scene: Scene, around: Sequence[Box], track: BoneTrack) -> FloatArray:
    """Where the vertices hang at the first frame around boxes [m], shape (V, 3).

    What lies deep in boxes as it is laid out, or is flung out by them, is put on without, and let out by boxes that are
    wider each time.

    Raises:
        Diverged: it can't be let out so far.
    """
    if not around or _deepest(_settled(scene, track, 0.0), around) < DEEP:
        try:
            return _settled(replace(scene, colliders=(*scene.colliders, *around)), track, None)
        except Diverged:
            if not around:
                raise
    places = _settled(scene, track, None)
    for share in np.linspace(0.0, 1.0, STAGES + 1)[1:]:
        narrower = [replace(box, half_sizes=box.half_sizes * [share, share, 1.0]) for box in around]
        kept_off = replace(scene, colliders=(*scene.colliders, *narrower))
        places = _go_on(track, STAGE if share < 1.0 else LAST, kept_off, places)
    return places


def _deepest(places: FloatArray, boxes: Sequence[Box]) -> float:
    """How deep the deepest of some places (V, 3) is in one of the boxes [m], below zero outside of all."""
    return -min(float(signed_distance(box, places).min()) for box in boxes)


def _go_on(track: BoneTrack, settle: float, scene: Scene, places: FloatArray) -> FloatArray:
    """Where the vertices of a cloth that is on get from some places [m] at the first frame in a time [s], (V, 3)."""
    worn = replace(scene, cloth=started_at(scene.cloth, places), dressing=None)
    return _settled(worn, track, settle)


def _settled(scene: Scene, track: BoneTrack, settle: float | None) -> FloatArray:
    """Where the vertices are once they have settled for so long [s] at the first frame [m], shape (V, 3)."""
    simulation = Simulation(scene)
    simulation.start(poses_of(track.first(1), simulation.bones)[0], settle=settle)
    return np.array(simulation.positions, dtype=float)


def _stand_in(name: str, cloth: Cloth, places: FloatArray) -> list[Box]:
    """What others are kept off where a garment is: boxes around what of it is at one height, band for band."""
    if WAIST not in cloth.regions and "belt" not in cloth.regions:
        return []
    low, high = places[:, 2].min(), places[:, 2].max()
    count = max(1, round((high - low) / BAND))
    edges = np.linspace(low, high, count + 1)
    boxes: list[Box] = []
    for bottom, top in pairwise(edges):
        # Of the bands beside it, too, so that what leads from one to the next is inside.
        within = places[(places[:, 2] >= bottom - BAND / 2.0) & (places[:, 2] <= top + BAND / 2.0), :2]
        if not len(within):
            continue
        middle, halves, rotation = upright_box(within)
        boxes.append(
            Box(
                name=f"within {name} at {bottom:.2f} m",
                center=np.append(middle, (bottom + top) / 2.0),
                half_sizes=np.append(halves, (top - bottom) / 2.0),
                rotation_wxyz=rotation,
            )
        )
    return boxes


def _require_apart(outfit: Outfit) -> None:
    """Look whether the parts pass through each other.

    Raises:
        ValueRangeError: two do; self-contact would keep them so.
    """
    starts = [part.start for part in outfit.parts]
    owner = np.searchsorted(starts, outfit.faces[:, 0], side="right") - 1
    pairs = owner[self_crossings(outfit.positions, outfit.triangles)]
    between = pairs[pairs[:, 0] != pairs[:, 1]]
    if len(between):
        inner, outer = sorted(between[0])
        raise _cannot(outfit.parts[outer].name, [outfit.parts[inner].name], "they pass through each other at the start")


def _cannot(outer: str, below: Sequence[str], why: str) -> ValueRangeError:
    over = f" over the {' and the '.join(below)}" if below else ""
    return ValueRangeError(f"the {outer} can't be put on{over}: {why}")
