"""What holds for every solver: its order, its stability at any stiffness, the same bits on any number of threads."""

import hashlib
import os
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cape
import motions
import skeleton
from cape import Fabric, Pose, Scene, Simulation, Solver, Wind, attach
from cape.run.hanging import Hanging
from cape.run.simulate import SlowWarning
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import plain
from cape.solvers import SOLVERS
from motions.errors import ValueRangeError
from skeleton.shapes import Cylinder, Ellipsoid, TaperedCapsule
from skeleton.track import BoneTrack
from tests.support.code import compiled_only, name_of, requests_of
from tests.support.scenes import Run, bend_energy, every_solver, grid_cloth, mesh_cloth, spring_energy, turn_about

G = 9.81  # m/s2
ORDERS = {"euler": 1, "xpbd": 1, "backward_euler": 1, "tr_bdf2": 2}

EXPLICIT = ("euler", "xpbd")
by_default = pytest.mark.parametrize("name", SOLVERS)


# -- order in time --


def swung(solver: Solver, substeps: int, wind: Wind | None) -> np.ndarray:
    """Positions of a soft cloth that hangs from a bone which is swung and turned for a third of a second."""
    fabric = Fabric(stretch=50.0, shear=10.0, bend=1e-4, damping_time=1e-3, bend_damping_time=1e-3)
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.3, 4), fabric)
    run = Run(Scene(cloth, [attach(cloth, "hand", range(4))], wind=wind), solver)
    for frame in range(1, 21):
        angle = 2 * np.pi * frame / 60
        pose = [[0.1 * np.sin(angle), 0.05 * np.sin(2 * angle), 0.0]], [turn_about((0, 0, 1), 0.5 * np.sin(angle))]
        assert run.step(1 / 60, substeps, pose) == 0
    return run.positions


WIND = Wind(velocity=(1.0, 2.0, 0.0))


@cache
def accurately_swung(substeps: int, wind: bool) -> np.ndarray:
    """One reference for all solvers: they solve the same equations."""
    return swung(cape.TRBDF2(tolerance=1e-12, forcing=1e-6), substeps, WIND if wind else None)


@pytest.mark.parametrize("wind", [None, WIND], ids=["vacuum", "wind"])
@every_solver
def test_observed_order_in_time(solver: Solver, wind: Wind | None):
    finest, half = (accurately_swung(n, wind is not None) for n in (128, 64))
    uncertainty = np.linalg.norm(finest - half)
    steps = (2, 4, 8) if ORDERS[solver.name] == 2 else (20, 40, 80)
    errors = [np.linalg.norm(swung(solver, n, wind) - finest) for n in steps]
    assert uncertainty < 0.1 * errors[-1]
    observed = np.log2(errors[1] / errors[2])
    assert observed == pytest.approx(ORDERS[solver.name], abs=0.2)


# -- stiffness --


@pytest.mark.parametrize("stretch", [1e2, 1e4, 1e6, 1e8])
@by_default
def test_no_stiffness_breaks_a_solver_at_its_default_settings(name: str, stretch: float):
    fabric = Fabric(stretch=stretch, shear=stretch / 10, bend=1e-5, damping_time=0.0, bend_damping_time=0.0)
    cloth = grid_cloth(np.linspace(0, 0.3, 5), np.linspace(0, 0.3, 5), fabric, right=(1, 0, 0), down=(0, 1, 0))
    simulation = Simulation(Scene(cloth, [attach(cloth, "rod", range(5))]), solver=cape.solver(name))
    rod = {"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}
    simulation.start(rod)
    mass = cloth.masses()
    # It falls and swings from the rod, and can't have more than it had when it lay flat at the rod's height.
    scale = mass.sum() * G * 0.3
    energies = []
    for _ in range(60):
        simulation.step(rod, 1 / 60)
        energy = 0.5 * mass @ np.sum(simulation.velocities**2, axis=1) + mass @ simulation.positions[:, 2] * G
        if name == "euler":
            # Iterative solvers leave a strain that would store much at such a stiffness, and is never given back.
            energy += spring_energy(cloth, simulation.positions) + bend_energy(cloth, simulation.positions)
        energies.append(energy)
    assert simulation.retried == simulation.unconverged == 0
    assert max(energies) < 0.02 * scale


# -- the same bits --


def digest(name: str, layout: str, threads: int) -> str:
    """Hash of the state of a cloth of some 900 vertices after a few frames with wind and contact."""
    make = grid_cloth if layout == "grid" else mesh_cloth
    cloth = make(np.linspace(0, 0.6, 31), np.linspace(0, 0.6, 30), Fabric(bend=1e-4))
    ball = cape.Sphere(bone="rod", center=np.array([0.3, -0.06, -0.3]), radius=0.1)
    slope = cape.Plane(point=np.array([0.0, -0.03, -0.5]), normal=np.array([0.1, 1.0, 0.2]))
    block = cape.Box(center=np.array([0.1, -0.04, -0.2]), half_sizes=np.full(3, 0.05))
    # All solvers share contact: the implicit ones, with one kind of shapes, compile in half the time.
    shapes = [ball, slope, block] if name in EXPLICIT else [ball]
    scene = Scene(cloth, [attach(cloth, "rod", range(31))], shapes, wind=Wind(velocity=(0.0, -4.0, 0.0)))
    simulation = Simulation(scene, solver=cape.solver(name), threads=threads)
    for frame in range(4):
        place = np.array([0.05 * np.sin(frame), 0.02 * frame, 0.0])
        simulation.step(Pose(place[None], turn_about((0, 0, 1), 0.1 * frame)[None]), 1 / 60)
    return hashlib.sha256(simulation.positions.tobytes() + simulation.velocities.tobytes()).hexdigest()


@cache
def digest_alone(name: str, layout: str) -> str:
    """What one thread of this process comes to."""
    return digest(name, layout, 1)


# The implicit solvers share all that contact adds; on meshes test_implicit.py repeats them to the last bit.
REPEATED = [*((name, layout) for name in EXPLICIT for layout in ("grid", "mesh")), ("tr_bdf2", "grid")]


@pytest.mark.parametrize(("name", "layout"), REPEATED)
def test_the_same_bits_for_one_two_and_three_threads(name: str, layout: str):
    assert digest(name, layout, 2) == digest(name, layout, 3) == digest_alone(name, layout)


SCRIPT = """
import sys
sys.path.insert(0, {root!r})
from tests.solvers.test_solvers import REPEATED, digest
for name, layout in REPEATED:
    print(digest(name, layout, int(sys.argv[1])))
"""


def test_the_same_bits_in_every_process():
    script = SCRIPT.format(root=str(Path(__file__).parents[2]))
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", script, "2"], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [digest_alone(name, layout) for name, layout in REPEATED]


@by_default
@pytest.mark.few("xpbd")
def test_simulations_run_in_several_python_threads_at_once(name: str):
    expected = digest_alone(name, "grid")
    seen: list[str] = []
    workers = [threading.Thread(target=lambda: seen.append(digest(name, "grid", 2))) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert seen == [expected] * 3


def test_a_number_of_threads_that_is_none_is_refused():
    cloth = grid_cloth([0, 1], [0, 1], Fabric())
    with pytest.raises(ValueRangeError, match="threads must be 1 or more, not 0"):
        Simulation(Scene(cloth), threads=0)


def test_a_grid_wider_than_the_kernels_room_is_refused():
    cloth = grid_cloth(np.linspace(0, 3, 3000), [0, 0.1], Fabric())
    with pytest.raises(ValueRangeError, match="a grid of cloth has 2 to 2725 columns, not 3000"):
        Simulation(Scene(cloth)).start({})


# -- what a scene lacks --


SCENES: dict[str, dict[str, Any]] = {
    "nothing": {},
    "wind": {"wind": Wind(viscous=0.0)},
    "sticky wind": {"wind": Wind(viscous=0.1)},
    "capsule": {"colliders": [cape.Capsule("", None, np.zeros(3), np.ones(3), 0.1)]},
    "sphere": {"colliders": [cape.Sphere()]},
    "tapered capsule": {"colliders": [TaperedCapsule()]},
    "box": {"colliders": [cape.Box(thickness=0.1)]},  # so that its edges need no triangles
    "plane": {"colliders": [cape.Plane()]},
    "cylinder": {"colliders": [Cylinder(thickness=0.1)]},
    "ellipsoid": {"colliders": [Ellipsoid()]},
    "needle": {"colliders": [cape.Sphere(radius=0.001)]},
    "held": {"attachments": [cape.Attachment(vertices=np.arange(3), bone="rod")]},
    "layers": {"self_contact": cape.SelfContact()},
}
SOLID = {"capsule", "sphere", "tapered capsule", "box", "plane", "cylinder", "ellipsoid", "needle"}
# Units that a feature adds to a frame, or code that they call by address, and the scenes that have it.
FEATURES = {
    "wind": ({"grid_air"}, {"wind", "sticky wind"}),
    "viscosity": ({"skin_drag"}, {"sticky wind"}),
    "contact": ({"find_nearby", "watch_tiles", "keep_out"}, SOLID),
    "capsules": ({"nearest of capsule", "gaps of capsule"}, {"capsule", "sphere", "needle"}),
    "tapered capsules": ({"nearest of tapered_capsule", "gaps of tapered_capsule"}, {"tapered capsule"}),
    "boxes": ({"nearest of box", "gaps of box"}, {"box"}),
    "planes": ({"nearest of plane", "gaps of plane"}, {"plane"}),
    "cylinders": ({"nearest of cylinder", "gaps of cylinder"}, {"cylinder"}),
    "ellipsoids": ({"nearest of ellipsoid", "gaps of ellipsoid"}, {"ellipsoid"}),
    "triangles": ({"wake_faces", "keep_faces_out", "planes of capsule"}, {"needle"}),
    "attachments": ({"lift_attached"}, {"held"}),
    "self-contact": ({"keep_apart", "look_ahead", "search_pairs"}, {"layers"}),
    "journal": ({"note_integrated", "note_pressed", "note_end"}, set()),
    "threads": ({"wait_for_all"}, set()),
}  # fmt: skip
# What else solvers need for a feature.
PRESSING = {"add_contact_blocks", "find_touchable", "note_motion", "press_colliders"}
ROUNDING = {"round_state", "add_changes"}
OWN = {
    "euler": {"attachments": {"hold_attached"}, "self-contact": {"press"}},
    "xpbd": {"wind": {"blow_all"}, "attachments": {"aim_attached"}, "self-contact": {"press"}},
    "backward_euler": {
        "contact": PRESSING | ROUNDING,
        "attachments": {"place_attached"},
        "self-contact": {"add_pressure"} | ROUNDING,
    },
    "tr_bdf2": {
        "contact": PRESSING | ROUNDING | {"hold_back", "hold_back_at_start", "leave_out_contact", "round_places"},
        "attachments": {"place_attached"},
        "self-contact": {"add_pressure", "add_held"} | ROUNDING,
    },
}

# Units of cloth that can touch nothing, by solver.
FREE = {"backward_euler": {"aim_again"}, "tr_bdf2": {"aim_again"}}


@compiled_only
@by_default
@pytest.mark.parametrize("scene", SCENES)
def test_a_frame_has_what_its_scene_needs_and_nothing_else(scene: str, name: str):
    cloth, solver = grid_cloth([0, 0.01, 0.02], [0, 0.01, 0.02], Fabric()), SOLVERS[name]()
    bare, full = Scene(cloth), Scene(cloth, **SCENES[scene])
    bare, found = set(requests_of(bare, solver)), set(requests_of(full, solver))
    # All that the bare scene needs is used as it is, compiled for the same groups, but for what free cloth alone has.
    touching = bool(full.colliders) or full.self_contact is not None
    assert {name_of(request) for request in bare - found} == (FREE.get(name, set()) if touching else set())
    expected = set[str]()
    for feature, (code, scenes) in FEATURES.items():
        if scene in scenes:
            expected |= code | OWN[name].get(feature, set())
    assert {name_of(request) for request in found - bare} == expected


@compiled_only
@by_default
def test_a_mesh_has_none_of_the_grid_s_units_nor_a_grid_of_the_mesh_s(name: str):
    side = [0, 0.01, 0.02]
    grid, mesh = (
        {name_of(request) for request in requests_of(Scene(make(side, side, Fabric())), SOLVERS[name]())}
        for make in (grid_cloth, mesh_cloth)
    )
    assert grid - mesh
    assert all("grid" in unit or unit == "linearise_springs" for unit in grid - mesh)
    assert mesh - grid
    assert all("mesh" in unit for unit in mesh - grid)


@compiled_only
@by_default
def test_several_threads_need_their_meetings_more_and_nothing_else(name: str):
    cloth = grid_cloth([0, 0.01, 0.02], [0, 0.01, 0.02], Fabric())
    colliders = [cape.Plane(), cape.Sphere(radius=0.001)]
    scene = Scene(cloth, colliders=colliders, wind=Wind(), self_contact=cape.SelfContact())
    alone, together = (set(requests_of(scene, SOLVERS[name](), threads=threads)) for threads in (1, 2))
    assert {name_of(request) for request in together - alone} == {"wait_for_all"}


# -- time --


def hanging_track(frames: int) -> tuple[Scene, BoneTrack]:
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.3, 4), Fabric())
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1, 1))
    track = BoneTrack(("rod",), np.arange(frames) / 60, np.zeros((frames, 1, 3)), turns)
    return Scene(cloth, [attach(cloth, "rod", range(4))]), track


def test_a_long_run_is_announced_before_its_first_frame(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cape.run.notes.SLOW", 0.0)
    monkeypatch.setattr("cape.run.notes.SLOW_FACTOR", 0.0)
    scene, track = hanging_track(4)
    done: list[int] = []
    with pytest.warns(SlowWarning, match=r"euler takes \d+ steps a frame here, about \d+ s for 3 frames"):
        cape.simulate(scene, track, progress=lambda frame, _: done.append(frame))
    assert done
    with pytest.warns(SlowWarning), pytest.raises(RuntimeError, match="first frame"):
        cape.simulate(scene, track, progress=fail)


def fail(frame: int, frames: int) -> None:
    raise RuntimeError("first frame")


def test_what_does_not_converge_is_kept_and_told():
    scene, track = hanging_track(4)
    take = cape.simulate(scene, track, solver=cape.BackwardEuler(iterations=1, tolerance=1e-12))
    assert take.result == "finished with warnings"
    assert len(take.positions) == 4
    assert any("3 frames did not reach the solver's tolerance" in note for note in take.warnings)
    assert any("ask for more substeps or a larger tolerance" in note for note in take.warnings)


def test_a_forecast_changes_nothing():
    scene, track = hanging_track(2)
    poses = [Pose(track.positions[f], track.rotations_wxyz[f]) for f in range(2)]
    results = []
    for asked in (False, True):
        simulation = Simulation(scene)
        simulation.start(poses[0])
        if asked:
            forecast = simulation.forecast(1 / 60)
            assert forecast.substeps > 1
            assert forecast.seconds > 0
        simulation.step(poses[1], 1 / 60)
        results.append(simulation.positions)
    np.testing.assert_array_equal(*results)


def test_a_forecast_before_the_start_is_of_a_cloth_that_nothing_jerks(monkeypatch: pytest.MonkeyPatch):
    """Where it lies, and not on its way to where it is worn within a frame, which took hundreds of times as long."""
    clip = motions.load("walk").trim(0.0, 0.1)
    body = skeleton.Skeleton.from_clip(clip)
    scene = cape.dress(body, body.track(clip), spacing=0.06)
    speeds, complete = [], Hanging.complete

    def noting(cloth: Hanging, *arguments: Any) -> tuple[int, bool]:
        told = complete(cloth, *arguments)
        speeds.append(max(float(np.abs(component).max()) for component in cloth.state[3:]))
        return told

    monkeypatch.setattr(Hanging, "complete", noting)
    Simulation(scene).forecast(1 / 60, poses_of(body.track(clip), scene.bones)[0])
    # In a frame it falls by 0.16 m/s; what is too near to a limb or a layer is pushed off at no more than that tenfold.
    assert 0.0 < max(speeds) < 2.0


def test_the_plain_scene_is_what_others_measure_and_keeps_its_quality():
    standard = plain()
    cloth = standard.scene.cloth
    assert cloth.vertices == 32 * 48
    np.testing.assert_allclose(np.ptp(cloth.pattern, axis=0), [0.8, 1.2])
    assert cloth.masses().sum() == pytest.approx(0.2 * 0.8 * 1.2)
    assert len(standard.scene.colliders) == 6
    assert standard.track.frames == 601
    take = cape.simulate(standard.scene, standard.track)
    assert take.result == "finished"
    assert take.stretch_max.max() <= 0.04
    assert take.penetration.max() == 0.0
