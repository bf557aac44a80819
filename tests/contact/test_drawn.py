"""Threads that are held short around limbs: cloth is drawn into the thickness, and never through.

The kernels also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest

import cape
from cape import Capsule, Fabric, Pose, Scene, Simulation, attach
from cape.assembly.assemble import assemble
from cape.kernels.bones import Motion
from cape.kernels.contact import contact
from cape.kernels.contact.contact import EXIT
from cape.kernels.contact.drawn import DRAWN, Drawing, Drawn, begin_drawing, end_drawing
from cape.kernels.contact.shapes import MOMENT
from cape.kernels.contact.watch import GAIN, NEVER
from cape.kernels.state import State
from cape.kernels.team import Team
from cape.run.attempts import DRAWING
from cape.run.hanging import Hanging
from cape.run.strain_limit import LEFT, TUG, StrainLimit
from skeleton.shapes import Plane
from tests.support.scenes import grid_cloth
from tests.support.shapes import moving, record, touching

THICKNESS, STEP = 0.01, 1e-3  # m, s
UNTURNED = [1.0, 0.0, 0.0, 0.0]


class OnAFloor:
    """Four vertices on the ground, some of which contact has stopped there, that threads then move."""

    def __init__(self, heights: list[float]) -> None:
        places = np.array([[0.1 * k, 0.0, height] for k, height in enumerate(heights)])
        self.state = State(*places.T.copy(), *np.zeros((3, len(heights))))
        self.floor = record(Plane, np.zeros(4), thickness=THICKNESS, vertices=len(heights))
        self.floor.clock[MOMENT] += 1
        self.drawn = Drawn.blank(len(heights))
        self.touch = touching(self.state, self.floor, moving([[0, 0, 0]]))._replace(drawn=self.drawn)

    def collide(self, turn: int) -> None:
        contact.collide(self.touch, 0, len(self.z), turn, STEP)

    def draw(self, ways: np.ndarray) -> None:
        drawing, team = Drawing(self.state, self.drawn, self.floor), Team.alone(len(self.z))
        begin_drawing(drawing, team, 0, 1, STEP)
        for component, way in zip(self.state[:3], ways.T, strict=True):
            component += way
        end_drawing(drawing, team, 0, 1, STEP)

    @property
    def z(self) -> np.ndarray:
        return np.asarray(self.state.z)


def test_what_contact_has_stopped_is_drawn_in_by_a_share_of_the_thickness_at_most():
    cloth = OnAFloor([THICKNESS - 1e-3, THICKNESS - 1e-3, 0.5, THICKNESS - 1e-3])
    cloth.collide(0)
    np.testing.assert_allclose(cloth.z, [THICKNESS, THICKNESS, 0.5, THICKNESS], atol=1e-15)
    ways = np.array([[0.02, 0.0, -0.03], [0.0, 0.01, -1e-3], [0.0, 0.0, -0.03], [0.0, 0.0, 0.02]])
    before = np.array(cloth.state.x)
    cloth.draw(ways)
    np.testing.assert_allclose(
        cloth.z, THICKNESS + np.array([-DRAWN * THICKNESS, -1e-3, 0.49 - 0.03, 0.02]), atol=1e-15
    )
    np.testing.assert_allclose(np.array(cloth.state.x) - before, ways[:, 0], atol=1e-15)
    # In the next step contact gives it all back, however little of a depth it would else take away at once.
    assert DRAWN * THICKNESS > EXIT * STEP / 2
    cloth.floor.clock[MOMENT] += 1
    cloth.floor.next[:] = 0
    cloth.floor.wake[:] = 0
    cloth.collide(1)
    np.testing.assert_allclose(cloth.z[:2], THICKNESS, atol=1e-15)


def test_what_two_limbs_pinch_is_drawn_along_them_alone():
    cloth = OnAFloor([THICKNESS - 1e-3] * 4)
    cloth.collide(0)
    cloth.floor.pinched[:2] = True
    cloth.draw(np.array([[0.02, 0.0, -1e-3], [0.0, 0.0, 0.02], [0.0, 0.0, -1e-3], [0.0, 0.0, 0.02]]))
    np.testing.assert_allclose(cloth.z - THICKNESS, [0.0, 0.0, -1e-3, 0.02], atol=1e-15)
    assert cloth.state.x[0] == pytest.approx(0.02)


def test_what_was_stopped_before_is_not_held():
    cloth = OnAFloor([THICKNESS - 1e-3] * 4)
    cloth.collide(0)
    cloth.floor.clock[MOMENT] += 1
    cloth.draw(np.tile([0.0, 0.0, -0.03], (4, 1)))
    np.testing.assert_allclose(cloth.z, THICKNESS - 0.03, atol=1e-15)


@pytest.mark.parametrize(("share", "wakes"), [(0.9, False), (1.1, True)])
def test_what_is_drawn_faster_than_expected_wakes_its_tile(share: float, wakes: bool):
    cloth = OnAFloor([0.5] * 4)
    cloth.draw(np.tile([share * GAIN * STEP, 0.0, 0.0], (4, 1)))
    assert (cloth.floor.alarm[0] == 0) == wakes
    assert cloth.floor.alarm[-1] == (0 if wakes else NEVER) or not wakes


def at(height: float) -> Pose:
    """The frame that holds the strip, and the limb."""
    return Pose(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, height]]), np.array([UNTURNED, UNTURNED]))


@pytest.mark.parametrize("name", ["euler", "xpbd"])
def test_no_limb_is_drawn_through_a_strip_that_can_t_give_way(name: str):
    across = np.linspace(-0.3, 0.3, 21)
    strip = grid_cloth(across, np.linspace(0.0, 0.12, 5), Fabric(), down=(0.0, -1.0, 0.0))
    ends = np.flatnonzero(np.isin(np.arange(strip.vertices) % 21, (0, 20)))
    radius, thickness, low, high = 0.03, 0.012, -0.05, 0.15
    limb = Capsule("limb", "limb", np.array([0.0, -0.4, 0.0]), np.array([0.0, 0.3, 0.0]), radius)
    scene = Scene(strip, [attach(strip, "frame", ends)], [limb], thickness=thickness, strain_limit=True)
    simulation = Simulation(scene, solver=cape.solver(name), threads=1, cuts=None)
    simulation.start(at(low))
    closest, strains, meter = np.inf, [], simulation.meter()
    for share in (*np.linspace(0.0, 1.0, 8), *np.ones(20), *np.linspace(1.0, 0.0, 8), *np.zeros(10)):
        height = low + share * (high - low)
        simulation.step(at(height), 1 / 60)
        free = np.delete(simulation.positions, ends, axis=0)
        closest = min(closest, np.hypot(free[:, 0], free[:, 2] - height).min() - radius)
        strains.append(simulation.read(meter).stretch)
    # Drawn straight from both ends onto a circle and around its top, the strip is 19 % longer than it was.
    away, reach = np.hypot(0.3, high), radius + thickness
    around = np.pi - np.arctan2(0.3, high) - np.arccos(reach / away)
    needed = (np.sqrt(away**2 - reach**2) + reach * around) / 0.3 - 1.0
    assert 0.95 * needed < max(strains) < 1.7 * needed
    # A step's own way in, of 1.7 m/s in 1/40 of a frame, apart.
    assert closest > (1.0 - DRAWN) * thickness - 1e-3
    assert simulation.positions[:, 2].max() < 0.01
    assert strains[-1] < 0.041


def test_long_threads_are_those_that_shorter_steps_may_shorten():
    cloth = grid_cloth(np.linspace(0, 0.2, 3), np.linspace(0, 0.2, 3), Fabric())
    limb = Capsule("limb", None, np.zeros(3), np.ones(3), 0.01)
    scene = Scene(cloth, [attach(cloth, "hand", [0, 1])], [limb], strain_limit=True)
    assembly = assemble(scene, [np.array([0, 1])])
    state = State.at_rest(cloth.positions, np.float64)
    limit = StrainLimit(assembly, state, list(np.ones((2, 9))))
    assert not limit.is_too_much(limit.excess())
    most = 0.1 * 1.04
    state.x[1] = state.x[0] + 1.01 * most  # held at both ends, beside a shorter one
    assert not limit.is_too_much(limit.excess())
    state.x[1] = cloth.positions[1, 0]
    state.z[8] = state.z[5] - 1.01 * most
    assert limit.is_too_much(limit.excess())
    state.z[8] = state.z[5] - 0.99 * most
    assert not limit.is_too_much(limit.excess())
    state.z[8] = state.z[5] - 1.01 * most
    colliders = assembly.contacts.colliders
    assert colliders is not None
    colliders.pinched[5] = True
    assert not limit.is_too_much(limit.excess())
    colliders.pinched[5] = False
    limit.lasting = TUG
    assert limit.is_too_much(limit.excess())
    state.z[8] = state.z[5] - 1.005 * most
    assert not limit.is_too_much(limit.excess())
    assert limit.excess() > 0.0


def test_threads_that_stay_too_long_a_little_are_not_shortened_for_ever(monkeypatch: pytest.MonkeyPatch):
    # Two threads in a row between two bones, of which one is left what the other is not let to: up to 4.8, later 8 %.
    cloth = grid_cloth(np.linspace(0, 0.2, 3), np.linspace(0, 0.1, 2), Fabric())
    ends = [attach(cloth, "left", [0, 3]), attach(cloth, "right", [2, 5])]
    simulation = Simulation(Scene(cloth, ends, strain_limit=True))
    taken: list[list[int]] = []
    advance = Hanging.advance

    def counted(cloth: Hanging, motion: Motion, duration: float, substeps: int) -> int:
        taken[-1].append(substeps)
        return advance(cloth, motion, duration, substeps)

    monkeypatch.setattr(Hanging, "advance", counted)
    little, more = 0.2 * (0.04 + 0.3 * LEFT), 0.2 * (0.04 + 2.0 * LEFT)
    simulation.start({"left": (np.zeros(3), UNTURNED), "right": (np.zeros(3), UNTURNED)}, settle=0.0)
    for by in [little] * (TUG + 5) + [more] * 2 + [0.0] * 2 + [little] * 2:
        taken.append([])
        simulation.step({"left": (np.zeros(3), UNTURNED), "right": (np.array([by, 0.0, 0.0]), UNTURNED)}, 1.0 / 60.0)
    shortened = [max(steps) >= DRAWING * min(steps) for steps in taken]
    assert shortened == [True] * TUG + [False] * 5 + [True] * 2 + [False] * 2 + [True] * 2
