"""What is measured: a hanging sheet as a grid and as a mesh, and the same with one feature more."""

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np

from cape.air.wind import Wind
from cape.assembly.assemble import Assembly, assemble
from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.scene.colliders import Box, Plane
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from cape.scene.standard_scenes import StandardScene, swing
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

WIDTH, HEIGHT = 0.8, 1.2  # m, of the scene `swing`
SECONDS = 2.0  # of its motion

LAYOUTS: Final = ("grid", "mesh")
FABRIC: Final = ("springs", "damping", "bending", "bend damping")  # features of the default fabric
WHOLE: Final = "bend damping"  # label of the variant that has them all, and nothing else
OFF: Final = "all of these switched off"  # label of the same, made of a scene that has everything


def sheet(vertices: int, layout: str = "grid", *, fabric: Fabric | None = None) -> StandardScene:
    """The scene `swing` with about so many vertices, as a grid or as the same triangles in a mesh.

    A free sheet of springs, damping and bending, whose top edge is shaken; no contact, no wind.
    """
    swinging = swing(spacing=_spacing(vertices), fabric=fabric or Fabric(), seconds=SECONDS)
    return swinging if layout == "grid" else replace(swinging, scene=as_mesh(swinging.scene))


@cache
def assembled(vertices: int, layout: str) -> tuple[Assembly, BoneTrack]:
    """The arrays of a sheet and the motion of its bones; all that step it in turn may share them."""
    swinging = sheet(vertices, layout)
    return assemble_standing(swinging.scene), swinging.track


def assemble_standing(scene: Scene) -> Assembly:
    """The arrays of a scene whose attachments hold vertices where they start, for one thread or two."""
    return assemble(scene, [a.vertices for a in scene.attachments], threads=2)


def as_mesh(scene: Scene) -> Scene:
    """Give the same scene with its cloth as a mesh."""
    cloth = scene.cloth
    mesh = Cloth.from_mesh(
        cloth.positions, cloth.triangles, pattern=cloth.pattern, fabric=cloth.fabric, regions=cloth.regions
    )
    return replace(scene, cloth=mesh, attachments=[attach(mesh, a.bone, a.vertices) for a in scene.attachments])


def _spacing(vertices: int) -> float:
    """Spacing at which the sheet has so many vertices: (WIDTH / s + 1) (HEIGHT / s + 1) of them [m]."""
    half = (WIDTH + HEIGHT) / 2.0
    return WIDTH * HEIGHT / (math.sqrt(half * half + WIDTH * HEIGHT * (vertices - 1)) - half)


@dataclass(frozen=True)
class Variant:
    """A scene with a feature, next to the one without it.

    Attributes:
        label: what the scene has beyond `over`.
        over: label of the variant that it is compared with, None for the first.
        features: all that it has.
        scene: the scene.
        read: statistics are read after every frame.
    """

    label: str
    over: str | None
    features: tuple[str, ...]
    scene: Scene
    read: bool = False


# The sheet hangs aslant, so that what stands behind it is touched by all of it.
ASLANT: Final = (3.0, 0.0, -9.0)  # m/s2
AT, FAR = 0.13, 5.0  # m, from the sheet to the axes of the body: touching, and out of reach


def variants(vertices: int) -> list[Variant]:
    """The sheet of springs alone, of a whole fabric, and that with each feature that a scene may have."""
    springs = Fabric(bend=0.0, damping_time=0.0, bend_damping_time=0.0)
    damped = replace(springs, damping_time=Fabric().damping_time)
    bending = replace(damped, bend=Fabric().bend)
    box = Box(center=np.array([AT, 0.0, 1.0]), half_sizes=np.array([AT, 0.2, 0.3]))
    plane = Plane(point=np.zeros(3), normal=np.array([-1.0, 0.0, 0.0]))
    hung = {"friction": 0.0, "gravity": ASLANT}

    def variant(
        label: str, over: str | None, features: tuple[str, ...], fabric: Fabric | None = None, **has
    ) -> Variant:
        read = has.pop("read", False)
        return Variant(label, over, features, replace(sheet(vertices, fabric=fabric).scene, **hung | has), read)

    everything = variant(
        "", None, (), wind=Wind(velocity=(2.0, 0.0, 0.0)), colliders=(*body(AT), box, plane), friction=0.3
    ).scene
    return [
        variant("springs", None, FABRIC[:1], springs),
        variant("damping", "springs", FABRIC[:2], damped),
        variant("bending", "damping", FABRIC[:3], bending),
        variant(WHOLE, "bending", FABRIC),
        variant("wind", WHOLE, (*FABRIC, "wind"), wind=Wind(velocity=(2.0, 0.0, 0.0))),
        variant("capsules out of reach", WHOLE, (*FABRIC, "capsules"), colliders=body(FAR)),
        variant("capsules touched", WHOLE, (*FABRIC, "capsules"), colliders=body(AT)),
        variant("friction", "capsules touched", (*FABRIC, "capsules", "friction"), colliders=body(AT), friction=0.3),
        variant("box touched", WHOLE, (*FABRIC, "boxes"), colliders=(box,)),
        variant("plane touched", WHOLE, (*FABRIC, "planes"), colliders=(plane,)),
        variant("statistics", WHOLE, (*FABRIC, "statistics"), read=True),
        Variant(OFF, WHOLE, FABRIC, replace(everything, wind=None, colliders=(), friction=0.0)),
    ]


def body(distance: float) -> tuple[Capsule, ...]:
    """Six capsules of a body behind the sheet: trunk, head, arms, thighs."""
    places = {
        "trunk": ((0.0, 0.95), (0.0, 1.25), 0.13),
        "head": ((0.0, 1.6), (0.0, 1.7), 0.10),
        "left arm": ((0.25, 1.25), (0.3, 0.95), 0.05),
        "right arm": ((-0.25, 1.25), (-0.3, 0.95), 0.05),
        "left thigh": ((0.1, 0.9), (0.1, 0.5), 0.08),
        "right thigh": ((-0.1, 0.9), (-0.1, 0.5), 0.08),
    }
    return tuple(
        Capsule(name, None, np.array([distance, *start]), np.array([distance, *end]), radius)
        for name, (start, end, radius) in places.items()
    )
