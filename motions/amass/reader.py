"""AMASS's .npz files of SMPL-H and SMPL-X (Mahmood et al. 2019, "AMASS: Archive of Motion Capture as Surface Shapes").

They hold a turn for each joint, as axis times angle, and where the body is, but no joint's place: that is what the
model of the body computes from `betas`, which only its owners may hand out. So joints stand at published places of the
mean body here, whoever it was that moved. Fingers, face and soft tissue are left out.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.arrays import array_names, read_arrays
from motions.bvh.reader import Recording
from motions.errors import FileError

FloatArray = NDArray[np.float64]

SUFFIX = ".npz"
UP = "z"
"""The axis of the files' world that points up."""
JOINTS: tuple[tuple[str, str | None, tuple[float, float, float]], ...] = (
    ("pelvis", None, (0.0, -0.2233, 0.0282)),
    ("left_hip", "pelvis", (0.0695, -0.0914, -0.0068)),
    ("right_hip", "pelvis", (-0.0695, -0.0914, -0.0068)),
    ("spine1", "pelvis", (0.0, 0.1090, -0.0267)),
    ("left_knee", "left_hip", (0.0343, -0.3752, -0.0045)),
    ("right_knee", "right_hip", (-0.0343, -0.3752, -0.0045)),
    ("spine2", "spine1", (0.0, 0.1352, 0.0011)),
    ("left_ankle", "left_knee", (-0.0136, -0.3980, -0.0437)),
    ("right_ankle", "right_knee", (0.0136, -0.3980, -0.0437)),
    ("spine3", "spine2", (0.0, 0.0529, 0.0254)),
    ("left_foot", "left_ankle", (0.0264, -0.0558, 0.1193)),
    ("right_foot", "right_ankle", (-0.0264, -0.0558, 0.1193)),
    ("neck", "spine3", (0.0, 0.2139, -0.0429)),
    ("left_collar", "spine3", (0.0788, 0.1217, -0.0341)),
    ("right_collar", "spine3", (-0.0788, 0.1217, -0.0341)),
    ("head", "neck", (0.0, 0.0650, 0.0513)),
    ("left_shoulder", "left_collar", (0.0910, 0.0305, -0.0089)),
    ("right_shoulder", "right_collar", (-0.0910, 0.0305, -0.0089)),
    ("left_elbow", "left_shoulder", (0.2596, -0.0128, -0.0275)),
    ("right_elbow", "right_shoulder", (-0.2596, -0.0128, -0.0275)),
    ("left_wrist", "left_elbow", (0.2492, 0.0090, -0.0012)),
    ("right_wrist", "right_elbow", (-0.2492, 0.0090, -0.0012)),
)
"""Joint, the one above, and its place in that one's frame [m], in the files' order: x to the left, y up, z ahead, the
arms out. SMPL's mean body, as the MuJoCo humanoids made of it have it (smpl_humanoid.xml of ProtoMotions); of both
sides the left one's, mirrored, and the trunk in the middle."""
ENDS = {
    "head": (0.0, 0.2030, 0.0),
    "left_foot": (0.0, 0.0, 0.0744),
    "right_foot": (0.0, 0.0, 0.0744),
    "left_wrist": (0.1918, -0.0082, -0.0149),
    "right_wrist": (-0.1918, -0.0082, -0.0149),
}
"""Tips of head, toes and hands in the frames of their joints [m], by the boxes of the same humanoids."""
ROLES = {
    "pelvis": "pelvis", "chest": "spine3", "neck": "neck", "head": "head",
    **{
        f"{side}_{role}": f"{side}_{joint}"
        for side in ("left", "right")
        for role, joint in (
            ("shoulder", "collar"), ("upper_arm", "shoulder"), ("forearm", "elbow"), ("hand", "wrist"),
            ("thigh", "hip"), ("shin", "knee"), ("foot", "ankle"),
        )
    },
}  # fmt: skip
RATES = ("mocap_framerate", "mocap_frame_rate")
WHOLE = "poses"
PARTS = ("root_orient", "pose_body")


def is_amass(path: Path) -> bool:
    """Whether a file is one of these, by the names of its arrays."""
    if path.suffix.lower() != SUFFIX:
        return False
    names = array_names(path)
    return "trans" in names and (WHOLE in names or set(PARTS) <= names)


def read(path: Path, *, rate: float | None = None) -> Recording:
    """Read a motion.

    Args:
        path: the file.
        rate: frames per second, whatever the file says.

    Raises:
        FileError: the file is damaged, or its arrays do not fit each other.
    """
    arrays = read_arrays(path, only=(WHOLE, *PARTS, "trans", *RATES))
    parts = PARTS if PARTS[0] in arrays else (WHOLE,)
    poses = np.concatenate([_numbers(path, arrays, part) for part in parts], axis=1)
    places, turning = _numbers(path, arrays, "trans"), 3 * len(JOINTS)
    if poses.shape[1] < turning or places.shape != (len(poses), 3):
        raise FileError(f"{path} holds poses {poses.shape} for places {places.shape}: AMASS has 66 or more, and 3")
    names = [joint for joint, _, _ in JOINTS]
    offsets = np.array([offset for _, _, offset in JOINTS])
    fps, remarks = rate or _rate(arrays), []
    if fps is None:
        fps = 60.0
        remarks.append("rate: 60 frames a second, a guess, since the file tells none; give rate to change it")
    return Recording(
        joints=tuple(names),
        parents=np.array([-1 if above is None else names.index(above) for _, above, _ in JOINTS]),
        offsets=offsets,
        end_parents=np.array([names.index(joint) for joint in ENDS]),
        end_offsets=np.array(list(ENDS.values())),
        fps=fps,
        moving=np.array([0]),
        positions=(places + offsets[0])[:, None],
        rotations=quaternions.from_rotation_vector(poses[:, :turning].reshape(len(poses), -1, 3)),
        remarks=(
            "body: the file holds no joint's place, so they are those of SMPL's mean body, whoever moved; give height "
            "to scale it; fingers are left out",
            *remarks,
        ),
        up=UP,
        roles={role: names.index(joint) for role, joint in ROLES.items()},
    )


def _numbers(path: Path, arrays: dict[str, NDArray[np.generic]], name: str) -> FloatArray:
    found = arrays.get(name)
    if found is None or found.dtype.kind not in "fiu" or found.ndim != 2 or not len(found):
        raise FileError(f"{path}: {name} is no table of numbers")
    values = found.astype(float)
    if not (np.abs(values) <= 1e6).all():
        raise FileError(f"{path}: {name} holds a number that isn't finite, or no angle or place")
    return values


def _rate(arrays: dict[str, NDArray[np.generic]]) -> float | None:
    for name in RATES:
        if name in arrays and arrays[name].size == 1 and arrays[name].dtype.kind in "fiu":
            fps = float(arrays[name].astype(float).ravel()[0])
            if np.isfinite(fps) and 1.0 <= fps <= 1e4:
                return fps
    return None
