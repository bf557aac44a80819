"""A character's own mesh in a live run: drawn frame by frame, and kept."""

import time
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

import cape
import motions
import skeleton
from cape.live.feed.mailbox import LiveFrame, Mailbox
from cape.live.live import Live
from cape.record.frames import send_once
from cape.record.moments import MomentRecording, Shown
from motions.errors import UnknownNameError
from skeleton.track import BoneTrack
from tests.characters.builder import body, character
from tests.characters.test_morphs import KEYS, by_lines, face

LONG = 60.0  # s that something may take on a machine that is busy


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> tuple[cape.Scene, BoneTrack]:
    """A character of its own mesh that walks, with a sheet on its chest."""
    clip = motions.load(character(tmp_path_factory.mktemp("hero") / "hero.glb", body(), frames=8))
    track = skeleton.Skeleton.from_clip(clip).track(clip)
    sheet = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1)
    return cape.Scene(sheet, [cape.attach(sheet, track.names[-1], "top")]), track


def sent_by(shown: Shown, moments: list[BoneTrack], path: Path) -> dict[str, list]:
    """What goes to the path of the first piece of a skin for motions of one frame, column by column."""
    stream = rr.RecordingStream(f"cape live {shown.name}")
    stream.save(path)
    recording = MomentRecording(stream)
    recording.begin(shown, moments[0])
    for number, moment in enumerate(moments):
        recording.add(number, moment, shown.cloth.positions.astype(np.float32))
    stream.flush()
    stream.disconnect()
    assert shown.skin is not None
    piece = shown.skin.pieces[0]
    found: dict[str, list] = {"frame": []}
    for chunk in rr.chunk.RrdReader(path).stream().filter(content=f"/world/body/{piece.name}"):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name == "frame" or name.startswith("Mesh3D:"):
                found.setdefault(name.removeprefix("Mesh3D:"), []).extend(batch.column(name).to_pylist())
    return found


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
    moments = [shown.track(track.times[k], track.positions[k], track.rotations_wxyz[k]) for k in range(3)]
    sent = sent_by(shown, moments, tmp_path / "hero.rrd")
    assert len(sent["triangle_indices"]) == len(once) == 1
    assert sorted(sent["frame"]) == [0, 1, 2]
    (piece,) = track.skin.pieces
    for number, vertices in zip(sent["frame"], sent["vertex_positions"], strict=True):
        (expected,) = track.skin.posed(
            piece,
            track.positions[[number]][:, [track.index(bone) for bone in track.skin.bones]],
            track.rotations_wxyz[[number]][:, [track.index(bone) for bone in track.skin.bones]],
        )
        np.testing.assert_allclose(np.array(vertices), expected[0], atol=1e-6)


def test_morphs_are_drawn_as_they_are_told(tmp_path: Path):
    clip = motions.load(face(tmp_path / "face.glb", weights=(KEYS, by_lines(KEYS), "LINEAR")), unit="m")
    track = skeleton.Skeleton.from_clip(clip).track(clip)
    assert track.skin is not None
    assert track.morphs is not None
    sheet = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1)
    shown = Shown("face", sheet, (), 0.01, track.names, skin=track.skin)
    moving = int(np.abs(track.morphs - track.morphs[0]).sum(axis=1).argmax())
    box = Mailbox.create(tmp_path / "frames", sheet.vertices, len(track.names), track.morphs.shape[1])
    places = sheet.positions.astype(np.float32)
    box.put(LiveFrame(0, 0.0, 0, places, track.positions[moving], track.rotations_wxyz[moving], track.morphs[moving]))
    frame = Mailbox.open(tmp_path / "frames").take()
    assert frame is not None
    told = shown.track(frame.time, frame.bone_positions, frame.rotations_wxyz, frame.morphs)
    np.testing.assert_array_equal(told.morphs, track.morphs[[moving]])
    plain = shown.track(frame.time, frame.bone_positions, frame.rotations_wxyz)
    assert plain.morphs is None
    drawn = [
        sent_by(shown, [moment], tmp_path / f"{k}.rrd")["vertex_positions"] for k, moment in enumerate((told, plain))
    ]
    at = [track.index(bone) for bone in track.skin.bones]
    piece = track.skin.pieces[0]
    (expected,) = track.skin.posed(
        piece, track.positions[[moving]][:, at], track.rotations_wxyz[[moving]][:, at], morphs=track.morphs[[moving]]
    )
    np.testing.assert_allclose(np.array(drawn[0][0]), expected[0], atol=1e-6)
    assert np.abs(np.array(drawn[0]) - np.array(drawn[1])).max() > 1e-3


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
