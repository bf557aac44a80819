"""Files that appear whole or not at all, under names that nobody can foresee, and nothing left of what was killed."""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from motions import load
from motions.errors import FileError
from motions.files import begin_file, printable, read_bytes, whole_file, write_text

HOST = re.sub(r"\W", "_", platform.node())


def gone() -> int:
    """Number of a process that has ended."""
    done = subprocess.Popen([sys.executable, "-c", ""])
    done.wait()
    return done.pid


def test_what_a_killed_process_began_is_removed_and_nothing_else(tmp_path):
    token = "0" * 32
    left = tmp_path / f".{HOST}-{gone()}-{token}.part.rrd"
    others = [
        tmp_path / f".{HOST}-{os.getppid()}-{token}.part.rrd",  # is still running
        tmp_path / f".elsewhere-{gone()}-{token}.part.rrd",  # may be running on another machine
        tmp_path / f".{HOST}-{gone()}-short.part.rrd",
        tmp_path / f"{HOST}-{gone()}-{token}.part.rrd",
    ]
    for path in (left, *others):
        path.touch()
    write_text(tmp_path / "out.txt", "whole")
    assert not left.exists()
    assert sorted(tmp_path.iterdir()) == sorted([*others, tmp_path / "out.txt"])


def test_names_of_what_is_unfinished_are_never_the_same(tmp_path):
    names = {begin_file(tmp_path / "out.rrd") for _ in range(20)}
    assert len(names) == 20
    assert all(name.suffix == ".rrd" and name.name.startswith(".") for name in names)


def fail_half_way(path: Path, error: Exception) -> None:
    with whole_file(path) as partial:
        partial.write_text("half")
        raise error


def test_a_failed_block_leaves_what_was_there(tmp_path):
    path = tmp_path / "out.txt"
    path.write_text("before")
    with pytest.raises(RuntimeError):
        fail_half_way(path, RuntimeError())
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_device_is_told_in_a_line(tmp_path):
    with pytest.raises(FileError, match=r"can't write .*No space left"):
        fail_half_way(tmp_path / "out.txt", OSError(28, "No space left on device"))
    with pytest.raises(FileError, match="can't write"):
        write_text(tmp_path / ("n" * 300), "text")
    assert list(tmp_path.iterdir()) == []


def test_only_regular_files_of_a_size_are_read(tmp_path, monkeypatch):
    (tmp_path / "ten").write_bytes(b"0123456789")
    assert read_bytes(tmp_path / "ten") == b"0123456789"
    monkeypatch.setattr("motions.files.LARGEST_FILE", 9)
    os.mkfifo(tmp_path / "pipe")
    for name, told in (
        ("ten", "has 0 MB, more than 0"), ("pipe", "not a regular file"), ("none", "No such file"),
        (".", "a directory"), ("n" * 300, "File name too long"), ("a\0b", "embedded null"),
    ):  # fmt: skip
        with pytest.raises(FileError, match=told):
            read_bytes(tmp_path / name)


@pytest.mark.parametrize("name", ["n" * 300, "a\0b"])
def test_names_that_no_file_may_have_are_not_written(tmp_path, name):
    with pytest.raises(FileError, match="can't write"):
        write_text(tmp_path / name, "text")
    assert list(tmp_path.iterdir()) == []


def test_what_can_not_be_seen_is_written_as_an_escape():
    assert printable("Hüfte_L 1") == "Hüfte_L 1"
    assert printable("a\x1b[31mb\u202e\n\x7f") == "a\\x1b[31mb\\u202e\\n\\x7f"


@pytest.mark.parametrize(
    ("name", "told"),
    [("take.pkl", "pickle, .*npz"), ("q.npy", "npz"), ("walk.FBX", "GLB, .*blender -b"), ("a.c3d", "no joints.*BVH")],
)
def test_files_of_other_kinds_say_what_to_make_of_them(tmp_path, name, told):
    (tmp_path / name).write_bytes(b"\x80\x04")
    with pytest.raises(FileError, match=rf"{name} is an? .*{told}"):
        load(tmp_path / name)
