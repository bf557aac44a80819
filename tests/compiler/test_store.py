"""Compiled code on disk: named for all that it depends on, whole or not used, and done without where it can't be kept.

They need the compiler.
"""

import json
import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cape.kernels import store
from cape.kernels.compiler import internals
from cape.kernels.contact import shapes
from cape.kernels.jit import Function, formula_of
from cape.kernels.store import Piece, Request
from skeleton.shapes import Box, Plane
from tests.compiler.functions import scaled, summed
from tests.support.code import compiled_only
from tests.support.processes import ROOT, python

pytestmark = compiled_only


# -- pieces --

pieces = st.builds(
    Piece,
    st.text(),
    st.one_of(st.text(), st.lists(st.sampled_from(["int", "float", "bool"])).map(tuple)),
    st.binary(max_size=200),
)


@given(pieces)
def test_a_piece_is_what_was_packed(piece: Piece):
    assert Piece.unpack(piece.pack()) == piece


@given(pieces, st.data())
def test_what_is_not_whole_is_no_piece(piece: Piece, data: st.DataObject):
    text = bytearray(piece.pack())
    place = data.draw(st.integers(0, len(text) - 1))
    with pytest.raises(ValueError, match="not whole"):
        Piece.unpack(bytes(text[:place]))
    text[place] ^= data.draw(st.integers(1, 255))
    with pytest.raises(ValueError, match="not whole"):
        Piece.unpack(bytes(text))


# -- names --


def names_of(requests: list[Request]) -> list[str]:
    return [request.file for request in requests]


def test_code_is_named_for_its_function_and_the_kinds_of_its_arguments():
    box, plane = formula_of(Box.nearest), formula_of(Plane.nearest)
    requests = [
        Request(summed, ("int",)),
        Request(scaled, ("int",)),
        Request(summed, ("float",)),
        Request(summed, ("int", "float")),
        Request(box, ("float",) * 7),
        Request(plane, ("float",) * 7),
        Request(shapes.gaps.around(box), ("float",)),
        Request(shapes.gaps.around(plane), ("float",)),
        Request(shapes.planes.around(plane), ("float",)),
    ]
    assert len(set(names_of(requests))) == len(requests)
    assert names_of(requests) == names_of(requests)
    assert requests[0].file.startswith("summed-")


def test_another_processor_or_version_has_code_of_its_own(monkeypatch: pytest.MonkeyPatch):
    request = Request(summed, ("int",))
    before, known = request.file, store.machine()
    for place in range(len(known)):
        changed = (*known[:place], known[place] + "!", *known[place + 1 :])
        monkeypatch.setattr(store, "machine", lambda changed=changed: changed)
        assert request.file != before
    monkeypatch.setattr(store, "machine", lambda: known)
    assert request.file == before


SOURCES = {
    "cape/kernels/first.py": "from cape.kernels.second import it\nfrom cape.kernels.room import (\n    fifth,\n)\n",
    "cape/kernels/second.py": "import numpy\nfrom cape.kernels import third\n",
    "cape/kernels/third.py": "import skeleton.outside\n",
    "cape/kernels/fourth.py": "from cape.kernels.first import nothing\n",
    "cape/kernels/room/__init__.py": "",
    "cape/kernels/room/fifth.py": "",
    "cape/kernels/__init__.py": "",
    "cape/kernels/compiler/__init__.py": "",
    "cape/kernels/compiler/lowering.py": "",
    "skeleton/outside.py": "from skeleton import further\n",
    "skeleton/further.py": "",
    "cape/shape.py": "from cape.kernels.fourth import nothing\n",
}


class Sources:
    """A folder of sources, and digests of what functions of them depend on."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._folder, self._patch = folder, monkeypatch
        for name, text in SOURCES.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        monkeypatch.setattr(store, "ROOT", folder)

    def digest(self, module: str, formula: str | None = None) -> str:
        """Of a function of a module, as a process that starts now finds it; around a formula of another module."""

        def nothing() -> None: ...

        def function(module: str, formula: Function | None = None) -> Function:
            made = Function(nothing, formula=formula)
            made.__module__ = module
            return made

        store._digest.cache_clear()
        store._file_of.cache_clear()
        return store.sources_of(function(module, None if formula is None else function(formula)))

    def change(self, name: str) -> None:
        """Change a file."""
        path = self._folder / name
        path.write_text(path.read_text() + "# changed\n")


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    yield Sources(tmp_path, monkeypatch)
    monkeypatch.undo()
    store._digest.cache_clear()
    store._file_of.cache_clear()


@pytest.mark.parametrize("name", SOURCES)
def test_a_change_in_any_source_that_a_function_is_made_of_gives_another_name(sources: Sources, name: str):
    outside = {"cape/kernels/fourth.py", "cape/shape.py"}
    before = sources.digest("cape.kernels.first")
    sources.change(name)
    assert (sources.digest("cape.kernels.first") != before) == (name not in outside)


def test_a_loop_depends_on_the_formula_s_source_too(sources: Sources):
    alone, around = sources.digest("cape.kernels.third"), sources.digest("cape.kernels.third", "cape.shape")
    assert alone != around
    for name in ("cape/shape.py", "cape/kernels/fourth.py", "cape/kernels/room/fifth.py"):
        sources.change(name)
        assert sources.digest("cape.kernels.third") == alone
        changed = sources.digest("cape.kernels.third", "cape.shape")
        assert changed != around
        around = changed


# -- on disk --

SCRIPT = """
import json, sys
import numpy as np
from cape.kernels import store
from tests.compiler.functions import scaled, summed
values = np.arange(5.0)
scaled(values, 3.0)
print(json.dumps({
    "sum": summed(values), "whole": summed(np.arange(4)), "compiled": sorted(store.compiled),
    "numba": "numba" in sys.modules,
}))
"""


class Seen(NamedTuple):
    sum: float
    whole: float
    compiled: list[str]
    numba: bool


def run(folder: Path) -> Seen:
    """What a process computes with code kept in a folder, and what it compiled."""
    seen = Seen(**json.loads(python(SCRIPT, NUMBA_CACHE_DIR=str(folder))))
    assert (seen.sum, seen.whole) == (30.0, 6.0)
    return seen


ALL = ["scaled", "summed", "summed"]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that a process has compiled all into."""
    folder = tmp_path_factory.mktemp("kept")
    first = run(folder)
    assert first.compiled == ALL
    assert first.numba
    return folder


def test_what_is_on_disk_is_not_compiled_and_needs_no_compiler(kept: Path):
    second = run(kept)
    assert second.compiled == []
    assert not second.numba
    # Whole files alone, each named for its function.
    names = sorted(path.name.split("-")[0] for path in (kept / "cape").iterdir())
    assert names == ALL
    assert all(path.suffix == ".o" for path in (kept / "cape").iterdir())


def test_files_that_are_not_whole_are_compiled_anew(kept: Path, tmp_path: Path):
    shutil.copytree(kept / "cape", tmp_path / "cape")
    files = sorted((tmp_path / "cape").iterdir())
    whole = [path.read_bytes() for path in files]
    middle = len(whole[1]) // 2
    files[0].write_bytes(whole[0][: len(whole[0]) // 2])
    files[1].write_bytes(whole[1][:middle] + bytes([whole[1][middle] ^ 1]) + whole[1][middle + 1 :])
    files[2].write_bytes(b"")
    assert run(tmp_path).compiled == ALL
    # The same source gives the same code, to the last byte.
    assert [path.read_bytes() for path in files] == whole


@pytest.fixture
def told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> Iterator[pytest.LogCaptureFixture]:
    """Warnings, as of a process that keeps code in `tmp_path / "own"` and has compiled nothing yet."""
    caches = (store.folder, store._tell_that_nothing_is_kept)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "own"))
    for name, empty in (("compiled", []), ("_loaded", {}), ("_pieces", {})):
        monkeypatch.setattr(store, name, empty)
    for each in caches:
        each.cache_clear()
    caplog.set_level(logging.WARNING, "cape.compiling")
    yield caplog
    monkeypatch.undo()
    for each in caches:
        each.cache_clear()


def computes() -> None:
    """Functions that nothing knows yet are compiled, and compute what they should."""
    first, second, values = Function(summed.python), Function(scaled.python), np.arange(5.0)
    second(values, 3.0)
    assert (first(values), first(np.arange(4))) == (30.0, 6.0)
    assert sorted(store.compiled) == ALL


def test_without_a_folder_to_write_to_all_works_and_it_is_said_once(tmp_path: Path, told: pytest.LogCaptureFixture):
    (tmp_path / "own").write_text("not a folder")
    computes()
    (record,) = told.records
    assert record.levelname == "WARNING"
    assert record.getMessage().startswith(f"compiled code can't be kept in {tmp_path / 'own' / 'cape'} (")
    assert record.getMessage().endswith("): it is compiled anew in each run")


def test_a_folder_that_others_can_write_to_is_not_used(tmp_path: Path, told: pytest.LogCaptureFixture):
    place = tmp_path / "own" / "cape"
    place.mkdir(parents=True)
    place.chmod(0o777)
    computes()
    (record,) = told.records
    assert record.getMessage().startswith(f"compiled code can't be kept in {place} (others can write to it)")
    assert list(place.iterdir()) == []


@pytest.mark.parametrize(
    ("mode", "risk"), [(0o700, None), (0o755, None), (0o775, "others"), (0o757, "others"), (0o1777, None)]
)
def test_what_makes_a_folder_a_risk(tmp_path: Path, mode: int, risk: str | None, monkeypatch: pytest.MonkeyPatch):
    tmp_path.chmod(mode)
    found = store._risk_of(tmp_path)
    assert found is None if risk is None else found == "others can write to it"
    monkeypatch.setattr(store.os, "getuid", lambda: tmp_path.stat().st_uid + 1)
    assert store._risk_of(tmp_path) == "it belongs to somebody else"


def test_what_is_somebody_else_s_is_thrown_away_and_made_anew(
    tmp_path: Path, told: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    computes()
    place = tmp_path / "own" / "cape"
    files = {path.name for path in place.iterdir()}
    monkeypatch.setattr(store, "_is_own", lambda file: False)
    for name, empty in (("compiled", []), ("_loaded", {})):
        monkeypatch.setattr(store, name, empty)
    computes()
    assert {path.name for path in place.iterdir()} == files
    assert told.records == []


@pytest.mark.parametrize("home", [None, "/dev/null"])
def test_without_a_home_pieces_are_kept_beside_temporary_files_and_it_is_said_once(
    home: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: pytest.LogCaptureFixture
):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    if home is None:
        monkeypatch.setattr(store.os.path, "expanduser", lambda path: path)
    else:
        monkeypatch.setenv("HOME", home)
    monkeypatch.setattr(store.tempfile, "gettempdir", lambda: str(tmp_path))
    place = tmp_path / f"cape-{os.getuid()}"
    computes()
    assert len(list(place.iterdir())) == len(ALL)
    assert place.stat().st_mode & 0o077 == 0
    (record,) = told.records
    assert ("there is no home folder" if home is None else "Not a directory") in record.getMessage()
    assert record.getMessage().endswith(f"it is kept in {place}")


def test_a_link_beside_temporary_files_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: pytest.LogCaptureFixture
):
    """Whoever may write there could have laid it."""
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/dev/null")
    monkeypatch.setattr(store.tempfile, "gettempdir", lambda: str(tmp_path))
    (tmp_path / "mine").mkdir()
    (tmp_path / f"cape-{os.getuid()}").symlink_to(tmp_path / "mine")
    assert store.folder() is None
    (record,) = told.records
    assert record.getMessage().endswith("it is compiled anew in each run")


@pytest.mark.extra
def test_a_package_that_can_not_be_written_runs_without_a_home(tmp_path: Path):
    installed = tmp_path / "installed"
    for package in ("cape", "motions", "skeleton"):
        shutil.copytree(ROOT / package, installed / package, ignore=shutil.ignore_patterns("__pycache__"))
    for path in (installed, *installed.rglob("*")):
        path.chmod(path.stat().st_mode & ~0o222)
    (tmp_path / "temporary").mkdir()
    (tmp_path / "home").mkdir(mode=0o555)
    # To root, permissions mean nothing but where it gives up what lets it pass over them.
    bound = ["setpriv", "--bounding-set=-dac_override,-dac_read_search,-fowner"] if os.getuid() == 0 else []
    kept = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    done = subprocess.run(
        [*bound, sys.executable, "-m", "cape.cli", "replay", "idle", "--end", "0.1", "--garment", "back_cape",
         "--spacing", "0.1", "-o", str(tmp_path / "idle.rrd")],
        env={**kept, "HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "temporary"),
             "PYTHONPATH": str(installed)},
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    for path in (installed, *installed.rglob("*")):
        path.chmod(path.stat().st_mode | 0o200)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("can't be kept") == 1
    assert f"it is kept in {tmp_path / 'temporary' / f'cape-{os.getuid()}'}" in done.stderr
    assert not list(installed.rglob("__pycache__"))
    assert (tmp_path / "idle.rrd").stat().st_size > 0


def test_a_numba_without_what_is_used_of_it_is_told_in_a_line():
    internals.require()
    lacking = ("numba.core.codegen:JITCodeLibrary.nothing_like_it", "numba.core.nowhere:gone", internals.USED[0])
    with pytest.raises(
        ImportError, match=r"^numba [\d.]+ can't compile .*: it has no numba.core.codegen.JITCodeLibrary.n.*"
    ):
        internals.require(lacking)


def test_a_disk_that_becomes_full_is_borne_and_told_once(
    tmp_path: Path, told: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    def refuse(self: Path, text: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", refuse)
    computes()
    (record,) = told.records
    assert record.levelname == "WARNING"
    place = tmp_path / "own" / "cape"
    assert record.getMessage().startswith(f"compiled code can't be kept in {place} (No space left on device)")
    assert list(place.iterdir()) == []


def test_the_folder_is_where_it_was_asked_for_or_the_user_s_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = store.folder.__wrapped__
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert folder() == tmp_path / "home/.cache/cape"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    assert folder() == tmp_path / "user/cape"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "asked"))
    assert folder() == tmp_path / "asked/cape"
    assert (tmp_path / "asked/cape").is_dir()


# -- in memory --


def test_a_request_is_missing_until_it_is_made(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(store, "folder", lambda: None)
    monkeypatch.setattr(store, "compiled", [])

    def fresh(value):
        return value + 1.0

    request = Request(Function(fresh), ("float",))
    assert store.missing([request, request]) == [request]
    store.make(request)
    assert store.missing([request]) == []
    assert store.compiled == ["fresh"]
    code = store.code_of(request)
    assert store.code_of(request) is code
    assert code.returns == "float"
    assert store.compiled == ["fresh"]
