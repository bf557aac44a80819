"""A glTF file as joints, their motion and the mesh that they carry, still in its own unit and axes.

Joints are rigid frames elsewhere: of a transform with scales the turn counts as the joint's, and what stretches is left
to the mesh.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bvh.reader import Recording
from motions.errors import FileError
from motions.gltf.accessors import require_sane
from motions.gltf.animation import channels_of, find_animation, frame_times, sampled, weights_of
from motions.gltf.borrowed import borrowed, is_elsewhere
from motions.gltf.document import Document, reading
from motions.gltf.humanoid import roles_of_file
from motions.gltf.meshes import Gathering
from motions.gltf.morphs import Morphs, target_counts
from motions.gltf.nodes import Nodes, read_nodes
from motions.gltf.poses import require_short, world_poses

FloatArray = NDArray[np.float64]

UP = "y"
"""The axis that points up in glTF, whose unit is the metre (3.4)."""
STILL_SECONDS, STILL_FPS = 3.0, 30.0  # how long a figure without animation stands
_STRETCHED = 0.01  # by which a joint's scale may change in a motion without a word


def read(path: Path, *, rate: float | None = None, animation: str | None = None) -> Recording:
    """Read a character.

    Args:
        path: a .glb, .gltf or .vrm file.
        rate: frames per second in which to take its animation; None for those of its keyframes.
        animation: name of the animation, or a file of these suffixes whose first one the character takes over; None
            for its own first one.

    Raises:
        FileError: the file is missing, damaged, compressed, or has neither skin nor animation.
        UnknownNameError: there is no such animation.
    """
    document = Document.read(path)
    with reading(str(path)):
        return _figure(document, rate, animation)


def _figure(document: Document, rate: float | None, asked: str | None) -> Recording:
    nodes = read_nodes(document)
    chosen = _joints(document, nodes, asked)
    every = nodes.with_above(chosen)
    morphs = Morphs(document)
    if asked is not None and is_elsewhere(asked):
        moved, fps, remarks = borrowed(document, nodes, every, Path(asked), rate)
    else:
        moved, morphs.moved, fps, remarks = _moved(document, nodes, chosen, rate, asked)
    places, turns, stretches = world_poses(nodes, every, chosen, moved)
    for each in (places, stretches):
        require_sane(document, each, "joints")
    if (changes := np.ptp(stretches, axis=0).max(axis=(1, 2)) > _STRETCHED * np.abs(stretches).max()).any():
        some = ", ".join(nodes.names[chosen[k]] for k in np.flatnonzero(changes)[:3])
        remarks.append(f"scales that change in the motion stay as they are at first: {some}, {changes.sum()} in all")

    joint_of = {node: joint for joint, node in enumerate(chosen)}
    parents = np.array([_parent(nodes, node, joint_of) for node in chosen])
    names = [nodes.names[node] for node in chosen]
    if (parents < 0).sum() > 1:  # trees side by side hang at one root in the middle of the world
        parents, names = np.concatenate([[-1], parents + 1]), ["root", *names]
        joint_of = {node: joint + 1 for node, joint in joint_of.items()}
        places = np.concatenate([np.zeros_like(places[:, :1]), places], axis=1)
        turns = np.concatenate([np.broadcast_to([1.0, 0.0, 0.0, 0.0], turns[:, :1].shape), turns], axis=1)
        stretches = np.concatenate([np.broadcast_to(np.eye(3), stretches[:, :1].shape), stretches], axis=1)
    gathering = Gathering(document, nodes, joint_of, stretches[0], morphs)
    skin = gathering.skin([str(joint) for joint in range(len(names))])
    local, rotations = _in_parents(parents, places, turns)
    return Recording(
        joints=tuple(names),
        parents=parents,
        offsets=local[0].copy(),
        end_parents=np.zeros(0, dtype=np.int64),
        end_offsets=np.zeros((0, 3)),
        fps=fps,
        moving=np.arange(len(parents)),
        positions=local,
        rotations=rotations,
        remarks=(*remarks, *gathering.notes),
        up=UP,
        roles={role: joint_of[node] for role, node in roles_of_file(document).items() if node in joint_of},
        skin=skin,
        morphs=morphs.weights(),
    )


def _moved(
    document: Document, nodes: Nodes, joints: Sequence[int], rate: float | None, asked: str | None
) -> tuple[dict[str, FloatArray], dict[int, FloatArray], float, list[str]]:
    """What the file's own animation makes of all nodes in each frame, and how it came about.

    Returns:
        Transforms, as of `animation.sampled`; weights of morph targets by node, shape (F, n) each; the frame rate; and
        what was decided.
    """
    every, targets = nodes.with_above(joints), target_counts(document, nodes, joints)
    number, remarks = find_animation(document, asked, moving=every)
    if number is None:  # a face may move while the body stands
        number, remarks = find_animation(document, asked, moving=list(targets))
    channels = [] if number is None else channels_of(document, number, every)
    weights = [] if number is None else weights_of(document, number, targets)
    if channels or weights:
        times, fps = frame_times([*channels, *weights], rate)
    else:
        fps = rate or STILL_FPS
        times = np.arange(round(STILL_SECONDS * fps) + 1) / fps
        remarks.append(f"no animation moves the figure: it stands as it is for {STILL_SECONDS:g} s")
    require_short(document, len(times), nodes)
    document.take(8 * len(times) * sum(targets[each.node] for each in weights), "weights of morph targets")
    return sampled(nodes, channels, times), {each.node: each.at(times) for each in weights}, fps, remarks


def _joints(document: Document, nodes: Nodes, asked: str | None) -> list[int]:
    """The nodes that count as joints, those above first: of skins, or of an animation where there is no skin.

    Those between them count as well, and those above them up to where all meet.
    """
    skins = {node["skin"] for node in document.list_of("nodes") if "skin" in node and "mesh" in node}
    own = {joint for skin in skins for joint in document.list_of("skins")[skin]["joints"]}
    if not own:
        number, _ = find_animation(document, None if asked and is_elsewhere(asked) else asked, moving=nodes.order)
        moved = [] if number is None else channels_of(document, number, nodes.order)
        own = {channel.node for channel in moved}
    if not own:
        raise FileError(
            f"{document.label} has no skin and no animation, so nothing in it moves: cape replay --cloth wears a mesh"
        )
    found = nodes.with_above(own)
    below = Counter(nodes.parents[node] for node in found)
    while below[-1] == 1 and found[0] not in own and below[found[0]] == 1:
        del found[0]  # what only places the character in its world
    return found


def _parent(nodes: Nodes, node: int, joint_of: dict[int, int]) -> int:
    return joint_of.get(nodes.parents[node], -1)


def _in_parents(parents: NDArray[np.int64], places: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (F, J, 3) and turns wxyz (F, J, 4) of the world in the frames of the joints above."""
    local, rotations = places.copy(), quaternions.make_continuous(turns)
    above = np.maximum(parents, 0)
    inverse = quaternions.conjugate(turns[:, above[1:]])
    local[:, 1:] = quaternions.rotate(inverse, places[:, 1:] - places[:, above[1:]])
    rotations[:, 1:] = quaternions.multiply(inverse, turns[:, 1:])
    return local, rotations
