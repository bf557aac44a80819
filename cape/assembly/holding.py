"""What holds a cloth, as arrays: hard, by springs, by tethers."""

import numpy as np
from numpy.typing import NDArray

from cape.assembly.geodesics import geodesic_distances
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth
from cape.kernels.solve.attachments import Attached, Blend
from cape.kernels.solve.lift import Ties
from cape.kernels.solve.soft import Pull
from cape.kernels.solve.tethers import Tethers
from cape.scene.attachments import Attachment
from cape.scene.scene import Scene

FloatArray = NDArray[np.float64]

Hold = tuple[Attachment, NDArray[np.int64], NDArray[np.int64]]
"""An attachment, the vertices of the scene that it holds, and the same as the assembly numbers them, (n,) each."""


def attached_of(scene: Scene, holds: list[Hold]) -> Attached | None:
    indices = np.concatenate([np.empty(0, np.int64), *(place for _, _, place in holds)])
    if not len(indices):
        return None
    lift, drift = (np.zeros((len(indices), 3)) for _ in range(2))
    if all(attachment.weights is None for attachment, _, _ in holds):
        bones = np.concatenate([np.full(len(place), scene.bones.index(a.bone)) for a, _, place in holds])
        return Attached(indices, bones, np.zeros((len(indices), 3)), lift, drift)
    weights = np.zeros((len(indices), len(scene.bones)))
    first = 0
    for attachment, vertices, _ in holds:
        own = np.ones((len(vertices), 1))
        if attachment.weights is not None:
            own = attachment.of(attachment.weights, vertices)
        rows = slice(first, first + len(vertices))
        weights[rows, [scene.bones.index(bone) for bone in attachment.bones]] = own
        first += len(vertices)
    heavy = np.argsort(-weights, axis=1, kind="stable")
    weights = np.take_along_axis(weights, heavy, axis=1)
    starts = np.concatenate([[0], np.cumsum((weights > 0.0).sum(axis=1))])
    bones = heavy[weights > 0.0]
    return Attached(indices, bones, np.zeros((len(bones), 3)), lift, drift, Blend(starts, weights[weights > 0.0]))


def pull_of(scene: Scene, holds: list[Hold], mass: FloatArray) -> Pull | None:
    attached = attached_of(scene, holds)
    if attached is None:
        return None
    stiffness, damping = [], []
    for attachment, vertices, place in holds:
        assert attachment.stiffness is not None
        own = attachment.of(attachment.stiffness, vertices)
        critical = 2.0 * np.sqrt(own * mass[place])
        stiffness.append(own)
        damping.append(critical if attachment.damping is None else attachment.of(attachment.damping, vertices))
    goals, speeds = (np.zeros((3, len(attached.vertices))) for _ in range(2))
    return Pull(attached, np.concatenate(stiffness), np.concatenate(damping), goals, speeds)


def tethers_of(scene: Scene, cloth: Cloth, attached: Attached | None) -> Tethers | None:
    if scene.tethers is None or attached is None:
        return None
    distances, nearest = geodesic_distances(cloth, attached.vertices)
    nearest[attached.vertices] = -1
    return Tethers(nearest, (1.0 + scene.tethers.slack) * distances)

def ties_of(cloth: Cloth, springs: Springs, attached: Attached) -> Ties:
    """The threads, or edges of a mesh, between vertices that are held hard: no longer than the fabric lets them get."""
    count = len(attached.vertices)
    places = np.full(cloth.vertices, -1)
    places[attached.vertices] = np.arange(count)
    first, second = places[springs.first], places[springs.second]
    chosen = springs.measured & (first >= 0) & (second >= 0)
    limit = min(cloth.fabric.limit_warp, cloth.fabric.limit_weft)
    room = (np.zeros((count, 3)) for _ in range(2))
    return Ties(first[chosen], second[chosen], (1.0 + limit) * springs.rest[chosen], *room)
