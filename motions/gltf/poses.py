"""Nodes in the world of their file: turn and place of each, and what of its transform is neither."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import FileError
from motions.gltf.document import Document
from motions.gltf.nodes import Nodes

FloatArray = NDArray[np.float64]

LONGEST = 2**24  # poses of nodes, over all frames: an hour of sixty at 60 frames a second
_EVEN = 1e-4  # by which scales along the axes may differ, of the largest, and still count as one


def require_short(document: Document, frames: int, nodes: Nodes) -> None:
    """Check that a motion is no longer than any is.

    Raises:
        FileError: it is.
    """
    if frames * len(nodes.names) > LONGEST:
        raise FileError(f"{document.label}: {frames} frames of {len(nodes.names)} nodes are too long a motion")


def world_poses(
    nodes: Nodes, every: Sequence[int], chosen: Sequence[int], local: dict[str, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where joints are in the file's world in each of F frames, as rigid frames.

    Args:
        nodes: of the file.
        every: the joints and what is above them, those above first.
        chosen: those whose place is wanted.
        local: transforms of all nodes to those above, as of `animation.sampled`.

    Returns:
        Places, shape (F, J, 3), turns wxyz, shape (F, J, 4), and what of the transforms is neither, shape (F, J, 3, 3).
    """
    frames = len(local["scale"])
    count = len(nodes.names)
    places, linear = np.zeros((frames, count, 3)), np.zeros((frames, count, 3, 3))
    turns = np.zeros((frames, count, 4))
    for node in every:
        parent, rotation = nodes.parents[node], local["rotation"][:, node]
        own = quaternions.to_matrix(rotation) * local["scale"][:, node, None]
        if parent < 0:
            places[:, node], turns[:, node], linear[:, node] = local["translation"][:, node], rotation, own
            continue
        moved = np.einsum("fij,fj->fi", linear[:, parent], local["translation"][:, node])
        places[:, node] = places[:, parent] + moved
        turns[:, node] = quaternions.multiply(turns[:, parent], rotation)
        linear[:, node] = linear[:, parent] @ own
    scales = local["scale"][:, list(every)]
    if scales.min() <= 0.0 or (np.ptp(scales, axis=2) > _EVEN * scales.max(axis=2)).any():
        _turn_by_nearest(turns, linear, chosen)
    stretches = np.swapaxes(quaternions.to_matrix(turns[:, chosen]), -1, -2) @ linear[:, chosen]
    return places[:, chosen], turns[:, chosen], stretches


def _turn_by_nearest(turns: FloatArray, linear: FloatArray, chosen: Sequence[int]) -> None:
    """Give joints the turn that is nearest to their transform, where scales differ by axes or mirror it.

    It is U V' of the decomposition U S V' (Higham 1986, "Computing the polar decomposition"), mirrored along the first
    axis where that is no turn. What has lost a dimension keeps the turn that it has by its rotations.
    """
    for node in chosen:
        u, values, v = np.linalg.svd(linear[:, node])
        nearest = u @ v
        nearest[np.linalg.det(nearest) < 0.0] *= np.array([-1.0, 1.0, 1.0])
        sound = values[:, 2] > 1e-6 * values[:, 0]
        turns[sound, node] = quaternions.from_matrix(nearest[sound])
