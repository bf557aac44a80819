"""The standard scenes that tests, benchmarks and the report share."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cape.air.wind import Wind
from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.scene.colliders import Box, Sphere
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from motions import quaternions
from motions.errors import UnknownNameError
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

FPS = 60.0
# A woven cloth of twill's weight, tightly set and stiff in bending. It is no one's measured fabric, and stays as it is:
# errors and times of two versions compare on one cloth alone.
SHEET = Fabric(density=0.220, stretch=2026.0, shear=105.0, bend=1.6e-4)


@dataclass(frozen=True, eq=False)
class StandardScene:
    """A scene with the motion of its bones.

    Attributes:
        name: what it is called.
        scene: cloth, attachments, colliders, forces.
        track: poses of the bones.
        smooth: nothing touches the cloth, and it neither buckles nor flutters, so that errors stay as small as they are
            made. In all other scenes trajectories diverge, however short the step.
    """

    name: str
    scene: Scene
    track: BoneTrack
    smooth: bool = False


def standard_scene(name: str) -> StandardScene:
    """Build the standard scene of that name, also one that tears (`cape.scene.tearing_scenes`).

    Raises:
        UnknownNameError: there is no such scene.
    """
    from cape.scene.tearing_scenes import TEARING_SCENES

    scenes = {**STANDARD_SCENES, **TEARING_SCENES}
    if name not in scenes:
        raise UnknownNameError("standard scene", name, scenes)
    return scenes[name]()


def swing(
    *, spacing: float = 0.03, fabric: Fabric | None = None, seconds: float = 3.0, fps: float = FPS
) -> StandardScene:
    """A woven sheet, 0.8 x 1.2 m, whose top edge is moved forth and back by 15 cm, once in two seconds, from rest.

    Twice as often it would buckle on its way back. `fps` are the frames a second in which the motion is told.
    """
    fabric = fabric or SHEET
    cloth = Cloth.rectangle(width=0.8, height=1.2, spacing=spacing, fabric=fabric, origin=(0.0, 0.4, 1.5))
    times = frame_times(seconds, fps)
    # The sine sets out slowly over a quarter of its period, so that it has no kink that a step could not resolve.
    ramp = np.clip(times / 0.5, 0.0, 1.0)
    place = np.zeros((len(times), 3))
    place[:, 0] = 0.15 * ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2) * np.sin(np.pi * times)
    track = track_of(times, rod=place)
    return StandardScene("swing", Scene(cloth, [attach(cloth, "rod", "top")]), track, smooth=True)


def flag(*, spacing: float = 0.03, seconds: float = 3.0) -> StandardScene:
    """A flag of 1.2 x 0.8 m in a wind of 6 m/s, held along one edge by a pole that stands still."""
    cloth = Cloth.rectangle(width=1.2, height=0.8, spacing=spacing, origin=(0.0, 0.0, 2.0), right=(0.98, 0.2, 0.0))
    times = frame_times(seconds)
    scene = Scene(cloth, [attach(cloth, "pole", "left")], wind=Wind(velocity=(6.0, 0.0, 0.0)))
    return StandardScene("flag", scene, track_of(times, pole=np.zeros((len(times), 3))))


def draped(name: str, collider: Sphere | Box, *, spacing: float = 0.03, seconds: float = 3.0) -> StandardScene:
    """A sheet of 1 x 1 m that falls onto a shape from 0.1 m above it."""
    cloth = Cloth.rectangle(
        width=1.0, height=1.0, spacing=spacing, origin=(-0.5, 0.5, 0.4), right=(0, -1, 0), down=(1, 0, 0)
    )
    times = frame_times(seconds)
    return StandardScene(
        name, Scene(cloth, [], [collider], wind=Wind()), track_of(times, ground=np.zeros((len(times), 3)))
    )


def curtain(*, spacing: float = 0.03, gather: float = 1.0, seconds: float = 1.0) -> StandardScene:
    """A woven sheet, 0.72 x 1.2 m, whose top edge is held still in two waves, and whose hem opens by itself.

    Along the edge its direction turns as gather sin(k u), the sine-generated curve of Langbein and Leopold 1966, "River
    meanders": as long as the pattern, so that the sheet starts without strain. `gather` is the largest angle to the
    straight line [rad], 0 for a sheet that hangs flat. Half of 6 cm, and half of that, cut the sheet evenly, too.
    """
    cloth = Cloth.rectangle(width=0.72, height=1.2, spacing=spacing, fabric=SHEET)
    u, v = cloth.pattern.T
    # So fine that the curve is the same to a nanometre whatever the spacing.
    lines = np.linspace(0.0, 0.72, 20_001)
    angles = gather * np.sin(2.0 * np.pi * 2.0 * (lines[1:] + lines[:-1]) / 2.0 / 0.72)
    along, off = (
        np.interp(u, lines, np.concatenate([[0.0], np.cumsum(np.diff(lines) * part)]))
        for part in (np.cos(angles), np.sin(angles))
    )
    cloth = replace(cloth, positions=np.stack([off, -along, 1.5 - v], axis=1))
    times = frame_times(seconds)
    track = track_of(times, rod=np.zeros((len(times), 3)))
    return StandardScene("curtain", Scene(cloth, [attach(cloth, "rod", "top")]), track, smooth=True)


def plain(*, spacing: float = 0.0257, fabric: Fabric | None = None, seconds: float = 10.0) -> StandardScene:
    """A cape of 32 x 48 vertices behind six moving capsules, without any skeleton.

    0.8 x 1.2 m, 0.2 kg/m2; the top row walks forward at 1.5 m/s with a bob of 5 cm at 2 Hz, and torso, head, upper arms
    and thighs with it, the limbs swinging once a second.
    """
    cloth = Cloth.rectangle(width=0.8, height=1.2, spacing=spacing, fabric=fabric, origin=(-0.2, 0.4, 1.45))
    times = frame_times(seconds)
    walk = np.zeros((len(times), 3))
    walk[:, 0] = 1.5 * times
    walk[:, 2] = 0.05 * np.sin(2.0 * np.pi * 2.0 * times)
    swinging = 0.5 * np.sin(2.0 * np.pi * times)
    joints = {
        "torso": ((0.0, 0.0, 1.0), 0.0),
        "head": ((0.0, 0.0, 1.55), 0.0),
        "left_arm": ((0.0, 0.2, 1.4), 1.0),
        "right_arm": ((0.0, -0.2, 1.4), -1.0),
        "left_thigh": ((0.0, 0.1, 0.95), -0.8),
        "right_thigh": ((0.0, -0.1, 0.95), 0.8),
    }
    sizes = {"torso": (0.4, 0.13), "head": (0.12, 0.1), "arm": (-0.3, 0.05), "thigh": (-0.42, 0.08)}
    capsules = []
    for bone in joints:
        length, radius = sizes[bone.split("_")[-1]]
        capsules.append(Capsule(bone, bone, np.zeros(3), np.array([0.0, 0.0, length]), radius))
    turns = [swinging[:, None] * np.array([0.0, share, 0.0]) for _, share in joints.values()]
    track = BoneTrack(
        tuple(joints),
        times,
        np.stack([walk + np.array(place) for place, _ in joints.values()], axis=1),
        np.stack([quaternions.from_rotation_vector(turn) for turn in turns], axis=1),
    )
    return StandardScene("plain", Scene(cloth, [attach(cloth, "torso", "top")], capsules), track)


def worn(clip: str, *, vertices: int | None = None, fabric: Fabric | None = None) -> StandardScene:
    """A cape that hangs from the shoulders of a body which moves as a shipped clip tells, of about so many vertices."""
    import motions
    from cape.garments.back_cape import BACK_CAPE, SPACING
    from cape.scene.dress import dress
    from skeleton.model import Skeleton

    motion = motions.load(clip)
    body = Skeleton.from_clip(motion)
    track = body.track(motion)
    spacing = SPACING * body.height()
    if vertices is not None:
        spacing *= np.sqrt(dress(body, track, garment=BACK_CAPE.name).cloth.vertices / vertices)
    return StandardScene(clip, dress(body, track, garment=BACK_CAPE.name, spacing=spacing, fabric=fabric), track)


STANDARD_SCENES: dict[str, Callable[[], StandardScene]] = {
    "swing": swing,
    "flag": flag,
    "sphere": partial(draped, "sphere", Sphere(center=np.zeros(3), radius=0.3)),
    "cube": partial(draped, "cube", Box(center=np.zeros(3), half_sizes=np.full(3, 0.3))),
    "plain": plain,
    "walk": partial(worn, "walk"),
    "run": partial(worn, "run"),
    "spin": partial(worn, "spin"),
    "kick": partial(worn, "kick"),
    "stiff": lambda: replace(swing(fabric=replace(SHEET, stretch=1e6, shear=1e5)), name="stiff"),
    "fine": lambda: replace(worn("walk", vertices=20_000), name="fine"),
}


def frame_times(seconds: float, fps: float = FPS) -> FloatArray:
    """Times of the frames of a motion [s]."""
    return np.arange(round(seconds * fps) + 1) / fps


def track_of(times: FloatArray, turns: dict[str, FloatArray] | None = None, **places: FloatArray) -> BoneTrack:
    """Bones at positions [m] of shape (F, 3) each, turned by rotation vectors [rad] of the same shape where given."""
    still = np.zeros((len(times), 3))
    rotations = [quaternions.from_rotation_vector((turns or {}).get(name, still)) for name in places]
    return BoneTrack(tuple(places), times, np.stack(list(places.values()), axis=1), np.stack(rotations, axis=1))
