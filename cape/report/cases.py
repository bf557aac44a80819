"""Stress cases: what has broken character cloth elsewhere, each a small scene.

Gathered from papers on cloth and from the issue trackers of simulators; `Case.about` says what each is.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cape.air.wind import Wind
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.fabric import Fabric
from cape.scene.colliders import Box, Collider, Plane, Sphere
from cape.scene.holding.attachments import attach
from cape.scene.jumps import Cuts
from cape.scene.scene import Scene
from cape.scene.standard_scenes import StandardScene, frame_times, track_of
from cape.scene.tearing_scenes import torn
from skeleton.shapes import Capsule

FloatArray = NDArray[np.float64]
Disturbed = Callable[[np.random.Generator, FloatArray], FloatArray]

JITTER = 1e-6  # m, by which repeats differ
BALL_STOPS = 1.0  # s at which a ball that tears a sheet does, long after it has come through


def jittered(rng: np.random.Generator, positions: FloatArray) -> FloatArray:
    """Small offsets [m] of vertices at positions (V, 3)."""
    return JITTER * rng.standard_normal(positions.shape)


def crumpled(rng: np.random.Generator, positions: FloatArray) -> FloatArray:
    """Offsets [m] that put every vertex anywhere in a cube of half the cloth's size."""
    middle, size = positions.mean(axis=0), 0.5 * np.ptp(positions, axis=0).max()
    return middle + rng.uniform(-0.5 * size, 0.5 * size, positions.shape) - positions


def flattened(rng: np.random.Generator, positions: FloatArray) -> FloatArray:
    """Offsets [m] that put all vertices at the height of the highest one."""
    return jittered(rng, positions) + (positions[:, 2].max() - positions[:, 2])[:, None] * np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Case:
    """A stress case.

    Attributes:
        name: what it is called.
        about: what happens in it.
        build: makes its scene and motion.
        stretch: strain of a thread that is no fault whatever draws [1]: by default what a user would take for cloth.
        reason: why so much and no more; empty where a converged run may show that more is due (`stability`).
        after: time from which strain and penetration count [s]; before it the scene itself asks for the impossible.
        disturb: offsets of the vertices at the start [m], from a generator of random numbers and their positions.
        cuts: what counts as a jump of the bones, None to take all as motion.
    """

    name: str
    about: str
    build: Callable[[], StandardScene]
    stretch: float = 0.1
    reason: str = ""
    after: float = 0.0
    disturb: Disturbed = jittered
    cuts: Cuts | None = field(default_factory=Cuts)


def hung(
    *,
    fabric: Fabric | None = None,
    colliders: tuple[Collider, ...] = (),
    seconds: float = 2.0,
    wind: Wind | None = None,
    cloth: Cloth | None = None,
    places: dict[str, FloatArray] | None = None,
    turns: dict[str, FloatArray] | None = None,
    ends: dict[str, str] | None = None,
) -> StandardScene:
    """A sheet held by its top edge, between whatever is around it; bones are still but for `places` [m], `turns`."""
    cloth = cloth or _sheet(fabric=fabric)
    ends = ends or {"rod": "top"}
    times = frame_times(seconds)
    moved = {bone: np.zeros((len(times), 3)) for bone in ends} | (places or {})
    held = [attach(cloth, bone, region) for bone, region in ends.items()]
    return StandardScene("", Scene(cloth, held, colliders, wind=wind), track_of(times, turns, **moved))


def _sheet(
    *, width: float = 0.6, height: float = 0.6, spacing: float = 0.04, fabric: Fabric | None = None
) -> GridCloth:
    """A sheet that hangs in the plane x = 0 from the height 1.5 m."""
    return Cloth.rectangle(width=width, height=height, spacing=spacing, fabric=fabric, origin=(0.0, 0.5 * width, 1.5))


def _stiff() -> StandardScene:
    return hung(fabric=Fabric(stretch=1e8, shear=1e7, damping_time=0.0, bend_damping_time=0.0), seconds=1.0)


def _pulled() -> StandardScene:
    down = np.zeros((len(frame_times(2.0)), 3))
    down[:, 2] = -0.006 * np.clip(frame_times(2.0), 0.0, 1.0)
    return hung(fabric=Fabric(stretch=1e7, shear=1e6), places={"clamp": down}, ends={"rod": "top", "clamp": "bottom"})


def _twisted() -> StandardScene:
    times = frame_times(4.0)
    turns = np.zeros((len(times), 3))
    turns[:, 2] = 2.0 * np.pi * np.clip(times, 0.0, 3.0)
    rise = np.zeros_like(turns)
    rise[:, 2] = 0.1 * np.clip(times / 3.0, 0.0, 1.0)
    cloth = _sheet(width=0.12, height=1.0, spacing=0.02)
    return hung(cloth=cloth, seconds=4.0, places={"clamp": rise}, turns={"clamp": turns},
                ends={"rod": "top", "clamp": "bottom"})  # fmt: skip


def _pinched() -> StandardScene:
    times = frame_times(3.0)
    # Closed, 8 cm into each other, from 1 to 2 s; then open again.
    apart = 0.25 - 0.21 * np.clip(np.minimum(times, 3.0 - times), 0.0, 1.0)
    places = {"left": np.zeros((len(times), 3)), "right": np.zeros((len(times), 3))}
    places["left"][:, 0], places["right"][:, 0] = apart - 0.02, 0.02 - apart
    limbs = [
        Capsule(bone, bone, np.array([0.0, -0.3, 1.2]), np.array([0.0, 0.3, 1.2]), 0.06) for bone in ("left", "right")
    ]
    return hung(colliders=tuple(limbs), places=places, seconds=3.0)


def _started_inside() -> StandardScene:
    return hung(colliders=(Sphere(center=np.array([0.03, 0.0, 1.1]), radius=0.15),))


def _teleported() -> StandardScene:
    places = np.zeros((len(frame_times(2.0)), 3))
    places[30:, 0] = 10.0
    return hung(places={"rod": places})


def _half_turned() -> StandardScene:
    turns = np.zeros((len(frame_times(2.0)), 3))
    turns[30:, 2] = np.pi
    return hung(turns={"rod": turns})


def _struck(radius: float, speed: float) -> StandardScene:
    """A rod across the sheet comes through the place where it hangs at a speed [m/s], and goes on."""
    times = frame_times(2.0)
    places = np.zeros((len(times), 3))
    places[:, 0] = np.clip(speed * (times - 0.5), -1.0, 2.0)
    rod = Capsule("limb", "limb", np.array([0.0, -0.5, 1.2]), np.array([0.0, 0.5, 1.2]), radius)
    return hung(colliders=(rod,), places={"limb": places}, cloth=_sheet(spacing=0.05))


def _thin() -> StandardScene:
    times = frame_times(2.0)
    places = np.zeros((len(times), 3))
    places[:, 0] = -0.2 + 0.4 * np.clip(times, 0.0, 1.0)
    rod = Capsule("limb", "limb", np.array([-0.3, 0.01, 1.2]), np.array([0.0, 0.01, 1.2]), 0.004)
    return hung(colliders=(rod,), places={"limb": places}, cloth=_sheet(spacing=0.05))


def _graded() -> MeshCloth:
    """A sheet whose cells grow from 2 mm to 20 cm: areas, and masses, differ 10,000 times."""
    lines = np.concatenate([[0.0], np.cumsum(np.geomspace(0.002, 0.2, 12))])
    return _mesh(lines, lines)


def _slivers() -> MeshCloth:
    """A sheet of triangles as much as 50 times as long as high."""
    cells = np.tile([0.05, 0.001], 8)
    return _mesh(np.concatenate([[0.0], np.cumsum(cells)]), np.linspace(0.0, 0.4, 9))


def _mesh(across: FloatArray, down: FloatArray) -> MeshCloth:
    """A sheet of triangles that hangs in the plane x = 0 from the height 1.5 m, with vertices at all crossings."""
    columns, rows = len(across), len(down)
    v, u = np.meshgrid(down, across, indexing="ij")
    points = np.stack([np.zeros(u.size), u.ravel(), 1.5 - v.ravel()], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([a, a + 1, a + columns], axis=1), np.stack([a + 1, a + columns + 1, a + columns], axis=1)]
    )
    return Cloth.from_mesh(points, triangles, regions={"top": np.arange(columns)})


def _unsewn() -> MeshCloth:
    """A sheet of two halves whose vertices lie in the same places along the seam, and are not joined."""
    lines = np.linspace(0.0, 0.3, 8)
    half, other = _mesh(lines, np.linspace(0.0, 0.6, 16)), _mesh(lines + 0.3, np.linspace(0.0, 0.6, 16))
    return Cloth.from_mesh(
        np.concatenate([half.positions, other.positions]),
        np.concatenate([half.triangles, other.triangles + half.vertices]),
        regions={"top": np.concatenate([half.region("top"), other.region("top") + half.vertices])},
    )


def _draped() -> StandardScene:
    """A cloth of 30 cm on a plate of 18 cm, the sizes of Cusick's drape meter, both square."""
    sheet = Cloth.rectangle(
        width=0.3, height=0.3, spacing=0.02, origin=(-0.15, 0.15, 0.02), right=(0, -1, 0), down=(1, 0, 0)
    )
    times = frame_times(2.0)
    plate = Box(half_sizes=np.array([0.09, 0.09, 0.01]))
    return StandardScene("", Scene(sheet, [], [plate], wind=Wind()), track_of(times, ground=np.zeros((len(times), 3))))


# Denim by its weight, but several times as stiff in bending. It stays as it is: figures of two versions compare on one
# cloth alone.
STIFF_STRIP = Fabric(density=0.324, stretch=640.0, shear=69.0, bend=7e-5)


def _cantilever() -> StandardScene:
    """A strip of stiff cloth, 5 x 20 cm, held level by its first two rows, as the standard test of stiffness begins."""
    strip = Cloth.rectangle(
        width=0.05, height=0.2, spacing=0.01, origin=(0.0, 0.025, 1.5), down=(1, 0, 0), fabric=STIFF_STRIP
    )
    held = attach(strip, "rod", np.flatnonzero(strip.pattern[:, 1] < 0.015))
    times = frame_times(2.0)
    return StandardScene("", Scene(strip, [held]), track_of(times, rod=np.zeros((len(times), 3))))


def _rested() -> StandardScene:
    sheet = Cloth.rectangle(
        width=0.8, height=0.8, spacing=0.04, origin=(-0.4, 0.4, 0.32), right=(0, -1, 0), down=(1, 0, 0)
    )
    times = frame_times(60.0)
    ball = Sphere(center=np.zeros(3), radius=0.3)
    return StandardScene("", Scene(sheet, [], [ball], wind=Wind()), track_of(times, ground=np.zeros((len(times), 3))))


def _crowded() -> StandardScene:
    places = np.random.default_rng(1).uniform(-1.0, 1.0, (1000, 3)) * np.array([1.0, 1.0, 0.1])
    balls = [Sphere(name=f"ball {k}", center=place, radius=0.05) for k, place in enumerate(places)]
    sheet = Cloth.rectangle(
        width=0.8, height=0.8, spacing=0.04, origin=(-0.4, 0.4, 0.3), right=(0, -1, 0), down=(1, 0, 0)
    )
    times = frame_times(2.0)
    return StandardScene("", Scene(sheet, [], balls, wind=Wind()), track_of(times, ground=np.zeros((len(times), 3))))


def _shaken() -> StandardScene:
    times = frame_times(3.0)
    places = np.zeros((len(times), 3))
    places[:, 0] = 0.5 * np.sin(6.0 * np.pi * np.clip(times, 0.0, 2.0))
    return hung(places={"rod": places}, seconds=3.0)


def _at(fps: float) -> StandardScene:
    """A swing for two seconds, seen at some frames a second."""
    times = np.arange(round(2.0 * fps) + 1) / fps
    places = np.zeros((len(times), 3))
    places[:, 0] = 0.15 * np.sin(2.0 * np.pi * np.clip(times, 0.0, 1.0))
    cloth = _sheet()
    return StandardScene("", Scene(cloth, [attach(cloth, "rod", "top")]), track_of(times, rod=places))


def _on_the_floor() -> StandardScene:
    """A sheet dropped on edge, which has to fold up on the ground."""
    cloth = Cloth.rectangle(width=0.5, height=0.5, spacing=0.04, origin=(0.0, 0.25, 0.52), down=(0.02, 0.0, -1.0))
    times = frame_times(2.0)
    return StandardScene(
        "", Scene(cloth, [], [Plane()], wind=Wind()), track_of(times, ground=np.zeros((len(times), 3)))
    )


def _torn() -> StandardScene:
    """The scene of that name, but for the ball, which stops 4 m below, so that what is left can come to rest."""
    standard = torn(spacing=0.05)
    track, places = standard.track, standard.track.positions.copy()
    falls = track.times <= BALL_STOPS
    places[~falls] = places[falls][-1]
    return replace(standard, track=replace(track, positions=places))


_CASES = (
    Case("stiff", "1e8 N/m, undamped, hanging", _stiff),
    Case(
        "pulled",
        "1e7 N/m, drawn to 1 % of strain by its ends",
        _pulled,
        stretch=0.011,
        reason="1.1 times what its ends are drawn to",
    ),
    Case("crumpled", "all vertices start anywhere", hung, after=1.5, disturb=crumpled),
    Case("flattened", "all vertices start at one height", hung, after=1.5, disturb=flattened),
    Case("twisted", "three turns of a strip by its ends", _twisted),
    Case("pinched", "two limbs close on the cape, 8 cm into each other", _pinched, after=2.5),
    Case("inside", "starts across a ball", _started_inside, after=1.0),
    Case("teleported", "10 m in a frame", _teleported),
    Case("half a turn", "in a frame", _half_turned),
    Case("struck", "by an arm at 30 m/s", lambda: _struck(0.04, 30.0)),
    Case("cut", "by a rod of 5 mm at 30 m/s", lambda: _struck(0.005, 30.0)),
    Case("poked", "by a rod of 4 mm between vertices 5 cm apart", _thin),
    Case("light", "vertices of 2 mg", lambda: hung(fabric=Fabric(density=1e-3))),
    Case("graded", "masses that differ 10,000 times", lambda: hung(cloth=_graded())),
    Case("slivers", "triangles 50 times as long as high", lambda: hung(cloth=_slivers())),
    Case("unsewn", "two halves with vertices of their own along the seam", lambda: hung(cloth=_unsewn())),
    Case("stormy", "in a wind of 40 m/s", lambda: hung(wind=Wind(velocity=(40.0, 0.0, 0.0)))),
    Case(
        "gusty",
        "in gusts and eddies of 15 m/s",
        lambda: hung(wind=Wind(velocity=(15.0, 0.0, 0.0), gusts=0.5, turbulence=4.0)),
    ),
    Case("shaken", "three times a second by half a metre", _shaken),
    Case("jerky", "10 frames a second", lambda: _at(10.0)),
    Case("swift", "240 frames a second", lambda: _at(240.0)),
    Case("dropped", "on edge, to fold up on the ground", _on_the_floor),
    Case("resting", "on a ball for a minute", _rested),
    Case("draped", "over a plate with sharp edges", _draped),
    Case("cantilever", "of stiff cloth, held level by one end", _cantilever),
    Case("crowded", "falls among a thousand balls", _crowded),
    Case("torn", "by a ball of 30 cm that falls through it", _torn, after=BALL_STOPS),
)

CASES = {case.name: case for case in _CASES}
"""All cases by name, in the order of the table."""
