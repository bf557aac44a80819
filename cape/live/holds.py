"""What holds a cloth, changed by hand: corners that are pinned or let go, and where a tear may begin."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.assembly import putting_on
from cape.assembly.assemble import Assembly
from cape.cloth.cloth import Cloth, GridCloth
from cape.run.whereabouts import Hold
from cape.scene.holding.attachments import Attachment, attach
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from motions.errors import ValueRangeError

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

TEAR = 8  # edges that part at once
CORNERS = (("top", "left"), ("top", "right"), ("bottom", "left"), ("bottom", "right"))


def corners(cloth: Cloth) -> dict[str, IntArray]:
    """Parts of a cloth that can be pinned, by their names: its corners, or what its regions are called."""
    found: dict[str, IntArray] = {}
    for ends in CORNERS:
        named = "_".join(ends)
        if named in cloth.regions:
            found[" ".join(ends)] = np.asarray(cloth.regions[named], np.int64)
        elif all(end in cloth.regions for end in ends):
            both = np.intersect1d(cloth.regions[ends[0]], cloth.regions[ends[1]])
            if len(both):
                found[" ".join(ends)] = both.astype(np.int64)
    return found or {name: np.asarray(part, np.int64) for name, part in sorted(cloth.regions.items())}


def let_go(scene: Scene, vertices: IntArray) -> Scene | None:
    """The scene without holding any of the vertices; None where none is held.

    Raises:
        ValueRangeError: something else goes by what is held.
    """
    kept: list[Attachment] = []
    for attachment in scene.attachments:
        stays = ~np.isin(attachment.vertices, vertices)
        if stays.all():
            kept.append(attachment)
        elif stays.any():
            kept.append(_part(attachment, stays))
    if all(a is b for a, b in zip(kept, scene.attachments, strict=False)) and len(kept) == len(scene.attachments):
        return None
    hard = any(attachment.hard for attachment in kept)
    if not kept and any(confinement.needs_holds for confinement in scene.confinements):
        raise ValueRangeError("something goes by what is held here: the last of it can't be let go")
    return replace(scene, attachments=kept, tethers=scene.tethers if hard else None)


def pinned(scene: Scene, vertices: IntArray, bone: str, points: FloatArray) -> Scene:
    """The scene with vertices held in the frame of a bone, at points in it [m], shape (n, 3)."""
    held = attach(scene.cloth, bone, vertices, points=points)
    # Where it is while the cloth is put on matters to nothing: that takes no time, and what is pinned tells its points.
    still = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    dressing = None if scene.dressing is None else {**scene.dressing, bone: still}
    return replace(scene, attachments=[*scene.attachments, held], dressing=dressing)


def held_where_they_are(
    assembly: Assembly, hold: Sequence[Hold], bones: Sequence[str], pose: Pose, state: FloatArray
) -> None:
    """Have the points at which some bones hold vertices, in place, be where these are.

    Args:
        assembly: the scene's arrays.
        hold: of each that it carries.
        bones: by their names in its scene.
        pose: of all of that scene's.
        state: of the vertices as the scene numbers them, positions first, in the same frame as the pose, shape (V, 6).
    """
    chosen, places = [assembly.scene.bones.index(bone) for bone in bones], assembly.inwards(state)[:, :3]
    for attached, (points, _, _) in zip(assembly.carried, hold, strict=True):
        rows = np.isin(attached.bones, chosen)
        points[rows] = putting_on.in_bones(attached, pose, places[attached.vertices])[rows]


def tear_path(cloth: Cloth, start: int, length: int = TEAR) -> IntArray:
    """Vertices one after the other, from one at the rim of the cloth straight inwards."""
    neighbours = _neighbours(cloth)
    at = cloth.pattern
    middle = at.mean(axis=0)
    inwards = middle - at[start]
    inwards = inwards / max(float(np.linalg.norm(inwards)), 1e-9)
    path = [start]
    while len(path) <= length:
        around = [v for v in neighbours[path[-1]] if v not in path]
        if not around:
            break
        ways = at[around] - at[path[-1]]
        straight = ways @ inwards / np.maximum(np.linalg.norm(ways, axis=1), 1e-12)
        if straight.max() <= 0.0:
            break
        path.append(around[int(straight.argmax())])
        inwards = ways[int(straight.argmax())]
        inwards = inwards / max(float(np.linalg.norm(inwards)), 1e-12)
    return np.array(path)


def rim(cloth: Cloth) -> IntArray:
    """Vertices at the rim of the cloth by their angle about its middle, the lowest of its pattern first."""
    triangles = cloth.triangles
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    once, counts = np.unique(edges, axis=0, return_counts=True)
    ends = np.unique(once[counts == 1])
    off = cloth.pattern[ends] - cloth.pattern.mean(axis=0)
    angles = (np.arctan2(off[:, 1], off[:, 0]) - np.pi / 2.0) % (2.0 * np.pi)
    return ends[np.argsort(angles, kind="stable")].astype(np.int64)


def _part(attachment: Attachment, chosen: NDArray[np.bool_]) -> Attachment:
    """An attachment of some of its vertices."""
    rows = {
        name: values[chosen]
        for name in ("points", "weights", "stiffness", "damping")
        if (values := getattr(attachment, name)) is not None
    }
    return replace(attachment, vertices=attachment.vertices[chosen], **rows)


def _neighbours(cloth: Cloth) -> dict[int, list[int]]:
    """The vertices to which threads lead from each one; in a mesh, edges."""
    found: dict[int, set[int]] = {}
    if isinstance(cloth, GridCloth):
        index = np.arange(cloth.vertices).reshape(cloth.rows, cloth.columns)
        pairs = [*zip(index[1:].ravel(), index[:-1].ravel(), strict=True)]
        pairs += zip(index[:, 1:].ravel(), index[:, :-1].ravel(), strict=True)
        for one, other in pairs:
            found.setdefault(int(one), set()).add(int(other))
            found.setdefault(int(other), set()).add(int(one))
        return {vertex: sorted(around) for vertex, around in found.items()}
    for a, b, c in cloth.triangles.tolist():
        for one, other in ((a, b), (b, c), (c, a)):
            found.setdefault(one, set()).add(other)
            found.setdefault(other, set()).add(one)
    return {vertex: sorted(around) for vertex, around in found.items()}
