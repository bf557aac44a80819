"""Recordings that are written while a cloth is simulated: the same as those written at the end, as far as they fit."""

import os
import signal
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr

import cape
from cape.record import save
from cape.record.growing import growing_file
from cape.results.so_far import StopRun
from skeleton.track import BoneTrack
from tests.support.command import CAPE

FRAMES = 30
SHEET = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1, fabric=cape.Fabric(stretch=100.0, shear=20.0))


def hung(**what) -> cape.Scene:
    ball = cape.Sphere(name="ball", bone=None, center=np.array([0.08, -0.2, -0.2]), radius=0.1)
    return cape.Scene(SHEET, [cape.attach(SHEET, "rod", "top")], colliders=[ball], **what)


def moved() -> BoneTrack:
    places = np.zeros((FRAMES, 1, 3))
    places[:, 0, 0] = 0.1 * np.sin(0.3 * np.arange(FRAMES))
    return BoneTrack(("rod",), np.arange(FRAMES) / 60, places, np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 1, 1)))


def rows(path: Path) -> dict[tuple[str, str], dict]:
    """What is in a recording, by entity and component, and then by frame and time; None for what always holds."""
    found: dict[tuple[str, str], dict] = {}
    for chunk in rr.chunk.RrdReader(path).stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if chunk.entity_path.startswith("/__") or name in ("frame", "time") or "RowId" in name:
                continue
            kept = found.setdefault((chunk.entity_path, name), {})
            if chunk.is_static:
                kept[None] = batch.column(name)[0].as_py()
            else:
                stamps = zip(batch.column("frame"), batch.column("time"), strict=True)
                kept |= {(a.as_py(), b.value): v.as_py() for (a, b), v in zip(stamps, batch.column(name), strict=True)}
    return found


@pytest.mark.parametrize("together", [1, 7, 1000])
def test_it_holds_what_is_written_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, together: int):
    monkeypatch.setattr("cape.record.growing.BYTES_PER_CHUNK", 24 * SHEET.vertices * together)
    scene, track = hung(), moved()
    with growing_file(tmp_path / "grown.rrd", scene, track, name="take") as file:
        take = cape.simulate(scene, track, on_frame=file.note)
        file.finish(take)
    save(take, tmp_path / "saved.rrd")
    assert take.contacts is not None
    assert len(take.contacts.points)
    assert rows(tmp_path / "grown.rrd") == rows(tmp_path / "saved.rrd")


def test_frames_are_on_the_disk_before_the_run_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cape.record.growing.BYTES_PER_CHUNK", 24 * SHEET.vertices * 5)
    scene, track = hung(), moved()
    seen = []

    def note(done, so_far):
        file.note(done, so_far)
        seen.append(file._file.room and next(tmp_path.iterdir()).stat().st_size)

    with growing_file(tmp_path / "grown.rrd", scene, track, name="take") as file:
        file.finish(cape.simulate(scene, track, on_frame=note))
    grown = np.flatnonzero(np.diff(seen)) + 2
    assert grown.tolist() == [5, 10, 15, 20, 25, 30]


def test_part_of_a_run_is_a_take_of_these_frames():
    scene, track, parts = hung(), moved(), {}

    def note(done, so_far):
        if done % 10 == 0:
            parts[done] = so_far(done - 10)

    whole = cape.simulate(scene, track, on_frame=note)
    assert list(parts) == [10, 20, 30]
    for name in ("positions", "stretch_max", "penetration", "penetrated", "kinetic_energy"):
        joined = np.concatenate([getattr(part, name) for part in parts.values()])
        np.testing.assert_array_equal(joined, getattr(whole, name))
    np.testing.assert_array_equal(np.concatenate([part.bones.times for part in parts.values()]), whole.bones.times)
    assert whole.contacts is not None
    counts = [part.contacts.counts for part in parts.values()]
    np.testing.assert_array_equal(np.concatenate(counts), whole.contacts.counts)


def test_what_there_is_no_room_for_is_left_out_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The disk fills up when twelve frames are done; five and five are in the recording by then."""
    monkeypatch.setattr("cape.record.growing.BYTES_PER_CHUNK", 24 * SHEET.vertices * 5)
    scene, track, free = hung(), moved(), [10**9]
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free[0]))

    def note(done, so_far):
        if done == 12:
            free[0] = 4_000_000
        file.note(done, so_far)

    with growing_file(tmp_path / "grown.rrd", scene, track, name="take") as file:
        take = cape.simulate(scene, track, on_frame=note)
        file.finish(take)
    assert take.result == "stopped at frame 15"
    assert file.full == take.warnings[0] == "4 MB are free, too little for more than 10 frames"
    found = rows(tmp_path / "grown.rrd")
    for column in [("/world/cape", "Mesh3D:vertex_positions"), ("/world/character", "Transform3D:translation")]:
        assert len(found[column]) == 10


def test_a_file_that_takes_no_more_is_an_error_and_no_wait(tmp_path: Path):
    """What Rerun's own writer meets with silence, and whoever flushes it then with a wait without end."""
    script = """
import resource, sys, numpy as np
import rerun as rr, rerun.blueprint as rrb
from cape.record.files.recording import recording_file
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, -1))
with recording_file(sys.argv[1], name="n", opening=lambda: ("a", rrb.Blueprint()), size=0) as file:
    for k in range(20):
        file.stream.log("a", rr.Points3D(np.random.default_rng(k).random((9000, 3))))
        file.stream.flush()
"""
    command = [CAPE.with_name("python"), "-c", script, str(tmp_path / "a.rrd")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr.splitlines()[-1].endswith(f"can't write {tmp_path / 'a.rrd'}: File too large")
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_stopped_says_why():
    def note(done, so_far):
        if done == 4:
            raise StopRun("enough")

    take = cape.simulate(hung(), moved(), on_frame=note)
    assert (take.result, take.warnings[0], len(take.positions)) == ("stopped at frame 4", "enough", 4)


@pytest.mark.few("15")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_command_that_is_told_to_end_keeps_what_is_done(tmp_path: Path, number: signal.Signals):
    process = subprocess.Popen(
        [CAPE, "replay", "--scene", "sheet", "--fps", "1000", "-o", "part.rrd"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    until = time.monotonic() + 120.0
    while not any(path.stat().st_size > 9_000_000 for path in tmp_path.iterdir()) and process.poll() is None:
        assert time.monotonic() < until
        time.sleep(0.05)
    process.send_signal(number)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 128 + number, told
    assert [path.name for path in tmp_path.iterdir()] == ["part.rrd"]
    chunks = rr.chunk.RrdReader(tmp_path / "part.rrd").stream().filter(content="/world/cape")
    frames = [chunk.num_rows for chunk in chunks if "Mesh3D:vertex_positions" in chunk.to_record_batch().schema.names]
    assert sum(frames) > 1
