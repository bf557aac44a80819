"""From colliders to the records that kernels work on."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.self_contact import layers_of
from cape.cloth.cloth import Cloth, areas
from cape.kernels import store
from cape.kernels.contact import shapes
from cape.kernels.contact.faces import CHUNK, GROUP, SEEN
from cape.kernels.contact.shapes import COLLIDER, Colliders, Faces, Points
from cape.kernels.contact.slip import NOT
from cape.kernels.contact.watch import NEVER, TILE
from cape.kernels.jit import COMPILER_OFF, formula_of
from cape.kernels.linking import Linker
from cape.kernels.packing import Packed
from cape.kernels.self_contact.self_contact import Layers, Pressure
from cape.scene.scene import Scene
from skeleton.shapes import Bounded, Layout, Shape

FloatArray = NDArray[np.float64]


class Contacts(NamedTuple):
    """What the cloth can't enter, and which vertices (N,) are `free`: False for attached ones.

    `colliders` is None where there are none, `faces` is what could poke through between vertices, None where nothing
    could. `layers` is what keeps the cloth off itself, `pressure` what acts between them, None where nothing does.
    `settled` (1,) is the last turn in which triangles left nothing to do for vertices.
    """

    free: NDArray[np.bool_]
    colliders: Colliders | None
    faces: Faces | None
    layers: Layers | None
    pressure: Pressure | None
    settled: NDArray[np.int64]


STRETCHED = 1.05  # triangles, as they are compared with colliders


def contacts_of(scene: Scene, cloth: Cloth, free: NDArray[np.bool_]) -> Contacts:
    """The colliders of a scene, in its order.

    `cloth` is the scene's cloth as the solver numbers it, `free` (V,) which of its vertices no bone holds.
    """
    shared = _shared(len(free))
    colliders, layouts = _colliders(scene, len(free), shared)
    faces = None if colliders is None else _faces(colliders, layouts, cloth)
    layers = layers_of(scene, cloth, **shared)
    pressure = None if layers is None else layers.pressure
    return Contacts(free, colliders, faces, layers, pressure, np.full(1, NEVER, np.int64))


def colliders_of(scene: Scene, vertices: int) -> Colliders | None:
    """The colliders of a scene for a cloth of so many vertices, without what else it can't enter."""
    return _colliders(scene, vertices, _shared(vertices))[0]


def _shared(vertices: int) -> dict[str, Any]:
    """What colliders and layers know of the tiles of so many vertices."""
    tiles = -(-vertices // TILE)
    return {"spreads": np.zeros((tiles, 3)), "alarm": np.zeros(tiles + 1, dtype=np.int64)}


def link_distances(scene: Scene, colliders: Colliders, faces: Faces | None, linker: Linker) -> None:
    """Have the addresses of the distances of a scene's shapes put into the records of its colliders."""
    points = Packed(colliders.points).kind
    for kind in dict.fromkeys(map(type, scene.colliders)):
        rows = np.array([type(collider) is kind for collider in scene.colliders])
        formula = formula_of(kind.nearest)
        numbers = ("float",) * 4
        wanted = {
            "nearest": (formula, ("float",) * 7),
            "gaps": (shapes.gaps.around(formula), (points, "int", "float", *numbers)),
        }
        if faces is not None and faces.exposed[:, rows].any():
            wanted["planes"] = (shapes.planes.around(formula), (points, "int", *numbers))
        for field, (function, kinds) in wanted.items():
            put = _putter(colliders.records, field, rows)
            if COMPILER_OFF:
                put(len(shapes.numbered))
                shapes.numbered.append(function)
            else:
                linker.want(store.Request(function, kinds), put)


def _putter(records: Any, field: str, rows: NDArray[np.bool_]) -> Callable[[int], None]:
    def put(address: int) -> None:
        records[field][rows] = address

    return put


def for_another_thread(contacts: Contacts) -> Contacts:
    """The same contacts with notes of a thread's own, where not each vertex has its own."""
    if contacts.colliders is None:
        return contacts
    own = ("records", "active", "clock", "hot", "touches", "before")
    copies = {name: getattr(contacts.colliders, name).copy() for name in own}
    return contacts._replace(colliders=contacts.colliders._replace(points=_points(TILE), **copies))


def _points(count: int) -> Points:
    return Points(*np.zeros((7, count)))


def _colliders(scene: Scene, vertices: int, shared: dict[str, Any]) -> tuple[Colliders | None, list[Layout]]:
    layouts = [collider.layout() for collider in scene.colliders]
    count, tiles = len(layouts), len(shared["spreads"])
    if not count:
        return None, layouts
    rows = np.zeros(count, COLLIDER).view(np.recarray)
    for row, collider, layout in zip(rows, scene.colliders, layouts, strict=True):
        # The world comes after the last bone.
        row.bone = len(scene.bones) if collider.bone is None else scene.bones.index(collider.bone)
        row.origin, row.frame, row.core = layout.origin, layout.rotation, layout.core
        row.tip = tip_of(collider) @ layout.rotation
        row.sizes = (*layout.sizes, 0.0, 0.0, 0.0, 0.0)[:4]
        row.thickness = scene.thickness if collider.thickness is None else collider.thickness
        row.friction = scene.friction if collider.friction is None else collider.friction
    colliders = Colliders(
        records=rows,
        active=np.zeros(count + 1, dtype=np.int64),
        clock=np.zeros(2, dtype=np.int64),
        wake=np.zeros((tiles, count), dtype=np.int64),
        next=np.zeros(tiles, dtype=np.int64),
        hot=np.zeros(count + 1, dtype=np.int64),
        points=_points(TILE),
        touches=np.zeros(TILE, dtype=np.int64),
        between=np.ones(tiles, dtype=bool),
        before=np.zeros((6, TILE)),
        pinched=np.zeros(vertices, dtype=bool),
        slips=np.full(vertices, NOT, dtype=np.int64),
        beyond=np.full(count, NOT, dtype=np.int64),
        **shared,
    )
    return colliders, layouts


def tip_of(collider: Shape) -> FloatArray:
    """The unit vector (3,), in a bone's frame, along which a limb leads that a collider surrounds; zero for none.

    That is from the bone's joint to its middle, if it is farther from there than it is thick.
    """
    if collider.bone is None or not isinstance(collider, Bounded):
        return np.zeros(3)
    middle, reach = collider.ball()
    far = float(np.linalg.norm(middle))
    return middle / far if far > 0.5 * reach else np.zeros(3)


def _faces(colliders: Colliders, layouts: Sequence[Layout], cloth: Cloth) -> Faces | None:
    """Those triangles and colliders of which the colliders could poke through, None where there are none.

    Vertices at the thickness t of a surface that is curved by r hold a triangle off it whose points are at most p from
    the nearest corner, where (r + t)^2 - p^2 >= r^2.
    """
    reach = (STRETCHED * _cover(cloth)) ** 2
    curvature, thickness = np.array([layout.curvature for layout in layouts]), colliders.records.thickness
    flat = np.isinf(curvature)
    held = np.where(flat, np.inf, thickness * (2.0 * np.where(flat, 0.0, curvature) + thickness))
    corners, reach = cloth.triangles[reach > held.min()].astype(np.int64), reach[reach > held.min()]
    if not len(corners):
        return None
    order = np.argsort(corners.min(axis=1), kind="stable")
    corners, reach = corners[order], reach[order]
    tile = corners.min(axis=1) // TILE
    place = np.arange(len(corners)) - np.searchsorted(tile, tile)
    starts = np.flatnonzero(place % GROUP == 0)
    return Faces(
        corners=np.ascontiguousarray(corners.T.astype(np.uint32)),
        starts=np.append(starts, len(corners)),
        tiles=tile[starts],
        longest=STRETCHED * _longest_edge(cloth),
        exposed=np.maximum.reduceat(reach, starts)[:, None] > held,
        wake=np.zeros((len(starts), len(layouts)), np.int64),
        next=np.zeros(len(starts), np.int64),
        due=np.zeros(-(-len(starts) // CHUNK), np.int64),
        middles=_points(GROUP),
        seen=np.zeros((SEEN, GROUP)),
        known=np.zeros((len(corners), 10)),
        known_of=np.full(len(corners), -1, np.int64),
        haste=np.zeros(1),
        pushed=np.zeros(1, np.int64),
    )


def _longest_edge(cloth: Cloth) -> float:
    flat = cloth.corners_at_rest
    return float(np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2).max())


def _cover(cloth: Cloth) -> FloatArray:
    """Distance of the point of each triangle that is farthest from its corners, from the nearest of them [m], (T,)."""
    flat = cloth.corners_at_rest
    edges = np.sort(np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2), axis=1)
    a, b, c = edges.T
    # No shape is so thin that an obtuse triangle's longest edge, half of which bounds it, would need to be cut finer.
    acute = a**2 + b**2 > c**2
    around = a * b * c / np.maximum(4.0 * np.abs(areas(flat)), 1e-300)
    return np.where(acute, np.minimum(around, c), c / 2.0)
