"""What the viewer calls for each file that it opens: which files it takes, and what it writes to standard output."""

import os
import shutil
import subprocess
import sys
from itertools import chain
from pathlib import Path

import pytest
import rerun as rr

import cape.importer.entry as entry
import motions
from tests.support.processes import ROOT

SCRIPT = Path(entry.__file__).with_name("rerun-importer-cape")
COMMAND = [sys.executable, SCRIPT]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    path = tmp_path / "stroll.bvh"
    motions.save(motions.load("walk").trim(0.0, 0.4), path)
    return path


def imported(path: Path, *options: str) -> tuple[int, Path, str]:
    """The status, the recording and the errors of an import."""
    out = path.with_suffix(".rrd")
    with out.open("wb") as file:
        done = subprocess.run(
            [*COMMAND, path, *options], stdout=file, stderr=subprocess.PIPE, env=ENVIRONMENT, text=True, timeout=300
        )
    return done.returncode, out, done.stderr


def notes(recording: Path) -> list[str]:
    chunks = rr.chunk.RrdReader(recording).stream().filter(content="/notes")
    return [text for c in chunks for row in c.to_record_batch()["TextLog:text"].to_pylist() for text in row]


def frames_of_cape(recording: Path) -> list[list[int]]:
    """The frames of each chunk, in the order of the file."""
    batches = [c.to_record_batch() for c in rr.chunk.RrdReader(recording).stream().filter(content="/world/cape")]
    return [batch["frame"].to_pylist() for batch in batches if "frame" in batch.schema.names]


@pytest.mark.parametrize(
    ("name", "text"),
    [("walk.txt", "HIERARCHY"), ("walk.bvh", "not one"), ("lone.urdf", "<robot name='r'/>"), ("page.urdf", "<html/>")],
)
def test_foreign_files_are_passed_on_before_any_import(tmp_path: Path, name: str, text: str):
    (tmp_path / name).write_text(text)
    (tmp_path / "page.csv").write_text("1,2")
    code = (
        "import atexit, runpy, sys\n"
        "atexit.register(lambda: print({'numpy', 'cape'} & set(sys.modules)))\n"
        "sys.argv = sys.argv[1:]\n"
        "runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, SCRIPT, tmp_path / name], capture_output=True, text=True, env=ENVIRONMENT
    )
    assert (done.returncode, done.stdout.strip()) == (rr.EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE, "set()")


def test_a_file_that_is_gone_or_a_robot_with_a_motion(tmp_path: Path):
    assert entry.motion_of(str(tmp_path / "none.bvh")) is None
    (tmp_path / "r.urdf").write_text("<?xml version='1.0'?><robot name='r'/>")
    (tmp_path / "r.npz").touch()
    assert entry.motion_of(str(tmp_path / "r.urdf")) == str(tmp_path / "r.npz")
    assert entry.motion_of(str(tmp_path / "r.npz")) == str(tmp_path / "r.npz")
    (tmp_path / "lone.npz").touch()
    assert entry.motion_of(str(tmp_path / "lone.npz")) is None


def test_frames_of_the_cape_come_one_after_the_other_under_the_ids_that_were_asked_for(walk: Path):
    options = "--application-id app --recording-id rec --entity-path-prefix far --time_sequence t=1 --unheard-of 3"
    status, recording, errors = imported(walk, *options.split())
    assert status == 0, errors
    reader = rr.chunk.RrdReader(recording)
    entry = reader.recordings()[0]
    assert (entry.application_id, entry.recording_id) == ("app", "rec")
    frames = frames_of_cape(recording)
    assert frames[0] == [0]  # sent before another is computed
    assert len(frames) > 2
    assert list(chain(*frames)) == list(range(motions.load(walk).frames))
    paths = {c.entity_path for c in reader.stream()}
    assert {"/world/hitboxes", "/world/skeleton", "/world/floor", "/plots/stretch", "/notes"} <= paths
    assert any("--entity-path-prefix far" in note for note in notes(recording))


def test_a_mistake_in_the_file_is_a_note_and_told_where_the_viewer_looks(tmp_path: Path):
    path = tmp_path / "broken.bvh"
    path.write_text("HIERARCHY nonsense")
    status, recording, errors = imported(path)
    assert status == 2
    assert errors.startswith("cape: ")
    assert "nonsense" in errors
    assert len(notes(recording)) == 1
    assert "nonsense" in notes(recording)[0]


def test_a_viewer_that_is_closed_ends_the_import(walk: Path):
    with subprocess.Popen([*COMMAND, walk], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        process.stdout.read(1)
        process.stdout.close()
        assert process.wait(timeout=120) == 0
        assert process.stderr is not None
        assert b"Traceback" not in process.stderr.read()


@pytest.mark.extra
def test_the_viewer_itself(walk: Path, tmp_path: Path):
    folder = tmp_path / "bin"
    folder.mkdir()
    script = folder / "rerun-importer-cape"
    script.write_text(f'#!/bin/sh\nexec {sys.executable} {entry.__file__} "$@"\n')
    script.chmod(0o755)
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    assert rerun is not None
    saved = tmp_path / "saved.rrd"
    path = f"{folder}:{Path(sys.executable).parent}:/usr/bin:/bin"
    run = [rerun, walk, "--save", saved, "--bind", "127.0.0.1", "--port", "0"]
    subprocess.run(run, env={**ENVIRONMENT, "PATH": path}, check=True, timeout=300)
    assert sorted(chain(*frames_of_cape(saved))) == list(range(motions.load(walk).frames))
