"""`cape live` in a terminal: keys that are answered in the next frames, and runs that end in order."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cape
import motions
import skeleton
from tests.support.command import CAPE, Done, Forks
from tests.support.machine.disks import small_disk
from tests.support.processes import mistake_told
from tests.support.takes import cloth_frames

if sys.platform == "win32":
    pytest.skip("needs a terminal of its own", allow_module_level=True)
else:
    from tests.support.machine.terminal import LONG, READY, answers, stamped, terminal

QUICK = ("--garment", "back_cape", "--spacing", "0.08", "--no-self-contact")


def test_a_key_is_answered_within_two_frames_of_the_recording(tmp_path: Path):
    """It stands still, is told to kick, and is then let go on frame by frame: the first of them kicks already."""
    with terminal("-o", "run.npz", *QUICK, folder=tmp_path) as run:
        run.wait_for(READY)
        run.press(" ")
        before = int(run.wait_for(r"frame (\d+) \| paused")[1])
        run.press("k......")
        run.wait_for(rf"frame {before + 6} \| paused")
        run.press("q")
        assert run.ended() == 0
    bones = cape.Take.load(tmp_path / "run.npz").bones
    clip = motions.load("idle")
    still = skeleton.Skeleton.from_clip(clip).track(clip)
    off = [np.abs(bones.positions[k] - still.positions[k]).max() for k in range(before + 7)]
    assert max(off[: before + 1]) < 1e-9
    assert min(off[before + 1 :]) > 0.0


def test_keys_are_answered_within_two_frames_while_it_runs(tmp_path: Path):
    """At five frames a second, so that a machine that is busy takes nothing for long: keys that turn who stands."""
    pressed = []
    with terminal("-o", "run.npz", "--fps", "5", *QUICK, folder=tmp_path, command=stamped()) as run:
        run.wait_for(READY)
        for _ in range(5):
            begun = run.reach(1)
            pressed.append(run.press("\x1b[D"))
            run.reach(begun + 4)
        run.press("q")
        assert run.ended() == 0
    found = answers(cape.Take.load(tmp_path / "run.npz"), tmp_path / "stamps", pressed)
    assert [frames for frames, _ in found] == pytest.approx([1] * 5, abs=1)


def test_keys_in_a_run_that_goes_on(tmp_path: Path):
    """From a key to the motion that answers it, measured at full speed: as many frames as told since the key."""
    with terminal("-o", "run.npz", *QUICK, folder=tmp_path) as run:
        run.wait_for(READY)
        run.press("?")
        run.wait_for("kick, once")
        run.press("w")
        run.wait_for(r"wind -3\.0 0\.0 0\.0 m/s")
        run.press("\x1b[A")
        run.press("x")
        run.wait_for("no key x")
        run.press("\x03")
        assert run.ended() == 0
    take = cape.Take.load(tmp_path / "run.npz")
    assert "recording" in run.said or "take of" in run.said
    walked = np.linalg.norm(take.bones.positions[-1, 0, :2] - take.bones.positions[0, 0, :2])
    assert walked > 0.001


@pytest.mark.parametrize(
    "way", ["SIGINT", "hang up", *(pytest.param(way, marks=pytest.mark.extra) for way in ("SIGTERM", "seconds"))]
)
def test_however_it_ends_what_was_recorded_is_complete(way: str, tmp_path: Path):
    limit = ["--seconds", "0.5"] if way == "seconds" else []
    with terminal("--scene", "sheet", "--spacing", "0.1", "-o", "run.rrd", "--json", *limit, folder=tmp_path) as run:
        run.wait_for(READY)
        run.wait_for(r"frame [1-9]\d* ")
        if way == "hang up":
            run.hang_up()
        elif way != "seconds":
            run.process.send_signal(getattr(signal, way))
        assert run.ended() == 0
    import rerun as rr

    chunks = rr.chunk.RrdReader(tmp_path / "run.rrd").store()
    facts = json.loads(run.printed)
    assert facts["frames"] > 0
    assert facts["output"] == "run.rrd"
    assert chunks is not None
    assert not list(tmp_path.glob(".*part*"))


def on_a_full_disk(forks: Forks, how: str, *, output: str, folder: Path, spacing: float = 0.1) -> Done:
    """Record a sheet for a second and a half, after some lines that have the disk fill up."""
    return forks.script(full_disk(how, output=output, spacing=spacing), folder=folder)


def full_disk(how: str, *, output: str, spacing: float) -> str:
    return (
        "import sys\n"
        "sys.dont_write_bytecode = True\n"
        f"{how}\n"
        "sys.argv = ['cape', 'live', '--no-viewer', '--scene', 'sheet', '--spacing',"
        f" '{spacing}', '--seconds', '1.5', '-o', '{output}', '--json']\n"
        "from cape.cli import main\n"
        "main()\n"
    )


EARLY = """
import collections, itertools, shutil
usage, asked = collections.namedtuple('usage', 'total used free'), itertools.count(1)
shutil.disk_usage = lambda path: usage(10**12, 10**12, 10**9 if next(asked) < 4 else 10**7)
"""
LATE = """
import resource
import cape.cli.live.command as command
write = command.write_what_fits
def limited(*arguments, **named):
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST, MOST))
    return write(*arguments, **named)
command.write_what_fits = limited
"""


def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path: Path, forks: Forks):
    """As though next to nothing were free: the run goes on, and what fits is written."""
    done = on_a_full_disk(forks, EARLY, output="run.npz", folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "recording stopped" in done.stderr
    kept, of = len(cape.Take.load(tmp_path / "run.npz").positions), json.loads(done.stdout)["frames"] + 1
    assert 2 <= kept < of
    told = f"cape: can't write all of run.npz: the disk was nearly full after {kept} of {of} frames"
    assert done.stderr.splitlines()[-1] == told


@pytest.mark.parametrize(("name", "most"), [("run.rrd", 4_150_000), ("run.npz", 60_000)])
def test_a_disk_that_is_full_when_it_is_written_leaves_what_fits(tmp_path: Path, name: str, most: int, forks: Forks):
    """A recording needs 4 MB besides its cloth."""
    done = on_a_full_disk(forks, LATE.replace("MOST", str(most)), output=name, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    path, of = tmp_path / name, json.loads(done.stdout)["frames"] + 1
    frames = cloth_frames(path) if path.suffix == ".rrd" else len(cape.Take.load(path).positions)
    assert 2 <= frames < of
    told = done.stderr.splitlines()[-1]
    assert told.startswith(f"cape: can't write all of {name}: ")
    assert f" {frames} " in told
    assert [each.name for each in tmp_path.iterdir()] == [name]


FILLED = """
import shutil
import cape.cli.live.command as command
write = command.write_what_fits
def crowded(*arguments, **named):
    with open('others', 'wb') as file:
        file.write(bytes(shutil.disk_usage('.').free - LEFT))
    return write(*arguments, **named)
command.write_what_fits = crowded
"""


def test_on_a_small_disk_as_much_is_recorded_as_fits(tmp_path: Path, forks: Forks):
    """Of 1 MB, on which a sheet of 441 vertices has room for some dozens of frames."""
    with small_disk(tmp_path / "disk", 1_000_000) as folder:
        done = on_a_full_disk(forks, "", output="run.npz", folder=folder, spacing=0.05)
        assert done.returncode == 2, done.stderr
        kept, of = len(cape.Take.load(folder / "run.npz").positions), json.loads(done.stdout)["frames"] + 1
        assert 20 <= kept < of
        assert done.stderr.splitlines()[-1].endswith(f"the disk was nearly full after {kept} of {of} frames")


@pytest.mark.parametrize(("name", "left"), [("run.npz", 60_000), ("run.rrd", 4_250_000)])
def test_a_disk_that_others_fill_while_it_runs_leaves_what_fits(tmp_path: Path, name: str, left: int, forks: Forks):
    """The disk itself tells that it is full, which nothing has foreseen; a recording needs 4 MB besides its cloth."""
    with small_disk(tmp_path / "disk", 8_000_000) as folder:
        done = on_a_full_disk(forks, FILLED.replace("LEFT", str(left)), output=name, folder=folder)
        assert done.returncode == 2, done.stderr
        path, of = folder / name, json.loads(done.stdout)["frames"] + 1
        frames = cloth_frames(path) if path.suffix == ".rrd" else len(cape.Take.load(path).positions)
        assert 2 <= frames < of
        assert f" {frames} " in done.stderr.splitlines()[-1]
        assert sorted(each.name for each in folder.iterdir()) == ["others", name]


def test_where_temporary_files_find_no_room_all_is_recorded(tmp_path: Path):
    """A sheet of 2793 vertices is moved to disk after a second: to one of 1 MB."""
    with small_disk(tmp_path / "disk", 1_000_000) as folder:
        # In a process of its own, which looks for where temporary files are to be.
        done = subprocess.run(
            [sys.executable, "-c", full_disk("", output="run.npz", spacing=0.025)],
            cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LONG,
            env={**os.environ, "TMPDIR": str(folder)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        take = cape.Take.load(tmp_path / "run.npz")
        assert len(take.positions) == json.loads(done.stdout)["frames"] + 1
        # What was lost would be zeros, more than a metre away; at 18 m/s a frame gets 0.3 m.
        assert np.abs(np.diff(take.positions, axis=0)).max() < 0.3
        assert take.positions[0].nbytes * len(take.positions) > 2**20


def test_mistakes_are_told_in_a_line(tmp_path: Path, forks: Forks):
    for arguments, text in [
        (["--web", "--no-viewer"], "--web"),
        (["--seconds", "-1"], "--seconds"),
        (["--bind", "everywhere"], "0.0.0.0"),
        (["--solver", "auto"], "solver by its name"),
        (["swim"], "walk"),
    ]:
        assert text in mistake_told(forks("live", *arguments, folder=tmp_path))[1]


def test_arms_that_are_left_out_are_told(tmp_path: Path, forks: Forks):
    """Those of Talos, which pass through its hips in the walk, for a skirt."""
    skirt = (
        "--skeleton",
        "talos",
        "--garment",
        "skirt",
        "--spacing",
        "0.08",
        "--end",
        "0.3",
        "--no-viewer",
        "--seconds",
        "0.1",
    )
    done = forks("live", "walk", *skirt, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    told = [line for line in done.stderr.splitlines() if " is left out: " in line]
    assert any("deep in" in line for line in told)


def test_it_warns_of_who_may_look_on_where_anything_listens_and_only_there(tmp_path: Path, forks: Forks):
    told = []
    for seen in ("--no-viewer", "--web"):
        arguments = ("--scene", "sheet", "--spacing", "0.2", "--seconds", "0.1", "--bind", "0.0.0.0", seen)
        done = forks("live", *arguments, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        told.append("listening on 0.0.0.0" in done.stderr)
    assert told == [False, True]


def test_without_a_display_it_says_so_and_how_else(tmp_path: Path):
    """The viewer itself finds out, before or after it listens; what was recorded by then is written."""
    kept = {name: value for name, value in os.environ.items() if "DISPLAY" not in name}
    done = subprocess.run(
        [CAPE, "live", "--scene", "sheet", "--spacing", "0.1", "-o", "run.npz"],
        cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LONG, env=kept,
    )  # fmt: skip
    if not sys.platform.startswith("linux"):
        pytest.skip("has a display in any case")
    said, line = mistake_told(done)
    assert "--web" in line
    if "does not start" not in line:
        assert any("take of" in each for each in said)
        assert len(cape.Take.load(tmp_path / "run.npz").positions) >= 1
