"""A cloth that touches itself: layers stay apart, come to rest, rub, and never pass through each other."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from cape import Fabric, Plane, Scene, SelfContact, Simulation, attach, solver
from cape.assembly.self_contact import contact_thickness, default_thickness, rest_shape, surplus
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.kernels.self_contact.self_contact import SLACK
from cape.scene.poses import Pose
from cape.scene.standard_scenes import standard_scene
from cape.solvers import Solver, SymplecticEuler
from motions import quaternions
from motions.errors import ValueRangeError
from tests.support.crossing import crossings
from tests.support.scenes import Run, grid_cloth, turn_about

FloatArray = NDArray[np.float64]

FRAME = 1.0 / 60.0
G = 9.81
EULER = SymplecticEuler(precision="double")
SOLVERS = ("euler", "xpbd", "backward_euler", "tr_bdf2")
TOUCHING = SelfContact()
SMOOTH = SelfContact(friction=0.0)

every_solver = pytest.mark.parametrize("name", SOLVERS)


class Layers(Run):
    """A run of a cloth that is kept off itself, frame by frame."""

    def __init__(
        self,
        scene: Scene,
        solver: Solver = EULER,
        *,
        velocities: ArrayLike = 0.0,
        contact: SelfContact | None = TOUCHING,
    ) -> None:
        super().__init__(replace(scene, self_contact=contact), solver, velocities=velocities)

    def go(self, frames: int, pose: Callable[[float], tuple[ArrayLike, ArrayLike]] | None = None) -> None:
        """Advance by frames of a 60th of a second; `pose` of the share of the time that has passed."""
        substeps = self.solver.choose_substeps(self.running, FRAME)
        for frame in range(frames):
            self.step(FRAME, substeps, None if pose is None else pose((frame + 1) / frames))
            assert self.assembly.layers is None or surplus(self.assembly.layers) == 0

    @property
    def thickness(self) -> float:
        return contact_thickness(self.scene)

    @property
    def crossings(self) -> int:
        """Number of edges that go through triangles."""
        return crossings(self.positions, self.scene.cloth.triangles)

    @property
    def speed(self) -> float:
        """Root mean square over the vertices [m/s]."""
        return float(np.sqrt(np.mean(np.sum(self.velocities**2, axis=1))))


def sheets(
    gap: float, *, size: float = 0.3, count: int = 8, turn: float = 0.0, fabric: Fabric | None = None
) -> tuple[MeshCloth, int]:
    """Two level sheets, one above the other, turned about its middle; the vertices of the upper one come second."""
    line = np.linspace(-size / 2, size / 2, count)
    sheet = grid_cloth(line, line, fabric or Fabric(), down=(0.0, 1.0, 0.0))
    rotation = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    upper = sheet.positions @ rotation + np.array([0.0, 0.0, gap])
    triangles = np.concatenate([sheet.triangles, sheet.triangles + sheet.vertices])
    return Cloth.from_mesh(np.concatenate([sheet.positions, upper]), triangles, fabric=fabric), sheet.vertices


def lying(cloth: Cloth, lower: int, *, gravity: float = G) -> Scene:
    """A scene in which the lower sheet is held."""
    return Scene(cloth, [attach(cloth, "table", np.arange(lower))], gravity=(0.0, 0.0, -gravity))


def test_a_falling_layer_comes_to_rest_at_the_thickness():
    cloth, n = sheets(0.02, turn=0.3)
    run = Layers(lying(cloth, n))
    run.go(240)
    heights = run.positions[n:, 2]
    over = np.abs(run.positions[n:, :2]).max(axis=1) < 0.13
    # On single precision of the sides and the slack that touching layers are allowed.
    assert np.abs(heights[over] - run.thickness).max() < 2.0 * SLACK * run.thickness
    # The corners that stick out still swing.
    assert np.linalg.norm(run.velocities[n:][over], axis=1).max() < 1e-3
    assert run.crossings == 0


@pytest.mark.parametrize("closing", [1.0, 10.0, 30.0])
def test_layers_that_hit_each_other_do_not_pass(closing: float):
    cloth, n = sheets(0.04, turn=0.4)
    velocities = np.zeros((2 * n, 3))
    velocities[:n, 2], velocities[n:, 2] = closing / 2, -closing / 2
    run = Layers(Scene(cloth, [], gravity=(0.0, 0.0, 0.0)), velocities=velocities, contact=SMOOTH)
    mass = run.assembly.mass
    before = mass @ np.stack(run.state[3:], axis=1)
    run.go(round(0.1 / closing * 60) + 1)
    rising = run.velocities[n:, 2].mean() - run.velocities[:n, 2].mean()
    assert run.crossings == 0
    assert rising > -0.02 * closing
    # What the corners that stick out give back, and no more.
    assert rising < 0.25 * closing
    np.testing.assert_allclose(mass @ np.stack(run.state[3:], axis=1), before, atol=1e-12)
    without = Layers(run.scene, velocities=velocities, contact=None)
    without.go(round(0.1 / closing * 60) + 1)
    assert (without.positions[n:, 2] < without.positions[:n, 2].max()).all()


@pytest.mark.parametrize("name", ["xpbd", "tr_bdf2"])
def test_layers_that_close_by_several_thicknesses_in_a_step_do_not_pass(name: str):
    """Implicit steps of 2 ms: at 10 m/s, four times the thickness."""
    cloth, n = sheets(0.04, turn=0.4)
    velocities = np.zeros((2 * n, 3))
    velocities[:n, 2], velocities[n:, 2] = 5.0, -5.0
    run = Layers(Scene(cloth, [], gravity=(0.0, 0.0, 0.0)), solver(name), velocities=velocities)
    for _ in range(4):
        run.go(1)
        assert run.crossings == 0
    assert run.positions[n:, 2].mean() > run.positions[:n, 2].mean()


def test_equal_layers_that_hit_each_other_squarely_stop():
    """Perfectly inelastic: their common velocity stays, and the energy of that alone."""
    cloth, n = sheets(0.02)
    velocities = np.tile((0.3, 0.0, 0.5), (2 * n, 1))
    velocities[n:, 2] -= 1.0
    run = Layers(Scene(cloth, [], gravity=(0.0, 0.0, 0.0)), velocities=velocities, contact=SMOOTH)
    mass = run.assembly.mass
    run.go(4)
    np.testing.assert_allclose(mass @ np.stack(run.state[3:], axis=1) / mass.sum(), (0.3, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(run.velocities, np.tile((0.3, 0.0, 0.0), (2 * n, 1)), atol=0.01)
    gap = run.positions[n:, 2] - run.positions[:n, 2]
    np.testing.assert_allclose(gap, run.thickness, atol=2.0 * SLACK * run.thickness)


def test_a_sliding_layer_stops_where_coulomb_lets_it():
    """From speed v it slides v^2 / (2 mu g), in v / (mu g); where vertices sink in between edges, a little less."""
    mu, v = 0.4, 0.8
    fabric = Fabric(stretch=500.0, shear=100.0)
    table = Cloth.rectangle(
        width=0.8, height=0.4, spacing=0.04, origin=(-0.2, 0.2, 0.0), right=(1, 0, 0), down=(0, -1, 0)
    )
    line = np.linspace(-0.12, 0.12, 7)
    sheet = grid_cloth(line, line, fabric, down=(0.0, 1.0, 0.0), origin=(0.0, 0.0, 0.005))
    both = Cloth.from_mesh(
        np.concatenate([table.positions, sheet.positions]),
        np.concatenate([table.triangles, sheet.triangles + table.vertices]),
        fabric=fabric,
    )
    velocities = np.zeros((both.vertices, 3))
    velocities[table.vertices :, 0] = v
    run = Layers(lying(both, table.vertices), velocities=velocities, contact=SelfContact(friction=mu))
    run.go(round(v / (mu * G) * 60) + 60)
    slid = run.positions[table.vertices :, 0].mean() - sheet.positions[:, 0].mean()
    # Braked neither with a friction of 0.37 nor 0.43.
    assert v**2 / (2.0 * 1.07 * mu * G) < slid < v**2 / (2.0 * 0.93 * mu * G)
    assert run.speed < 1e-3


def folded(count: int, size: float = 0.5, gap: float = 0.03, height: float = 0.012) -> GridCloth:
    """A level sheet folded over itself once."""
    line = np.linspace(0.0, size, count)
    cloth = grid_cloth(line, line, Fabric())
    u, v = cloth.pattern.T
    half = (size - np.pi * gap / 2.0) / 2.0
    bend = np.clip((v - half) / (gap / 2.0), 0.0, np.pi)
    y = np.where(bend == 0.0, v, np.where(bend == np.pi, size - v, half + gap / 2.0 * np.sin(bend)))
    return replace(cloth, positions=np.stack([u, y, height + gap / 2.0 * (1.0 - np.cos(bend))], axis=1))


def on_the_ground(cloth: Cloth) -> Scene:
    return Scene(cloth, colliders=[Plane(normal=np.array([0.0, 0.0, 1.0]))], self_contact=TOUCHING)


@pytest.mark.parametrize("name", ["euler", "xpbd", "backward_euler"])
@pytest.mark.few("euler", "backward_euler")
def test_a_folded_sheet_comes_to_rest(name: str):
    """Apart from TR-BDF2, which damps nothing: there it trembles, at some millimetres a second."""
    cloth = folded(21)
    simulation = Simulation(on_the_ground(cloth), solver=solver(name))
    simulation.start({})
    for _ in range(240):
        simulation.step({}, FRAME)
    speeds = []
    for _ in range(60):
        simulation.step({}, FRAME)
        speeds.append(float(np.sqrt(np.mean(np.sum(simulation.velocities**2, axis=1)))))
    assert max(speeds) < 1e-3
    assert crossings(simulation.positions, cloth.triangles) == 0


@every_solver
def test_the_layers_of_a_folded_sheet_stay_apart(name: str):
    cloth = folded(11)
    scene = on_the_ground(cloth)
    simulation, without = Simulation(scene, solver=solver(name)), Simulation(replace(scene, self_contact=None))
    for run in (simulation, without):
        run.start({})
        for _ in range(60):
            run.step({}, FRAME)
    heights = simulation.positions[:, 2]
    lower, upper = heights[cloth.pattern[:, 1] < 0.18], heights[cloth.pattern[:, 1] > 0.32]
    assert crossings(simulation.positions, cloth.triangles) == 0
    # Implicit solvers let the weight of the cloth press it into the ground a little.
    np.testing.assert_allclose(lower, 0.005, atol=2e-4)
    np.testing.assert_allclose(upper, 0.01, atol=4e-4)
    assert without.positions[cloth.pattern[:, 1] > 0.32, 2].max() < 0.0051


def twisted(turns: float) -> tuple[FloatArray, FloatArray]:
    """Poses of the two ends, turned against each other about X."""
    half = np.pi * turns / 2.0
    turn = np.array([[np.cos(half), np.sin(half), 0.0, 0.0], [np.cos(half), -np.sin(half), 0.0, 0.0]])
    return np.zeros((2, 3)), turn


def test_a_wrung_strip_does_not_pass_through_itself():
    across, along = np.linspace(-0.06, 0.06, 7), np.linspace(0.0, 0.5, 26)
    cloth = grid_cloth(across, along, Fabric(), right=(0.0, 1.0, 0.0), down=(1.0, 0.0, 0.0))
    ends = [attach(cloth, "first", np.arange(7)), attach(cloth, "last", np.arange(7) + 175)]
    scene = Scene(cloth, ends)
    run, without = Layers(scene), Layers(scene, contact=None)
    crossed = 0
    for frame in range(120):
        for each in (run, without):
            each.go(1, lambda _, frame=frame: twisted((frame + 1) / 120))
        crossed += without.crossings
        assert run.crossings == 0
    assert crossed > 10


def test_layers_that_start_inside_each_other_are_not_torn():
    cloth, n = sheets(0.0, turn=0.2)
    positions = cloth.positions.copy()
    positions[n:, 2] = 0.01 * np.sin(40.0 * positions[n:, 0])
    run = Layers(Scene(replace(cloth, positions=positions), [], gravity=(0.0, 0.0, 0.0)))
    run.go(30)
    # They let go of each other as far as they can, at the pace of the recovery.
    assert run.speed < 0.3
    assert np.abs(run.positions).max() < 0.3


def test_the_rest_shape_decides_what_is_left_alone():
    cloth = folded(11)
    np.testing.assert_array_equal(rest_shape(cloth), np.column_stack([cloth.pattern, np.zeros(cloth.vertices)]))
    mesh = Cloth.from_mesh(cloth.positions, cloth.triangles)
    np.testing.assert_array_equal(rest_shape(mesh), cloth.positions)
    patterned = Cloth.from_mesh(cloth.positions, cloth.triangles, pattern=cloth.pattern)
    np.testing.assert_array_equal(rest_shape(patterned)[:, :2], cloth.pattern)
    both, n = sheets(0.01)
    assert isinstance(both, MeshCloth)
    apart = rest_shape(both)
    assert np.linalg.norm(apart[n:, None] - apart[None, :n], axis=2).min() > 0.3


def test_the_thickness_by_default():
    def of(spacing: float) -> float:
        return default_thickness(Cloth.rectangle(width=10 * spacing, height=10 * spacing, spacing=spacing))

    assert of(0.03) == 0.005
    # Of n x n cells 2 n (n + 1) edges are sides of cells, n^2 are diagonals.
    mean = 0.003 * (220 + 100 * 2.0**0.5) / 320
    assert of(0.003) == pytest.approx(mean / 3.0)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"thickness": 0.0}, "positive and finite, not 0"),
        ({"thickness": -0.01}, "positive and finite, not -0.01"),
        ({"thickness": np.nan}, "not nan"),
        ({"friction": -1.0}, "zero or more and finite, not -1"),
        ({"friction": np.inf}, "not inf"),
    ],
)
def test_what_makes_no_sense_is_refused(given: dict[str, float], told: str):
    with pytest.raises(ValueRangeError, match=told):
        SelfContact(**given)


def test_friction_is_the_scenes_unless_told_otherwise():
    cloth = Cloth.rectangle(width=0.2, height=0.2, spacing=0.05)
    for contact, friction in ((SelfContact(), 0.7), (SelfContact(friction=0.2), 0.2), (SMOOTH, 0.0)):
        layers = Layers(Scene(cloth, friction=0.7), contact=contact).assembly.layers
        assert layers is not None
        assert layers.friction == friction


def test_a_scene_without_it_has_nothing_of_it():
    run = Layers(Scene(folded(11)), contact=None)
    assert run.assembly.layers is None
    assert run.assembly.contacts.pressure is None


def walked(
    contact: SelfContact | None, frames: int, *, name: str = "euler", threads: int = 1
) -> tuple[FloatArray, int]:
    """Positions (F, V, 3) of the cape of the standard walk, and the crossings in every fourth frame."""
    standard = standard_scene("walk")
    simulation, track = (
        Simulation(replace(standard.scene, self_contact=contact), solver=solver(name), threads=threads),
        standard.track,
    )
    chosen = [track.index(bone) for bone in simulation.bones]
    poses = [Pose(track.positions[f, chosen], track.rotations_wxyz[f, chosen]) for f in range(frames + 1)]
    simulation.start(poses[0])
    positions, crossed = [], 0
    for pose in poses[1:]:
        simulation.step(pose, FRAME)
        positions.append(simulation.positions)
        if len(positions) % 4 == 0:
            crossed += crossings(positions[-1], standard.scene.cloth.triangles)
    return np.array(positions), crossed


@cache
def on_a_walk(contact: SelfContact | None, name: str = "euler") -> tuple[FloatArray, int]:
    return walked(contact, 120, name=name)


def test_a_cape_does_not_pass_through_itself_on_a_walk():
    assert on_a_walk(TOUCHING)[1] == 0


@pytest.mark.extra
def test_without_contact_it_would():
    # Where it first would depends on the processor, and is later by Euler.
    assert on_a_walk(None)[1] + on_a_walk(None, "xpbd")[1] > 0
    assert not np.array_equal(on_a_walk(None)[0], on_a_walk(TOUCHING)[0])


def test_runs_repeat_to_the_last_bit_on_any_number_of_threads():
    # The cape first touches itself after some 80 frames.
    first = on_a_walk(TOUCHING)[0]
    np.testing.assert_array_equal(walked(TOUCHING, 120, threads=2)[0], first)


def falling(frames: int) -> Simulation:
    simulation = Simulation(on_the_ground(folded(11)))
    simulation.start({})
    for _ in range(frames):
        simulation.step({}, FRAME)
    return simulation


def test_a_frame_that_is_taken_back_leaves_no_trace():
    plain, tried = falling(30), falling(30)
    tried.forecast(FRAME)
    for _ in range(10):
        plain.step({}, FRAME)
        tried.step({}, FRAME)
    np.testing.assert_array_equal(tried.positions, plain.positions)


def test_lists_that_are_too_short_grow(monkeypatch: pytest.MonkeyPatch):
    plain = falling(40)
    for name in ("FACES_A_VERTEX", "EDGES_A_VERTEX", "LEAST_ROOM"):
        monkeypatch.setattr(f"cape.assembly.self_contact.{name}", 1)
    short = falling(40)
    assert plain.assembly.layers is not None
    assert short.assembly.layers is not None
    assert len(short.assembly.layers.faces.first) < len(plain.assembly.layers.faces.first)
    np.testing.assert_array_equal(short.positions, plain.positions)
    assert short.retried == 0


def test_what_is_known_turns_with_a_jump_of_the_bones():
    cloth = folded(11)
    scene = Scene(cloth, [attach(cloth, "table", np.arange(55))], self_contact=TOUCHING)
    turn, shift = turn_about((0.0, 0.0, 1.0), 3.0), np.array([5.0, -3.0, 0.0])
    still, there = (np.zeros(3), turn_about((0.0, 0.0, 1.0), 0.0)), (shift, turn)
    jumping, staying = Simulation(scene), Simulation(scene)
    for simulation in (jumping, staying):
        simulation.start({"table": still})
        for _ in range(60):
            simulation.step({"table": still}, FRAME)
    jumping.step({"table": there}, FRAME)
    staying.step({"table": still}, FRAME)
    assert jumping.jumps == 1
    layers = jumping.assembly.layers
    assert layers is not None
    assert layers.pressure.held.any()
    # Gravity is along the axis of the turn: nothing else changes, up to single precision. Forces that weren't turned
    # would throw the layers more than a centimetre apart.
    expected = quaternions.rotate(turn, staying.positions) + shift
    np.testing.assert_allclose(jumping.positions, expected, atol=1e-4)
