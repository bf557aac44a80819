import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motions.errors import UnknownNameError, ValueRangeError
from skeleton import BoneTrack
from tests.support.figures import matrices_of


def turn_about_z(angle):
    """Unit quaternions of turns about z [rad]."""
    angle = np.asarray(angle, dtype=float)
    zero = np.zeros_like(angle)
    return np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=-1)


def spinning(frames=5, fps=10.0, speed=2.0):
    """Two bones: one stands still, one moves at 3 m/s along x and turns at `speed` [rad/s] about z."""
    times = np.arange(frames) / fps
    positions = np.zeros((frames, 2, 3))
    positions[:, 1, 0] = 3 * times
    rotations = np.stack([turn_about_z(0 * times), turn_about_z(speed * times)], axis=1)
    return BoneTrack(("still", "moving"), times, positions, rotations, np.array([-1, 0]), {"left_hand": "moving"})


@given(st.floats(0, 0.4))
@settings(deadline=None)
def test_sample_follows_a_uniform_motion_exactly(t):
    # Uniform velocity is what both interpolations reproduce, so nothing but rounding remains.
    positions, rotations = spinning().sample(t)
    assert positions[1] == pytest.approx([3 * t, 0, 0], abs=1e-12)
    assert np.abs(matrices_of(rotations[1]) - matrices_of(turn_about_z(2 * t))).max() < 1e-12


def test_sample_takes_any_shape_of_times_and_holds_the_ends():
    track = spinning()
    positions, rotations = track.sample([[-1.0, 0.0, 0.2], [0.4, 0.5, 99.0]])
    assert positions.shape == (2, 3, 2, 3)
    assert rotations.shape == (2, 3, 2, 4)
    assert np.abs(positions[0, 0] - track.positions[0]).max() < 1e-15
    assert np.abs(positions[1, 1:] - track.positions[-1]).max() < 1e-15
    assert np.abs(positions[0, 2] - track.positions[2]).max() < 1e-15


def test_sample_of_one_frame_stands_still():
    track = spinning(frames=1)
    assert np.array_equal(track.sample([0.0, 5.0])[0], np.zeros((2, 2, 3)))


def test_resample_keeps_motion_and_duration():
    track = spinning(frames=7)
    finer = track.resample(30)
    assert finer.frames == 19
    assert finer.fps == pytest.approx(30)
    assert finer.times[-1] == pytest.approx(track.times[-1])
    assert finer.positions[:, 1, 0] == pytest.approx(3 * finer.times)
    assert np.abs(finer.resample(10).positions - track.positions).max() < 1e-12
    assert finer.roles == track.roles


def test_signs_become_continuous_without_turning_anything():
    track = spinning(frames=40, speed=9.0)
    flipped = np.array(track.rotations_wxyz)
    flipped[1::3] *= -1
    mended = BoneTrack(track.names, track.times, track.positions, flipped)
    assert (np.sum(mended.rotations_wxyz[1:] * mended.rotations_wxyz[:-1], axis=-1) > 0).all()
    assert np.abs(matrices_of(mended.rotations_wxyz) - matrices_of(flipped)).max() < 1e-12


def test_arrays_are_copies_and_read_only():
    positions = np.zeros((1, 1, 3))
    track = BoneTrack(("bone",), np.zeros(1), positions, np.array([[[1.0, 0, 0, 0]]]))
    positions[:] = 7
    assert track.positions[0, 0, 0] == 0
    for array in (track.times, track.positions, track.rotations_wxyz):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1


def test_select_by_name_and_role_keeps_ancestry():
    rotations = np.tile([1.0, 0, 0, 0], (1, 3, 1))
    chain = BoneTrack(("a", "b", "c"), np.zeros(1), np.zeros((1, 3, 3)), rotations, np.array([-1, 0, 1]), {"head": "c"})
    some = chain.select(["head", "a", "c"])
    assert some.names == ("c", "a")
    assert some.parents is not None
    assert some.parents.tolist() == [1, -1]
    assert some.roles == {"head": "c"}
    assert chain.select(["a"]).roles == {}


def test_at_gives_a_frame():
    track = spinning()
    assert np.array_equal(track.at(2)[0], track.positions[2])
    assert np.array_equal(track.at(-1)[1], track.rotations_wxyz[-1])
    with pytest.raises(ValueRangeError, match="no frame 5: the track's frames are 0 to 4"):
        track.at(5)


def test_unknown_bones_list_the_bones():
    with pytest.raises(UnknownNameError, match=r"no bone named 'tail'; available: still, moving\. Roles: left_hand"):
        spinning().index("tail")
    assert spinning().index("left_hand") == spinning().index("moving") == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": ("a", "a")}, "unique; given twice: a"),
        ({"times": np.zeros(0)}, "at least one frame"),
        ({"times": np.zeros(2)}, "times must increase, frame 1 is"),
        ({"times": np.array([0, np.inf])}, "times must be finite"),
        ({"positions": np.zeros((2, 3, 3))}, r"positions must have the shape \(2, 2, 3\), got \(2, 3, 3\)"),
        ({"positions": np.full((2, 2, 3), np.nan)}, r"positions must be finite.*index \(0, 0, 0\)"),
        ({"rotations_wxyz": np.full((2, 2, 4), 0.6)}, "unit length, that of 'a' at frame 0"),
        ({"parents": np.array([-1, 2])}, "parents must lie between -1 and 1"),
        ({"roles": {"head": "c"}}, "role 'head' is given to 'c', which isn't among: a, b"),
    ],
)
def test_what_is_no_track_is_refused(change, message):
    good = {
        "names": ("a", "b"),
        "times": np.array([0.0, 1.0]),
        "positions": np.zeros((2, 2, 3)),
        "rotations_wxyz": np.full((2, 2, 4), 0.5),
    }
    BoneTrack(**good)
    with pytest.raises(ValueRangeError, match=message):
        BoneTrack(**{**good, **change})


def test_frame_rates_need_a_duration():
    with pytest.raises(ValueRangeError, match="one frame has no frame rate"):
        _ = spinning(frames=1).fps
    with pytest.raises(ValueRangeError, match="must be positive, got 0"):
        spinning().resample(0)
    with pytest.raises(ValueRangeError, match="must be finite"):
        spinning().sample(np.nan)
