"""Joints and limbs that are faster than any human's, and frames out of line, which look as if they were.

Figures from the literature that the limits start from:

- upper arm against trunk: up to 9,000 deg/s in fast throws, the fastest motion of the body (Roach et al. 2013, "Elastic
  energy storage in the shoulder and the evolution of high-speed throwing in Homo", Nature 498:483);
- elbow and wrist: extension of the elbow in pitching, means about 2,300 deg/s (Fleisig et al. 1999, "Kinematic and
  kinetic comparison of baseball pitching among various levels of development", J. Biomech. 32:1371), to which comes
  the turn of the forearm about itself;
- knee: extension in kicking a ball, about 1,700 deg/s; hip and ankle are slower (review: Kellis and Katis 2007,
  "Biomechanical characteristics and determinants of instep soccer kick", J. Sports Sci. Med. 6:154);
- the body in the world: the fastest spin on skates, 342 turns a minute or 2,050 deg/s;
- hands and feet: a kicked ball leaves at 34 m/s at most (Andersen and Dörge 2011, Scand. J. Med. Sci. Sports 21:79),
  faster than the foot that hit it; the pelvis of a sprinter at 12 m/s.

All but the first and the last are means of groups; the limits leave room for the fastest and for axes not measured.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.checks.findings import Finding, in_frames, run_of
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

FASTEST_TURNS: Mapping[str, float] = {
    "pelvis": 2100.0,
    "upper_arm": 9000.0,
    "forearm": 4000.0,
    "hand": 4000.0,
    "thigh": 2000.0,
    "shin": 3000.0,
    "foot": 2000.0,
}
"""Greatest angular speed of a bone by the role it plays [deg/s], against the bone above it, the pelvis in the world."""
FASTEST_OTHER = 2000.0
"""The same for the joints of the spine, the neck and the collar bones [deg/s]."""
FASTEST_LIMB = 30.0
"""Greatest speed of a hand or foot against the pelvis [m/s]."""
FASTEST_PELVIS = 12.0
"""Greatest speed of the pelvis in the world [m/s]."""
GLITCH_SPEED = 1000.0
"""Slowest turn of a joint that can be a glitch [deg/s]: noise in a turn that is slower is hardly seen."""
GLITCH_RATIO = 4.0
"""How many times faster a glitch is than the steps two and three before and after it: a limb can't stop so fast."""


def glitches(track: BoneTrack, capsules: Sequence[Capsule]) -> list[Finding]:
    """Find frames in which a joint is out of line: one fast step, or one there and one back, amid slow ones.

    Looked at are the bones with a role or a capsule; nothing is found without the bones' parents.

    Returns:
        One for each joint, the fastest first.
    """
    found = []
    joints = _joints(track, capsules)
    for bone, speed in _angular_speeds(joints).items():
        sudden = _sudden(speed)
        if sudden.any():
            step = int(np.where(sudden, speed, 0.0).argmax())
            (first, last), others = run_of(sudden, step)
            turn = speed[step] * (track.times[step + 1] - track.times[step])
            text = (
                f"{_name(joints, bone)} turns by {turn:.0f} degrees {in_frames((first + 1, last + 1), others)}, far "
                f"faster than before and after ({speed[step]:.0f} deg/s): out of line?"
            )
            found.append(Finding("glitch", text, float(speed[step]), "deg/s", (first + 1, last + 1), (bone,)))
    return sorted(found, key=lambda finding: -finding.figure)


def too_fast(track: BoneTrack, capsules: Sequence[Capsule]) -> list[Finding]:
    """Find joints, hands, feet and pelvis that are faster than a human's, other than by a glitch.

    Returns:
        One for each joint and limb, what exceeds its limit most first.
    """
    found = []
    joints = _joints(track, capsules)
    for bone, speed in _angular_speeds(joints).items():
        limit = FASTEST_TURNS.get(_limb(joints, bone), FASTEST_OTHER)
        found += _beyond(np.where(_sudden(speed), 0.0, speed), limit, "turns", "deg/s", _name(joints, bone), bone)
    if pelvis := track.roles.get("pelvis"):
        steps = np.diff(track.times)
        path = track.positions[:, track.index(pelvis)]
        found += _beyond(_speeds(path, steps), FASTEST_PELVIS, "moves", "m/s", "pelvis", pelvis)
        for role in ("left_hand", "right_hand", "left_foot", "right_foot"):
            if limb := track.roles.get(role):
                relative = track.positions[:, track.index(limb)] - path
                found += _beyond(_speeds(relative, steps), FASTEST_LIMB, "moves", "m/s", role, limb)
    return [finding for _, finding in sorted(found, key=lambda scored: -scored[0])]


def _beyond(speed: FloatArray, limit: float, verb: str, unit: str, name: str, bone: str) -> list[tuple[float, Finding]]:
    """The finding that speeds of steps, shape (F - 1,), exceed a limit, with by how many times; none if they don't."""
    if not len(speed) or speed.max() <= limit:
        return []
    fastest = int(speed.argmax())
    (first, last), others = run_of(speed > limit, fastest)
    frames = (first + 1, last + 1)
    reached = f"{name} {verb} at up to {speed[fastest]:.0f} {unit} {in_frames(frames, others)}"
    text = f"{reached}; humans reach {limit:.0f} at most"
    return [(speed[fastest] / limit, Finding("speed", text, float(speed[fastest]), unit, frames, (bone,)))]


def _joints(track: BoneTrack, capsules: Sequence[Capsule]) -> BoneTrack:
    """The bones with a role or a capsule."""
    carriers = [capsule.bone for capsule in capsules if capsule.bone is not None]
    return track.select([*track.roles.values(), *carriers])


def _angular_speeds(track: BoneTrack) -> dict[str, FloatArray]:
    """Angular speed of each bone against its parent, of roots in the world, in each step [deg/s], shape (F - 1,)."""
    if track.parents is None:
        return {}
    speeds = {}
    for bone, (name, parent) in enumerate(zip(track.names, track.parents.tolist(), strict=True)):
        turned = track.rotations_wxyz[:, bone]
        if parent >= 0:
            turned = quaternions.multiply(quaternions.conjugate(track.rotations_wxyz[:, parent]), turned)
        steps = quaternions.multiply(quaternions.conjugate(turned[:-1]), turned[1:])
        angles = np.linalg.norm(quaternions.to_rotation_vector(steps), axis=-1)
        speeds[name] = np.degrees(angles) / np.diff(track.times)
    return speeds


def _sudden(speed: FloatArray) -> NDArray[np.bool_]:
    """Steps (F - 1,) that are far faster than those two and three before and after, as many as there are."""
    padded = np.pad(speed, 3, constant_values=np.nan)
    near = np.stack([padded[3 + shift : 3 + shift + len(speed)] for shift in (-3, -2, 2, 3)])
    around = np.where(np.isnan(near), 0.0, near).max(axis=0)
    known = np.isfinite(near).sum(axis=0) >= 2
    return known & (speed > GLITCH_SPEED) & (speed > GLITCH_RATIO * around)


def _speeds(path: FloatArray, steps: FloatArray) -> FloatArray:
    """Speeds along a path of points (F, 3) [m] whose steps take (F - 1,) [s], shape (F - 1,) [m/s]."""
    return np.linalg.norm(np.diff(path, axis=0), axis=1) / steps


def _name(track: BoneTrack, bone: str) -> str:
    """The first role that a bone plays, its own name if it plays none."""
    return next((role for role, name in track.roles.items() if name == bone), bone)


def _limb(track: BoneTrack, bone: str) -> str:
    """The part of the body that a bone is, its side left out."""
    return _name(track, bone).removeprefix("left_").removeprefix("right_")
