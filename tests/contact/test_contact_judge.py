"""The judge of random arrangements: what it calls stuck, what pinched, and what the arrangements promise."""

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from cape import Box, Cloth, Plane, Scene, Simulation, Sphere, SymplecticEuler, attach
from cape.scene.colliders import Collider
from skeleton.track import BoneTrack
from tests.support import arrangements
from tests.support.arrangements import COUNT, FRAMES, SHALLOW, STARTS, Arrangement, depths
from tests.support.code import compiled_only, requests_of
from tests.support.contact_judge import PATIENCE, Judge, run

FloatArray = NDArray[np.float64]

arrangement = cache(arrangements.arrangement)  # many tests look at the same ones

SOME = range(0, COUNT, 10)
RADIUS, THICKNESS = 0.1, Scene.thickness


def judged(
    vertex: ArrayLike,
    solids: list[Collider],
    *,
    frames: int = PATIENCE + 1,
    ways: dict[str, FloatArray] | None = None,
    held_at: list[float] | None = None,
) -> tuple[list[str], int]:
    """What a judge says of a vertex of a cloth of 4 that is held at another, 10 cm from it.

    The vertex stays at a place (3,) or is led along places (FRAMES + 1, 3) [m]. Bones stand in the origin, or are led
    along `ways`.
    """
    cloth = Cloth.rectangle(width=0.1, height=0.1, spacing=0.1)
    bones = ["rod", *dict.fromkeys(str(s.bone) for s in solids)]
    places = np.zeros((FRAMES + 1, len(bones), 3))
    for bone, way in (ways or {}).items():
        places[:, bones.index(bone)] = way
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES + 1, len(bones), 1))
    track = BoneTrack(tuple(bones), np.arange(FRAMES + 1) / 60, places, turns)
    scene = Scene(cloth, [attach(cloth, "rod", [0])], solids)
    judge = Judge(Arrangement(0, "clear", scene, track, len(solids), 0.0))
    way = np.broadcast_to(np.asarray(vertex, float), (FRAMES + 1, 3))
    positions = np.full((4, 3), -9.0)
    for frame in range(1, frames + 1):
        positions[1] = way[frame]
        positions[0] = way[frame] + [0.0, 0.08, 0.0] if held_at is None else held_at
        judge.see(frame, positions)
    return judge.verdict()


def ball(**fields) -> Sphere:
    return Sphere(**({"bone": "a", "radius": RADIUS} | fields))


DEEP = [0.06, 0.0, 0.0]  # 4 cm deep in the ball, the way out is along x


def test_deep_for_long_with_a_way_out_is_stuck():
    stuck, pinched = judged(DEEP, [ball()])
    assert stuck == [f"vertex 1 stuck in sphere for {PATIENCE + 1} frames up to {PATIENCE + 1}, by up to 40.0 mm"]
    assert pinched == 0


@pytest.mark.parametrize(
    ("vertex", "frames"),
    [(DEEP, PATIENCE), ([RADIUS - 0.0019, 0.0, 0.0], FRAMES), ([0.2, 0.0, 0.0], FRAMES)],
    ids=["not for long", "not deep", "outside"],
)
def test_not_long_or_not_deep_is_sound(vertex: list[float], frames: int):
    assert judged(vertex, [ball()], frames=frames) == ([], 0)


def test_who_gets_out_in_between_is_not_stuck():
    way = np.tile(DEEP, (FRAMES + 1, 1))
    way[:: PATIENCE + 1, 0] = 0.2
    assert judged(way, [ball()], frames=FRAMES) == ([], 0)


def test_what_is_held_may_be_deep():
    assert judged([9.0, 9.0, 9.0], [ball()], held_at=DEEP) == ([], 0)


@pytest.mark.parametrize(("gap", "out"), [(2.0 * THICKNESS + 1e-5, True), (2.0 * THICKNESS - 2e-4, False)])
def test_a_way_out_that_another_collider_bars_is_none(gap: float, out: bool):
    wall = Plane(name="wall", bone="b", point=np.array([RADIUS + gap, 0, 0]), normal=np.array([-1.0, 0, 0]))
    stuck, pinched = judged(DEEP, [ball(), wall])
    assert (len(stuck), pinched) == ((1, 0) if out else (0, 1))


def test_a_way_out_that_another_collider_is_about_to_bar_is_none():
    # It closes the gap and opens it again, in every other frame.
    to_and_fro = np.zeros((FRAMES + 1, 3))
    to_and_fro[::2, 0] = 0.5
    wall = Plane(name="wall", bone="b", point=np.array([RADIUS, 0, 0]), normal=np.array([-1.0, 0, 0]))
    assert judged(DEEP, [ball(), wall], ways={"b": to_and_fro}) == ([], 1)


@pytest.mark.parametrize(("speed", "out"), [(2.9, True), (3.1, False), (-20.0, True)])
def test_a_way_out_that_the_collider_overruns_is_none(speed: float, out: bool):
    way = np.zeros((FRAMES + 1, 3))
    way[:, 0] = speed / 60 * np.arange(FRAMES + 1)
    stuck, pinched = judged(way + DEEP, [ball()], ways={"a": way})
    assert (len(stuck), pinched) == ((1, 0) if out else (0, 1))


@pytest.mark.parametrize(
    ("place", "out"),
    [
        ([0.09, 0.0, 0.0], False),
        ([0.09, 0.0, 0.03], True),
        ([0.09, 0.06, 0.0], False),
        ([0.08, 0.02, 0.0], False),
        ([0.115, 0.03, 0.0], True),
        ([0.04, 0.0, 0.0], True),
    ],
    ids=[
        "on the way",
        "beside the way",
        "across the thread to what is held",
        "across the thread on the way alone",
        "beyond the thread",
        "behind the vertex",
    ],
)
def test_a_way_out_through_another_collider_is_none(place: list[float], out: bool):
    # Out of the ball, the vertex would be at 0.105, and what is held stays at (0.06, 0.08).
    bead = Sphere(name="bead", bone="b", center=np.array(place), radius=0.01)
    held_at = [0.075, 0.08, 0.0] if place[1] == 0.06 else [0.06, 0.08, 0.0]
    stuck, pinched = judged(DEEP, [ball(), bead], held_at=held_at)
    assert (len(stuck), pinched) == ((1, 0) if out else (0, 1))


@pytest.mark.parametrize(("away", "out"), [(0.104, True), (0.106, False)])
def test_a_way_out_of_reach_is_none(away: float, out: bool):
    # The cloth is 10 cm long between the vertex and what is held.
    stuck, pinched = judged(DEEP, [ball()], held_at=[RADIUS + THICKNESS, away, 0.0])
    assert (len(stuck), pinched) == ((1, 0) if out else (0, 1))


def test_a_way_out_leads_past_a_corner():
    # 1 cm under one face of a box and 1.1 cm under another, which a wall bars: the nearer one counts.
    box = Box(bone="a", half_sizes=np.full(3, RADIUS))
    wall = Plane(name="wall", bone="b", point=np.array([RADIUS, 0, 0]), normal=np.array([-1.0, 0, 0]))
    vertex = [RADIUS - 0.011, RADIUS - 0.01, 0.0]
    assert len(judged(vertex, [box, wall])[0]) == 1
    assert judged([RADIUS - 0.01, RADIUS - 0.011, 0.0], [box, wall]) == ([], 1)


def test_the_middle_of_a_ball_has_no_way_out():
    assert judged([0.0, 0.0, 0.0], [ball()]) == ([], 1)


# -- arrangements --


def test_an_arrangement_is_made_again_by_its_number():
    one, two, other = (arrangements.arrangement(number) for number in (7, 7, 8))
    np.testing.assert_array_equal(one.track.positions, two.track.positions)
    np.testing.assert_array_equal(one.track.rotations_wxyz, two.track.rotations_wxyz)
    np.testing.assert_array_equal(one.scene.cloth.positions, two.scene.cloth.positions)
    assert [c.name for c in one.scene.colliders] == [c.name for c in two.scene.colliders]
    assert one.scene.friction == two.scene.friction != other.scene.friction


def test_arrangements_are_as_told():
    given = [arrangement(number) for number in range(COUNT)]
    starts = Counter(a.start for a in given)
    for start, share in STARTS.items():
        # Four standard deviations.
        assert abs(starts[start] - share * COUNT) < 4 * np.sqrt(share * (1 - share) * COUNT)
    assert {a.present for a in given} == set(range(1, 7))
    assert all(150 <= a.scene.cloth.vertices <= 250 for a in given)
    kinds = Counter(c.name.split()[0] for a in given for c in a.scene.colliders[: a.present])
    assert min(kinds[kind] for kind in ("sphere", "capsule", "box", "plane", "tapered")) > COUNT / 3


@pytest.mark.parametrize("frame", [0, 10, FRAMES])
def test_cloth_starts_as_told_and_what_is_held_stays_clear(frame: int):
    for number in SOME:
        given = arrangement(number)
        track, cloth = given.track, given.scene.cloth
        (attachment,) = given.scene.attachments
        held = cloth.positions[attachment.vertices] + track.positions[frame, track.index("rod")]
        for solid in given.scene.colliders[: given.present] if given.start != "contrary" else ():
            bone = track.index(str(solid.bone))
            pose = track.positions[frame, bone], track.rotations_wxyz[frame, bone]
            assert depths(solid, *pose, held).max() < -THICKNESS
            if frame == 0:
                most = -THICKNESS if given.start == "clear" else SHALLOW
                assert depths(solid, *pose, cloth.positions).max() <= most + 1e-9


def test_nothing_moves_in_the_last_third():
    for number in SOME:
        track = arrangement(number).track
        for values in (track.positions, track.rotations_wxyz):
            np.testing.assert_allclose(
                values[2 * FRAMES // 3 :], np.stack([values[-1]] * (FRAMES // 3 + 1)), atol=1e-12
            )


@compiled_only
def test_all_arrangements_run_on_one_compiled_code():
    needed = {frozenset(requests_of(arrangement(number).scene, SymplecticEuler())) for number in SOME}
    assert len(needed) == 1


@pytest.mark.extra
def test_the_judge_finds_fault_with_a_cloth_that_ignores_what_comes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Simulation, "step", lambda *_: None)
    found = [run(arrangement(number)) for number in SOME[::2]]
    stuck = Counter(o.start for o in found if o.stuck)
    assert stuck["shallow"] > 2
    assert stuck["clear"] > 2
    assert not any(o.faults for o in found if o.start == "contrary")


@pytest.mark.parametrize(("start", "snap"), [("clear", 30.0), ("contrary", 330.0)])
def test_the_judge_finds_fault_with_too_fast_a_cloth(monkeypatch: pytest.MonkeyPatch, start: str, snap: float):
    given = next(a for a in map(arrangement, range(COUNT)) if a.start == start)
    still = replace(given, fastest=1.0)
    monkeypatch.setattr(Simulation, "step", lambda *_: None)
    fall = np.sqrt(2 * 9.81 * np.linalg.norm(np.ptp(given.scene.cloth.pattern, axis=0)))
    allowed = snap + 5.0 * fall
    for speed, faults in ((allowed + 5.1, 1), (allowed + 4.9, 0), (np.nan, 1)):
        monkeypatch.setattr(Simulation, "velocities", np.array([[0.0, speed, 0.0]]))
        assert sum("m/s" in fault or "finite" in fault for fault in run(still).faults) == faults
