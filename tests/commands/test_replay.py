"""Replaying motion with a cape, from the command to what a viewer reads: real motion capture and the shipped clips."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import motions
from cape.scene.dress import dress
from motions import quaternions
from skeleton import Skeleton

CAPE = Path(sys.executable).with_name("cape")
REAL = [
    "ad_cmu1_jumping_jacks",
    "ad_fair1_jumping_zup",
    "cmu_02_04_jump",
    "cmu_05_11_pirouette_daz",
    "cmu_09_01_run",
    "cmu_10_03_soccer_kick",
    "cmu_12_01_walk",
]


class Recording:
    """What a viewer finds in a recording, read back from the file."""

    def __init__(self, path: Path):
        import rerun as rr

        self._reader = rr.chunk.RrdReader(path)

    def column(self, entity: str, name: str) -> list:
        """All values of a component, in the order of their frames; static ones come alone."""
        found = []
        for chunk in self._reader.stream().filter(content=entity):
            batch = chunk.to_record_batch()
            if name not in batch.schema.names:
                continue
            frames = batch.column("frame").to_numpy() if "frame" in batch.schema.names else np.zeros(batch.num_rows)
            found += zip(frames.tolist(), batch.column(name).to_pylist(), strict=True)
        return [value for _, value in sorted(found, key=lambda pair: pair[0])]


def replay(clip: str | Path, folder: Path, *options: str) -> tuple[dict, Recording]:
    done = subprocess.run(
        [CAPE, "replay", clip, "-o", "take.rrd", "--json", *options], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), Recording(folder / "take.rrd")


def deepest_penetration(recording: Recording, vertices: np.ndarray, counted: np.ndarray) -> float:
    """Depth of the counted vertices in the recorded hitboxes [m], from the file alone and in double precision."""
    lengths = np.array(recording.column("/world/hitboxes", "Capsules3D:lengths")[0], dtype=float)
    radii = np.array(recording.column("/world/hitboxes", "Capsules3D:radii")[0], dtype=float)
    starts = np.array(recording.column("/world/hitboxes", "Capsules3D:translations"), dtype=float)
    turns = np.roll(np.array(recording.column("/world/hitboxes", "Capsules3D:quaternions"), dtype=float), 1, axis=-1)
    axes = quaternions.rotate(turns, np.broadcast_to([0.0, 0.0, 1.0], starts.shape))
    worst = 0.0
    for frame, points in enumerate(vertices[:, counted]):
        for capsule, (length, radius) in enumerate(zip(lengths, radii, strict=True)):
            offset = points - starts[frame, capsule]
            along = np.clip(offset @ axes[frame, capsule], 0.0, length)
            distance = np.linalg.norm(offset - along[:, None] * axes[frame, capsule], axis=1)
            worst = max(worst, radius - distance.min())
    return worst


def check(clip: str | Path, folder: Path) -> None:
    """Hold a clip to what every replay must reach."""
    facts, recording = replay(clip, folder)
    assert facts["result"] == "finished"
    assert facts["warnings"] == []
    assert facts["stretch_max"] <= 0.10
    assert facts["stretch_p99"] <= 0.03
    assert facts["penetration_max_mm"] <= 5.0

    vertices = np.array(recording.column("/world/cape", "Mesh3D:vertex_positions"), dtype=float)
    assert vertices.shape == (facts["frames"], facts["vertices"], 3)
    assert np.isfinite(vertices).all()

    read = motions.load(clip)
    body = Skeleton.from_clip(read)
    scene = dress(body, body.track(read))
    columns = len(scene.cloth.region("top"))
    free = np.ones(facts["vertices"], dtype=bool)
    for attachment in scene.attachments:
        free[attachment.vertices] = False
    assert free.sum() > facts["vertices"] - columns
    # The recording's single precision: 2 ulp of a few metres.
    assert deepest_penetration(recording, vertices, free) <= 0.005 + 2e-6

    track = body.track(read, ["left_upper_arm", "right_upper_arm", "pelvis"]).resample(facts["fps"])
    left, right, pelvis = (track.positions[: len(vertices), k] for k in range(3))
    trunk = (left + right) / 2.0 - pelvis
    forward = np.cross(left - right, trunk)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    # On the shoulders: both ends of the neckline stay within a hand's breadth of the line between the shoulder joints.
    height = body.height()
    for end, shoulder in ((vertices[:, 0], left), (vertices[:, columns - 1], right)):
        assert np.linalg.norm(end - shoulder, axis=1).max() < 0.12 * height
    # Behind the back: the upper third of the cape, on average, in every frame.
    upper = vertices[:, : facts["vertices"] // 3].mean(axis=1)
    assert np.einsum("ij,ij->i", upper - (left + right) / 2.0, forward).max() < 0.0


@pytest.mark.parametrize("name", REAL)
def test_real_motion_wears_its_cape(name, mocap, tmp_path):
    check(mocap / f"{name}.bvh", tmp_path)


@pytest.mark.parametrize("name", motions.clip_names())
def test_shipped_clips_wear_their_cape(name, tmp_path):
    check(name, tmp_path)


def test_xpbd_replays_too(tmp_path):
    facts, _ = replay("walk", tmp_path, "--solver", "xpbd")
    assert facts["result"] == "finished"
    assert facts["penetration_max_mm"] <= 5.0


def mean_position(folder: Path, *options: str) -> np.ndarray:
    facts, recording = replay("idle", folder, "--end", "2", *options)
    assert facts["result"] == "finished"
    return np.mean(recording.column("/world/cape", "Mesh3D:vertex_positions")[-1], axis=0)


def test_wind_blows_the_cape_its_way(tmp_path):
    moved = mean_position(tmp_path, "--wind", "-6", "0", "0") - mean_position(tmp_path)
    assert moved[0] < -0.05
