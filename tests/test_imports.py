"""Which way imports run: motions <- skeleton <- cape, kernels on numpy and numba (and what it builds on) alone but for
the distances from shapes, nothing heavy up front."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted(p for package in ("motions", "skeleton", "cape") for p in (ROOT / package).rglob("*.py"))
MOST_LINES = 450
MAY_IMPORT = {"motions": {"motions"}, "skeleton": {"motions", "skeleton"}, "cape": {"motions", "skeleton", "cape"}}
HEAVY = ("rerun", "pinocchio", "trimesh", "matplotlib", "pink", "typer", "rich")

modules = pytest.mark.parametrize("module", MODULES, ids=lambda p: str(p.relative_to(ROOT)))


def imported(module: Path) -> Iterator[str]:
    """Dotted names of all that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} has a relative import"
            yield node.module or ""


@modules
def test_imports_run_one_way(module: Path):
    package = module.relative_to(ROOT).parts[0]
    inside = {name.split(".")[0] for name in imported(module)} & set(MAY_IMPORT)
    assert inside <= MAY_IMPORT[package]


@pytest.mark.parametrize("module", sorted((ROOT / "cape" / "kernels").glob("*.py")), ids=lambda p: p.name)
def test_kernels_know_numpy_and_numba_and_the_distances_from_shapes_alone(module: Path):
    for name in imported(module):
        top = name.split(".")[0]
        known = top in {"numpy", "numba", "llvmlite"} or top in sys.stdlib_module_names
        assert known or name.startswith(("cape.kernels", "skeleton.shapes"))


@pytest.mark.parametrize("module", sorted((ROOT / "motions").rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_motions_need_numpy_alone(module: Path):
    for name in imported(module):
        top = name.split(".")[0]
        assert top in {"numpy", "motions"} or top in sys.stdlib_module_names


@modules
def test_a_module_fits_a_chapter(module: Path):
    assert len(module.read_text().splitlines()) <= MOST_LINES


@pytest.mark.parametrize("package", ["motions", "skeleton", "cape"])
def test_importing_a_package_loads_nothing_heavy(package: str):
    script = f"import sys, {package}; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
