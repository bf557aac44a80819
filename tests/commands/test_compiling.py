"""What is compiled and when, as a user of the command sees it."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cape.cli.character import read_character
from cape.cli.commands.replay import Cut
from cape.cli.commands.warm_up import COARSE, _requests, _usual_requests
from cape.cli.reading import Reading
from cape.kernels import store
from cape.live.rig import Rig
from cape.live.sources import TrackSource
from cape.solvers import SOLVERS
from tests.commands.test_cli import cape

BOX = """\
robot = "walk"

[[solid]]
name = "chest"
kind = "box"
bone = "Spine2"
center = [0.0, 0.0, 0.1]
half_sizes = [0.1, 0.1, 0.15]
"""

LACKING = {"advance", "wake_faces", "kinetic_energy"}  # what compiles fast

SHORT = ("replay", "--end", "0.1", "-o", "out.rrd")

# Two cheap functions, compiled as commands and as scripts compile.
TOLD = """
import numpy as np
from cape.cli.compiling_told import tell
from cape.kernels import calling, store
from cape.kernels.cloth.measure import is_strained, kinetic_energy

if {telling}:
    tell()
else:
    import logging
    logging.basicConfig(level=logging.INFO, stream=__import__("sys").stdout, format="%(name)s: %(message)s")
ones, ends = np.ones(3), np.arange(3)
energy = calling.Bound(kinetic_energy, ones, ones, ones, ones)
strained = calling.Bound(is_strained, ones, ones, ones, ends, ends, ones, 0.2)
store.prepare([energy.request, strained.request])
assert energy() == 4.5
assert not strained()
"""


@pytest.fixture(scope="module")
def kept(tmp_path_factory) -> Path:
    """A folder of these tests' own with the code that warming up compiles, from the suite's folder, but for some."""
    folder = tmp_path_factory.mktemp("compiled")
    (folder / "cape").mkdir()
    requests = _usual_requests(read_character(Reading("walk", end=0.1)))
    store.prepare(requests)
    whole = store.folder()
    assert whole is not None
    for request in requests:
        if request.name not in LACKING:
            shutil.copy(whole / request.file, folder / "cape")
    return folder


def untimed(text: str) -> list[str]:
    """Lines without the times at their ends."""
    return [re.sub(r" in [\d.]+ s$", " in TIME", line) for line in text.splitlines()]


def told(telling: bool, folder: Path | str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    script = TOLD.format(telling=telling)
    return subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=120, check=True
    )


def test_after_a_warm_up_a_replay_compiles_nothing(kept, tmp_path, forks):
    def replayed() -> str:
        done = forks(*SHORT, "--json", folder=tmp_path, NUMBA_CACHE_DIR=str(kept))
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["result"].startswith("finished")
        return done.stderr

    done = forks("warm-up", "--json", folder=tmp_path, NUMBA_CACHE_DIR=str(kept))
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert set(facts) == {"pieces", "compiled", "seconds", "folder"}
    assert facts["compiled"] == len(LACKING)
    assert facts["pieces"] == len(list((kept / "cape").iterdir())) > 2 * len(LACKING)
    assert facts["folder"] == str(kept / "cape")
    first, last = untimed(done.stderr)
    assert first.startswith("compiling 3 pieces of code for this machine, once: 1 of 3, ")
    assert last == "compiled 3 pieces in TIME"

    assert "compil" not in replayed()
    again = json.loads(forks("warm-up", "--json", folder=tmp_path, NUMBA_CACHE_DIR=str(kept)).stdout)
    assert again == facts | {"compiled": 0, "seconds": again["seconds"]}
    # A run asks for no more than it was warmed up for, and makes what is missing.
    (one,) = (kept / "cape").glob("wake_faces-*")
    one.unlink()
    assert untimed(replayed())[-2:] == [
        "compiling 1 piece of code for this machine, once: 1 of 1, wake_faces",
        "compiled 1 piece in TIME",
    ]
    assert one.exists()


@pytest.mark.parametrize("name", SOLVERS)
def test_what_a_live_run_asks_for_is_warmed_up_with_all(name: str):
    """Hands among it, which may take hold of the cape there."""
    who = read_character(Reading("walk", end=0.1))
    scene = Cut(spacing=COARSE).scene(who)
    rig = Rig(scene, TrackSource(who.track), SOLVERS[name](), threads=1)
    assert set(rig.simulation.requests(rig.pose_for(scene))) <= set(_requests(scene, who, SOLVERS[name]()))


@pytest.mark.extra
def test_after_warming_up_for_all_no_replay_compiles(kept, tmp_path):
    done = cape("warm-up", "--all", folder=tmp_path, NUMBA_CACHE_DIR=str(kept), timeout=900)
    assert done.returncode == 0, done.stderr
    assert "pieces of code" in done.stdout
    (tmp_path / "box.toml").write_text(BOX)
    (tmp_path / "none.toml").write_text('robot = "walk"\n')
    for options in (
        (),
        ("--self-contact",),
        *(("--solver", name) for name in ("euler", "xpbd", "backward_euler", "tr_bdf2", "auto")),
        ("--self-contact", "--solver", "tr_bdf2"),
        ("--wind", "-3", "0", "0", "--fabric", "denim"),
        ("--hitboxes", "box.toml"),
        ("--hitboxes", "none.toml"),
        ("--hitboxes", "none.toml", "--solver", "backward_euler"),
        ("--tolerance", "1"),
        ("--budget", "4"),
        ("--check",),
        ("--spacing", "0.012"),
        ("--spacing", "0.012", "--solver", "xpbd"),
    ):
        done = cape(*SHORT, *options, folder=tmp_path, NUMBA_CACHE_DIR=str(kept))
        assert done.returncode == 0, done.stderr
        assert "compil" not in done.stderr, options
    done = cape("hitboxes", "walk", "-o", "out.rrd", "--fps", "10", folder=tmp_path, NUMBA_CACHE_DIR=str(kept))
    assert done.returncode == 0, done.stderr
    assert "compil" not in done.stderr


def test_a_command_tells_what_it_compiles_on_standard_error(tmp_path):
    folder = tmp_path / "new" / "folder"
    done = told(True, folder)
    assert untimed(done.stderr) == [
        "compiling 2 pieces of code for this machine, once: 1 of 2, is_strained",
        "compiled 2 pieces in TIME",
    ]
    assert done.stdout == ""
    assert len(list((folder / "cape").iterdir())) == 2
    assert told(True, folder).stderr == ""


def test_the_library_tells_a_logger_and_prints_nothing(tmp_path):
    done = told(False, tmp_path)
    assert done.stderr == ""
    assert done.stdout.splitlines() == [
        "cape.compiling: compiling is_strained, 1 of 2",
        "cape.compiling: compiling kinetic_energy, 2 of 2",
        "cape.compiling: compiled 2 pieces",
    ]


def test_without_a_folder_to_keep_it_in_code_is_compiled_in_each_run(tmp_path):
    (tmp_path / "file").write_text("")
    for telling in (True, False):
        done = told(telling, tmp_path / "file" / "folder")
        said = done.stderr if telling else done.stdout
        assert said.count("can't be kept in") == 1
        assert "compiled 2 pieces" in said


def test_on_a_terminal_one_line_is_rewritten(tmp_path):
    pty = pytest.importorskip("pty", reason="there are no terminals here")
    reader, writer = pty.openpty()
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    with os.fdopen(writer, "wb") as terminal:
        subprocess.run(
            [sys.executable, "-c", TOLD.format(telling=True)],
            env=environment, stderr=terminal, timeout=120, check=True,
        )  # fmt: skip
    shown = os.read(reader, 10_000).decode()
    os.close(reader)
    assert untimed(shown.replace("\r\n", "\n").replace("\r\x1b[K", "|")) == [
        "|compiling 2 pieces of code for this machine, once: 1 of 2, is_strained"
        "|compiling 2 pieces of code for this machine, once: 2 of 2, kinetic_energy"
        "|compiled 2 pieces in TIME"
    ]
