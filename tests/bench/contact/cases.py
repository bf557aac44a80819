"""What `contact.py` measures: one function a case, each gives a row."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cape
import motions
from cape import Capsule, Cloth, Diverged, Pose, Scene, SelfContact, Simulation, Solver, attach
from cape.reach import reach_of
from cape.results.penetration import crossings, penetration
from cape.scene.colliders import Collider
from cape.scene.standard_scenes import FPS, STANDARD_SCENES, worn
from skeleton import BoneTrack, Skeleton

FloatArray = NDArray[np.float64]

DEEP = 0.002  # m
STILL = 60.0  # s that a cloth is left to come to rest
WATCHED = 10.0  # s at the end of them


# -- clips --


@dataclass(frozen=True)
class ClipRow:
    """A cape on a moving body; depths [mm] of vertices and faces that no bone holds, and of all.

    `skin_mm` is how deep free faces are in the skin that colliders should keep clear, of the scene's thickness.
    """

    clip: str
    solver: str
    seconds: float
    vertex_mm: float
    face_mm: float
    skin_mm: float
    all_vertex_mm: float
    all_face_mm: float
    deep_frames: int
    """Frames in which a free face is deeper than 2 mm."""
    worst_frame: int
    worst_collider: str
    by_collider: dict[str, list[float]]
    """For each collider that is the deepest of some frame: frames deeper than 2 mm, and the deepest [mm]."""
    crossings: int
    """Free vertices that passed into or through a collider's core, over all frames."""
    stretch_percent: float
    substeps: int
    wall_per_second: float
    result: str


def clip_paths(folder: Path | None, chosen: Sequence[str]) -> list[str]:
    """Shipped clips, and the files of a folder; those of the chosen names, all for none."""
    files = [] if folder is None else sorted(str(p) for p in folder.glob("*.bvh"))
    return [c for c in (*motions.clip_names(), *files) if not chosen or Path(c).stem in chosen]


def measure_clip(clip: str, solver: Solver) -> ClipRow:
    """Dress the body of a clip, simulate and judge."""
    motion = motions.load(clip)
    body = Skeleton.from_clip(motion)
    track = body.track(motion)
    scene = cape.dress(body, track, garment="back_cape")
    take = cape.simulate(scene, track, solver=solver)
    free = free_vertices(scene)
    ours, everything = penetration(take, counted=free), penetration(take)
    faces = ours.faces
    worst = int(faces.depth.argmax())
    inside = bool(faces.depth[worst] > 0.0)
    names = [c.name for c in take.colliders]
    return ClipRow(
        clip=Path(clip).stem,
        solver=take.solver,
        seconds=len(take.positions) / track.fps,
        vertex_mm=1e3 * float(ours.vertices.depth.max()),
        face_mm=1e3 * float(faces.depth.max()),
        skin_mm=1e3 * float(penetration(take, counted=free, margin=scene.thickness).faces.depth.max()),
        all_vertex_mm=1e3 * float(everything.vertices.depth.max()),
        all_face_mm=1e3 * float(everything.faces.depth.max()),
        deep_frames=int((faces.depth > DEEP).sum()),
        worst_frame=worst if inside else -1,
        worst_collider=names[faces.collider[worst]] if inside else "",
        by_collider={
            names[c]: [int((of_it > DEEP).sum()), 1e3 * float(of_it.max())]
            for c in np.unique(faces.collider[faces.depth > 0.0])
            for of_it in [faces.depth[faces.collider == c]]
        },
        crossings=int(crossings(take, counted=free).sum()),
        stretch_percent=100.0 * float(take.stretch_max.max()),
        substeps=take.substeps,
        wall_per_second=take.solve_s / (len(take.positions) / track.fps),
        result=take.result,
    )


def free_vertices(scene: Scene) -> NDArray[np.bool_]:
    """Vertices that no bone holds, shape (V,)."""
    free = np.ones(scene.cloth.vertices, dtype=bool)
    for attachment in scene.attachments:
        free[attachment.vertices] = False
    return free


# -- rest --


@dataclass(frozen=True)
class RestRow:
    """A cloth that is left on something that stands still; speeds are root mean squares over its vertices [mm/s]."""

    scene: str
    solver: str
    end_mm_s: float
    largest_mm_s: float
    """In the last 10 s."""
    crept_mm: float
    """Farthest that a vertex moved in the last 10 s."""
    sunk_m: float
    """How far the middle of the cloth sank in all: what slips off falls far."""
    result: str


REST: dict[str, Callable[[], tuple[Scene, BoneTrack]]] = {
    "sphere": lambda: (STANDARD_SCENES["sphere"]().scene, STANDARD_SCENES["sphere"]().track),
    "cube": lambda: (STANDARD_SCENES["cube"]().scene, STANDARD_SCENES["cube"]().track),
    "shoulders": lambda: (worn("idle").scene, worn("idle").track),
}


def measure_rest(name: str, solver: Solver, *, still: float = STILL) -> RestRow:
    """Hold the first pose of a scene for a minute."""
    scene, track = REST[name]()
    simulation = Simulation(scene, solver=solver)
    pose = poses_of(simulation, track)[0]
    simulation.start(pose)
    start, result, speeds, kept = simulation.positions, "finished", [], simulation.positions
    frames, watched = round(still * FPS), round(WATCHED * FPS)
    for frame in range(frames):
        if frame == frames - watched:
            kept = simulation.positions
        try:
            simulation.step(pose, 1.0 / FPS)
        except Diverged:
            result = f"diverged at frame {frame}"
            break
        speeds.append(float(np.sqrt(np.mean(np.sum(simulation.velocities**2, axis=1)))))
    end = simulation.positions
    return RestRow(
        scene=name,
        solver=solver.name,
        end_mm_s=1e3 * speeds[-1],
        largest_mm_s=1e3 * max(speeds[-watched:]),
        crept_mm=1e3 * float(np.linalg.norm(end - kept, axis=1).max()),
        sunk_m=float((start - end)[:, 2].mean()),
        result=result,
    )


# -- cost --


@dataclass(frozen=True)
class CostRow:
    """Time of the solver's steps alone [us per frame], and the share of it beyond a scene without colliders."""

    scene: str
    solver: str
    us_per_frame: float
    added_percent: float


def measure_cost(solver: Solver, *, repeats: int = 5) -> list[CostRow]:
    """The walk without colliders, with those that the cape can reach, and with its contact with itself besides."""
    walk = worn("walk")
    scene = reach_of(walk.scene, walk.track).cull(walk.scene)
    variants = {
        "no colliders": replace(scene, colliders=()),
        "colliders": scene,
        "colliders and itself": replace(scene, self_contact=SelfContact()),
    }
    cost = step_times(variants, walk.track, solver, repeats=repeats)
    bare = cost["no colliders"]
    return [CostRow(name, solver.name, 1e6 * time, 100.0 * (time / bare - 1.0)) for name, time in cost.items()]


def step_times(
    variants: dict[str, Scene], track: BoneTrack, solver: Solver, *, repeats: int, settle: float | None = None
) -> dict[str, float]:
    """Mean time of a frame's steps [s], of each frame the fastest of all repeats, the scenes in turn run by run."""
    clocked = {name: _clocked(solver) for name in variants}
    simulations = {name: Simulation(scene, solver=clocked[name][0]) for name, scene in variants.items()}
    poses = {name: poses_of(simulation, track) for name, simulation in simulations.items()}
    least = {name: np.full(track.frames - 1, np.inf) for name in variants}
    for _ in range(repeats):
        for name, simulation in simulations.items():
            simulation.start(poses[name][0], settle=settle)
            spent = clocked[name][1]
            for frame in range(1, track.frames):
                spent.clear()
                simulation.step(poses[name][frame], float(track.times[frame] - track.times[frame - 1]))
                least[name][frame - 1] = min(least[name][frame - 1], sum(spent))
    return {name: float(times.mean()) for name, times in least.items()}


def _clocked(solver: Solver) -> tuple[Solver, list[float]]:
    """The same solver, and a list to which it adds how long each of its steps takes [s]."""
    spent: list[float] = []

    kind: Any = type(solver)

    class Clocked(kind):
        def step(self, *arguments: Any, **options: Any) -> int:
            begun = time.perf_counter()
            result = super().step(*arguments, **options)
            spent.append(time.perf_counter() - begun)
            return result

    return Clocked(**{f.name: getattr(solver, f.name) for f in fields(solver)}), spent


def poses_of(simulation: Simulation, track: BoneTrack) -> list[Pose]:
    """The poses of a track as a simulation takes them."""
    chosen = [track.index(bone) for bone in simulation.bones]
    return [Pose(track.positions[f, chosen], track.rotations_wxyz[f, chosen]) for f in range(track.frames)]


# -- a limb through a sheet --

SPEEDS = (1.0, 3.0, 10.0, 30.0, 100.0)  # m/s
RADII = {"arm": 0.04, "rod": 0.005}  # m; the rod is thinner than the sheet's vertices are apart
SHEET, SPACING = (0.8, 1.2), 0.03  # m
HEIGHT = 0.495  # m below the sheet's edge that is held, in the middle between two rows of vertices
BEGIN, END = -0.3, 0.6  # m before and behind the sheet: at the end its lower edge is still beyond the limb


@dataclass(frozen=True)
class LimbRow:
    """A limb of 1 m that is driven into a hanging sheet of 0.8 x 1.2 m and pushes it by 0.6 m.

    A thread is a column of the sheet's vertices. From the edge that is held on, it turns around the limb on the side
    that the limb moves to, by half a turn or, thrown around it, by several; around a limb that passed through, it turns
    the other way. At the end the limb is still moving.
    """

    limb: str
    speed: float
    solver: str
    threads_passed: int
    threads: int
    vertices_inside: int
    """Deeper than 2 mm, at the end."""
    face_mm: float
    """Deepest of any frame [mm]."""
    stretch_percent: float
    result: str


def measure_limb(limb: str, speed: float, solver: Solver) -> LimbRow:
    """Drive a limb through a sheet at a speed [m/s]."""
    width, height = SHEET
    cloth = Cloth.rectangle(width=width, height=height, spacing=SPACING, origin=(0.0, width / 2, 0.0))
    half = np.array([0.0, 0.5, 0.0])
    capsule = Capsule(limb, "limb", -half, half, RADII[limb])
    scene = Scene(cloth, [attach(cloth, "rod", "top")], [capsule])
    frames = math.ceil((END - BEGIN) * FPS / speed)
    places = np.zeros((frames + 1, 2, 3))
    places[:, 1, 0] = END - speed / FPS * np.arange(frames, -1, -1)
    places[:, 1, 2] = -HEIGHT
    unturned = np.tile([1.0, 0.0, 0.0, 0.0], (frames + 1, 2, 1))
    track = BoneTrack(("rod", "limb"), np.arange(frames + 1) / FPS, places, unturned)
    take = cape.simulate(scene, track, solver=solver, settle=0.0)
    last = len(take.positions) - 1
    end = take.positions[last].astype(float)
    across = np.hypot(end[:, 0] - places[last, 1, 0], end[:, 2] + HEIGHT)
    inside = (across < capsule.radius - DEEP) & (np.abs(end[:, 1]) < 0.5)
    threads = end.reshape(cloth.rows, cloth.columns, 3).transpose(1, 0, 2)
    return LimbRow(
        limb=limb,
        speed=speed,
        solver=solver.name,
        threads_passed=sum(has_passed(thread[:, [0, 2]], places[last, 1, 0], -HEIGHT) for thread in threads),
        threads=cloth.columns,
        vertices_inside=int(inside.sum()),
        face_mm=1e3 * float(penetration(take).faces.depth.max()),
        stretch_percent=100.0 * float(take.stretch_max.max()),
        result=take.result,
    )


def has_passed(thread: FloatArray, x: float, z: float) -> bool:
    """Tell whether a thread of points, shape (N, 2) [m], turns behind (x, z) on its way down, not in front of it."""
    seen = (thread - [x, z]) @ [1.0, 1.0j]
    return float(np.angle(seen[1:] / seen[:-1]).sum()) > 0.0


# -- many colliders --

NEAR, MANY = 20, 1000


@dataclass(frozen=True)
class ManyRow:
    """Time of a frame's steps with 20 colliders that the cloth touches, and with 980 more that are far [us]."""

    solver: str
    few_us: float
    many_us: float
    ratio: float


def measure_many(solver: Solver, *, repeats: int = 3, seconds: float = 1.0) -> ManyRow:
    """A sheet that hangs against a swaying body of many capsules."""
    cloth = Cloth.rectangle(width=0.8, height=1.2, spacing=0.024, origin=(0.0, 0.4, 0.0))
    rows, columns = 5, 4
    near = [_peg(i, 0.06, 0.3 - 0.2 * (i % columns), -0.2 - 0.2 * (i // columns)) for i in range(NEAR)]
    far = [_peg(i, 3.0 + 0.3 * (i % 40), 0.3 * (i // 40) - 3.0, -1.0) for i in range(NEAR, MANY)]
    assert rows * columns == NEAR
    times = np.arange(round(seconds * FPS) + 1) / FPS
    places = np.zeros((len(times), 2, 3))
    places[:, 1, 0] = 0.02 * np.sin(2 * np.pi * times)
    track = BoneTrack(("rod", "body"), times, places, np.tile([1.0, 0, 0, 0], (len(times), 2, 1)))

    def scene(colliders: Sequence[Collider]) -> Scene:
        # It hangs aslant, so that it lies on all of the near ones.
        return Scene(cloth, [attach(cloth, "rod", "top")], colliders, gravity=(4.0, 0.0, -9.0))

    cost = step_times({"few": scene(near), "many": scene([*near, *far])}, track, solver, repeats=repeats)
    return ManyRow(solver.name, 1e6 * cost["few"], 1e6 * cost["many"], cost["many"] / cost["few"])


def _peg(index: int, x: float, y: float, z: float) -> Capsule:
    place = np.array([x, y, z])
    return Capsule(f"peg {index}", "body", place, place - [0.0, 0.0, 0.08], 0.05)
