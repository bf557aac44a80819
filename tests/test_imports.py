"""Which way imports run: motions <- skeleton <- cape, never in a circle, kernels on numpy and numba (and what it builds
on) alone, nothing heavy up front; and that modules and rooms stay small."""

import ast
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from cape.kernels import store
from cape.kernels.jit import COMPILER_OFF
from tests.support.processes import python

ROOT = Path(__file__).parents[1]
MOST_LINES = 450
MOST_MODULES = 12  # side by side in a folder
MAY_IMPORT = {"motions": {"motions"}, "skeleton": {"motions", "skeleton"}, "cape": {"motions", "skeleton", "cape"}}
HEAVY = ("numba", "rerun", "pinocchio", "trimesh", "matplotlib", "pink", "typer", "rich", "pxr", "pygltflib")


def within(folder: str) -> list[Path]:
    """The files of a folder and of those in it."""
    return sorted((ROOT / folder).rglob("*.py"))


MODULES = [*within("motions"), *within("skeleton"), *within("cape")]


@cache
def parsed(module: Path) -> ast.Module:
    return ast.parse(module.read_text())


def imported(module: Path) -> Iterator[str]:
    """Dotted names of all that a file imports, anywhere in it."""
    for node in ast.walk(parsed(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} has a relative import"
            yield node.module or ""


def test_imports_run_one_way():
    for module in MODULES:
        inside = {name.split(".")[0] for name in imported(module)} & set(MAY_IMPORT)
        assert inside <= MAY_IMPORT[module.relative_to(ROOT).parts[0]], module


def test_kernels_know_numpy_and_numba_alone():
    for module in within("cape/kernels"):
        for name in imported(module):
            top = name.split(".")[0]
            known = top in {"numpy", "numba", "llvmlite"} or top in sys.stdlib_module_names
            assert known or name.startswith("cape.kernels"), module


def test_only_the_compiler_imports_numba_as_it_is_imported():
    room = ROOT / "cape" / "kernels" / "compiler"
    # Whether a numba will do is asked before any of it is imported.
    expected = {path for path in room.glob("*.py") if path.name not in {"__init__.py", "internals.py"}}
    assert {module for module in MODULES if "numba" in imported_at_once(module)} == expected


def imported_at_once(module: Path) -> set[str]:
    """The packages that are imported as a file is."""
    return {
        name.split(".")[0]
        for node in at_import(parsed(module))
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names])
    }


def test_motions_need_numpy_alone():
    for module in within("motions"):
        for name in imported(module):
            top = name.split(".")[0]
            assert top in {"numpy", "motions"} or top in sys.stdlib_module_names, module


def test_a_module_fits_a_chapter():
    lengths = {module: len(module.read_text().splitlines()) for module in MODULES}
    assert {module: length for module, length in lengths.items() if length > MOST_LINES} == {}


@pytest.mark.parametrize("package", ["motions", "skeleton", "cape", "tests"])
def test_a_room_is_taken_in_at_a_glance(package: str):
    for folder in [ROOT / package, *(ROOT / package).rglob("*/")]:
        assert len([p for p in folder.glob("*.py") if p.name != "__init__.py"]) <= MOST_MODULES, folder


def dotted(module: Path) -> str:
    """The name by which a file is imported."""
    return ".".join(module.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def at_import(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """The imports that run when a module is imported: those in no function, nor for the reader of types alone."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        elif isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        elif not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from at_import(child)


@cache
def graph_of_imports() -> dict[str, set[str]]:
    """Which of the packages' modules each one imports as it is imported itself."""
    files = {dotted(module): module for module in MODULES}
    graph = {}
    for name, module in files.items():
        graph[name] = wanted = set[str]()
        for node in at_import(parsed(module)):
            if isinstance(node, ast.Import):
                wanted |= {alias.name for alias in node.names}
            else:
                own = f"{node.module}."
                wanted |= {own + a.name if own + a.name in files else node.module or "" for a in node.names}
        wanted &= set(files)
        wanted.discard(name)
    return graph


def circle(graph: Mapping[str, set[str]]) -> list[str]:
    """Names that lead back to the first of them; empty where there is no circle."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_modules_import_each_other_in_no_circle():
    assert circle(graph_of_imports()) == []


@pytest.mark.parametrize("depth", [2, 3])
def test_rooms_import_each_other_in_no_circle(depth: int):
    def room(module: str) -> str:
        return ".".join(module.split(".")[:depth])

    rooms: dict[str, set[str]] = {}
    for module, wanted in graph_of_imports().items():
        rooms.setdefault(room(module), set()).update(map(room, wanted))
    assert circle({name: wanted - {name} for name, wanted in rooms.items()}) == []


@pytest.mark.parametrize("package", ["motions", "skeleton", "cape"])
def test_importing_a_package_loads_nothing_heavy(package: str):
    script = f"import sys, {package}; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


SMALL = """
import sys
import numpy as np
import cape
from skeleton.track import BoneTrack
cloth = cape.Cloth.rectangle(width=0.3, height=0.3, spacing=0.1)
scene = cape.Scene(cloth, [cape.attach(cloth, "rod", "top")], [cape.Plane(point=np.array([0.0, 0.0, -1.0]))])
turns = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1))
take = cape.simulate(scene, BoneTrack(("rod",), np.arange(3) / 60, np.zeros((3, 1, 3)), turns))
print("numba" in sys.modules, take.result, take.positions.sum())
"""


@pytest.mark.skipif(COMPILER_OFF, reason="the compiler is off")
def test_a_run_whose_code_is_on_disk_does_without_numba(tmp_path: Path):
    # What the suite has compiled is there already, in a folder that no other test writes to.
    (tmp_path / "cape").mkdir()
    whole = store.folder()
    for piece in whole.glob("*.o") if whole else ():
        with suppress(FileNotFoundError):
            shutil.copy(piece, tmp_path / "cape")
    first = python(SMALL, NUMBA_CACHE_DIR=str(tmp_path)).split()
    pieces = {path: path.stat().st_mtime_ns for path in (tmp_path / "cape").iterdir()}
    assert len(pieces) > 10
    second = python(SMALL, NUMBA_CACHE_DIR=str(tmp_path)).split()
    assert first[1] == "finished"
    assert second == ["False", *first[1:]]
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "cape").iterdir()} == pieces
