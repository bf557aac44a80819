"""Random arrangements of colliders and a small cloth, each made again by its number.

One to six spheres, capsules, boxes and planes are around a cloth that is held by its upper edge, by the left part of it
or by a corner. They may overlap, sweep through the cloth at up to 30 m/s, sway and spin, and all stand still for the
last third of the time. What kinds an arrangement lacks are parked far away, so that all run on the same compiled code.
Where the cloth starts it is

- `clear` of all colliders, or
- `shallow`: in them by up to 3 cm and half of their inner radius, so that all of it is on one side of each; or
- `contrary`: anywhere, also across the middle of a solid, or held inside of one: then what holds it and what keeps it
  out contradict each other.

No collider touches what is held but in the contrary ones. `contact_judge` runs them and tells what went wrong.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape import Box, Capsule, Cloth, GridCloth, Plane, Scene, Sphere, attach
from cape.scene import colliders
from cape.scene.colliders import Collider
from motions import quaternions
from skeleton.solid_measures import signed_distance
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

COUNT = 500
SEED = 20240
STARTS = {"clear": 0.45, "shallow": 0.4, "contrary": 0.15}  # and how many of them there are
FPS, FRAMES, MOVING = 60.0, 45, 30  # frames of which colliders move in the first ones
FINE = 8  # instants in a frame at which colliders must not touch what is held
TRIES = 30  # to place a collider
SPACING = 0.03  # m
SHALLOW = 0.03  # m
NUDGE = 1e-6  # m
PARKED = np.array([0.0, 0.0, -100.0])  # m

_Tapered: Any = getattr(colliders, "TaperedCapsule", None)


@dataclass(frozen=True)
class Arrangement:
    """A scene, the motion of its bones, how it starts, and the largest speed of a collider [m/s].

    The first `present` of the scene's colliders are those that count; the others are parked.
    """

    number: int
    start: str
    scene: Scene
    track: BoneTrack
    present: int
    fastest: float


def arrangement(number: int) -> Arrangement:
    """Make the arrangement of that number."""
    random = np.random.default_rng([SEED, number])
    kind = str(random.choice(list(STARTS), p=list(STARTS.values())))
    cloth = _cloth(random)
    attachment = attach(cloth, "rod", ("top", "top_left", [0])[random.integers(3)])
    times = np.arange(FRAMES * FINE + 1) / (FPS * FINE)
    rod = _rod(random, times)
    bones, solids, fastest = {"rod": (rod, np.tile([1.0, 0.0, 0.0, 0.0], (len(times), 1)))}, [], 0.0
    makers = (_sphere, _capsule, _box, _plane, _tapered)
    for index in range(random.integers(1, 7)):
        for _ in range(TRIES):
            solid = makers[random.integers(len(makers))](random, index)
            place, turn, speed = _motion(random, times, cloth, solid, _wanted_depth(random, kind, solid))
            held = cloth.positions[attachment.vertices] + rod[:, None]
            if kind == "contrary" or not _touched(solid, place, turn, held):
                bones[f"bone {index}"] = place, turn
                solids.append(solid)
                fastest = max(fastest, speed)
                break
    friction = float(random.uniform(0.05, 1.0))
    scene = Scene(cloth, [attachment], [*solids, *_parked()], friction=friction)
    track = BoneTrack(
        tuple(bones),
        times[::FINE],
        np.stack([place[::FINE] for place, _ in bones.values()], axis=1),
        np.stack([turn[::FINE] for _, turn in bones.values()], axis=1),
    )
    return Arrangement(number, kind, scene, track, len(solids), fastest)


def _cloth(random: np.random.Generator) -> GridCloth:
    """150 to 250 vertices, hanging or at any angle."""
    columns = int(random.integers(10, 18))
    rows = int(random.integers(-(-150 // columns), 250 // columns + 1))
    turn = np.eye(3) if random.random() < 0.5 else quaternions.to_matrix(_any_turn(random))
    return Cloth.rectangle(
        width=SPACING * (columns - 1), height=SPACING * (rows - 1), spacing=SPACING,
        right=turn @ [0.0, -1.0, 0.0], down=turn @ [0.0, 0.0, -1.0],
    )  # fmt: skip


def _rod(random: np.random.Generator, times: FloatArray) -> FloatArray:
    """Places of what holds the cloth, which stands still, or sways by up to 10 cm, shape (T, 3)."""
    sway = random.uniform(0.0, 0.1) if random.random() < 0.3 else 0.0
    return sway * np.sin(2 * np.pi * np.minimum(times, MOVING / FPS))[:, None] * _direction(random)


# All solids are around the origins of their bones; a plane goes through it.


def _sphere(random: np.random.Generator, index: int) -> Collider:
    return Sphere(name=f"sphere {index}", bone=f"bone {index}", radius=random.uniform(0.02, 0.2))


def _capsule(random: np.random.Generator, index: int) -> Collider:
    half = random.uniform(0.02, 0.3) * _direction(random)
    return Capsule(f"capsule {index}", f"bone {index}", -half, half, random.uniform(0.015, 0.12))


def _tapered(random: np.random.Generator, index: int) -> Collider:
    """A plain capsule where the package has no tapered ones, so that the numbers mean the same otherwise."""
    half, (first, last) = random.uniform(0.02, 0.3) * _direction(random), random.uniform(0.015, 0.12, 2)
    name, bone = f"tapered capsule {index}", f"bone {index}"
    if _Tapered is None:
        return Capsule(name, bone, -half, half, first)
    return _Tapered(name=name, bone=bone, start=-half, end=half, start_radius=first, end_radius=last)


def _box(random: np.random.Generator, index: int) -> Collider:
    return Box(
        name=f"box {index}", bone=f"bone {index}", half_sizes=random.uniform(0.02, 0.2, 3),
        rotation_wxyz=_any_turn(random),
    )  # fmt: skip


def _plane(random: np.random.Generator, index: int) -> Collider:
    return Plane(name=f"plane {index}", bone=f"bone {index}", normal=_direction(random))


def _parked() -> list[Collider]:
    """One of each kind where nothing comes."""
    kinds: list[Collider] = [
        # So small that triangles must be kept out of it, as they must of some capsules that count.
        Sphere(name="parked sphere", center=PARKED, radius=0.001),
        Capsule("parked capsule", None, PARKED, PARKED + 0.1, 0.1),
        Box(name="parked box", center=PARKED),
        Plane(name="parked plane", point=PARKED),
    ]
    if _Tapered is not None:
        kinds.append(
            _Tapered(
                name="parked tapered", bone=None, start=PARKED, end=PARKED + 0.3,
                start_radius=0.1, end_radius=0.001,
            )
        )  # fmt: skip
    return kinds


def _wanted_depth(random: np.random.Generator, kind: str, solid: Collider) -> float:
    """How deep the deepest vertex may be in a solid at the start [m], negative for a distance."""
    if kind == "contrary":
        return np.inf
    if kind == "clear":
        return -random.uniform(0.006, 0.1)
    half = np.inf if isinstance(solid, Plane) else -0.5 * signed_distance(solid, np.zeros((1, 3)))[0]
    return min(random.uniform(0.0, SHALLOW), half)


def _motion(
    random: np.random.Generator, times: FloatArray, cloth: Cloth, solid: Collider, depth: float
) -> tuple[FloatArray, FloatArray, float]:
    """How a solid moves, and the largest speed of its points [m/s].

    Somewhere around a place of the cloth, and drawn back until the cloth is no deeper in it than so much [m], it stands
    still, sweeps over that place, sways or spins. Places (T, 3) [m] and rotations bone_to_world wxyz (T, 4).
    """
    target = cloth.positions[random.integers(cloth.vertices)]
    first = _any_turn(random)
    way = _direction(random)
    if isinstance(solid, Plane):  # drawn back to where its normal comes from
        way = -quaternions.rotate(first, solid.normal)
    start, matrix = target + random.uniform(0.0, 0.3) * way, quaternions.to_matrix(first)
    while (excess := _depths(solid, start, matrix, cloth.positions).max() - depth) > 0.0:
        start = start + (excess + NUDGE) * way
    place, turn = np.tile(start, (len(times), 1)), np.tile(first, (len(times), 1))
    moving = np.minimum(times, MOVING / FPS)
    motion = random.choice(["stands", "sweeps", "sways", "spins"], p=[0.3, 0.35, 0.2, 0.15])
    if motion == "sweeps":
        speed = 0.3 * 100.0 ** random.random()
        path = np.linalg.norm(start - target) + random.uniform(0.0, 0.3)
        place -= np.minimum(speed * moving, path)[:, None] * way
        return place, turn, speed
    if motion == "sways":
        size, rate = random.uniform(0.05, 0.25), 2 * np.pi * random.uniform(0.5, 4.0)
        place += size * np.sin(rate * moving)[:, None] * _direction(random)
        return place, turn, size * rate
    if motion == "spins":
        rate = random.uniform(2.0, 30.0)
        spin = quaternions.from_rotation_vector(rate * moving[:, None] * _direction(random))
        reach = np.linalg.norm(cloth.positions - start, axis=1).max()  # at most, of what touches the cloth
        return place, quaternions.multiply(spin, turn), rate * reach
    return place, turn, 0.0


def _touched(solid: Collider, place: FloatArray, turn: FloatArray, points: FloatArray) -> bool:
    """Tell whether any of the points (T, N, 3) comes as near to the moving solid as cloth may."""
    return depths(solid, place[:, None], turn, points).max() > -Scene.thickness


def depths(solid: Collider, place: FloatArray, turn: FloatArray, points: FloatArray) -> FloatArray:
    """Depths of points in the world (..., N, 3) in a solid [m].

    Its bone is at places that broadcast against the points, turned bone_to_world wxyz (..., 4).
    """
    return _depths(solid, place, quaternions.to_matrix(turn), points)


def _depths(solid: Collider, place: FloatArray, matrix: FloatArray, points: FloatArray) -> FloatArray:
    local = (points - place) @ matrix
    return -signed_distance(solid, local.reshape(-1, 3)).reshape(local.shape[:-1])


def _direction(random: np.random.Generator) -> FloatArray:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _any_turn(random: np.random.Generator) -> FloatArray:
    return quaternions.normalize(random.normal(size=4))
