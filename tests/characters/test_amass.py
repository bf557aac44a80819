"""AMASS's files: turns as axis times angle on the mean body, and that it is told that it is that."""

import numpy as np
import pytest

import motions
from motions.amass.reader import JOINTS
from motions.errors import FileError
from skeleton import Skeleton

NAMES = [joint for joint, _, _ in JOINTS]
FRAMES = 5


def save(path, **changes):
    """A body that stands upright and raises its left arm from out to up, 1 m along X."""
    poses = np.zeros((FRAMES, 156))
    poses[:, 0] = np.pi / 2.0  # from the body's Y up to the world's Z up
    poses[:, 3 * NAMES.index("left_shoulder") + 2] = np.linspace(0.0, np.pi / 2.0, FRAMES)
    trans = np.zeros((FRAMES, 3))
    trans[:, 0], trans[:, 2] = 1.0, 1.2
    arrays = {"poses": poses, "trans": trans, "mocap_framerate": np.array(120.0), "betas": np.zeros(16)}
    arrays |= {"gender": np.array("neutral"), "labels": np.array([{}], dtype=object)}
    np.savez(path, **{name: value for name, value in (arrays | changes).items() if value is not None})
    return path


def test_turns_are_axis_times_angle_on_the_mean_body(tmp_path):
    clip = motions.load(save(tmp_path / "raise.npz"))
    assert (clip.fps, clip.frames) == (120.0, FRAMES)
    places = clip.world_positions()
    shoulder, elbow = (places[:, clip.index(f"left_{joint}")] for joint in ("shoulder", "elbow"))
    # The body faces -Y as +Z of its own goes there, its left is +X, and the upper arm ends pointing up.
    out, back = 0.2596, 0.0275
    assert np.allclose((elbow - shoulder)[0], [out, back, -0.0128], atol=1e-6)
    assert np.allclose((elbow - shoulder)[-1], [0.0128, back, out], atol=1e-6)
    assert np.allclose(places[:, 0], [1.0, -0.2233, 1.2282], atol=1e-6)
    assert 1.6 < clip.standing_height() < 1.75
    assert "SMPL's mean body" in clip.decisions[0]
    assert len(clip.decisions) == 1
    body = Skeleton.from_clip(clip)
    assert body.roles["left_upper_arm"] == "left_shoulder"
    assert body.roles["left_shoulder"] == "left_collar"
    assert body.roles["chest"] == "spine3"


def test_newer_files_keep_their_parts_apart(tmp_path):
    whole = np.load(save(tmp_path / "a.npz"), allow_pickle=True)["poses"]
    parts = {"root_orient": whole[:, :3], "pose_body": whole[:, 3:66], "mocap_frame_rate": np.array(30.0)}
    path = save(tmp_path / "b.npz", poses=None, mocap_framerate=None, **parts)
    clip = motions.load(path)
    assert clip.fps == 30.0
    assert np.allclose(clip.world_positions(), motions.load(tmp_path / "a.npz").world_positions())
    assert motions.load(path, rate=25.0).fps == 25.0


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"poses": np.zeros((FRAMES, 30))}, "66 or more"),
        ({"poses": np.full((FRAMES, 156), np.nan)}, "isn't finite"),
        ({"trans": np.zeros((FRAMES - 1, 3))}, "for places"),
        ({"poses": np.array([{}], dtype=object)}, "no table of numbers"),
        ({"trans": None}, "no motion of AMASS"),
    ],
)
def test_what_is_wrong_is_told(tmp_path, changes, told):
    with pytest.raises(FileError, match=told):
        motions.load(save(tmp_path / "bad.npz", **changes))


def test_a_cape_is_worn_by_it(tmp_path, forks):
    save(tmp_path / "raise.npz")
    done = forks("info", "raise.npz", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "SMPL's mean body" in " ".join(done.stdout.split())
    assert "vertices that reach" in done.stdout
