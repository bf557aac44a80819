"""Replaying motion with a cape, from the command to what a viewer reads: real motion capture and the shipped clips."""

import json
from pathlib import Path

import numpy as np
import pytest

import motions
from cape.scene.dress import dress
from motions import quaternions
from skeleton import Skeleton
from tests.support.command import Forks

# The suite replays one clip of each kind.
SLOW = pytest.mark.extra
REAL = [
    *(
        pytest.param(name, marks=SLOW)
        for name in ("ad_cmu1_jumping_jacks", "ad_fair1_jumping_zup", "cmu_02_04_jump", "cmu_05_11_pirouette_daz",
                     "cmu_09_01_run", "cmu_12_01_walk")
    ),
    "cmu_10_03_soccer_kick",
]  # fmt: skip
WORN = [
    pytest.param(name, marks=SLOW) if name in ("idle", "jump", "kick", "run") else name for name in motions.clip_names()
]
SHIPPED = [name if name == "jump" else pytest.param(name, marks=SLOW) for name in motions.clip_names()]


class Recording:
    """What a viewer finds in a recording, read back from the file."""

    def __init__(self, path: Path):
        import rerun as rr

        self._reader = rr.chunk.RrdReader(path)

    def column(self, entity: str, name: str) -> np.ndarray:
        """All values of a component, in the order of their frames; static ones come alone."""
        frames, values = [], []
        for chunk in self._reader.stream().filter(content=entity):
            batch = chunk.to_record_batch()
            if name not in batch.schema.names:
                continue
            frames.append(
                batch.column("frame").to_numpy() if "frame" in batch.schema.names else np.zeros(batch.num_rows)
            )
            column = batch.column(name)
            assert len(column.value_lengths().unique()) == 1
            flat, shape = column.flatten(), [batch.num_rows, -1]
            if hasattr(flat.type, "list_size"):
                shape.append(flat.type.list_size)
                flat = flat.flatten()
            values.append(flat.to_numpy().reshape(shape))
        return np.concatenate(values)[np.argsort(np.concatenate(frames))]


BACK = ("--garment", "back_cape")


def replay(forks: Forks, clip: str | Path, folder: Path, *options: str) -> tuple[dict, Recording]:
    done = forks("replay", clip, "-o", "take.rrd", "--json", *options, folder=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), Recording(folder / "take.rrd")


def deepest_penetration(recording: Recording, vertices: np.ndarray, counted: np.ndarray) -> float:
    """Depth of the counted vertices in the recorded hitboxes [m], from the file alone and in double precision."""
    lengths, radii, starts, turns = (
        recording.column("/world/hitboxes", f"Capsules3D:{name}").astype(float)
        for name in ("lengths", "radii", "translations", "quaternions")
    )
    axes = quaternions.rotate(np.roll(turns, 1, axis=-1), np.broadcast_to([0.0, 0.0, 1.0], starts.shape))
    offsets = np.vecdot(starts, axes)
    worst = 0.0
    for points, start, axis, offset in zip(vertices[:, counted], starts, axes, offsets, strict=True):
        projected = points @ axis.T
        along = np.clip(projected - offset, 0.0, lengths[0])
        # |p - q|^2 of each vertex and the point of each capsule's axis that is nearest to it, start + along * axis.
        squares = np.vecdot(points, points)[:, None] - 2.0 * (points @ start.T + along * projected)
        squares += np.vecdot(start, start) + along * (2.0 * offset + along * np.vecdot(axis, axis))
        worst = max(worst, (radii[0] - np.sqrt(squares.min(axis=0))).max())
    return worst


def check(clip: str | Path, facts: dict, recording: Recording) -> None:
    """Hold a clip to what every replay of a cape must reach that hangs behind the back."""
    assert facts["result"] == "finished"
    assert facts["warnings"] == []
    assert facts["stretch_max"] <= 0.10
    assert facts["stretch_p99"] <= 0.03
    assert facts["penetration_max_mm"] <= 5.0

    vertices = recording.column("/world/cape", "Mesh3D:vertex_positions").astype(float)
    assert vertices.shape == (facts["frames"], facts["vertices"], 3)
    assert np.isfinite(vertices).all()

    read = motions.load(clip)
    body = Skeleton.from_clip(read)
    scene = dress(body, body.track(read), garment="back_cape")
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
def test_real_motion_wears_its_cape(name, mocap, tmp_path, forks):
    clip = mocap / f"{name}.bvh"
    check(clip, *replay(forks, clip, tmp_path, *BACK))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_clips_wear_their_cape(name: str, tmp_path: Path, forks: Forks):
    check(name, *replay(forks, name, tmp_path, *BACK))


@pytest.mark.parametrize("name", WORN)
def test_a_cape_lies_on_the_shoulders_in_shipped_clips(name: str, tmp_path: Path, forks: Forks):
    """What is worn by default."""
    facts, recording = replay(forks, name, tmp_path)
    assert facts["result"] in ("finished", "finished with warnings")
    assert facts["penetration_max_mm"] <= 1.0
    assert facts["collar_gap_p95_mm"] <= 40.0
    assert 0.2 < facts["hem_m"] < 0.5
    assert np.isfinite(recording.column("/world/cape", "Mesh3D:vertex_positions")).all()
    assert facts["shoulders_covered"] >= 0.95  # also where raised arms push cloth up
    if name in ("walk", "idle"):  # the others set out at speed
        assert facts["folds"] >= 5
        assert facts["stretch_max"] <= 0.04
        assert facts["stretch_p99"] <= 0.01


@pytest.mark.extra
def test_xpbd_replays_too(tmp_path, forks):
    facts, _ = replay(forks, "walk", tmp_path, "--end", "1.5", "--solver", "xpbd", *BACK)
    assert facts["result"] == "finished"
    assert facts["penetration_max_mm"] <= 5.0


def test_wind_blows_the_cape_its_way(tmp_path: Path, forks: Forks):
    # In the lee of the body, from in front of which it comes, there is less of it,
    # behind the trunk but not where the cape is wider.
    (tmp_path / "mast.csv").write_text("0,-6,0,0\n9,-6,0,0\n")
    coarse = ("--spacing", "0.06")
    winds = ((), ("--wind", "-6", "0", "0"), ("--wind-file", "mast.csv", "--shelter"))
    ends = []
    for wind in winds:
        facts, recording = replay(forks, "idle", tmp_path, "--end", "1", *wind, *BACK, *coarse)
        assert facts["result"] == "finished"
        places = recording.column("/world/cape", "Mesh3D:vertex_positions")[facts["frames"] - 1]
        ends.append(float(places[:, 0].mean()))
    calm, blown, sheltered = ends
    assert blown - calm < -0.05
    assert blown - calm < 1.1 * (sheltered - calm) < 0.0
