"""Cloth against shapes: sliding and sticking by Coulomb's law, moving surfaces, and nothing gets in."""

import numpy as np
import pytest

from cape import Box, Capsule, Collider, Fabric, Plane, Scene, Sphere
from cape.solvers import Solver
from tests.support.scenes import DEFAULTS, DOUBLE, Run, both_by_default, both_solvers, grid_cloth, turn_about
from tests.support.shapes import box_distance, capsule_distance

G = 9.81  # m/s2
THICKNESS = 0.005  # m
FABRIC = Fabric(density=0.2, stretch=500.0, shear=50.0, damping_time=1e-4)
# Soft enough for symplectic Euler at few steps a frame: a patch that moves as one piece strains nothing.
SOFT = Fabric(density=0.2, stretch=5.0, shear=0.5, bend=0.0)

# Every scene has all kinds of colliders, those that it does not need far below, so that all share their compiled code.
FAR = np.array([0.0, 0.0, -1000.0])


def scene(cloth, colliders: list[Collider], **settings) -> Scene:
    kinds = {type(c) for c in colliders}
    far: list[Collider] = [
        Sphere(name="far sphere", center=FAR),
        Box(name="far box", center=FAR),
        Plane(name="far plane", point=FAR),
    ]
    return Scene(cloth, colliders=colliders + [c for c in far if type(c) not in kinds], thickness=THICKNESS, **settings)


def patch_on_slope(solver: Solver, angle: float, friction: float) -> Run:
    """A patch of cloth that lies at rest on a plane falling off towards +X at an angle [rad]."""
    across, along = np.array([0.0, 1.0, 0.0]), np.array([np.cos(angle), 0.0, -np.sin(angle)])
    normal = np.cross(along, across)
    cloth = grid_cloth([0, 0.05, 0.1], [0, 0.05], SOFT, right=across, down=along, origin=THICKNESS * normal)
    slope = Plane(name="slope", normal=normal, friction=friction)
    return Run(scene(cloth, [slope]), solver)


@both_solvers
@pytest.mark.parametrize(("degrees", "friction"), [(20, 0.0), (30, 0.3), (45, 0.5), (45, 0.99)])
def test_slides_down_a_slope_with_coulomb_friction(solver: Solver, degrees: float, friction: float):
    angle = np.radians(degrees)
    run = patch_on_slope(solver, angle, friction)
    start = run.positions
    frames, substeps = 30, 10
    for _ in range(frames):
        run.step(1 / 60, substeps)
    t, h = frames / 60, 1 / 60 / substeps
    acceleration = G * (np.sin(angle) - friction * np.cos(angle))
    along = np.array([np.cos(angle), 0, -np.sin(angle)])
    # All vertices slide alike, as a point would: the discrete motion of both methods, but for 300 roundings.
    expected = along * acceleration * t * (t + h) / 2
    np.testing.assert_allclose(run.positions - start, np.tile(expected, (6, 1)), atol=1e-11)
    np.testing.assert_allclose(run.velocities, np.tile(along * acceleration * t, (6, 1)), atol=1e-9)


@pytest.mark.parametrize("solver", [DEFAULTS[0], *DOUBLE], ids=lambda s: f"{s.name}-{s.precision}")
@pytest.mark.parametrize("degrees", [0, 10, 21])
def test_sticks_below_the_angle_of_friction(solver: Solver, degrees: float):
    # The angle of friction of 0.4 is 21.8 degrees.
    run = patch_on_slope(solver, np.radians(degrees), 0.4)
    start = run.positions
    for _ in range(120):
        run.step(1 / 60, 10)
    # 1200 steps, each of which may round a coordinate below 0.13 m by 2^-27 m / 2 in single precision: 4.5e-6 m if all
    # went the same way.
    limit = 4.5e-6 if solver.precision == "single" else 1e-13
    assert np.abs(run.positions - start).max() < limit


@both_solvers
def test_a_conveyor_takes_the_cloth_along(solver: Solver):
    speed, friction = 0.8, 0.25
    cloth = grid_cloth([0, 0.05, 0.1], [0, 0.05], SOFT, down=(0, -1, 0), origin=(0, 0, THICKNESS))
    run = Run(scene(cloth, [Plane(name="belt", bone="belt", friction=friction)]), solver)
    start = run.positions
    substeps, frames = 20, 40
    h = 1 / 60 / substeps
    for frame in range(1, frames + 1):
        run.step(1 / 60, substeps, ([[0.0, speed * frame / 60, 0.0]], [[1, 0, 0, 0]]))
    # It slips for a time v / (mu g), and is v^2 / (2 mu g) behind from then on.
    assert speed / (friction * G) < frames / 60
    behind = speed**2 / (2 * friction * G)
    moved = run.positions - start
    # First order: half a step at the belt's speed.
    np.testing.assert_allclose(moved[:, 1], speed * frames / 60 - behind, atol=0.51 * h * speed)
    np.testing.assert_allclose(moved[:, [0, 2]], 0.0, atol=1e-12)
    np.testing.assert_allclose(run.velocities[:, 1], speed, atol=1e-9)


@both_solvers
def test_a_turntable_carries_the_cloth_round(solver: Solver):
    spin, friction, radius = 2.0, 0.5, 0.4
    # Friction holds it: mu g = 4.9 m/s2 against w^2 r = 2.0 m/s2, with edges of 5 cm.
    cloth = grid_cloth(
        [radius, radius + 0.05, radius + 0.1], [0, 0.05], SOFT, down=(0, -1, 0), origin=(0, 0, 0.1 + THICKNESS)
    )
    table = Box(name="table", bone="table", half_sizes=np.array([1.0, 1.0, 0.1]), friction=friction)
    start = cloth.positions
    rigid = np.cross([0, 0, spin], start)
    run = Run(scene(cloth, [table]), solver, velocities=rigid)
    substeps, frames = 20, 60
    h = 1 / 60 / substeps
    for frame in range(1, frames + 1):
        run.step(1 / 60, substeps, ([[0.0, 0.0, 0.0]], [turn_about((0, 0, 1), spin * frame / 60)]))
    c, s = np.cos(spin), np.sin(spin)
    expected = start @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    # Each step follows the tangent: the radius grows by w^2 h / 2 a second, over one second.
    np.testing.assert_allclose(run.positions, expected, atol=1.1 * spin**2 * h / 2 * np.abs(start).max())


@both_solvers
@pytest.mark.parametrize("shape", ["sphere", "capsule"])
def test_a_spinning_shape_drags_the_cloth_along_its_surface(solver: Solver, shape: str):
    radius, spin, friction, half = 1.0, 3.0, 0.3, 0.005
    cloth = grid_cloth([-half, half], [-half, half], SOFT, down=(0, -1, 0), origin=(0, 0, radius + THICKNESS))
    if shape == "sphere":
        solid: Collider = Sphere(name="ball", bone="ball", radius=radius, friction=friction)
    else:
        solid = Capsule("roll", "ball", np.array([0, -1.0, 0]), np.array([0, 1.0, 0]), radius, friction)
    run = Run(scene(cloth, [solid]), solver)
    duration = 0.02
    run.step(duration, 100, ([[0.0, 0.0, 0.0]], [turn_about((0, 1, 0), spin * duration)]))
    # The top moves towards +X at w R = 3 m/s and drags with mu m g. Corners are 5 mm off the top, half a percent of the
    # radius, which is the share of gravity along the surface; by symmetry it cancels in the mean.
    pulled = run.velocities.mean(axis=0)
    assert pulled[0] == pytest.approx(friction * G * duration, rel=0.01)
    assert abs(pulled[1]) < 1e-6


@both_by_default
@pytest.mark.parametrize("shape", ["sphere", "box", "capsule", "plane"])
def test_rests_on_a_shape_without_entering_it(solver: Solver, shape: str):
    cloth = grid_cloth(
        np.linspace(-0.3, 0.3, 25), np.linspace(-0.3, 0.3, 25), FABRIC, down=(0, -1, 0), origin=(0.01, 0.02, 0.03)
    )
    start, end = np.array([-0.2, 0.0, -0.2]), np.array([0.2, 0.0, -0.2])
    box_center, halves = np.array([0, 0, -0.12]), np.array([0.15, 0.1, 0.1])
    shapes: dict[str, Collider] = {
        "sphere": Sphere(center=np.array([0, 0, -0.2]), radius=0.2),
        "box": Box(center=box_center, half_sizes=halves),
        "capsule": Capsule("roll", None, start, end, 0.15),
        "plane": Plane(point=np.array([0, 0, -0.1])),
    }
    run = Run(scene(cloth, [shapes[shape]], friction=0.6), solver)

    def distance(points: np.ndarray) -> np.ndarray:
        if shape == "sphere":
            return np.linalg.norm(points - start * [0, 0, 1], axis=1) - 0.2
        if shape == "box":
            return box_distance(points - box_center, halves)
        if shape == "plane":
            return points[:, 2] + 0.1
        return capsule_distance(points, start, end, 0.15)

    substeps = run.stable_substeps()
    for _ in range(60):
        run.step(1 / 60, substeps)
        # A micrometre of grazing contact, and single precision.
        assert distance(run.positions).min() > THICKNESS - 2e-6
    touching = distance(run.positions) < THICKNESS + 1e-4
    assert touching.sum() >= 4
    assert np.abs(run.velocities[touching]).max() < 0.5


@both_by_default
def test_a_capsule_at_5_m_s_pushes_the_cloth_ahead(solver: Solver):
    speed, radius = 5.0, 0.08
    cloth = grid_cloth(np.linspace(-0.3, 0.3, 21), np.linspace(0, 0.8, 28), FABRIC, right=(0, 1, 0))
    fist = Capsule("fist", "fist", np.array([0, -0.1, -0.4]), np.array([0, 0.1, -0.4]), radius)
    run = Run(scene(cloth, [fist], friction=0.4), solver)
    run.pose = (np.array([[-0.2, 0.0, 0.0]]), run.pose[1])
    substeps = run.stable_substeps()
    for frame in range(1, 16):
        x = -0.2 + speed * frame / 60
        run.step(1 / 60, substeps, ([[x, 0.0, 0.0]], [[1, 0, 0, 0]]))
        place = np.array([x, 0.0, 0.0])
        depth = capsule_distance(run.positions, fist.start + place, fist.end + place, radius)
        assert depth.min() > THICKNESS - 2e-6
    # What was in its way is ahead of it.
    pushed = np.abs(cloth.positions - [0, 0, -0.4]).max(axis=1) < 0.07
    assert (run.positions[pushed, 0] > -0.2 + speed * 15 / 60 + radius / 2).all()
