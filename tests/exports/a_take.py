"""A take made by hand in which every field holds something of its own."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from cape.cloth.cloth import Cloth
from cape.cloth.fabrics import FABRICS
from cape.measure.contact_points import ContactPoints
from cape.results.loop import Loop
from cape.results.take import StepError, Take
from cape.scene.colliders import Box, Capsule, Cylinder, Ellipsoid, Plane, Sphere, TaperedCapsule
from cape.scene.loops import Travel
from motions import quaternions
from skeleton.track import BoneTrack

FRAMES, FPS = 7, 50.0
X, Y, Z = np.eye(3)


def make_bones(frames: int = FRAMES) -> BoneTrack:
    """A hip that walks and turns, an arm on it whose name no identifier has, and its hand, told before the arm."""
    times = 0.5 + np.arange(frames) / FPS
    positions = np.zeros((frames, 3, 3))
    positions[:, 0] = np.stack([times, 0.1 * times, 0.9 + 0 * times], axis=1)
    positions[:, 1] = positions[:, 0] + [0.1, 0.5, 0.3]
    positions[:, 2] = positions[:, 0] + [0.0, 0.2, 0.3]
    turns = np.random.default_rng(4).normal(size=(1, 3, 3)) + times[:, None, None] * [0.0, 1.0, 3.0]
    names, parents = ("hip", "left:hand", "left arm"), np.array([-1, 2, 0])
    turned = quaternions.from_rotation_vector(turns)
    return BoneTrack(names, times, positions, turned, parents, {"pelvis": "hip", "left_hand": "left:hand"})


def make_take(frames: int = FRAMES) -> Take:
    """A take of all of that."""
    rng = np.random.default_rng(5)
    cloth = Cloth.rectangle(width=0.5, height=0.4, spacing=0.1, fabric=FABRICS["worsted"])
    colliders = (
        Capsule("arm", "left arm", 0.1 * X, 0.3 * Y, 0.06, friction=0.3),
        Sphere(name="arm.", bone="left:hand", center=0.1 * Z, radius=0.2),
        Box(name="bench", center=X, half_sizes=np.array([0.5, 0.2, 0.1])),
        Plane(name="ground", point=0.25 * Z),
        TaperedCapsule(name="club", bone="hip", start=X, end=Y, start_radius=0.05, end_radius=0.15, thickness=0.02),
        Cylinder(name="drum", start=X, end=2.0 * X, radius=0.3),
        Ellipsoid(name="egg", bone="hip", center=Z, radii=np.array([0.1, 0.2, 0.3])),
    )
    contacts = ContactPoints(
        starts=np.minimum(np.arange(frames + 1), 3),
        points=rng.normal(size=(3, 3)).astype(np.float32),
        normals=np.eye(3, dtype=np.float32),
        depths=np.array([0.01, 0.02, 0.03], np.float32),
        colliders=np.array([0, 3, 1], np.int32),
        vertices=np.array([4, 5, 6], np.int32),
    )
    moved = cloth.positions + np.sin(np.arange(frames))[:, None, None] * [0.1, 0.2, 0.3]
    return Take(
        name="a take",
        bones=make_bones(frames),
        colliders=colliders,
        triangles=cloth.triangles,
        texcoords=cloth.texcoords,
        positions=(moved + rng.normal(scale=1e-2, size=moved.shape)).astype(np.float32),
        stretch_max=rng.random(frames),
        stretch_p99=0.01,
        penetration=rng.random(frames),
        penetrated=rng.integers(-1, 7, frames),
        kinetic_energy=rng.random(frames),
        solver="euler",
        substeps=12,
        compile_s=1.0 / 3.0,
        settle_s=0.2,
        solve_s=0.3,
        thickness=0.011,
        held=np.arange(20),
        left_out={"drum": "too far"},
        contacts=contacts,
        jumps=(2, 4),
        renewed=(4,),
        step_errors=(StepError(0.1, np.inf, "euler", 12), StepError(0.2, 1e-4, "euler", 12, 0.1, 1.0)),
        cloth=cloth,
        loop=Loop(Travel(0.1, 2.0 * X, 0.01, "hip"), 3, 0.02, 0.03, (1, 4), drawn=True),
        result="finished with warnings",
        warnings=("look \N{RIGHTWARDS ARROW} here",),
    )


def difference(a: Any, b: Any, where: str = "") -> str:
    """Where two values differ, an empty text where they don't: types, shapes and bits, but for the last of unit
    quaternions, which a track normalises."""
    if type(a) is not type(b) or (isinstance(a, list | tuple | dict) and len(a) != len(b)):
        return f"{where}: {a!r} and {b!r}"
    if isinstance(a, np.ndarray):
        close = np.array_equal(a, b) or ("rotations" in where and np.allclose(a, b, rtol=0.0, atol=1e-15))
        return "" if a.dtype == b.dtype and a.shape == b.shape and close else where
    if is_dataclass(a):
        return next(
            filter(None, (difference(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}") for f in fields(a))),
            "",
        )
    if isinstance(a, dict):
        return next(filter(None, (difference(a[key], b.get(key), f"{where}.{key}") for key in a)), "")
    if isinstance(a, list | tuple):
        return next(filter(None, (difference(x, y, f"{where}.{i}") for i, (x, y) in enumerate(zip(a, b)))), "")  # noqa: B905
    return "" if a == b or (a != a and b != b) else f"{where}: {a!r} and {b!r}"
