"""From colliders to the records that kernels work on: a line in `KINDS` for each kind of shape."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth import Cloth, MeshCloth, areas
from cape.colliders import Box, Capsule, Collider, Cylinder, Ellipsoid, Plane, Sphere, TaperedCapsule
from cape.kernels import shapes
from cape.kernels.faces import CHUNK, GROUP, SEEN
from cape.kernels.records import Contacts
from cape.kernels.shapes import COLLIDER, Faces, Shapes
from cape.kernels.watch import TILE
from cape.layers import layers_of
from cape.scene import Scene
from motions.errors import UnknownNameError
from skeleton.shapes import Layout

FloatArray = NDArray[np.float64]


KINDS: dict[type[Shapes], tuple[type[Collider], ...]] = {
    shapes.Capsules: (Capsule, Sphere),
    shapes.TaperedCapsules: (TaperedCapsule,),
    shapes.Boxes: (Box,),
    shapes.Planes: (Plane,),
    shapes.Cylinders: (Cylinder,),
    shapes.Ellipsoids: (Ellipsoid,),
}
"""For each kind of record the colliders that become one, in the order in which contact is made."""


STRETCHED = 1.05  # triangles, as they are compared with colliders


def contacts_of(scene: Scene, cloth: Cloth, free: NDArray[np.bool_]) -> tuple[Contacts, tuple[list[int], ...]]:
    """The colliders of a scene by kind, and for each kind their indices into `scene.colliders`.

    `cloth` is the scene's cloth as the solver numbers it, `free` (V,) which of its vertices no bone holds.

    Raises:
        UnknownNameError: a collider has no kind of record.
    """
    known = [collider for kind in KINDS.values() for collider in kind]
    for collider in scene.colliders:
        if type(collider) not in known:
            raise UnknownNameError("kind of contact for the shape", collider.kind(), (c.kind() for c in known))
    groups, orders, faces = [], [], []
    tiles = -(-len(free) // TILE)
    shared = {"spreads": np.zeros((tiles, 3)), "alarm": np.zeros(tiles + 1, dtype=np.int64)}
    for record, kind in _kinds_for(scene).items():
        order = [i for i, collider in enumerate(scene.colliders) if type(collider) in kind]
        if not order:
            continue
        colliders = [scene.colliders[i] for i in order]
        layouts = [collider.layout() for collider in colliders]
        group = _group(record, scene, colliders, layouts, shared)
        groups.append(group)
        orders.append(order)
        if (found := _faces(group, layouts, cloth)) is not None:
            faces.append(found)
    layers = layers_of(scene, cloth, **shared)
    pressure = None if layers is None else layers.pressure
    return Contacts(free, tuple(groups) or None, tuple(faces) or None, layers, pressure), tuple(orders)


def _kinds_for(scene: Scene) -> dict[type[Shapes], tuple[type[Collider], ...]]:
    """`KINDS`; where there are tapered capsules, all round colliders are records of theirs.

    Only colliders of one kind see that they pinch cloth between them.
    """
    if not any(isinstance(collider, TaperedCapsule) for collider in scene.colliders):
        return KINDS
    round_ones = KINDS[shapes.Capsules] + KINDS[shapes.TaperedCapsules]
    others = {record: kind for record, kind in KINDS.items() if record is not shapes.Capsules}
    return others | {shapes.TaperedCapsules: round_ones}


def for_another_thread(contacts: Contacts) -> Contacts:
    """The same contacts with notes of a thread's own, where not each vertex has its own."""
    if contacts.groups is None:
        return contacts
    own = ("colliders", "active", "clock", "hot", "gaps", "touches", "before")
    groups = tuple(g._replace(**{name: getattr(g, name).copy() for name in own}) for g in contacts.groups)
    return contacts._replace(groups=groups)


def _group(
    record: type[Shapes], scene: Scene, colliders: Sequence[Collider], layouts: Sequence[Layout], shared: dict[str, Any]
) -> Shapes:
    count, tiles = len(colliders), len(shared["spreads"])
    rows = np.zeros(count, COLLIDER).view(np.recarray)
    for row, collider, layout in zip(rows, colliders, layouts, strict=True):
        # The world comes after the last bone.
        row.bone = len(scene.bones) if collider.bone is None else scene.bones.index(collider.bone)
        row.origin, row.frame, row.core = layout.origin, layout.rotation, layout.core
        row.sizes = (*layout.sizes, 0.0, 0.0, 0.0, 0.0)[:4]
        row.thickness = scene.thickness if collider.thickness is None else collider.thickness
        row.friction = scene.friction if collider.friction is None else collider.friction
    return record(
        colliders=rows,
        active=np.zeros(count + 1, dtype=np.int64),
        clock=np.zeros(2, dtype=np.int64),
        wake=np.zeros((tiles, count), dtype=np.int64),
        next=np.zeros(tiles, dtype=np.int64),
        hot=np.zeros(count + 1, dtype=np.int64),
        gaps=np.zeros(TILE),
        touches=np.zeros(TILE, dtype=np.int64),
        between=np.ones(tiles, dtype=bool),
        before=np.zeros((6, TILE)),
        pinched=np.zeros(scene.cloth.vertices, dtype=bool),
        **shared,
    )


def _faces(group: Shapes, layouts: Sequence[Layout], cloth: Cloth) -> Faces | None:
    """Those triangles and colliders of a kind of which the colliders could poke through, None where there are none.

    Vertices at the thickness t of a surface that is curved by r hold a triangle off it whose points are at most p from
    the nearest corner, where (r + t)^2 - p^2 >= r^2.
    """
    reach = STRETCHED * _cover(cloth)
    curvature, thickness = np.array([layout.curvature for layout in layouts]), group.colliders.thickness
    flat = np.isinf(curvature)
    held = np.where(flat, np.inf, thickness * (2.0 * np.where(flat, 0.0, curvature) + thickness))
    group.colliders.thin = held < reach.max() ** 2
    if not group.colliders.thin.any():
        return None
    corners = cloth.triangles[reach**2 > held.min()].astype(np.int64)
    corners = corners[np.argsort(corners.min(axis=1), kind="stable")]
    tile = corners.min(axis=1) // TILE
    place = np.arange(len(corners)) - np.searchsorted(tile, tile)
    starts = np.flatnonzero(place % GROUP == 0)
    return Faces(
        shapes=group,
        corners=np.ascontiguousarray(corners.T.astype(np.uint32)),
        starts=np.append(starts, len(corners)),
        tiles=tile[starts],
        longest=STRETCHED * _longest_edge(cloth),
        wake=np.zeros((len(starts), len(group.colliders)), np.int64),
        next=np.zeros(len(starts), np.int64),
        due=np.zeros(-(-len(starts) // CHUNK), np.int64),
        seen=np.zeros(SEEN),
        haste=np.zeros(1),
        pushed=np.zeros(1, np.int64),
    )


def _flat(cloth: Cloth) -> FloatArray:
    """Corners of the triangles in the pattern [m], shape (T, 3, 2)."""
    return cloth.corners if isinstance(cloth, MeshCloth) else cloth.pattern[cloth.triangles]


def _longest_edge(cloth: Cloth) -> float:
    flat = _flat(cloth)
    return float(np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2).max())


def _cover(cloth: Cloth) -> FloatArray:
    """Distance of the point of each triangle that is farthest from its corners, from the nearest of them [m], (T,)."""
    flat = _flat(cloth)
    edges = np.sort(np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2), axis=1)
    a, b, c = edges.T
    # No shape is so thin that an obtuse triangle's longest edge, half of which bounds it, would need to be cut finer.
    acute = a**2 + b**2 > c**2
    around = a * b * c / np.maximum(4.0 * np.abs(areas(flat)), 1e-300)
    return np.where(acute, np.minimum(around, c), c / 2.0)
