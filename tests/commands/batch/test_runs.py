"""Batches through the installed command: killed, interrupted, taken up again, and told in a table and on a page."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import motions
from cape.results.take import Take
from tests.support.command import CAPE, Forks, cape

COARSE = ("--end", "0.1", "--spacing", "0.1", "--no-pictures")
HOPELESS = 120.0  # s


def runs_of(batch: int) -> list[int]:
    """Processes that a process has begun and that are not gone."""
    threads = Path(f"/proc/{batch}/task")
    return [int(child) for thread in threads.iterdir() for child in (thread / "children").read_text().split()]


def state(process: int) -> str:
    """What the system says of a process: "T" where it is stopped, "Z" where it has ended, nothing where it is gone."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return ""


def kill_one(batch: int) -> bool:
    """Kill a process that a batch has begun and that has not ended; whether there was one.

    One that has ended is still told among its children until it has been waited for, and so is one that dies of an
    earlier signal: neither dies of this one. What has come to a stop is alive, and does.
    """
    for process in runs_of(batch):
        try:
            os.kill(process, signal.SIGSTOP)
            while (now := state(process)) not in ("T", "Z", "X", ""):
                time.sleep(0.001)
            if now == "T":
                os.kill(process, signal.SIGKILL)
                return True
        except ProcessLookupError:
            continue
    return False


def begin(*arguments: str, folder: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [CAPE, "batch", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that starts tests in the background has it ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def results(folder: Path) -> dict:
    return json.loads((folder / "out" / "results.json").read_text())


def test_a_batch_outlives_what_is_killed_and_goes_on_where_it_was_interrupted(tmp_path: Path):
    (tmp_path / "clips").mkdir()
    for name in ("idle", "walk"):
        (tmp_path / "clips" / f"{name}.bvh").write_bytes(motions.clip_path(name).read_bytes())
    (tmp_path / "torn.bvh").write_text("HIERARCHY\nROOT hips\n")
    asked = ("clips", "torn.bvh", "-o", "out", "--jobs", "1", *COARSE)
    batch = begin(*asked, folder=tmp_path)
    until = time.monotonic() + HOPELESS
    while not (first := runs_of(batch.pid)) and time.monotonic() < until:
        time.sleep(0.02)
    os.kill(first[0], signal.SIGKILL)
    assert batch.stderr is not None
    assert batch.stderr.readline().startswith("1 of 3: idle, finished, ")
    batch.send_signal(signal.SIGINT)
    table, rest = batch.communicate(timeout=HOPELESS)
    assert batch.returncode == 130
    assert rest == "cape: interrupted\n"
    assert "1 of 3" in table
    found = results(tmp_path)
    assert [run["status"] for run in found["runs"]] == ["done", "stopped", "stopped"]
    assert found["runs"][0]["attempts"] == 2
    kept = (tmp_path / "out" / "idle" / "idle.rrd").stat()
    assert not list((tmp_path / "out").rglob("*.part*"))

    done = cape("batch", *asked, "--json", folder=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("1 of 3 stand complete already\n1 of 2: walk, finished")
    found = json.loads(done.stdout)
    assert found == results(tmp_path)
    assert (found["done"], found["failed"], found["stopped"]) == (2, 1, 0)
    idle, walk, torn = found["runs"]
    assert (idle["attempts"], walk["attempts"]) == (0, 1)
    assert (tmp_path / "out" / "idle" / "idle.rrd").stat() == kept
    assert (tmp_path / "out" / walk["output"]).stat().st_size > 10_000
    assert walk["facts"]["frames"] == 7
    assert "torn.bvh" in torn["error"]
    page = (tmp_path / "out" / "index.html").read_text()
    assert "2 of 3 runs are done, 1 failed" in page
    assert 'href="walk/walk.rrd"' in page
    assert torn["error"].split(":")[0] in page


def test_a_run_is_the_same_as_a_replay_of_the_same_options(tmp_path: Path, forks: Forks):
    """The same bits: a batch adds nothing and leaves nothing out, and what is swept comes on top."""
    options = ("--end", "0.1", "--wind", "-3", "0", "0")
    swept = cape("batch", "walk", "-o", "out", "--format=npz", "--sweep", "spacing=0.1", *options, folder=tmp_path)
    assert swept.returncode == 0, swept.stderr
    alone = forks("replay", "walk", "-o", "alone.npz", "--spacing", "0.1", *options, folder=tmp_path)
    assert alone.returncode == 0, alone.stderr
    take = Take.load(tmp_path / "alone.npz")
    assert np.ptp(take.positions, axis=0).max() > 0.01
    same = Take.load(tmp_path / "out" / "walk_spacing=0.1" / "walk_spacing=0.1.npz")
    assert same.positions.tobytes() == take.positions.tobytes()


@pytest.mark.extra
def test_pictures_are_drawn_where_they_can_be_and_told_where_not(tmp_path: Path):
    asked = ("batch", "walk", "-o", "out", *COARSE[:-1])
    without = cape(*asked, folder=tmp_path, VK_DRIVER_FILES="/none", VK_ICD_FILENAMES="/none")
    assert without.returncode == 0, without.stderr
    assert "without pictures: " in results(tmp_path)["notes"][0]
    done = cape(*asked, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    if results(tmp_path)["notes"]:
        pytest.skip(results(tmp_path)["notes"][0])
    assert results(tmp_path)["runs"][0]["picture"] == "walk/picture.jpg"
    assert Image.open(tmp_path / "out" / "walk" / "picture.jpg").size == (720, 480)
    assert '<img src="walk/picture.jpg"' in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.extra
def test_a_hundred_clips_with_processes_killed_all_along(tmp_path: Path):
    (tmp_path / "clips").mkdir()
    for number in range(100):
        name = motions.clip_names()[number % len(motions.clip_names())]
        (tmp_path / "clips" / f"{number:02}.bvh").write_bytes(motions.clip_path(name).read_bytes())
    batch = begin("clips", "-o", "out", *COARSE, folder=tmp_path)
    assert batch.stderr is not None
    killed = 0
    for number, _line in enumerate(batch.stderr):
        if number % 5 == 0:
            killed += kill_one(batch.pid)
    batch.communicate(timeout=HOPELESS)
    assert batch.returncode == 0
    found = results(tmp_path)
    assert found["done"] == 100
    assert sum(run["attempts"] for run in found["runs"]) == 100 + killed
    assert killed > 15
