"""Clips: what they refuse, sampling between frames, and where their joints are."""

from dataclasses import replace

import numpy as np
import pytest

from motions import Clip, UnknownNameError, ValueRangeError, quaternions

ROUNDING = 1e-12


def make_clip(frames: int = 5, moving: bool = False, fps: float = 10.0) -> Clip:
    """A small tree that tumbles: a chain of three with a side branch and two end sites."""
    random = np.random.default_rng(7)
    turns = random.normal(size=(frames, 4, 3)).cumsum(axis=0) / 3
    local = random.normal(size=(frames, 4, 3))
    return Clip(
        name="tumble",
        joints=("root", "middle", "tip", "branch"),
        parents=np.array([-1, 0, 1, 0]),
        offsets=np.array([[0, 0, 0], [0, 0, 1], [0, 0.5, 0], [1, 0, 0]], dtype=float),
        end_parents=np.array([2, 3]),
        end_offsets=np.array([[0.1, 0, 0], [0, 0, 0.2]]),
        fps=fps,
        root_positions=local[:, 0],
        rotations_wxyz=quaternions.make_continuous(quaternions.from_rotation_vector(turns)),
        local_positions=local if moving else None,
    )


def test_arrays_are_copied_and_read_only():
    positions = np.zeros((5, 3))
    clip = replace(make_clip(), root_positions=positions)
    positions[:] = 1
    assert not clip.root_positions.any()
    for array in (clip.parents, clip.offsets, clip.root_positions, clip.rotations_wxyz):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fps": 0.0}, "fps must be more than 0, not 0"),
        ({"fps": float("nan")}, "fps must be more than 0, not nan"),
        ({"joints": ("root", "middle", "middle", "branch")}, "unique"),
        ({"parents": [-1, 0, 3, 0]}, "parents before children"),
        ({"parents": [-1, 0, -1, 0]}, "parents before children"),
        ({"end_parents": [2, 4]}, "joints 0 to 3"),
        ({"offsets": np.zeros((3, 3))}, r"offsets has shape \(3, 3\), not \(4, 3\)"),
        ({"root_positions": np.zeros((0, 3))}, "no frame"),
        ({"root_positions": np.full((5, 3), np.inf)}, "root_positions holds a number that isn't finite"),
        ({"rotations_wxyz": np.ones((5, 4, 4))}, "unit quaternions"),
        ({"local_positions": np.zeros((4, 4, 3))}, "local_positions has shape"),
    ],
)
def test_contradictions_are_refused(change, message):
    with pytest.raises(ValueRangeError, match=message):
        replace(make_clip(), **change)


def test_index_of_unknown_joint_lists_the_joints():
    assert make_clip().index("tip") == 2
    with pytest.raises(UnknownNameError, match="'toe'; available: root, middle, tip, branch"):
        make_clip().index("toe")


@pytest.mark.parametrize("moving", [False, True])
def test_world_poses_are_products_of_homogeneous_matrices(moving):
    clip = make_clip(moving=moving)
    positions, rotations = clip.world_poses()
    ends = clip.end_positions()
    for frame in range(clip.frames):
        world = []
        for joint, parent in enumerate(clip.parents):
            local = np.eye(4)
            local[:3, :3] = quaternions.to_matrix(clip.rotations_wxyz[frame, joint])
            local[:3, 3] = clip.offsets[joint] if clip.local_positions is None else clip.local_positions[frame, joint]
            if parent < 0:
                local[:3, 3] = clip.root_positions[frame]
            world.append(local if parent < 0 else world[parent] @ local)
        for joint, matrix in enumerate(world):
            np.testing.assert_allclose(positions[frame, joint], matrix[:3, 3], atol=ROUNDING)
            np.testing.assert_allclose(quaternions.to_matrix(rotations[frame, joint]), matrix[:3, :3], atol=ROUNDING)
        for end, joint in enumerate(clip.end_parents):
            expected = world[joint] @ [*clip.end_offsets[end], 1]
            np.testing.assert_allclose(ends[frame, end], expected[:3], atol=ROUNDING)


def test_sample_turns_uniformly_and_moves_straight_between_frames():
    turns = np.zeros((3, 1, 3))
    turns[:, 0, 2] = [0.0, 1.0, 3.0]
    clip = Clip(
        name="turn", joints=("root",), parents=np.array([-1]), offsets=np.zeros((1, 3)),
        end_parents=np.zeros(0, dtype=np.int64), end_offsets=np.zeros((0, 3)), fps=2.0,
        root_positions=np.array([[0, 0, 0], [1, 0, 0], [1, 4, 0]], dtype=float),
        rotations_wxyz=quaternions.from_rotation_vector(turns),
    )  # fmt: skip
    poses = clip.sample([0.125, 0.5, 0.75, -1.0, 9.0])
    angle = 2 * np.arctan2(poses.rotations_wxyz[:, 0, 3], poses.rotations_wxyz[:, 0, 0])
    np.testing.assert_allclose(angle, [0.25, 1.0, 2.0, 0.0, 3.0], atol=ROUNDING)
    np.testing.assert_allclose(
        poses.root_positions, [[0.25, 0, 0], [1, 0, 0], [1, 2, 0], [0, 0, 0], [1, 4, 0]], atol=ROUNDING
    )
    assert clip.sample(0.3).root_positions.shape == (1, 3)
    with pytest.raises(ValueRangeError, match="finite"):
        clip.sample(np.nan)


@pytest.mark.parametrize("moving", [False, True])
def test_resample_at_a_multiple_keeps_the_frames(moving):
    clip = make_clip(frames=7, moving=moving, fps=10 / 3)
    fine = clip.resample(10.0)
    assert (fine.frames, fine.fps) == (19, 10.0)
    assert fine.duration == pytest.approx(clip.duration)
    np.testing.assert_allclose(fine.world_positions()[::3], clip.world_positions(), atol=1e-9)
    dots = np.sum(fine.rotations_wxyz[1:] * fine.rotations_wxyz[:-1], axis=-1)
    assert np.all(dots > 0)


def test_resample_of_one_frame_and_to_a_rate_that_does_not_fit():
    assert make_clip(frames=1).resample(100.0).frames == 1
    slow = make_clip(frames=5, fps=10.0).resample(3.0)  # 0.4 s: frames at 0 and 1/3 s
    assert slow.frames == 2
    with pytest.raises(ValueRangeError, match="not -3"):
        make_clip().resample(-3)


def test_trim_keeps_the_frames_within():
    clip = make_clip(frames=11, moving=True)
    part = clip.trim(0.25, 0.7)
    assert (part.frames, part.duration) == (5, pytest.approx(0.4))
    np.testing.assert_array_equal(part.world_positions(), clip.world_positions()[3:8])
    assert clip.trim().frames == 11
    assert clip.trim(end=clip.duration).frames == 11


def test_a_part_knows_the_whole_unless_it_is_of_another_body():
    clip = make_clip(frames=11, moving=True)
    assert clip.whole is None
    part = clip.trim(0.25, 0.7).resample(20.0).trim(0.1)
    assert part.whole is clip
    assert replace(part, name="other", fps=30.0).whole is clip
    assert replace(part, offsets=2.0 * part.offsets).whole is None  # its joints' places are their own
    assert replace(part, offsets=2.0 * part.offsets, local_positions=None).whole is clip
    assert replace(part, joints=tuple(f"{joint}_" for joint in part.joints)).whole is None


@pytest.mark.parametrize(("start", "end"), [(-0.1, 0.2), (0.3, 0.2), (0.0, 1.5), (0.21, 0.29), (np.nan, 0.2)])
def test_trim_refuses_what_is_not_in_the_clip(start, end):
    with pytest.raises(ValueRangeError, match="tumble"):
        make_clip(frames=11).trim(start, end)


def test_standing_height_ignores_the_pose():
    """A body of legs 0.9 m and trunk 0.72 m stands 1.62 m and an ankle's height tall, also when its knees are bent."""
    joints = ("Hips", "Spine", "Head", "LeftUpLeg", "LeftLeg", "LeftFoot", "RightUpLeg", "RightLeg", "RightFoot")
    parents = [-1, 0, 1, 0, 3, 4, 0, 6, 7]
    leg = [[0, 0, -0.45], [0, 0, -0.45]]
    offsets = [[0, 0, 0], [0, 0, 0.3], [0, 0, 0.3], [0.1, 0, 0], *leg, [-0.1, 0, 0], *leg]
    rotations = np.tile([1.0, 0, 0, 0], (4, 9, 1))
    rotations[:, [3, 6]] = quaternions.from_euler([-1.4], "x")
    rotations[:, [4, 7]] = quaternions.from_euler([1.4], "x")
    crouching = Clip(
        name="crouch", joints=joints, parents=np.array(parents), offsets=np.array(offsets),
        end_parents=np.array([2]), end_offsets=np.array([[0, 0, 0.12]]), fps=30.0,
        root_positions=np.zeros((4, 3)), rotations_wxyz=rotations,
    )  # fmt: skip
    assert crouching.standing_height() == pytest.approx(1.62 / (1 - 0.039), abs=1e-9)
