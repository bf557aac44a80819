"""What people ask any command: its version, help, completion, what was meant, and what a machine lacks."""

import importlib.metadata
import json
import re
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

import cape
import motions
import skeleton
from cape.cli.commands import doctor
from motions.errors import likeliest


def test_the_version_is_the_packages(forks, tmp_path):
    done = forks("--version", folder=tmp_path)
    assert done.stdout == f"cape {cape.__version__}\n"
    assert cape.__version__ == importlib.metadata.version("cape")


def test_what_is_imported_is_no_garbage_to_be_looked_for():
    told = "atexit.register(lambda: print(gc.get_freeze_count() > 10_000))"
    code = f"import atexit, gc, sys; {told}; sys.argv[1:] = ['--version']; from cape.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "True"


def test_the_command_is_a_module_as_well():
    done = subprocess.run([sys.executable, "-m", "cape", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"cape {cape.__version__}\n"


@pytest.mark.parametrize("arguments", [[], ["replay"], ["warm-up"]])
def test_help_is_asked_for_in_short(arguments, forks, tmp_path):
    short, long = (forks(*arguments, option, folder=tmp_path) for option in ("-h", "--help"))
    assert short.stdout == long.stdout
    assert short.returncode == 0


@pytest.mark.parametrize("group", [[], ["scene"]])
def test_a_group_without_a_command_prints_its_help(group, forks, tmp_path):
    alone = forks(*group, folder=tmp_path)
    assert alone.returncode == 2
    assert alone.stderr.splitlines() == forks(*group, "-h", folder=tmp_path).stdout.splitlines()


def test_a_shell_completes_commands_and_options(tmp_path):
    # As bash asks once it has been told to by --show-completion.
    from tests.support.command import cape as run

    def completed(words: str, word: int) -> list[str]:
        asked = run(folder=tmp_path, _CAPE_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(word))
        return asked.stdout.split()

    assert completed("cape garm", 1) == ["garments"]
    assert completed("cape replay --turb", 2) == ["--turbulence"]


def test_a_name_that_is_nearly_right_is_told_which_is_meant(forks, tmp_path):
    done = forks("replay", "--fabric", "denin", folder=tmp_path)
    assert "did you mean 'denim'?" in done.stderr
    assert "did you mean" not in forks("replay", "--fabric", "xyzzy", folder=tmp_path).stderr


@given(st.lists(st.text(max_size=8), max_size=6), st.text(max_size=8))
def test_what_is_meant_is_one_of_what_there_is(known: list[str], name: str):
    assert likeliest(name, known) in {None, *known}
    for each in known:
        found = likeliest(each, known)
        assert found is None or found.casefold() == each.casefold()


def test_no_colour_is_printed_where_none_is_wanted(tmp_path):
    from tests.support.command import cape as run

    told = run("garments", folder=tmp_path, FORCE_COLOR="1", NO_COLOR="1").stdout
    assert not re.search(r"\x1b\[[0-9;]*(3[0-9]|4[0-9]|9[0-7])[;m]", told)


def test_the_doctor_tells_what_there_is(forks, tmp_path):
    found = json.loads(forks("doctor", "--json", folder=tmp_path).stdout)
    assert found["cape"] == cape.__version__
    assert found["packages"]["numpy"] == importlib.metadata.version("numpy")
    assert found["extras"]["retarget"].keys() == {"pin-pink", "daqp"}
    assert found["cores"] >= 1
    assert found["cache_mb"] >= 0.0


@pytest.mark.parametrize("lacking", ["daqp", "daqp rerun-sdk"])
def test_the_doctor_tells_what_is_missing(monkeypatch, capsys, lacking):
    """What is left out on purpose is not installed along with something else."""

    def version(package: str) -> str:
        if package in lacking.split():
            raise importlib.metadata.PackageNotFoundError
        return "1"

    monkeypatch.setattr(importlib.metadata, "version", version)
    monkeypatch.setenv("COLUMNS", "500")
    whole = "rerun-sdk" not in lacking
    assert doctor.run(json=False) == (0 if whole else 1)
    told = capsys.readouterr().out
    assert ("rerun-sdk MISSING" in told) is not whole
    ask = "'cape[retarget]'" if whole else "daqp"
    assert re.search(rf"lacks daqp: pip install {re.escape(ask)} *\n", told)


@pytest.mark.parametrize("package", ["cape", "motions", "skeleton"])
def test_types_of_the_packages_are_for_others_too(package):
    from importlib.resources import files

    assert (files(package) / "py.typed").is_file()


@pytest.mark.extra
def test_the_reference_holds_all_that_is_exported(tmp_path):
    subprocess.run([sys.executable, "-m", "pdoc", "cape", "motions", "skeleton", "-o", str(tmp_path)], check=True)
    for package in (cape, motions, skeleton):
        page = (tmp_path / f"{package.__name__}.html").read_text()
        for name in package.__all__:
            assert f'id="{name}"' in page
