"""`cape replay --loop`, from the command to what a viewer reads."""

import json
from pathlib import Path

import numpy as np
import pytest

import motions
from cape.scene.loops import Travel, round_of
from motions import quaternions
from skeleton import Skeleton
from tests.commands.test_replay import Recording
from tests.support.command import Forks

COARSE = ("--garment", "back_cape", "--spacing", "0.08", "--json")


@pytest.fixture(scope="module")
def walk(forks: Forks, tmp_path_factory) -> tuple[dict, Recording]:
    folder = tmp_path_factory.mktemp("loop")
    done = forks("replay", "walk", "--loop", "-o", "take.rrd", *COARSE, folder=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), Recording(folder / "take.rrd")


def in_the_characters_frame(points: np.ndarray, track, travel: Travel) -> np.ndarray:
    """A round of points in the world [m], and the first two frames of the next, seen from the pelvis."""
    pelvis = track.index("pelvis")
    origins, turns = track.positions[:, pelvis], track.rotations_wxyz[:, pelvis]
    seen = quaternions.rotate(quaternions.conjugate(turns)[:, None], points - origins[:, None])
    # Where the round begins again the pelvis is turned by the travel, as is the cape: seen from it nothing changes.
    return np.concatenate([seen, seen[:2]])


def test_the_cape_of_a_walk_shows_no_seam_to_who_walks_along(walk: tuple[dict, Recording]):
    facts, recording = walk
    clip = motions.load("walk")
    track, travel = round_of(Skeleton.from_clip(clip).track(clip))
    assert facts["frames"] == track.frames == clip.frames
    assert facts["loop_rounds"] >= 2
    first, last = facts["loop_blended"]
    assert 0 <= first < last < clip.frames
    cape = recording.column("/world/cape", "Mesh3D:vertex_positions").astype(float)
    seen = in_the_characters_frame(cape, track, travel)
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=2).max(axis=1)
    bends = np.linalg.norm(np.diff(seen, n=2, axis=0), axis=2).max(axis=1)
    frames = clip.frames
    assert steps[frames - 1] < np.percentile(steps[: frames - 1], 95)
    assert bends[frames - 2 : frames].max() < np.percentile(bends[: frames - 2], 95)


def test_the_figures_are_those_of_the_recording(walk: tuple[dict, Recording]):
    facts, recording = walk
    stretch = recording.column("/plots/stretch", "Scalars:scalars")
    assert facts["stretch_max"] == pytest.approx(stretch.max() / 100.0, abs=1e-5)
    assert facts["penetration_max_mm"] < 1.0
    repeated = facts["loop_gap_mm"] <= 5.0
    assert repeated != any("doesn't repeat" in warning for warning in facts["warnings"])


def test_a_clip_that_does_not_loop_is_told_in_a_line(forks: Forks, tmp_path: Path):
    done = forks("replay", "walk", "--loop", "--end", "0.6", *COARSE, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    (told,) = [warning for warning in facts["warnings"] if "doesn't loop" in warning]
    assert "\n" not in told
    assert facts["stretch_max"] < 0.15
    assert facts["loop_rounds"] >= 2


def test_without_a_loop_its_figures_are_empty(forks: Forks, tmp_path: Path):
    done = forks("replay", "idle", "--end", "0.1", *COARSE, folder=tmp_path)
    facts = json.loads(done.stdout)
    assert [facts[name] for name in ("loop_rounds", "loop_gap_mm", "loop_blended")] == [None] * 3
