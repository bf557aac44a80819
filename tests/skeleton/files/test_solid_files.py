"""Solids from a file: what is damaged, absurd or made to do harm ends in one short error."""

import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motions.errors import FileError
from skeleton.robot.solid_files import read_solids

SPHERE = '[[solid]]\nname = "a"\nkind = "sphere"\nbone = "Hips"\ncenter = [0.0, 0.0, 0.0]\nradius = {}\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (SPHERE.format("1" + "0" * 400), "solid 1 .*radius is a number, not 1000"),
        (SPHERE.format("1" + "0" * 5000), "is no TOML file: a number of more than 4300 digits$"),
        (SPHERE.format("nan"), "radius is a number, not nan"),
        (SPHERE.format("1e300"), r"radius is a number, not 1e\+300"),
        ("a = " + "[" * 100_000 + "]" * 100_000, "is no TOML file: nested too deeply"),
        (SPHERE.format("0.1") * 2, "there is a solid of that name already"),
        ("\x00", "is no TOML file"),
        (SPHERE.format("0.1").replace("a", "\udcff"), "is no TOML file"),
    ],
)
def test_a_file_that_makes_no_sense_ends_in_one_short_line(tmp_path, text, told):
    path = tmp_path / "solids.toml"
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(FileError, match=told) as caught:
        read_solids(path)
    assert len(str(caught.value)) < 500
    assert str(caught.value).isprintable()


def test_only_regular_files_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    for name in ("pipe.toml", "zero.toml"):
        with pytest.raises(FileError, match="not a regular file"):
            read_solids(tmp_path / name)


def test_twenty_thousand_solids_are_as_many_names(tmp_path):
    """Looking for a name among all before would take 2e8 comparisons."""
    path = tmp_path / "many.toml"
    path.write_text("".join(SPHERE.format("0.1").replace('"a"', f'"s{k}"') for k in range(20_000)))
    assert len(read_solids(path)[1]) == 20_000


@given(
    st.text(alphabet='[]{}="\\\n.,#ax01e-_', max_size=300) | st.binary(max_size=200).map(lambda b: b.decode("latin1"))
)
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_text_brings_the_reader_down(tmp_path, text):
    path = tmp_path / "noise.toml"
    path.write_text(text)
    try:
        read = read_solids(path)
    except FileError as error:
        read = str(error).partition(str(path))[0].removeprefix("can't read "), ()
    assert read == ("", ())  # an error that names the file, or nothing: there are too few letters to name anything
