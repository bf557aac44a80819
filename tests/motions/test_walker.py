"""A character that is steered: it answers in the next frame, as smoothly as its clips are."""

import numpy as np
import pytest
from numpy.typing import NDArray

import motions
from motions import quaternions
from motions.errors import UnknownNameError
from motions.graph.motion_graph import MotionGraph
from motions.graph.walker import Walker
from motions.kinematics import forward_kinematics

CLIPS = [motions.load(name) for name in ("idle", "walk", "kick")]
GRAPH = MotionGraph(CLIPS)
FPS = 60.0


def walk(frames: int, orders: dict[int, str], turning: float = 0.0) -> tuple[NDArray, NDArray, list[str]]:
    """Places of joints [m] (F, J, 3) and turns of the root wxyz (F, 4) of a character told so, and what it does."""
    walker = Walker(GRAPH, "idle", once=["kick"])
    walker.turning = turning
    places, turns, names = [], [], []
    for frame in range(frames):
        if frame in orders:
            walker.go(orders[frame])
        rotations, local, _ = walker.next()
        joints, to_world = forward_kinematics(CLIPS[0].parents, local[None], rotations[None])
        places.append(joints[0])
        turns.append(to_world[0, 0])
        names.append(walker.clip)
    return np.array(places), np.array(turns), names


def accelerations(places: NDArray) -> NDArray:
    """Largest of all joints [m/s2], shape (F - 2,)."""
    return np.linalg.norm(np.diff(places, 2, axis=0), axis=-1).max(axis=1) * FPS**2


@pytest.fixture(scope="module")
def steered() -> NDArray:
    """Places of joints [m] (F, J, 3) of one who stands, walks, kicks on the way, and stands."""
    return walk(700, {100: "walk", 260: "kick", 268: "idle", 275: "walk"})[0]


def test_it_answers_in_the_next_frame(steered: NDArray):
    still, _, _ = walk(140, {})
    moved = np.linalg.norm(steered[:140] - still, axis=-1).max(axis=1)
    assert (moved[:100] == 0.0).all()
    assert (moved[100:] > 0.0).all()


def test_it_is_as_smooth_as_its_clips(steered: NDArray):
    """Passages, also those that break others off, accelerate no joint more than a clip does."""
    most = max(accelerations(clip.world_positions()).max() for clip in CLIPS)
    assert accelerations(steered).max() < 1.001 * most


def test_what_is_done_once_is_followed_by_what_went_before():
    _, _, names = walk(500, {10: "walk", 60: "kick"})
    assert names[60] == "kick"
    assert names[-1] == "walk"
    assert names[60:].index("walk") > 120  # frames; the kick lasts for 223


def test_it_goes_round_for_good():
    places, _, names = walk(1200, {0: "walk"})
    assert set(names) == {"walk"}
    way = np.linalg.norm(np.diff(places[::60, 0, :2], axis=0), axis=1)
    assert way[1:].min() > 0.8 * way[1:].max() > 0.8  # metres in each second


def test_feet_stay_on_the_ground(steered: NDArray):
    assert steered[..., 2].min() > min(clip.world_positions()[..., 2].min() for clip in CLIPS) - 0.02


def test_it_turns_at_the_rate_that_it_is_told():
    rate = 0.7
    straight, turned = (walk(120, {}, turning)[1] for turning in (0.0, rate))
    relative = quaternions.multiply(turned, quaternions.conjugate(straight))
    angles = np.unwrap(2.0 * np.arctan2(relative[:, 3], relative[:, 0]))
    np.testing.assert_allclose(angles, rate / FPS * np.arange(120), atol=1e-9)


def test_where_it_turns_its_root_stays():
    straight, turned = (walk(60, {}, turning)[0][:, 0] for turning in (0.0, 2.0))
    assert np.abs(turned - straight).max() < 0.05  # it sways on the spot, seen from another side


def test_it_turns_in_the_next_frame():
    walker, straight = Walker(GRAPH, "idle"), Walker(GRAPH, "idle")
    for _ in range(10):
        walker.next()
        straight.next()
    walker.turning = 2.0
    about = quaternions.from_rotation_vector(np.array([0.0, 0.0, 2.0 / FPS]))
    expected = quaternions.multiply(about, straight.next().rotations[0])
    np.testing.assert_allclose(walker.next().rotations[0], expected, atol=1e-12)


def test_an_unknown_clip_is_told():
    walker = Walker(GRAPH, "idle")
    with pytest.raises(UnknownNameError, match="walk"):
        walker.go("swim")
