"""Fixtures that several test files share, and the order of the files."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.support.command import Forks

# As many processes as cores are busy already: more threads in each, which wait by spinning, only take their time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples in every run; `--hypothesis-profile search` looks for new ones.
settings.register_profile("repeat", derandomize=True, deadline=None)
settings.register_profile("search", max_examples=1000, deadline=None)
settings.load_profile("repeat")

# Files that take longest: begun last, one of them would leave all cores but one with nothing to do.
LONG = (
    "test_replay.py", "test_fuzz_contact.py", "test_cli.py", "test_hitboxes.py", "test_retarget.py", "test_auto.py",
    "test_compiling.py", "test_robot_commands.py", "test_readme.py", "test_registered_shapes.py", "test_graph.py",
    "test_self_contact.py", "test_fitting.py", "test_solvers.py", "test_imports.py", "test_report.py",
)  # fmt: skip


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One more than there are cores, some of which have nothing to do while tests wait for what they started."""
    return len(os.sched_getaffinity(0)) + 1


@pytest.hookimpl(tryfirst=True)  # before marks are looked at
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest; leave to `.ci/extra` what `few` of a test's parameters stand for."""
    for item in items:
        few = item.get_closest_marker("few")
        if few is not None and isinstance(item, pytest.Function) and item.callspec.id not in few.args:
            item.add_marker(pytest.mark.extra)
    places = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.name, len(LONG)))


def pytest_collection_finish() -> None:
    """Keep the collector from looking again and again through thousands of tests, which stay."""
    gc.freeze()


@pytest.fixture(scope="session")
def forks(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Forks]:
    """Runs commands of which there are many: each would spend most of its time importing, or much of it."""
    with Forks(tmp_path_factory.mktemp("forks")) as forks:
        yield forks


@pytest.fixture(scope="session")
def mocap() -> Path:
    """The folder of real motion clips, which isn't part of the project: tests that need it skip without it."""
    folder = Path(os.environ.get("CAPE_CLIPS", Path(__file__).parents[2] / "shared" / "clips"))
    if not folder.is_dir():
        pytest.skip(f"no real motion clips in {folder}; set CAPE_CLIPS to their folder")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _interrupts() -> None:
    """Let Ctrl-C interrupt: a shell that starts tests in the background has it ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
