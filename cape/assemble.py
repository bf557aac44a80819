"""From a scene to the arrays that kernels work on."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import UnionType

import numpy as np
from numpy.typing import NDArray

from cape.colliders import Box, Collider, Plane, Sphere
from cape.kernels.bones import blank_motion
from cape.kernels.contact import BLOCK
from cape.kernels.records import Air, Attached, Boxes, Capsules, Contacts, MotionRoom, Planes
from cape.scene import Scene
from cape.springs import Springs, springs_of
from motions import quaternions
from skeleton.capsules import Capsule

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Assembly:
    """A scene as arrays; bones are numbered as in `scene.bones`, and one more stands for the world.

    Attributes:
        scene: what was assembled.
        springs: the cloth's springs.
        mass: of the vertices [kg], shape (N,).
        inverse_mass: [1/kg], shape (N,), zero for attached vertices.
        free: False for attached vertices, shape (N,).
        attached: what bones hold; its points change while the cloth is put on. None when nothing is attached.
        air: None in vacuum.
        contacts: the colliders by kind, None for a kind that the scene has not.
        collider_order: for capsules, planes and boxes, indices into `scene.colliders`.
        room: for the bones' motion within a frame.
    """

    scene: Scene
    springs: Springs
    mass: FloatArray
    inverse_mass: FloatArray
    free: NDArray[np.bool_]
    attached: Attached | None
    air: Air | None
    contacts: Contacts
    collider_order: tuple[list[int], list[int], list[int]]
    room: MotionRoom


def assemble(scene: Scene, vertices: list[NDArray[np.int64]], dtype: type[np.floating]) -> Assembly:
    """Build the arrays of a scene whose attachments hold the given vertices, in the precision `dtype`."""
    cloth = scene.cloth
    mass = cloth.masses()
    free = np.ones(cloth.vertices, dtype=bool)
    for indices in vertices:
        free[indices] = False
    return Assembly(
        scene=scene,
        springs=springs_of(cloth),
        mass=mass,
        inverse_mass=np.where(free, 1.0 / mass, 0.0),
        free=free,
        attached=_attached(scene, vertices),
        air=_air(scene, dtype),
        contacts=_contacts(scene, free),
        collider_order=(_places(scene, Capsule | Sphere), _places(scene, Plane), _places(scene, Box)),
        room=MotionRoom(*blank_motion(len(scene.bones) + 1)),
    )


def _places(scene: Scene, kind: type | UnionType) -> list[int]:
    return [i for i, collider in enumerate(scene.colliders) if isinstance(collider, kind)]


def _attached(scene: Scene, vertices: list[NDArray[np.int64]]) -> Attached | None:
    if not any(len(indices) for indices in vertices):
        return None
    bones = [np.full(len(v), scene.bones.index(a.bone)) for a, v in zip(scene.attachments, vertices, strict=True)]
    indices = np.concatenate(vertices)
    return Attached(indices, np.concatenate(bones), np.zeros((len(indices), 3)))


def _air(scene: Scene, dtype: type[np.floating]) -> Air | None:
    wind, cloth = scene.wind, scene.cloth
    if wind is None:
        return None
    cells = np.zeros((cloth.rows, cloth.columns), dtype=dtype)
    cells[:-1, :-1] = 1.0
    return Air(
        wind=np.array(wind.velocity, dtype=float),
        drag=wind.density * wind.drag / 12.0,
        lift=wind.density * wind.lift / 12.0,
        cells=cells.ravel(),
        columns=cloth.columns,
        room=np.zeros((6, cloth.vertices), dtype=dtype),
    )


def _contacts(scene: Scene, free: NDArray[np.bool_]) -> Contacts:
    blocks = -(-len(free) // BLOCK)
    # A sphere is a capsule without length.
    capsules = [c for c in scene.colliders if isinstance(c, Capsule | Sphere)]
    planes = [c for c in scene.colliders if isinstance(c, Plane)]
    boxes = [c for c in scene.colliders if isinstance(c, Box)]
    return Contacts(
        free=free,
        thickness=scene.thickness,
        capsules=Capsules(
            bones=_bones(scene, capsules),
            starts=np.array([c.center if isinstance(c, Sphere) else c.start for c in capsules], dtype=float),
            ends=np.array([c.center if isinstance(c, Sphere) else c.end for c in capsules], dtype=float),
            radius=np.array([c.radius for c in capsules], dtype=float),
            friction=_friction(scene, capsules),
            placed=np.zeros((len(capsules), 8)),
            near=np.zeros((blocks, len(capsules) + 1), dtype=np.int64),
            touched=np.zeros(BLOCK, dtype=np.int64),
        )
        if capsules
        else None,
        planes=Planes(
            bones=_bones(scene, planes),
            points=np.array([c.point for c in planes], dtype=float),
            normals=np.array([c.normal / np.linalg.norm(c.normal) for c in planes], dtype=float),
            friction=_friction(scene, planes),
        )
        if planes
        else None,
        boxes=Boxes(
            bones=_bones(scene, boxes),
            centers=np.array([c.center for c in boxes], dtype=float),
            halves=np.array([c.half_sizes for c in boxes], dtype=float),
            frames=np.array([quaternions.to_matrix(c.rotation_wxyz) for c in boxes], dtype=float),
            friction=_friction(scene, boxes),
            room=np.zeros((3, 3)),
        )
        if boxes
        else None,
    )


def _bones(scene: Scene, colliders: Sequence[Collider]) -> NDArray[np.int64]:
    """Numbers of the bones that carry the colliders; the world comes after the last bone."""
    return np.array([len(scene.bones) if c.bone is None else scene.bones.index(c.bone) for c in colliders])


def _friction(scene: Scene, colliders: Sequence[Collider]) -> FloatArray:
    return np.array([scene.friction if c.friction is None else c.friction for c in colliders])
