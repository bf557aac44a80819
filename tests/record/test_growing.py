"""Recordings that are written while a cloth is simulated: the same as those written at the end, as far as they fit."""

import os
import re
import resource
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr

import cape
import motions
from cape.meshes.embedding import embedded
from cape.record import save
from cape.record.files.sink import Sink
from cape.record.growing import growing_file
from cape.results.so_far import StopRun
from cape.scene.standard_scenes import StandardScene
from cape.scene.tearing_scenes import torn
from skeleton.track import BoneTrack
from tests.support.command import CAPE, Forks
from tests.support.takes import cloth_frames

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


@pytest.fixture(scope="module")
def tearing() -> StandardScene:
    """A sheet that is whole at first, and is then torn by a ball."""
    return torn(spacing=0.1, seconds=0.6)


@pytest.mark.parametrize("together", [1, 7, 1000])
def test_so_it_does_of_what_tears(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tearing: StandardScene, together: int
):
    scene, track = tearing.scene, tearing.track
    monkeypatch.setattr("cape.record.growing.BYTES_PER_CHUNK", 24 * scene.cloth.vertices * together)
    with growing_file(tmp_path / "grown.rrd", scene, track, name="take") as file:
        take = cape.simulate(scene, track, on_frame=file.note)
        file.finish(take)
    save(take, tmp_path / "saved.rrd")
    found = rows(tmp_path / "grown.rrd")
    assert found == rows(tmp_path / "saved.rrd")
    # Each frame has the vertices that there are by then, and each change what belongs to all of them.
    last = len(take.positions) - 1
    counts = {frame: len(row) for (frame, _), row in found["/world/cape", "Mesh3D:vertex_positions"].items()}
    shapes = found["/world/cape", "Mesh3D:vertex_texcoords"]
    assert {frame: len(row) for (frame, _), row in shapes.items()} == {
        topology.frame: counts[topology.frame] for topology in take.topologies
    }
    assert len(take.topologies) > 2
    assert (counts[0], counts[last]) == (scene.cloth.vertices, take.positions.shape[1])
    assert counts[0] < counts[last]


def test_a_finer_mesh_is_drawn_until_it_tears(tmp_path: Path):
    """Its triangles would span the tear."""
    points, corners = SHEET.positions, SHEET.triangles
    apart = np.arange(3 * len(corners)).reshape(-1, 3)
    cloth = replace(SHEET, visual=embedded(points[corners].reshape(-1, 3), apart, None, points, corners))
    scene = replace(hung(tearing=cape.Tearing(force=0.05)), cloth=cloth)
    take = cape.simulate(scene, moved(), settle=0.0)
    save(take, tmp_path / "saved.rrd", layers="cape")
    found = rows(tmp_path / "saved.rrd")["/world/cape", "Mesh3D:vertex_positions"]
    counts = [len(found[key]) for key in sorted(found)]
    first = take.topologies[1].frame
    assert first > 0
    assert counts[:first] == [3 * len(corners)] * first
    assert counts[first] == len(take.topologies[1].parents)


@pytest.mark.parametrize("together", [7, 1000])
def test_a_loop_is_written_when_its_frames_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, together: int):
    monkeypatch.setattr("cape.record.growing.BYTES_PER_CHUNK", 24 * SHEET.vertices * together)
    monkeypatch.setattr("cape.run.looping.MOST_ROUNDS", 2)
    scene, track = hung(), moved()
    take = cape.simulate(scene, track, loop=True)
    with growing_file(tmp_path / "grown.rrd", scene, track, name="take") as file:
        file.finish(take)
    save(take, tmp_path / "saved.rrd")
    assert rows(tmp_path / "grown.rrd") == rows(tmp_path / "saved.rrd")


@pytest.mark.parametrize("slowly", [False, True])
def test_frames_are_on_the_disk_before_the_run_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, slowly: bool):
    def late(sink: Sink, some: bytes):
        time.sleep(0.01)
        keep(sink, some)

    keep = Sink._keep
    if slowly:
        monkeypatch.setattr(Sink, "_keep", late)
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


def test_as_many_frames_are_written_as_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Room for the half of thirty frames, which are handed over together."""
    scene, track = hung(), moved()
    with growing_file(tmp_path / "grown.rrd", scene, track, name="take", layers="cape") as file:
        take = cape.simulate(scene, track)
        free = file._needed(take, 16)
        monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free))
        file.finish(take)
    assert file.full == f"{free / 1e6:.3g} MB are free, too little for more than 15 frames"
    assert len(rows(tmp_path / "grown.rrd")["/world/cape", "Mesh3D:vertex_positions"]) == 15


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


@pytest.mark.few("15-sheet", "15-torn")
@pytest.mark.parametrize("scene", ["sheet", "torn"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_command_that_is_told_to_end_keeps_what_is_done(tmp_path: Path, number: signal.Signals, scene: str):
    process = subprocess.Popen(
        [CAPE, "replay", "--scene", scene, "--fps", "1000", "-o", "part.rrd"],
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
    assert cloth_frames(tmp_path / "part.rrd") > 1


INTERRUPTED = """
import os, signal, sys
from cape.cli import main
from cape.record.growing import GrowingFile
from cape.run.looping import Laps

def raises(owner, name, when):
    before = getattr(owner, name)
    def after(*given):
        result = before(*given)
        if when(*given):
            os.kill(os.getpid(), signal.SIGINT)
        return result
    setattr(owner, name, after)

where = sys.argv.pop(1)
if where == "in the second round":
    raises(Laps, "_tell", lambda laps, progress, rounds, done: rounds == 2 and done == 5)
else:
    raises(GrowingFile, "_write", lambda file, part: True)
main()
"""
LOOP = ("replay", "walk", "--loop", "--end", "0.5", "--garment", "back_cape", "--spacing", "0.1", "-o", "loop.rrd")
LOOP_FRAMES = 1 + round(0.5 * motions.load("walk").fps)


@pytest.mark.parametrize("where", ["in the second round", "while it is written"])
def test_ctrl_c_leaves_a_loop_as_far_as_it_was_done(tmp_path: Path, where: str, forks: Forks):
    done = forks.script(INTERRUPTED, where, *LOOP, folder=tmp_path)
    assert done.returncode == 130, done.stderr
    assert done.stderr.splitlines()[-1] == "cape: interrupted"
    assert [path.name for path in tmp_path.iterdir()] == ["loop.rrd"]
    assert cloth_frames(tmp_path / "loop.rrd") == LOOP_FRAMES


def test_a_full_disk_leaves_of_a_loop_what_fits(tmp_path: Path):
    limit = 4_220_000
    done = subprocess.run(
        [CAPE, *LOOP],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    frames = cloth_frames(tmp_path / "loop.rrd")
    told = rf"cape: can't write all of loop.rrd: 4\.\d+ MB are free, too little for more than {frames} frames"
    assert re.fullmatch(told, done.stderr.splitlines()[-1])
    assert 0 < frames < LOOP_FRAMES
