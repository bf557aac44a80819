"""The figures of the report that this project grew from, those of a sheet of cloth (`cape/scenes/registry.py`).

The bone that comes first is what the camera looks at, and the bones' heights tell how far away it is.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.air.wind import Wind
from cape.cloth.cloth import Cloth
from cape.cloth.fabrics import fabric
from cape.scene.colliders import Box, Collider, Plane, Sphere
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from cape.scene.self_contact import SelfContact
from cape.scene.standard_scenes import StandardScene, curtain, frame_times, track_of
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]
Place = tuple[float, float, float]

FLOOR = Plane(name="floor")
SEED = 5  # of the wind
FALL = 0.1  # m that a sheet falls before it meets something
ABOVE = 0.8  # m from the floor to the middle of what a sheet falls onto


def sheet(*, spacing: float = 0.03, seconds: float = 6.0) -> StandardScene:
    """Figure 1: a sheet of 1.2 x 1.4 m that hangs by its top edge in a wind of 1.6 m/s, with gusts and eddies."""
    cloth = Cloth.rectangle(width=1.2, height=1.4, spacing=spacing, origin=(0.0, 0.6, 1.8))
    wind = Wind(velocity=(1.6, 0.3, 0.0), gusts=0.4, turbulence=0.5, seed=SEED)
    scene = Scene(
        cloth, [attach(cloth, "rod", "top")], [FLOOR], wind=wind, self_contact=SelfContact(), strain_limit=True
    )
    return StandardScene("sheet", scene, _seen(seconds, (0.0, 0.0, 1.1), 0.4, rod=(0.0, 0.0, 1.8)))


def moved(*, spacing: float = 0.03, seconds: float = 6.0) -> StandardScene:
    """Figure 2: a sheet of 1 x 1 m held by cubes that move about, at its upper corners and the middle of its hem."""
    half = 0.05
    cloth = Cloth.rectangle(width=1.0, height=1.0, spacing=spacing, origin=(0.0, 0.5, 1.6))
    hem = cloth.region("bottom")
    corners = {
        "left_cube": cloth.region("top_left"),
        "right_cube": cloth.region("top_right"),
        "hem_cube": hem[[len(hem) // 2]],
    }
    below = half + Scene.thickness
    cubes = [
        Box(name=bone, bone=bone, center=np.array([0.0, 0.0, side * below]), half_sizes=np.full(3, half))
        for bone, side in (("left_cube", 1.0), ("right_cube", 1.0), ("hem_cube", -1.0))
    ]
    times = frame_times(seconds)
    # From rest and back, each in its own time, and never farther apart than the cloth is long.
    left, right, hem_way = (1.0 - np.cos(2.0 * np.pi * times / period) for period in (2.0, 3.0, 2.4))
    paths = {
        "left_cube": (0.0 * left, -0.15 * left, -0.05 * left),
        "right_cube": (0.1 * right, 0.1 * right, 0.0 * right),
        "hem_cube": (-0.15 * hem_way, 0.0 * hem_way, 0.2 * hem_way),
    }
    places = {
        bone: cloth.positions[corners[bone]].mean(axis=0) + np.stack(path, axis=1) for bone, path in paths.items()
    }
    attachments = [attach(cloth, bone, vertices) for bone, vertices in corners.items()]
    scene = Scene(cloth, attachments, [*cubes, FLOOR], wind=Wind(), self_contact=SelfContact(), strain_limit=True)
    return StandardScene("moved", scene, _seen(seconds, (0.0, 0.0, 1.1), 0.5, **places))


def on_sphere(*, spacing: float = 0.025, seconds: float = 4.0) -> StandardScene:
    """Figure 3: a sheet of 1.2 x 1.2 m that falls onto a sphere and stays there in folds."""
    return _falling("sphere", Sphere(name="sphere", center=np.array([0.0, 0.0, ABOVE]), radius=0.3), spacing, seconds)


def on_cube(*, spacing: float = 0.025, seconds: float = 4.0) -> StandardScene:
    """Figure 4: a sheet of 1.2 x 1.2 m that falls onto a cube and stays there."""
    cube = Box(name="cube", center=np.array([0.0, 0.0, ABOVE]), half_sizes=np.full(3, 0.3))
    return _falling("cube", cube, spacing, seconds)


def look(*, spacing: float = 0.02, seconds: float = 6.0) -> StandardScene:
    """Figure 5: a ribbed silk in folds, in a light wind, to look at its weave, its sheen and its other side."""
    standing = curtain(spacing=spacing, seconds=seconds)
    # Turned to the eye, which looks along X.
    cloth = replace(standing.scene.cloth, fabric=fabric("faille"))
    wind = Wind(velocity=(1.0, 1.0, 0.0), gusts=0.3, turbulence=0.3, seed=SEED)
    scene = replace(
        standing.scene,
        cloth=cloth,
        attachments=[attach(cloth, "rod", "top")],
        colliders=[FLOOR],
        wind=wind,
        self_contact=SelfContact(),
        strain_limit=True,
    )
    return StandardScene("look", scene, _seen(seconds, (0.0, -0.3, 0.9), 0.3, rod=(0.0, 0.0, 1.5)))


def _falling(name: str, onto: Collider, spacing: float, seconds: float) -> StandardScene:
    size, height = 1.2, ABOVE + 0.3 + Scene.thickness + FALL
    cloth = Cloth.rectangle(
        width=size, height=size, spacing=spacing,
        origin=(-size / 2.0, -size / 2.0, height), right=(0.0, 1.0, 0.0), down=(1.0, 0.0, 0.0),
    )  # fmt: skip
    scene = Scene(cloth, [], [onto, FLOOR], wind=Wind(), self_contact=SelfContact(), strain_limit=True)
    return StandardScene(name, scene, _seen(seconds, (0.0, 0.0, ABOVE), -0.2))


def _seen(seconds: float, middle: Place, low: float, /, **bones: FloatArray | Place) -> BoneTrack:
    """A track of bones that stand still or move [m].

    Before them come one that the camera looks at [m], and one as low as it has to see [m].
    """
    times = frame_times(seconds)
    still = np.zeros((len(times), 3))
    given = {"middle": middle, "low": (0.0, 0.0, low), **bones}
    return track_of(times, None, **{name: still + np.asarray(place, dtype=float) for name, place in given.items()})
