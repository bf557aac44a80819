"""Standard output that can't take what is printed: one line and status 2, or no word where nobody reads it any more."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.command import CAPE

FULL = "cape: can't write to standard output: No space left on device\n"
NO_DEVICE = not Path("/dev/full").exists()
PRINTED = {
    "--version": ("--version",),
    "clips": ("clips",),
    "help": ("replay", "--help"),
    "a table": ("info", "walk"),
    "json": ("info", "walk", "--json"),
    "a chapter": ("manual", "robots"),
}
REPLAY = ("replay", "idle", "--end", "0.1", "--garment", "back_cape", "--spacing", "0.1", "-o", "out.rrd")

pytestmark = pytest.mark.skipif(os.name == "nt", reason="what is a full device there?")


def run(
    *arguments: str, folder: Path, stdout: int, stderr: int = subprocess.PIPE, at_once: bool = False
) -> tuple[int, str]:
    """Status and standard error of the command; `at_once` to print without a buffer."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1" if at_once else ""}
    done = subprocess.run(
        [CAPE, *arguments], cwd=folder, env=environment, stdout=stdout, stderr=stderr, text=True, check=False
    )
    return done.returncode, done.stderr or ""


def unread() -> int:
    """The end of a pipe whose other end is closed."""
    read, write = os.pipe()
    os.close(read)
    return write


@pytest.mark.skipif(NO_DEVICE, reason="there is no /dev/full")
@pytest.mark.few("clips", "help")
@pytest.mark.parametrize("what", PRINTED)
def test_a_full_device_is_told_in_a_line(what: str, tmp_path: Path):
    with open("/dev/full", "w") as full:
        assert run(*PRINTED[what], folder=tmp_path, stdout=full.fileno()) == (2, FULL)


@pytest.mark.skipif(NO_DEVICE, reason="there is no /dev/full")
def test_where_both_streams_are_full_the_status_tells(tmp_path: Path):
    with open("/dev/full", "w") as full:
        assert run("clips", folder=tmp_path, stdout=full.fileno(), stderr=full.fileno()) == (2, "")


@pytest.mark.few("buffered-clips", "at once-help")
@pytest.mark.parametrize("what", PRINTED)
@pytest.mark.parametrize("at_once", [False, True], ids=["buffered", "at once"])
def test_a_closed_pipe_ends_without_a_word(what: str, at_once: bool, tmp_path: Path):
    assert run(*PRINTED[what], folder=tmp_path, stdout=unread(), at_once=at_once) == (141, "")


def test_a_mistake_is_told_where_nobody_reads_standard_output(tmp_path: Path):
    status, told = run("info", "nosuch", folder=tmp_path, stdout=unread())
    assert status == 2
    assert told.startswith("cape: no file 'nosuch'")


def test_standard_output_that_is_closed_is_told_and_nothing_else_gets_its_number(tmp_path: Path):
    done = subprocess.run(
        ["sh", "-c", f"{CAPE} scene init -o new.toml >&-"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (2, "cape: can't write to standard output: Bad file descriptor\n")
    assert "to replay it" not in (tmp_path / "new.toml").read_text()


@pytest.mark.skipif(NO_DEVICE, reason="there is no /dev/full")
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_what_is_computed_after_the_first_text_that_was_lost_is_written(stream: str, tmp_path: Path):
    code = f"""if True:
        import sys
        from pathlib import Path
        from cape.streams import guard
        out = guard()
        print("x" * 100_000, file=sys.{stream}, flush=True)
        Path("result").write_text(str(out.failure))
        print("y" * 100_000, file=sys.{stream}, flush=True)
    """
    with open("/dev/full", "w") as full:
        out, err = (full, None) if stream == "stdout" else (None, full)
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, stdout=out, stderr=err, check=False)
    assert done.returncode == 0
    assert (tmp_path / "result").read_text() == ("[Errno 28] No space left on device" if stream == "stdout" else "None")


@pytest.mark.extra
@pytest.mark.skipif(NO_DEVICE, reason="there is no /dev/full")
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_recording_is_whole_whose_figures_can_not_be_printed(options: tuple[str, ...], tmp_path: Path):
    import rerun as rr

    with open("/dev/full", "w") as full:
        status, told = run(*REPLAY, *options, folder=tmp_path, stdout=full.fileno(), at_once=True)
    assert status == 2
    assert told.splitlines()[-1] == FULL.strip()
    assert [path.name for path in tmp_path.iterdir()] == ["out.rrd"]
    assert list(rr.chunk.RrdReader(tmp_path / "out.rrd").stream())
