"""A figure moved by the animation of another file, such as a VRM by a VRM animation, or a mesh by a motion without one.

Both stand alike while nothing moves them, as VRM demands and Mixamo's files do. So a bone is turned in the world by
what its counterpart has turned from there (VRMC_vrm_animation-1.0, "how to transform"), and the hips go as far as legs
are long.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bodies.roles import find_roles
from motions.errors import FileError
from motions.gltf.animation import channels_of, find_animation, frame_times, sampled
from motions.gltf.document import SUFFIXES, Document, reading
from motions.gltf.humanoid import human_bones, roles_of_file
from motions.gltf.nodes import Nodes, read_nodes
from motions.gltf.poses import require_short, world_poses

FloatArray = NDArray[np.float64]

_ENOUGH = 10  # names that two files share by which their bones are told apart
_STEP, _NEARLY = np.pi / 2.0, np.radians(10.0)
"""Files face along an axis: what is this near to one of these angles is taken for it."""


def is_elsewhere(animation: str) -> bool:
    """Whether an animation is named by its file."""
    return Path(animation).suffix.lower() in SUFFIXES and os.path.isfile(animation)


def borrowed(
    document: Document, nodes: Nodes, every: Sequence[int], path: Path, rate: float | None
) -> tuple[dict[str, FloatArray], float, list[str]]:
    """Transforms of a figure's nodes in each frame of another file's first animation.

    Args:
        document: the file of the figure.
        nodes: its nodes.
        every: those that matter, those above first.
        path: the other file.
        rate: frames per second; None for those of the keyframes.

    Returns:
        As of `animation.sampled`; the frames per second; and what was decided, a sentence each.

    Raises:
        FileError: the other file can't be read, moves nothing, or its bones can't be told to be those of the figure.
    """
    other = Document.read(path)
    with reading(str(path)):
        theirs = read_nodes(other)
        pairs = {own: its for own, its in _pairs(document, nodes, other, theirs).items() if own in every}
        if not pairs:
            raise FileError(f"{path} moves no bone that is known to be one of {document.label}")
        hips = _hips(document, nodes, pairs)
        for above in nodes.above(hips)[1:]:
            pairs.pop(above, None)  # what places a figure in its world is its own
        needed = theirs.with_above(pairs.values())
        number, remarks = find_animation(other, None, moving=needed)
        if number is None:
            raise FileError(f"{path} has no animation that moves a bone of {document.label}")
        channels = channels_of(other, number, needed)
        times, fps = frame_times(channels, rate)
        require_short(document, len(times), nodes)
        chosen = sorted(set(pairs.values()))
        places, turns, _ = world_poses(theirs, needed, chosen, sampled(theirs, channels, times))
        at_rest = world_poses(theirs, needed, chosen, sampled(theirs, [], np.zeros(1)))
    column = {own: chosen.index(its) for own, its in pairs.items()}
    found = sampled(nodes, [], np.zeros(len(times)))
    own_places, own_turns, stretches = world_poses(nodes, every, every, sampled(nodes, [], np.zeros(1)))
    place_of = {node: k for k, node in enumerate(every)}
    # What each bone has turned in the world, and where it went, seen from where the figure faces.
    sides = [node for node in _sides(document, nodes) if node in column]
    facing = _facing(own_places[0, [place_of[n] for n in sides]], at_rest[0][0, [column[n] for n in sides]])
    places, rest_places = quaternions.rotate(facing, places), quaternions.rotate(facing, at_rest[0])
    turned = quaternions.multiply(turns, quaternions.conjugate(at_rest[1]))
    turned = quaternions.multiply(quaternions.multiply(facing, turned), quaternions.conjugate(facing))
    world = np.repeat(own_turns, len(times), axis=0)
    identity = np.broadcast_to([1.0, 0.0, 0.0, 0.0], world[:, 0].shape)
    for k, node in enumerate(every):
        above = world[:, place_of[nodes.parents[node]]] if nodes.parents[node] >= 0 else identity
        if node in column:
            world[:, k] = quaternions.multiply(turned[:, column[node]], own_turns[:, k])
        else:
            world[:, k] = quaternions.multiply(above, np.broadcast_to(nodes.rotations_wxyz[node], above.shape))
        found["rotation"][:, node] = quaternions.multiply(quaternions.conjugate(above), world[:, k])

    own_low = own_places[0, [place_of[node] for node in column], 1].min()
    low = rest_places[0, :, 1].min()
    ratio = float(own_places[0, place_of[hips], 1] - own_low) / max(float(rest_places[0, column[hips], 1] - low), 1e-9)
    went = ratio * (places[:, column[hips]] - [0.0, low, 0.0]) + [0.0, own_low, 0.0]
    if (above := nodes.parents[hips]) >= 0:
        k = place_of[above]
        linear = quaternions.to_matrix(own_turns[0, k]) @ stretches[0, k]
        went = np.linalg.solve(linear, (went - own_places[0, k]).T).T
    found["translation"][:, hips] = went
    return found, fps, [*remarks, f"animation: of {path.name}, whose {len(pairs)} bones move those that match them"]


def _sides(document: Document, nodes: Nodes) -> list[int]:
    """The left and the right one of a pair of limbs; none where they are unknown."""
    roles = _roles(document, nodes)
    for limb in ("upper_arm", "thigh", "shoulder"):
        if all(f"{side}_{limb}" in roles for side in ("left", "right")):
            return [roles[f"left_{limb}"], roles[f"right_{limb}"]]
    return []


def _facing(own: FloatArray, its: FloatArray) -> FloatArray:
    """The turn about Y, wxyz, that has the other figure face as this one does, by both sides of each, shape (2, 3)."""
    if len(own) < 2:
        return np.array([1.0, 0.0, 0.0, 0.0])
    first, second = (np.arctan2(-(left - right)[2], (left - right)[0]) for left, right in (own, its))
    angle = first - second
    if abs(angle - _STEP * np.rint(angle / _STEP)) < _NEARLY:
        angle = _STEP * np.rint(angle / _STEP)
    return np.array([np.cos(angle / 2.0), 0.0, np.sin(angle / 2.0), 0.0])


def _hips(document: Document, nodes: Nodes, pairs: dict[int, int]) -> int:
    """The node that carries all of the body: the pelvis, or else the highest that has a counterpart."""
    pelvis = _roles(document, nodes).get("pelvis")
    return pelvis if pelvis in pairs else next(node for node in nodes.order if node in pairs)


def _pairs(document: Document, nodes: Nodes, other: Document, theirs: Nodes) -> dict[int, int]:
    """The node of the other file that moves each node: by VRM's bones, by names that both have, or by roles."""
    mine, its = human_bones(document), human_bones(other)
    shared = [bone for bone in mine if bone in its]
    if shared:
        return {mine[bone]: its[bone] for bone in shared}
    known = {name: number for number, name in enumerate(theirs.names)}
    named = {number: known[name] for number, name in enumerate(nodes.names) if name in known}
    if len(named) >= _ENOUGH:
        return named
    mine, its = (_roles(each, of) for each, of in ((document, nodes), (other, theirs)))
    return {mine[role]: its[role] for role in mine if role in its}


def _roles(document: Document, nodes: Nodes) -> dict[str, int]:
    order = list(nodes.order)
    names = [nodes.names[node] for node in order]
    parents = [order.index(nodes.parents[node]) if nodes.parents[node] >= 0 else -1 for node in order]
    found = {role: order[names.index(joint)] for role, joint in find_roles(names, parents).items()}
    return found | roles_of_file(document)
