"""What a user is told after a run: what to look at, where, when, how deep and for how long."""

from dataclasses import replace

import numpy as np
import pytest

import cape
from cape.measure.contact_points import ContactPoints
from cape.results.take import Take
from cape.results.verdict import penetration_warnings, reach_warnings, stretch_warnings, stuck_warnings
from tests.support.takes import take_of

FRAMES = 40
THICKNESS = 0.01


def take_with(contacts: list[tuple[int, int, int, float]], **changes) -> Take:
    """A take of three vertices and two spheres, with contacts (frame, vertex, collider, penetration [m])."""
    spheres = [cape.Sphere(name="ball"), cape.Sphere(name="globe", thickness=0.02)]
    rows = sorted(contacts)
    n = len(rows)
    frames, vertices, colliders, depths = (np.array(column) for column in zip(*rows, strict=True)) if n else [[]] * 4
    thickness = np.array([THICKNESS, 0.02])[colliders] if n else np.zeros(0)
    points = ContactPoints(
        starts=np.searchsorted(frames, np.arange(FRAMES + 1)),
        points=np.zeros((n, 3), np.float32),
        normals=np.zeros((n, 3), np.float32),
        depths=(np.array(depths) + thickness).astype(np.float32),
        colliders=np.array(colliders, np.int32),
        vertices=np.array(vertices, np.int32),
    )
    take = take_of(np.zeros((FRAMES, 3, 3)), [[0, 1, 2]], spheres)
    return replace(take, contacts=points, thickness=THICKNESS, **changes)


def stay(first: int, frames: int, vertex: int, collider: int, depth: float) -> list[tuple[int, int, int, float]]:
    return [(frame, vertex, collider, depth) for frame in range(first, first + frames)]


def test_nothing_notable_is_no_warning():
    assert stuck_warnings(take_with([])) == []
    assert penetration_warnings(take_with([])) == []
    assert reach_warnings(take_with([])) == []
    # In the thickness all the time, and inside for as long as is no wonder.
    assert stuck_warnings(take_with(stay(0, 40, 0, 0, -0.005) + stay(3, 10, 1, 0, 0.004))) == []
    # At the surface of a collider, to rounding and what a step leaves.
    assert stuck_warnings(take_with(stay(0, 40, 0, 0, 0.0005))) == []


def test_vertices_that_stay_inside_are_named():
    contacts = stay(5, 11, 2, 0, 0.003) + stay(20, 14, 1, 0, 0.002) + stay(0, 9, 0, 0, 0.006)
    contacts[4] = (9, 2, 0, 0.0075)
    (warning,) = stuck_warnings(take_with(contacts))
    assert warning == (
        "stuck in ball: vertices 1, 2 stay inside for up to 14 frames from frame 20 on, "
        "and up to 7.5 mm deep (vertex 2 at frame 9)"
    )


def test_a_stay_is_in_one_collider_and_without_a_break():
    halves = stay(5, 8, 0, 0, 0.003) + stay(14, 8, 0, 0, 0.003)
    assert stuck_warnings(take_with(halves)) == []
    assert len(stuck_warnings(take_with([*halves, (13, 0, 0, 0.003)]))) == 1
    # The last frames of one vertex and the first of the next are not one stay.
    assert stuck_warnings(take_with(stay(30, 10, 0, 0, 0.003) + stay(0, 10, 1, 0, 0.003))) == []
    two = stay(5, 8, 0, 0, 0.003) + stay(13, 8, 0, 1, 0.003)
    assert stuck_warnings(take_with(two)) == []
    both = stay(5, 12, 0, 0, 0.003) + stay(5, 12, 0, 1, 0.003)
    assert [text.split(":")[0] for text in stuck_warnings(take_with(both))] == ["stuck in ball", "stuck in globe"]


def test_many_stuck_vertices_are_counted():
    contacts = [c for vertex in range(9) for c in stay(0, 12, vertex, 1, 0.002)]
    assert "vertices 0, 1, 2, 3, 4 and 4 more stay inside" in stuck_warnings(take_with(contacts))[0]


def test_penetration_is_told_by_frame_collider_depth_and_time():
    depth, which = np.zeros(FRAMES), np.full(FRAMES, -1)
    depth[10:14], which[10:14] = [0.006, 0.009, 0.007, 0.004], 0
    depth[30], which[30] = 0.02, 0
    depth[20], which[20] = 0.0123, 1
    ball, globe = penetration_warnings(take_with([], penetration=depth, penetrated=which))
    assert ball.startswith("the cloth enters ball by up to 20.0 mm at frame 30, for 4 frames from 10 to 30, 2 times: ")
    assert globe.startswith("the cloth enters globe by up to 12.3 mm at frame 20, for 1 frame: ")


def test_a_collider_that_was_left_out_and_yet_met_is_told():
    met = take_with(stay(7, 2, 0, 1, -0.005) + stay(0, 3, 0, 0, 0.0), left_out={"globe": "far away"})
    (warning,) = reach_warnings(met)
    assert warning.startswith("the cloth stretches as far as globe at frame 7, which was left out")


def test_advice_on_stretch_fits_what_brought_it_about():
    """Of a jump, of speed and of limbs that hold the cloth; a solver's name and the fabric belong to none of these."""
    stretch, depth = np.zeros(FRAMES), np.zeros(FRAMES)
    stretch[20], depth[17] = 0.3, 0.004
    take = take_with([], stretch_max=stretch, solver="xpbd")

    def told(**changes) -> str:
        (warning,) = stretch_warnings(replace(take, **changes))
        head, _, advice = warning.partition(": ")
        assert head == "the cloth stretches by up to 30% at frame 20, for 1 frames"
        return advice

    assert "substeps" in told()
    assert "substeps" not in told(solver="euler")
    assert told(jumps=(18,)).endswith("--cuts reset puts it on anew there")
    assert "substeps" in told(jumps=(18,), renewed=(18,))
    assert "substeps" in told(jumps=(2, 30))
    assert told(penetration=depth) == "limbs that pass through each other hold it fast"
    positions = take.bones.positions.copy()
    positions[16:] += 0.4  # m along each axis in a 60th of a second
    fast = replace(take.bones, positions=positions)
    assert told(bones=fast, penetration=depth).startswith("bones move at 42 m/s there: ")


@pytest.mark.parametrize("frames", [[0, 1, 2], [2, 0], [1], []])
def test_contacts_of_chosen_frames(frames):
    contacts = take_with(stay(0, 2, 1, 0, 0.001) + stay(0, 3, 2, 1, 0.002)).contacts
    assert contacts is not None
    chosen = contacts.select(np.array(frames, dtype=np.int64))
    expected = {0: [1, 2], 1: [1, 2], 2: [2]}
    assert chosen.counts.tolist() == [len(expected[f]) for f in frames]
    assert chosen.vertices.tolist() == [v for f in frames for v in expected[f]]
    parts = [contacts.select(np.array([f])) for f in range(FRAMES)]
    np.testing.assert_array_equal(ContactPoints.joined(parts).starts, contacts.starts)
    np.testing.assert_array_equal(ContactPoints.joined(parts).depths, contacts.depths)
    np.testing.assert_array_equal(contacts.frames, [0, 0, 1, 1, 2])
