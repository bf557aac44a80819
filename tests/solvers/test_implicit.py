"""Implicit solvers: order, stability at any stiffness, contact and friction inside the solve, honest failure."""

from typing import Any

import numpy as np
import pytest

from cape.air.wind import Wind
from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.kernels.contact import penalty
from cape.kernels.implicit.implicit import GAMMA
from cape.scene.colliders import Plane, Sphere
from cape.scene.holding.attachments import Attachment
from cape.scene.scene import Scene
from cape.scene.standard_scenes import STANDARD_SCENES
from cape.solvers import TRBDF2, BackwardEuler, SymplecticEuler
from motions.errors import ValueRangeError
from tests.support.scenes import Run, grid_cloth, turn_about

SOLVERS = (BackwardEuler, TRBDF2)
both = pytest.mark.parametrize("kind", SOLVERS, ids=lambda kind: kind.name)
FRAME = 1.0 / 60.0
THICKNESS = 0.005  # m, the scenes' default


def soft_grid(**properties: float) -> Cloth:
    side = np.linspace(0.0, 0.5, 7)
    fabric = Fabric(stretch=30.0, shear=5.0, bend=1e-3, bend_damping_time=1e-3, **properties)
    return grid_cloth(side, side, fabric, down=(0.0, -0.6, -0.8))


def soft_mesh(**properties: float) -> Cloth:
    grid = soft_grid(**properties)
    return Cloth.from_mesh(grid.positions, grid.triangles, fabric=grid.fabric)


SMOOTH = {
    "undamped": (soft_grid(damping_time=0.0), None),
    "damped": (soft_grid(damping_time=3e-3), None),
    "air": (soft_grid(damping_time=3e-3), Wind(velocity=(1.0, 2.0, 0.0))),
    "mesh": (soft_mesh(damping_time=3e-3), Wind(velocity=(1.0, 2.0, 0.0))),
}


def swung(solver, name: str, substeps: int, *, threads: int = 1, frames: int = 4) -> Run:
    cloth, wind = SMOOTH[name]
    run = Run(Scene(cloth, [Attachment(vertices=np.arange(7), bone="hand")], wind=wind), solver, threads=threads)
    for frame in range(1, frames + 1):
        t = 0.05 * frame
        place = np.array([[0.1 * np.sin(3 * t) ** 2, 0.0, 0.05 * np.sin(4 * t) ** 2]])
        assert run.step(0.05, substeps, (place, [turn_about((0.0, 0.0, 1.0), 0.5 * np.sin(2 * t) ** 2)])) == 0
    return run


@pytest.mark.parametrize("name", SMOOTH)
def test_order_in_time_and_the_limit_that_all_solvers_share(name: str):
    exact: dict[str, Any] = {"tolerance": 1e-10, "forcing": 1e-2}
    # Without damping the threads' own fast waves must be resolved as well.
    counts = (32, 64) if name == "undamped" else (8, 16)
    reference = swung(TRBDF2(**exact), name, 4 * counts[1]).positions
    for kind, order in ((BackwardEuler, 1.0), (TRBDF2, 2.0)):
        errors = []
        for substeps in counts:
            positions = swung(kind(**exact), name, substeps).positions
            errors.append(np.sqrt(np.mean((positions - reference) ** 2)))
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2), kind.name
    # Symplectic Euler is of first order: halving its step from the next but one extrapolates to the same limit.
    coarse, fine = (swung(SymplecticEuler(precision="double"), name, n).positions for n in (250, 500))
    assert np.abs(2 * fine - coarse - reference).max() < 0.2 * np.abs(fine - coarse).max() + 2e-6


def expected_decay(kind, speed: float, frequency: float, step: float, steps: int) -> np.ndarray:
    """Closed form for x'' + w^2 x = 0 from x = 0 with a velocity: displacement and velocity after some steps."""
    y, one = np.array([1e-4, speed]), np.eye(2)
    rate = np.array([[0.0, 1.0], [-(frequency**2), 0.0]])
    if kind is BackwardEuler:
        return np.linalg.matrix_power(np.linalg.inv(one - step * rate), steps) @ y
    b = GAMMA * step / 2
    inverse = np.linalg.inv(one - b * rate)
    c1 = 1 / (GAMMA * (2 - GAMMA))
    for k in range(steps):
        slope = rate @ y
        if k == 0:  # the bounded acceleration with which a frame begins
            slope[1] /= 1 + (b * frequency) ** 2
        middle = inverse @ (y + b * slope)
        y = inverse @ (c1 * middle - (c1 - 1) * y)
    return y


@both
@pytest.mark.parametrize("stiffness_of_step", [0.3, 1e3])
def test_a_stiff_spring_decays_as_the_stability_function_says(kind, stiffness_of_step: float):
    cloth = grid_cloth([0, 0.1], [0, 0.1], Fabric(stretch=100.0, shear=0.0, bend=0.0, damping_time=0.0))
    scene = Scene(cloth, [Attachment(vertices=np.arange(2), bone="hand")], gravity=(0.0, 0.0, 0.0))
    run = Run(scene, kind(tolerance=1e-13), velocities=[[0, 0, 0]] * 2 + [[0, 0, -0.01]] * 2)
    # Two vertical springs, each of half a strip of fabric; the vertices below have a third and two thirds of its area.
    frequencies = np.sqrt(50.0 / run.assembly.mass[2:])
    step, steps = stiffness_of_step / frequencies[0], 3
    run.state.z[2:] -= 1e-4
    assert run.step(step * steps, steps) == 0
    for vertex, frequency in enumerate(frequencies, start=2):
        moved, speed = expected_decay(kind, 0.01, frequency, step, steps)
        assert cloth.positions[vertex, 2] - run.positions[vertex, 2] == pytest.approx(moved, abs=1e-10)
        assert -run.velocities[vertex, 2] == pytest.approx(speed, abs=1e-9 / step)
        if stiffness_of_step == 1e3:
            assert abs(moved) < 1e-5  # L-stable: next to nothing is left of it


@both
@pytest.mark.parametrize("stretch", [1e2, 1e4, 1e6, 1e8])
def test_energy_does_not_grow_without_damping(kind, stretch: float):
    side = np.linspace(0.0, 0.4, 8)
    cloth = grid_cloth(side, side, Fabric(stretch=stretch, shear=stretch / 10, damping_time=0.0, bend_damping_time=0.0))
    run = Run(Scene(cloth, [Attachment(vertices=np.array([0, 7]), bone="hand")]), kind())
    weight = 9.81 * run.assembly.mass

    def energy() -> float:
        return run.kinetic_energy + run.elastic_energy + float(weight @ run.positions[:, 2])

    highest = start = energy()
    for _ in range(40):
        assert run.step(FRAME, run.solver.choose_substeps(run.running, FRAME)) == 0
        highest = max(highest, energy())
    # What the tolerance leaves open, in units of a fall through the cloth's own height.
    assert highest - start < 1e-3 * weight.sum() * 0.4
    assert run.positions[:, 2].min() > -1.0


def sheet(height: float, stretch: float = 2000.0) -> Cloth:
    side = np.linspace(-0.25, 0.25, 13)
    fabric = Fabric(stretch=stretch, shear=stretch / 10)
    return grid_cloth(side, side, fabric, down=(0.0, 1.0, 0.0), origin=(0.0, 0.0, height))


@both
def test_a_sheet_falls_on_the_floor_and_stays_there(kind):
    run = Run(Scene(sheet(0.02), colliders=[Plane()]), kind())
    for _ in range(40):
        assert run.step(FRAME, 8) == 0
        assert run.positions[:, 2].min() > 0.9 * THICKNESS
    assert np.abs(run.positions[:, 2] - THICKNESS).max() < 0.02 * THICKNESS
    assert np.abs(run.velocities).max() < 1e-5


@both
@pytest.mark.parametrize("stretch", [2e3, 1e6])
def test_a_sheet_drapes_over_a_sphere_within_its_thickness(kind, stretch: float):
    run = Run(Scene(sheet(0.21, stretch), colliders=[Sphere(radius=0.2)]), kind())
    for _ in range(30):
        run.step(FRAME, 8)
        assert np.linalg.norm(run.positions, axis=1).min() > 0.2 + 0.8 * THICKNESS
    assert run.positions[:, 2].min() < 0.15


@pytest.mark.parametrize(("kind", "before", "substeps", "frames"), [(BackwardEuler, 60, 1024, 1), (TRBDF2, 14, 128, 4)])
def test_cloth_that_strikes_a_sphere_converges_in_very_short_steps(kind, before: int, substeps: int, frames: int):
    """Impacts press the harder, the shorter the step, and friction then outweighs a vertex's inertia."""
    run = Run(STANDARD_SCENES["sphere"]().scene, kind())
    for _ in range(before):
        run.step(FRAME, 8)
    assert sum(run.step(FRAME, substeps) for _ in range(frames)) == 0


@pytest.mark.parametrize("speed", [1.2e-3, 1e-2, 0.2])
@pytest.mark.parametrize("left", [0.01, 0.3, 0.9, 1.1])
def test_friction_s_slope_leads_a_vertex_to_its_speed_in_a_step(speed: float, left: float):
    """A vertex by itself: inertia (s - s0) + most f1(s) = 0, from a speed above its solution, in closed form."""
    inertia, most = 4.0, 2.0
    solution = left * penalty.SLIP

    def grip(s: float) -> float:
        return 1.0 - (1.0 - min(s / penalty.SLIP, 1.0)) ** 2

    over = inertia * (solution - speed) + most * (grip(solution) - grip(speed))
    slope = penalty.friction_slope(most, speed, inertia, over)
    assert speed + over / (inertia + slope) == pytest.approx(solution, rel=1e-9)


@both
@pytest.mark.parametrize("degrees", [20.0, 35.0])
def test_a_slope_holds_a_sheet_up_to_the_angle_of_friction(kind, degrees: float):
    angle, friction = np.radians(degrees), 0.5
    gravity = 9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    scene = Scene(sheet(THICKNESS), colliders=[Plane(friction=friction)], gravity=tuple(gravity))
    run = Run(scene, kind(tolerance=1e-8))
    for _ in range(30):
        run.step(FRAME, 8)
    along = run.velocities[:, 0].mean()
    if np.tan(angle) < friction:
        assert abs(along) < 1e-3  # what the smoothing lets creep
    else:
        assert along == pytest.approx(0.5 * 9.81 * (np.sin(angle) - friction * np.cos(angle)), rel=0.01)


@both
def test_a_carried_sheet_moves_with_what_carries_it(kind):
    run = Run(Scene(sheet(THICKNESS), colliders=[Plane(bone="lift", friction=0.5)]), kind())
    for frame in range(1, 31):
        run.step(FRAME, 8, ([[0.5 * (2.0 * FRAME * frame**2 * FRAME), 0.0, 0.0]], [[1.0, 0.0, 0.0, 0.0]]))
    # Carried at 2 m/s2, less than friction gives; the plane's velocity over the last frame.
    assert run.velocities[:, 0].mean() == pytest.approx(2.0 * FRAME * 29.5, abs=2e-3)


@both
def test_a_forcing_that_single_precision_cannot_reach_does_no_harm(kind):
    """As cloth comes to rest residuals get so small that their squares are no normal numbers any more."""
    side = np.linspace(0.0, 0.3, 7)
    runs = []
    for forcing in (0.1, 1e-8):
        cloth = grid_cloth(side, side, Fabric(damping_time=1e-3))
        run = Run(Scene(cloth, [Attachment(vertices=np.arange(7), bone="hand")]), kind(forcing=forcing))
        for _ in range(240):
            run.step(FRAME, 8)
        assert np.abs(run.velocities).max() < 1e-3
        runs.append(run.positions)
    assert np.abs(runs[1] - runs[0]).max() < 1e-6


@both
def test_stages_that_do_not_converge_are_counted(kind):
    stages = 3 * (2 if kind is TRBDF2 else 1)
    cloth, _ = SMOOTH["damped"]
    scene = Scene(cloth, [Attachment(vertices=np.arange(7), bone="hand")])
    assert Run(scene, kind(tolerance=1e-15, iterations=1)).step(0.05, 3) == stages
    assert Run(scene, kind()).step(0.05, 3) == 0


@pytest.mark.parametrize(("kind", "name"), [(BackwardEuler, "mesh"), (TRBDF2, "mesh"), (TRBDF2, "air")])
def test_same_bits_again_and_on_two_threads(kind, name: str):
    one, again, two = (swung(kind(), name, 3, threads=t) for t in (1, 1, 2))
    for a, b, c in zip(one.state, again.state, two.state, strict=True):
        assert (a == b).all()
        assert (a == c).all()


@both
@pytest.mark.parametrize("setting", [{"tolerance": 0.0}, {"iterations": 0}, {"forcing": 1.0}, {"linear_iterations": 0}])
def test_settings_out_of_range_are_refused(kind, setting: dict):
    with pytest.raises(ValueRangeError, match=next(iter(setting))):
        kind(**setting)


def test_settings_that_nobody_chose_read_back_as_numbers():
    assert (BackwardEuler().tolerance, BackwardEuler().forcing) == (1e-6, 0.1)
    assert (TRBDF2().tolerance, TRBDF2().forcing) == (1e-7, 0.1)
