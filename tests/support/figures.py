"""A figure of known measures, and a forward kinematics that shares nothing with the packages' own."""

import numpy as np
from numpy.typing import NDArray

from motions.clip import Clip

FloatArray = NDArray[np.float64]

_LEFT_SIDE = (
    ("LeftShoulder", "Chest", (0.02, 0, 0.20)),
    ("LeftArm", "LeftShoulder", (0.16, 0, 0.02)),
    ("LeftForeArm", "LeftArm", (0, 0, -0.30)),
    ("LeftHand", "LeftForeArm", (0, 0, -0.26)),
    ("LeftUpLeg", "Hips", (0.09, 0, -0.05)),
    ("LeftLeg", "LeftUpLeg", (0, 0, -0.43)),
    ("LeftFoot", "LeftLeg", (0, 0, -0.42)),
)


def figure(*, size: float = 1.0, frames: int = 1, without: tuple[str, ...] = ()) -> Clip:
    """A person who stands still with hanging arms, left +X, facing -Y: hips 1.0 m and shoulder joints 1.41 m high.

    Args:
        size: factor on all lengths.
        frames: how many, at 60 frames a second.
        without: joints left out, with all that hangs on them.
    """
    bones = [
        ("Hips", None, (0, 0, 0)),
        ("Chest", "Hips", (0, 0, 0.24)),
        ("Neck", "Chest", (0, 0, 0.25)),
        ("Head", "Neck", (0, 0, 0.10)),
    ]
    for name, parent, offset in _LEFT_SIDE:
        bones.append((name, parent, offset))
        mirrored = (-offset[0], *offset[1:])
        bones.append((name.replace("Left", "Right"), parent.replace("Left", "Right"), mirrored))
    kept: list[tuple[str, str | None, tuple[float, ...]]] = []
    for bone in bones:
        if bone[0] not in without and (bone[1] is None or bone[1] in [name for name, *_ in kept]):
            kept.append(bone)
    names = tuple(name for name, *_ in kept)
    ends = {"Head": (0, 0, 0.17), "LeftFoot": (0, -0.20, -0.04), "RightFoot": (0, -0.20, -0.04)}
    ends = {name: offset for name, offset in ends.items() if name in names}
    return Clip(
        name="figure",
        joints=names,
        parents=np.array([-1 if parent is None else names.index(parent) for _, parent, _ in kept]),
        offsets=size * np.array([offset for *_, offset in kept], dtype=float),
        end_parents=np.array([names.index(name) for name in ends], dtype=np.int64),
        end_offsets=size * np.array(list(ends.values()), dtype=float).reshape(-1, 3),
        fps=60.0,
        root_positions=np.tile([0.0, 0.0, size], (frames, 1)),
        rotations_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (frames, len(names), 1)),
    )


def matrices_of(quaternions_wxyz: FloatArray) -> FloatArray:
    """Rotation matrices by the sandwich product written out, (..., 4) to (..., 3, 3)."""
    w, v = quaternions_wxyz[..., 0], quaternions_wxyz[..., 1:]
    cross = np.zeros((*w.shape, 3, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    cross -= np.swapaxes(cross, -1, -2)
    outer = v[..., :, None] * v[..., None, :]
    scalar = (w**2 - np.sum(v**2, axis=-1))[..., None, None]
    return scalar * np.eye(3) + 2 * outer + 2 * w[..., None, None] * cross


def world_matrices(clip: Clip) -> FloatArray:
    """Homogeneous matrices joint_to_world, chained from the root, shape (F, J, 4, 4)."""
    frames, joints = clip.rotations_wxyz.shape[:2]
    local = np.zeros((frames, joints, 4, 4))
    local[..., :3, :3] = matrices_of(clip.rotations_wxyz)
    local[..., :3, 3] = clip.offsets if clip.local_positions is None else clip.local_positions
    local[:, 0, :3, 3] = clip.root_positions
    local[..., 3, 3] = 1
    world = np.array(local)
    for joint, parent in enumerate(clip.parents):
        if parent >= 0:
            world[:, joint] = world[:, parent] @ local[:, joint]
    return world
