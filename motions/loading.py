"""From a file to a clip: read, decide what the file leaves open, convert once to metres and Z up."""

from collections import Counter
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions import conventions, quaternions
from motions.amass import reader as amass
from motions.bodies import stature
from motions.border import checked
from motions.bvh import reader
from motions.bvh.reader import Recording
from motions.clip import Clip
from motions.errors import FileError, ValueRangeError, likeliest
from motions.files import text_of
from motions.gltf import reader as gltf
from motions.gltf.document import SUFFIXES
from motions.shipped import clip_names, clip_path

FloatArray = NDArray[np.float64]

_STILL = 1e-6
"""A joint whose position channels stay within this distance [m] over the clip is one that doesn't move."""


@checked
def load(
    path: str | PathLike[str],
    *,
    unit: str | float | None = None,
    up: str | None = None,
    height: float | None = None,
    keep_first_frame: bool | None = None,
    name: str | None = None,
    rate: float | None = None,
    animation: str | None = None,
) -> Clip:
    """Read a BVH file, a character from a glTF one, or AMASS's .npz, into a clip, in metres and Z up.

    What the file leaves open is decided from the motion itself; every decision is a sentence in `Clip.decisions`. glTF
    (.glb, .gltf, .vrm) and AMASS state their unit, the metre, and their axis that is up: both are believed, unless that
    makes no body of 0.3 to 5 m.

    Args:
        path: a BVH, glTF or AMASS file, or the name of a shipped clip where no such file exists.
        unit: "m", "cm", "mm", "inch", "cmu" (1/0.45 inch) or metres in the file's unit; None takes the one that makes
            a person of 1.4 to 2.1 m.
        up: "x", "y", "z", "-x", "-y" or "-z", the file's axis that points up; None compares the head with the feet.
        height: standing height to which the body is scaled [m], instead of a unit.
        keep_first_frame: False drops the first frame, True keeps it, None drops it where the body jumps from it to the
            second, as from the T-pose in front of CMU's files.
        name: what to call the clip, by default the stem of the file.
        rate: frames per second, whatever the file says; of a glTF file how many are taken of its animation in a second.
        animation: name of one of a glTF file's animations, or another such file (.vrma as well) whose bones move the
            character's; None for the first of its own.

    Raises:
        FileError: the file is missing, unreadable or malformed; names the line.
        UnknownNameError: no such unit, up axis or animation.
        ValueRangeError: a unit or height of 0 or less, or both given; a rate below 0.001 or above 1e6.
    """
    require_ways(unit=unit, up=up, height=height, rate=rate)
    scale = None if unit is None else conventions.meters_per_unit(unit)
    path = find_motion(path)
    recording = _read(path, rate, animation)
    joints, decisions = _unique(recording.joints)
    decisions += recording.remarks
    roles = {role: joints[joint] for role, joint in recording.roles.items()}

    few = np.arange(min(len(recording.rotations), conventions.JUMP_FRAMES))
    spread = np.linspace(0, len(recording.rotations) - 1, stature.SAMPLES).astype(np.int64)
    points = recording.frames(np.concatenate([few, spread])).points()
    landmarks = stature.find_landmarks(joints, recording.parents, recording.end_parents, points, roles)
    units_tall = stature.standing_height(points, landmarks)

    jump = None
    if keep_first_frame is None and recording.up is None:
        bare = bool((np.abs(recording.rotations[0, :, 0]) > conventions.UNTURNED).all())
        jump = conventions.jumps_at_start(points[: len(few)], units_tall, bare=bare)
    if jump is not None:
        decisions.append(f"dropped frame 0: a joint jumps {jump:.2f} body heights to frame 1, as from an added T-pose")
    elif keep_first_frame is False and len(recording.rotations) > 1:
        decisions.append("dropped frame 0 as asked")
    if jump is not None or keep_first_frame is False:
        recording = recording.frames(slice(min(1, len(recording.rotations) - 1), None))
        points = points[1:]

    if up is None:
        up, sentence = conventions.choose_up(points, landmarks, units_tall)
        if recording.up is not None and landmarks is not None and up != recording.up:
            stated = f"up: +{recording.up.upper()} axis, as the file's format has it"
            sentence = f"{stated}, though the body stands along +{up.upper()}; give up if it's wrong"
        if recording.up is None or (landmarks is not None and up != recording.up):
            decisions.append(sentence)
        up = recording.up or up
    if height is not None:
        if units_tall <= 0:
            raise ValueRangeError(f"{path}: the body has no height, so it can't be scaled to {height:g} m")
        scale = height / units_tall
        decisions.append(f"unit: {scale:.4g} m, which makes the body {height:g} m tall, as asked")
    elif scale is None and recording.up is not None and conventions.is_in_metres(units_tall):
        scale = 1.0
    elif scale is None:
        scale, sentence = conventions.choose_unit(units_tall)
        decisions.append(sentence)
    elif remark := conventions.remark_on_height(units_tall * scale):
        decisions.append(f"unit: {scale:.4g} m as asked makes the body {units_tall * scale:.3g} m tall{remark}")
    clip = _convert(recording, joints, scale, up, text_of(name or path.stem), decisions)
    if (skin := recording.skin) is not None:
        skin = skin.turned(conventions.to_z_up(up), scale)
        skin = replace(skin, bones=tuple(joints[int(bone)] for bone in skin.bones))
    return replace(clip, roles=roles, skin=skin, morphs=recording.morphs)


def require_ways(*, unit: str | float | None, up: str | None, height: float | None, rate: float | None) -> None:
    """Check how a motion is to be read, as of `load`, before there is one.

    Raises:
        UnknownNameError: no such unit or up axis.
        ValueRangeError: a unit or height of 0 or less, or both given; a rate below 0.001 or above 1e6.
    """
    if unit is not None and height is not None:
        raise ValueRangeError("give either unit or height, not both")
    if height is not None and not 1e-3 <= height <= 1e3:
        raise ValueRangeError(f"height must be more than 0 m, not {height:g}")
    if unit is not None:
        conventions.meters_per_unit(unit)
    if up is not None:
        conventions.to_z_up(up)
    if rate is not None and not 1e-3 <= rate <= 1e6:
        raise ValueRangeError(f"rate must be above 0 frames per second, not {rate:g}")


def _read(path: Path, rate: float | None, animation: str | None) -> Recording:
    """What a file holds, by its kind."""
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        return gltf.read(path, rate=rate, animation=animation)
    if animation is not None:
        raise ValueRangeError(f"{path} holds a single motion: leave out the animation {animation!r}")
    if amass.is_amass(path):
        return amass.read(path, rate=rate)
    if suffix == amass.SUFFIX:
        raise FileError(f"{path} is no motion of AMASS, which holds trans and poses; a robot's needs its robot")
    return reader.read(path, rate)


_OTHERS = {
    **dict.fromkeys(
        (".pkl", ".pickle", ".joblib", ".pt", ".pth"),
        "a pickle, which may run any code as it is opened: save its arrays, such as root_pos, root_rot, dof_pos and "
        "fps, as an .npz file",
    ),
    ".npy": "an array without a name: save it as q or qpos in an .npz file",
    ".fbx": 'an FBX file: convert it to GLB, in Blender or by its command: blender -b --python-expr "import bpy; '
    "bpy.ops.wm.read_factory_settings(use_empty=True); bpy.ops.import_scene.fbx(filepath='IN.fbx'); "
    "bpy.ops.export_scene.gltf(filepath='OUT.glb')\"",
    ".dae": "a scene: export its motion as GLB or BVH, from Blender for example",
    ".c3d": "a take of markers, which are no joints: have the program that recorded them, or MotionBuilder, fit a "
    "skeleton to them, and export that as BVH",
    **dict.fromkeys((".asf", ".amc", ".trc"), "motion capture of another format: convert it to BVH"),
}
"""What files are that people have motions in and that are not read, by their suffixes."""


def find_motion(path: str | PathLike[str]) -> Path:
    """The file that is meant: one that exists, or a shipped clip.

    Raises:
        FileError: there is neither, or it is of a kind that isn't read; names the clip that may be meant.
    """
    found = Path(path)
    try:
        there = found.exists() and not (str(path) in clip_names() and found.is_dir())
    except (OSError, ValueError) as error:
        raise FileError(f"can't read {str(path)[:200]!r}: {error}") from None
    if there and (other := _OTHERS.get(found.suffix.lower())) is not None:
        raise FileError(f"{found} is {other}")
    if there:
        return found
    if str(path) in clip_names():
        return clip_path(str(path))
    if found.name != found.stem:
        raise FileError(f"no file {str(found)!r}")
    meant = f"; did you mean {like!r}?" if (like := likeliest(str(path), clip_names())) else ""
    raise FileError(f"no file {str(found)!r}; shipped clips: {', '.join(clip_names()) or 'none'}{meant}")


def _unique(names: tuple[str, ...]) -> tuple[tuple[str, ...], list[str]]:
    """Names with a number after the second and later uses of each, and a sentence for every new name."""
    taken, unique, decisions = set(names), [], []
    uses: Counter[str] = Counter()
    for name in names:
        uses[name] += 1
        new = name
        if uses[name] > 1:
            while (new := f"{name}_{uses[name]}") in taken:
                uses[name] += 1
            taken.add(new)
            decisions.append(f"renamed another joint {name!r} to {new!r}")
        unique.append(new)
    return tuple(unique), decisions


def _convert(
    recording: Recording, joints: tuple[str, ...], scale: float, up: str, name: str, decisions: list[str]
) -> Clip:
    """Turn all frames, the joints' own as well, so that offsets are Z up like the world."""
    turn = conventions.to_z_up(up)
    rotations = recording.rotations.copy()
    # R q R^-1 has q's scalar part and its vector part turned by R.
    rotations[..., 1:] = rotations[..., 1:] @ turn.T
    offsets = recording.offsets @ turn.T * scale
    positions = recording.positions @ turn.T * scale
    root_positions = np.repeat(offsets[None, 0], len(rotations), axis=0)
    offsets[0] = 0.0

    # A position channel replaces the OFFSET. One that stays constant is an offset, and only the others are kept.
    local_positions = None
    for slot, joint in enumerate(recording.moving):
        if joint == 0:
            root_positions = positions[:, slot]
            continue
        offsets[joint] = positions[:, slot].mean(axis=0)
        if np.ptp(positions[:, slot], axis=0).max() > _STILL:
            if local_positions is None:
                local_positions = np.zeros((len(rotations), len(joints), 3))
            local_positions[:, joint] = positions[:, slot]
    if local_positions is not None:
        still = ~local_positions.any(axis=(0, 2))
        local_positions[:, still] = offsets[still]
        local_positions[:, 0] = root_positions
    return Clip(
        name=name,
        joints=joints,
        parents=recording.parents,
        offsets=offsets,
        end_parents=recording.end_parents,
        end_offsets=recording.end_offsets @ turn.T * scale,
        fps=recording.fps,
        root_positions=root_positions,
        rotations_wxyz=quaternions.make_continuous(rotations),
        local_positions=local_positions,
        decisions=tuple(decisions),
    )
