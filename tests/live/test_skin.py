"""A character's own mesh in a live run: drawn frame by frame, and kept."""

import time
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

import cape
import motions
import skeleton
from cape.live.live import Live
from cape.record.frames import send_once
from cape.record.moments import MomentRecording, Shown
from motions.errors import UnknownNameError
from skeleton.track import BoneTrack
from tests.characters.builder import body, character

LONG = 60.0  # s that something may take on a machine that is busy


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> tuple[cape.Scene, BoneTrack]:
    """A character of its own mesh that walks, with a sheet on its chest."""
    clip = motions.load(character(tmp_path_factory.mktemp("hero") / "hero.glb", body(), frames=8))
    track = skeleton.Skeleton.from_clip(clip).track(clip)
    sheet = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1)
    return cape.Scene(sheet, [cape.attach(sheet, track.names[-1], "top")]), track


def test_the_mesh_is_sent_with_every_frame_and_all_else_of_it_once(
    walker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    scene, track = walker
    once: list[str] = []

    def counted(stream: rr.RecordingStream, path: str, archetype: rr.AsComponents) -> None:
        once.append(path)
        send_once(stream, path, archetype)

    monkeypatch.setattr("cape.record.figure.skin.send_once", counted)
    shown = Shown("hero", scene.cloth, (), 0.01, track.names, None, dict(track.roles), skin=track.skin)
    stream = rr.RecordingStream("cape live hero")
    stream.save(tmp_path / "hero.rrd")
    recording = MomentRecording(stream)
    moments = [shown.track(track.times[k], track.positions[k], track.rotations_wxyz[k]) for k in range(3)]
    recording.begin(shown, moments[0])
    for number, moment in enumerate(moments):
        recording.add(number, moment, scene.cloth.positions.astype(np.float32))
    stream.flush()
    stream.disconnect()
    (piece,) = track.skin.pieces
    frames, drawn, laid_out = [], [], 0
    for chunk in rr.chunk.RrdReader(tmp_path / "hero.rrd").stream().filter(content=f"/world/body/{piece.name}"):
        batch = chunk.to_record_batch()
        laid_out += "Mesh3D:triangle_indices" in batch.schema.names
        if "Mesh3D:vertex_positions" in batch.schema.names:
            frames += batch.column("frame").to_pylist()
            drawn += batch.column("Mesh3D:vertex_positions").to_pylist()
    assert laid_out == len(once) == 1
    assert sorted(frames) == [0, 1, 2]
    for number, vertices in zip(frames, drawn, strict=True):
        (expected,) = track.skin.posed(
            piece,
            track.positions[[number]][:, [track.index(bone) for bone in track.skin.bones]],
            track.rotations_wxyz[[number]][:, [track.index(bone) for bone in track.skin.bones]],
        )
        np.testing.assert_allclose(np.array(vertices), expected[0], atol=1e-6)


def test_what_is_kept_has_the_mesh(walker):
    scene, track = walker
    with Live(scene, track, viewer="none", keep=True) as run:
        end = time.monotonic() + LONG
        while run.status.frame < 3 and time.monotonic() < end:
            time.sleep(0.005)
    assert run.take().bones.skin is track.skin


def test_bones_that_the_mesh_lacks_are_told_at_once(walker):
    scene, track = walker
    with pytest.raises(UnknownNameError, match="The skin hangs at it"):
        Live(scene, lambda _: {track.names[-1]: (np.zeros(3), (1.0, 0.0, 0.0, 0.0))}, viewer="none", skin=track.skin)
