"""Limbs that have gone through a cloth: it slips off them, over their tips."""

import numpy as np
import pytest

import cape
from cape import Capsule, Cloth, Pose, Scene, Simulation, attach
from cape.kernels.contact.slip import NOT
from cape.kernels.state import State
from cape.run.contact.slips import Slips, boxes_that_meet
from cape.scene.poses import poses_of
from tests.contact.stunts import FPS, stunt

SPACING, RADIUS, THICKNESS = 0.05, 0.04, 0.01  # m
BEHIND, BEYOND = 0.15, 0.08  # m, of the limb's joint and its tip on either side of the sheet
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
LIMIT = 0.04  # of a woven fabric


class Pierced:
    """A sheet that hangs across a limb which is through it, in the middle of a cell, along Y or against it."""

    def __init__(
        self, *, ways: float = 1.0, solver: str = "euler", limit: bool = True, hand: float | None = None
    ) -> None:
        """Let contact push the sheet off the limb, which is on all sides; a `hand` so long [m] goes on from its tip."""
        sheet = Cloth.rectangle(
            width=0.4, height=0.4, spacing=SPACING, origin=(-0.223, 0.0, 0.226), right=(1.0, 0.0, 0.0)
        )
        tip = np.array([0.0, ways * (BEHIND + BEYOND), 0.0])
        limbs = [Capsule("arm", "arm", np.zeros(3), tip, RADIUS)]
        if hand is not None:
            limbs.append(Capsule("hand", "hand", np.zeros(3), np.array([0.0, ways * hand, 0.0]), RADIUS))
        held = attach(sheet, "beam", "top")
        self.scene = Scene(sheet, [held], limbs, thickness=THICKNESS, strain_limit=limit)
        self.simulation = Simulation(self.scene, solver=cape.solver(solver), threads=1)
        joint = np.array([0.0, -ways * BEHIND, 0.0])
        places = {"beam": np.zeros(3), "arm": joint, "hand": joint + tip}
        bones = self.simulation.bones
        self.pose = Pose(np.stack([places[bone] for bone in bones]), np.tile(UNTURNED, (len(bones), 1)))
        self.simulation.start(self.pose, settle=0.0)
        self.meter = self.simulation.meter()

    def go(self, frames: int) -> list[float]:
        """The largest strain after each of some frames."""
        strains = []
        for _ in range(frames):
            self.simulation.step(self.pose, 1.0 / 60.0)
            strains.append(self.simulation.read(self.meter).stretch)
        return strains

    @property
    def slipping(self) -> int:
        """How many vertices slip off."""
        colliders = self.simulation.assembly.contacts.colliders
        assert colliders is not None
        return int((colliders.slips != NOT).sum())

    @property
    def is_through(self) -> bool:
        """Whether the limb's middle goes through a triangle: in the plane of X and Z, of those that it may be in."""
        places, inside = self.simulation.positions, False
        for corners in places[self.scene.cloth.triangles]:
            if np.abs(corners[:, [0, 2]]).max() < 2.0 * SPACING and -BEHIND < corners[:, 1].mean() < BEYOND:
                x, z = corners[:, 0], corners[:, 2]
                turns = x * np.roll(z, -1) - z * np.roll(x, -1)
                inside |= bool((turns > 0.0).all() or (turns < 0.0).all())
        return inside


@pytest.mark.parametrize("ways", [1.0, -1.0], ids=["along Y", "against Y"])
@pytest.mark.parametrize("solver", ["euler", "xpbd"])
def test_a_cloth_slips_off_a_limb_that_is_through_it(solver: str, ways: float):
    """By itself it would stay there, its threads around the limb strained by 80 % and more."""
    pierced = Pierced(ways=ways, solver=solver)
    assert pierced.is_through
    # At the speed at which what is inside is led out, 3 m/s, it takes 2 frames to the tip.
    strains = pierced.go(8)
    assert max(strains) <= LIMIT
    assert not pierced.is_through
    assert pierced.slipping == 0
    # Where its neighbours are it went with them, beyond the tip.
    beyond = ways * pierced.simulation.positions[:, 1] > BEYOND - RADIUS
    assert beyond.sum() >= 3
    assert max(pierced.go(12)) <= LIMIT


@pytest.mark.parametrize("ways", [1.0, -1.0], ids=["along Y", "against Y"])
def test_a_cloth_slips_off_an_arm_over_the_hand_that_goes_on_from_it(ways: float):
    """The hand begins within the arm's end, and would stop there what comes out of that."""
    length = 0.12
    pierced = Pierced(ways=ways, hand=length)
    # 0.2 m to the hand's tip at 3 m/s take 4 frames; it begins later, and what is stopped in between goes on later.
    pierced.go(8)
    assert pierced.slipping == 0
    beyond = ways * pierced.simulation.positions[:, 1] > BEYOND + length - RADIUS
    assert beyond.sum() >= 3
    assert max(pierced.go(20)[-8:]) <= LIMIT  # it was drawn out as far as the tip, and swings back


def test_boxes_that_meet_are_those_that_share_a_point():
    rng = np.random.default_rng(8)
    one, other = rng.uniform(size=(40, 2, 3)), rng.uniform(size=(30, 3, 3))
    one[:, 1] = one[:, 0] + 0.4 * (one[:, 1] - one[:, 0])
    expected = [
        (k, n)
        for k, a in enumerate(one)
        for n, b in enumerate(other)
        if all(max(a[:, d].min(), b[:, d].min()) <= min(a[:, d].max(), b[:, d].max()) for d in range(3))
    ]
    assert 0 < len(expected) < 1200
    assert list(zip(*boxes_that_meet(one, other), strict=True)) == expected
    assert [len(each) for each in boxes_that_meet(one, other[:0])] == [0, 0]


def test_a_frame_is_taken_again_only_where_a_limb_newly_goes_through():
    """What else a limb goes through that something slips off already slips as well, but not from a frame earlier."""
    pierced = Pierced()
    pierced.go(2)
    places = pierced.simulation.positions.T
    slips = Slips(pierced.simulation.assembly, State(*places, *np.zeros_like(places)))
    slipping = np.flatnonzero(slips.of_vertices != NOT)
    assert len(slipping) == 3
    long = np.ones(len(slips.of_vertices), bool)
    slips.of_vertices[slipping[0]] = NOT
    assert not slips.begin(long, pierced.pose)
    assert slips.of_vertices[slipping[0]] != NOT
    slips.of_vertices[:] = NOT
    assert slips.begin(long, pierced.pose)


def test_a_limb_that_only_long_steps_take_through_a_cloth_is_not_let_go_of():
    """A hand that lifts a coarse cape fast, in its first steps: in shorter ones it takes that along."""
    body, track = stunt("cartwheel")
    scene = cape.dress(body, track.first(12), spacing=0.08)
    simulation = Simulation(scene, solver=cape.solver("euler"), threads=1)
    poses = poses_of(track, scene.bones)
    simulation.start(poses[0])
    meter, colliders = simulation.meter(), simulation.assembly.contacts.colliders
    assert colliders is not None
    for pose in poses[1:12]:
        simulation.step(pose, 1.0 / FPS)
        assert (colliders.slips == NOT).all()
        assert simulation.read(meter).stretch < 1.5 * LIMIT


def test_what_is_not_kept_short_goes_on_as_it_was(monkeypatch: pytest.MonkeyPatch):
    """Without a limit nothing tells threads that are too long, and nothing is looked for."""
    monkeypatch.setattr(Slips, "_find", None)
    assert max(Pierced(limit=False).go(8)) > 10.0 * LIMIT


def test_a_frame_that_is_taken_back_forgets_what_has_slipped():
    ends = []
    for disturbed in (False, True):
        pierced = Pierced()
        mark = pierced.simulation.mark()
        if disturbed:
            pierced.go(2)
            assert pierced.slipping > 0
            pierced.simulation.go_back(mark)
            assert pierced.slipping == 0
        pierced.go(4)
        ends.append(pierced.simulation.positions)
    assert np.array_equal(*ends)
