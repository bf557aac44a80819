"""Every solver with limbs driven through hanging cloth, and with what bones hold inside of shapes."""

import numpy as np
import pytest

import cape
from cape import Capsule, Cloth, Fabric, GridCloth, Scene, Simulation, Sphere, attach
from cape.kernels.contact.contact import EXIT
from cape.solvers import SOLVERS
from tests.support.scenes import Run, grid_cloth
from tests.support.shapes import FloatArray, capsule_distance

THICKNESS = 0.005  # m
SPACING = 0.03  # m
FPS = 60.0
UNTURNED = [1.0, 0.0, 0.0, 0.0]

# All scenes have one kind of colliders, thin ones, with friction, and what is held: they share their compiled code.
by_default = pytest.mark.parametrize("name", SOLVERS)


def faces_sampled(positions: FloatArray, triangles: np.ndarray) -> FloatArray:
    """Points 2.5 mm apart on all triangles."""
    n = round(SPACING / 0.0025)
    weights = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    return np.einsum("wk,tkc->twc", weights, positions[triangles]).reshape(-1, 3)


def passed(positions: FloatArray, cloth: GridCloth, center: FloatArray) -> int:
    """Columns of vertices that turn behind a limb along Y at the centre on their way down, and not in front of it."""
    columns = positions.reshape(cloth.rows, cloth.columns, 3).transpose(1, 0, 2)
    seen = (columns - center)[:, :, [0, 2]] @ np.array([1.0, 1.0j])
    return int((np.angle(seen[:, 1:] / seen[:, :-1]).sum(axis=1) > 0.0).sum())


@by_default
@pytest.mark.parametrize("last", [0.4, 0.5, 0.6], ids=["", "a share of a frame later", "another"])
@pytest.mark.parametrize("radius", [0.04, 0.005], ids=["arm", "rod thinner than the spacing"])
def test_a_limb_takes_a_hanging_sheet_along(name: str, radius: float, last: float):
    speed = 30.0  # m/s
    cloth = Cloth.rectangle(width=0.4, height=0.8, spacing=SPACING, origin=(0.0, 0.2, 0.0))
    half, height = np.array([0.0, 0.4, 0.0]), -0.315
    limb = Capsule("limb", "limb", -half, half, radius, friction=0.3)
    simulation = Simulation(
        Scene(cloth, [attach(cloth, "rod", "top")], [limb], thickness=THICKNESS), solver=cape.solver(name)
    )

    def pose(x: float):
        return {"rod": (np.zeros(3), UNTURNED), "limb": (np.array([x, 0.0, height]), UNTURNED)}

    frames = int(np.ceil((last + 0.2) * FPS / speed))
    simulation.start(pose(last - frames * speed / FPS), settle=0.0)
    where, center = simulation.positions, np.zeros(3)
    for frame in range(1, frames + 1):
        center = np.array([last - (frames - frame) * speed / FPS, 0.0, height])
        simulation.step(pose(center[0]), 1.0 / FPS)
        where = simulation.positions
        faces = faces_sampled(where, cloth.triangles)
        assert capsule_distance(where, center - half, center + half, radius).min() > 0.0
        assert capsule_distance(faces, center - half, center + half, radius).min() > 0.0
    assert passed(where, cloth, center) == 0
    assert simulation.retried == 0


def held(count: int, radius: float, solver: str) -> Run:
    """A little cloth whose first vertices a bone holds; the first is 1 cm below the centre of a ball on a bone."""
    cloth = grid_cloth(np.linspace(0, 0.1, 3), np.linspace(0, 0.1, 3), Fabric(stretch=500.0, shear=50.0))
    ball = Sphere(bone="ball", center=np.array([0.0, 0.0, 0.01]), radius=radius, friction=0.3)
    scene = Scene(cloth, [attach(cloth, "hand", range(count))], [ball], thickness=0.002)
    return Run(scene, cape.solver(solver))


def watched(run: Run, frames: int) -> FloatArray:
    """Positions after each frame, and before the first."""
    seen = [run.positions]
    for _ in range(frames):
        run.step(1 / FPS, max(run.stable_substeps(), 8))
        seen.append(run.positions)
    return np.array(seen)


@by_default
def test_held_vertices_are_led_out_of_a_ball_and_come_back_when_it_goes(name: str):
    run = held(3, 0.02, name)
    start = run.positions[:3]
    inside = watched(run, 3)[:, :3]
    # Straight down, away from the ball's centre, until its thickness is free; the others were out of it and stay, as
    # that strains the thread between by 2.8 %.
    np.testing.assert_allclose(inside[-1], start - [[0, 0, 0.02 + 0.002 - 0.01], [0, 0, 0], [0, 0, 0]], atol=1e-7)
    run.pose[0][run.scene.bones.index("ball")] = [0.0, 0.0, 1.0]
    gone = watched(run, 3)[:, :3]
    np.testing.assert_allclose(gone[-1], start, atol=1e-7)


@by_default
def test_what_is_held_deep_inside_leaves_no_faster_than_it_may(name: str):
    seen = watched(held(9, 0.25, name), 2)
    ways = np.linalg.norm(np.diff(seen, axis=0), axis=2)
    np.testing.assert_allclose(ways.max(axis=1), EXIT / FPS, atol=1e-6)
    # Threads hold those back that would leave by other sides.
    assert ways.min() > 0.5 * EXIT / FPS
