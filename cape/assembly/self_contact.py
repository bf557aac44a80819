"""From a cloth to the records that keep its layers apart."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth, MeshCloth
from cape.cloth.split_grid import SplitGrid
from cape.cloth.split_mesh import SplitMesh
from cape.cloth.triangle_mesh import edges_of
from cape.kernels.self_contact.near_pairs import Pairs
from cape.kernels.self_contact.patches import Patches, Sight
from cape.kernels.self_contact.self_contact import CLOCKS, Layers, Pressure
from cape.kernels.self_contact.tree import Tree
from cape.scene.scene import Scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PATCH = 16  # triangles at most; fewer make more pairs of patches, more make larger ones
# Times the thickness. The wider, the seldomer is there a search, and the more neighbours along the cloth are watched.
MARGIN = 2.5
# Closer than half of its height no triangle can be to the next one without a sharp fold.
SHARE_OF_EDGE = 1.0 / 3.0
THICKEST = 5e-3  # m, several times what any fabric has, so that layers stay apart in pictures, too
# Room for pairs. A cape in a run lists at most one of vertices and three of edges for each vertex; a sheet folded on
# itself 5 and 14, one that is wrung 7 and 20.
FACES_A_VERTEX, EDGES_A_VERTEX, LEAST_ROOM = 12, 36, 1024
EDGES_A_SPARE = 3  # edges that there is room for with each spare vertex of a cloth that may split; it needs one or two
MOST_A_VERTEX = 500  # far beyond any cloth that hasn't exploded; 100 bytes each


class Kept(NamedTuple):
    """What contact with itself knows at a moment, apart from the cloth's state."""

    places: FloatArray
    held: FloatArray
    clock: FloatArray
    pairs: tuple[tuple[NDArray[np.generic], ...], ...]


def default_thickness(cloth: Cloth) -> float:
    """Distance to keep between a cloth's layers [m]: a third of its mean edge without tension, at most 5 mm.

    At that distance no two parts of a triangle mesh touch along the cloth, unless it is sharply folded.
    """
    rest, (first, second) = rest_shape(cloth), edges_of(cloth.triangles).vertices.T
    return min(SHARE_OF_EDGE * float(np.linalg.norm(rest[first] - rest[second], axis=1).mean()), THICKEST)


def contact_thickness(scene: Scene) -> float:
    """Distance that the layers of a scene's cloth keep [m]; 0 where nothing keeps them apart."""
    contact = scene.self_contact
    if contact is None:
        return 0.0
    return default_thickness(scene.cloth) if contact.thickness is None else contact.thickness


def layers_of(scene: Scene, cloth: Cloth, *, alarm: IntArray, spreads: FloatArray) -> Layers | None:
    """Make the arrays that keep the layers of a scene's cloth apart; None where nothing does.

    Pairs that share a vertex or are nearer than the thickness at rest, along the flat pattern, are left alone. A mesh
    without a pattern is at rest as it starts, if it tells nothing else: layers that are nearer there stay as they are.

    Args:
        scene: tells how the cloth touches itself.
        cloth: the scene's cloth, its vertices numbered as in the state.
        alarm: of the records of colliders, see `kernels.contact.shapes`.
        spreads: the same.
    """
    contact = scene.self_contact
    if contact is None:
        return None
    thickness = contact_thickness(scene)
    friction = scene.friction if contact.friction is None else contact.friction
    patches, tree = cut_into_patches(cloth.triangles, rest_shape(cloth))
    if isinstance(cloth, SplitGrid | SplitMesh):
        patches = patches._replace(edges=with_room(patches.edges, EDGES_A_SPARE * (cloth.vertices - cloth.in_use)))
    vertices, triangles, edges = cloth.vertices, patches.triangles.shape[1], patches.edges.shape[1]
    pieces = len(patches.vertex_start) - 1
    most = max(int(np.diff(s).max()) for s in (patches.vertex_start, patches.triangle_start, patches.edge_start))
    most += most // 2 if isinstance(cloth, SplitGrid | SplitMesh) else 0
    return Layers(
        thickness=float(thickness),
        margin=MARGIN * thickness,
        friction=float(friction),
        patches=patches,
        sight=Sight(
            places=np.full((6, vertices), np.nan),
            vertex_boxes=np.zeros((6, vertices)),
            triangle_boxes=np.zeros((6, triangles)),
            edge_boxes=np.zeros((6, edges)),
            normals=np.zeros((3, triangles)),
            cones=np.zeros((pieces, 4)),
            tree=tree,
            picked=np.zeros((6, most + 1), np.uint32),
            matched=np.zeros((2, most * most + 1), np.uint32),
        ),
        faces=_pairs(vertices, max(LEAST_ROOM, FACES_A_VERTEX * vertices)),
        edges=_pairs(edges, max(LEAST_ROOM, EDGES_A_VERTEX * vertices)),
        pressure=Pressure(held=np.zeros((3, vertices)), clock=np.zeros(CLOCKS)),
        alarm=alarm,
        spreads=spreads,
    )


def with_room(edges: NDArray[np.uint32], more: int) -> NDArray[np.uint32]:
    """Edges (2, E) of patches, and room for more behind them, which belongs to no patch."""
    return np.concatenate([edges, np.zeros((2, more), np.uint32)], axis=1)


def surplus(layers: Layers) -> int:
    """How many pairs found no room; 0 where all of a frame's were kept apart."""
    return int(layers.faces.counts[1] + layers.edges.counts[1])


def may_grow(layers: Layers) -> bool:
    """Tell whether the lists that were too short may be `enlarged`."""
    vertices = len(layers.faces.head)
    return all(p.counts[1] == 0 or len(p.first) < MOST_A_VERTEX * vertices for p in (layers.faces, layers.edges))


def enlarged(layers: Layers) -> Layers:
    """The same with twice the room in each list that was too short; nothing is forgotten."""
    faces, edges = (
        _copy_pairs(p, _pairs(len(p.head), 2 * len(p.first))) if p.counts[1] else p
        for p in (layers.faces, layers.edges)
    )
    layers.sight.places[:] = np.nan  # so that what had no room is searched for
    return layers._replace(faces=faces, edges=edges)


def with_room_for(layers: Layers, kept: Kept) -> Layers:
    """The same with room in its lists for what another one of the same scene has kept, to be `put_back`; itself, where
    there is."""
    lists = []
    for pairs, (count, *_) in zip((layers.faces, layers.edges), kept.pairs, strict=True):
        room = len(pairs.first)
        while room < count[0]:
            room *= 2
        lists.append(pairs if room == len(pairs.first) else _pairs(len(pairs.head), room))
    faces, edges = lists
    same = faces is layers.faces and edges is layers.edges
    return layers if same else layers._replace(faces=faces, edges=edges)


def keep(layers: Layers) -> Kept:
    """Copy what is known, to `put_back` it should a frame be taken back."""
    pairs = tuple(
        (p.counts.copy(), *(values[: p.counts[0]].copy() for values in _known(p))) for p in (layers.faces, layers.edges)
    )
    return Kept(layers.sight.places.copy(), layers.pressure.held.copy(), layers.pressure.clock.copy(), pairs)


def put_back(layers: Layers, kept: Kept) -> None:
    """Know what was known when it was kept, in place."""
    layers.sight.places[:], layers.pressure.held[:], layers.pressure.clock[:] = kept.places, kept.held, kept.clock
    for pairs, (count, *known) in zip((layers.faces, layers.edges), kept.pairs, strict=True):
        pairs.counts[:] = count
        for values, before in zip(_known(pairs), known, strict=True):
            values[: len(before)] = before


def turn(layers: Layers, rotation: FloatArray) -> None:
    """Turn what is known, in place, as the cloth is turned as a whole; `rotation` is of shape (3, 3)."""
    layers.sight.places[:] = np.nan
    layers.pressure.held[:] = rotation @ layers.pressure.held
    for pairs in (layers.faces, layers.edges):
        for vectors in (pairs.apart[: pairs.counts[0]], pairs.force[: pairs.counts[0]]):
            vectors[:] = vectors @ rotation.T


def rest_shape(cloth: Cloth) -> FloatArray:
    """Where the vertices are without tension [m], shape (V, 3), pieces that aren't connected far from each other."""
    rest = np.column_stack([cloth.pattern, np.zeros(cloth.vertices)])
    if not cloth.lies_flat:
        told = cloth.rest if isinstance(cloth, MeshCloth) else None
        rest = np.array(cloth.positions if told is None else told)
    rest[:, 2] += 2.0 * np.ptp(rest, axis=0).max() * connected_pieces(cloth.triangles, cloth.vertices)
    return rest


def connected_pieces(triangles: NDArray[np.integer], vertices: int) -> IntArray:
    """Number the connected pieces of a mesh: that of each vertex, shape (V,)."""
    lowest = np.arange(vertices)
    while True:
        before = lowest.copy()
        np.minimum.at(lowest, triangles.ravel(), np.repeat(lowest[triangles].min(axis=1), 3))
        lowest = lowest[lowest]
        if np.array_equal(lowest, before):
            return np.unique(lowest, return_inverse=True)[1]


def cut_into_patches(triangles: NDArray[np.integer], rest: FloatArray) -> tuple[Patches, Tree]:
    """Halve a mesh across its longest extent at rest until pieces have at most `PATCH` triangles."""
    owner, tree = _halve(rest[triangles].mean(axis=1))
    pieces = int(tree.leaves[0])
    order = np.argsort(owner, kind="stable")
    triangles, owner = triangles[order], owner[order]
    mesh = edges_of(triangles)
    # Spare vertices, which no triangle has, are in no patch.
    edge_owner, vertex_owner = np.full(len(mesh.vertices), pieces), np.full(len(rest), pieces)
    np.minimum.at(edge_owner, mesh.of_triangle.ravel(), np.repeat(owner, 3))
    np.minimum.at(vertex_owner, triangles.ravel(), np.repeat(owner, 3))
    by_edge, by_vertex = np.argsort(edge_owner, kind="stable"), np.argsort(vertex_owner, kind="stable")
    neighbors = _neighbors(triangles, owner)
    ends = np.arange(pieces + 1)
    patches = Patches(
        vertices=by_vertex.astype(np.uint32),
        vertex_start=np.searchsorted(vertex_owner[by_vertex], ends),
        triangles=np.ascontiguousarray(triangles.T.astype(np.uint32)),
        triangle_start=np.searchsorted(owner, ends),
        edges=np.ascontiguousarray(mesh.vertices[by_edge].T.astype(np.uint32)),
        edge_start=np.searchsorted(edge_owner[by_edge], ends),
        neighbors=neighbors[:, 1].astype(np.uint32),
        neighbor_start=np.searchsorted(neighbors[:, 0], ends),
        rest=np.ascontiguousarray(rest.T),
    )
    return patches, tree


def _halve(middles: FloatArray) -> tuple[IntArray, Tree]:
    """Number of the patch of each triangle, and the tree of patches, by the middles of triangles [m], shape (T, 3)."""
    owner = np.zeros(len(middles), np.int64)
    leaves: list[int] = []
    first: list[int] = []

    def halve(members: IntArray, before: int) -> int:
        node = len(leaves)
        leaves.append(1)
        first.append(before)
        if len(members) > PATCH:
            axis = int(np.argmax(np.ptp(middles[members], axis=0)))
            members = members[np.argsort(middles[members, axis], kind="stable")]
            half = (len(members) + 1) // 2
            count = halve(members[:half], before)
            leaves[node] = count + halve(members[half:], before + count)
        else:
            owner[members] = before
        return leaves[node]

    pieces = halve(np.arange(len(middles)), 0)
    # Each of the two nodes of a pair is at most so deep, and each step down leaves at most two other pairs waiting.
    waiting = 4 * len(middles).bit_length() + 4
    return owner, Tree(
        leaves=np.array(leaves), first=np.array(first), boxes=np.zeros((2 * pieces - 1, 6)),
        waiting=np.zeros((waiting, 2), np.int64),
    )  # fmt: skip


def _neighbors(triangles: NDArray[np.integer], owner: IntArray) -> IntArray:
    """Pairs of patches that share a vertex, each both ways, sorted, shape (n, 2)."""
    # As single numbers, whose sorting lets other threads go on.
    pieces = int(owner.max(initial=0)) + 1
    at, patch = np.divmod(np.unique(triangles.ravel() * np.int64(pieces) + np.repeat(owner, 3)), pieces)
    pairs = [np.zeros((0, 2), np.int64)]
    for further in range(1, len(at)):  # of the patches around each vertex, which stand one after the other
        alike = at[further:] == at[:-further]
        if not alike.any():
            break
        pairs.append(np.stack([patch[:-further][alike], patch[further:][alike]], axis=1))
    one, other = np.concatenate(pairs).T
    both = np.unique(np.concatenate([one * pieces + other, other * pieces + one]))
    return np.stack(np.divmod(both, pieces), axis=1)


def _pairs(firsts: int, room: int) -> Pairs:
    return Pairs(
        counts=np.zeros(2, np.int64),
        first=np.zeros(room, np.uint32),
        second=np.zeros(room, np.uint32),
        apart=np.zeros((room, 3), np.float32),
        due=np.zeros(room),
        force=np.zeros((room, 3)),
        old_first=np.zeros(room, np.uint32),
        old_second=np.zeros(room, np.uint32),
        old_apart=np.zeros((room, 3), np.float32),
        old_due=np.zeros(room),
        old_force=np.zeros((room, 3)),
        head=np.full(firsts, -1, np.int32),
        following=np.zeros(room, np.int32),
    )


def _known(pairs: Pairs) -> tuple[NDArray[np.generic], ...]:
    """What lasts from search to search."""
    return pairs.first, pairs.second, pairs.apart, pairs.due, pairs.force


def _copy_pairs(pairs: Pairs, into: Pairs) -> Pairs:
    into.counts[0] = pairs.counts[0]
    for values, before in zip(_known(into), _known(pairs), strict=True):
        values[: pairs.counts[0]] = before[: pairs.counts[0]]
    return into
