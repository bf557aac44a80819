"""Several pieces compiled at once, by this process and its helpers. They need the compiler."""

import json
import pickle
import stat
from pathlib import Path
from typing import NamedTuple

import pytest

from cape.kernels import store
from cape.kernels.contact import contact, distance, shapes, units
from cape.kernels.jit import Function, formula_of, routine
from cape.kernels.store import Request
from tests.support.code import compiled_only
from tests.support.processes import python

pytestmark = compiled_only


@routine
def add(a, b):
    return a + b


@routine
def multiply(a, b):
    return a * b


@routine
def power(a, b):
    return float(a) ** b


ALL = ("add", "multiply", "power")
KINDS = ("int", "float", "single")
REQUESTS = [Request(f, (a, b)) for f in (add, multiply, power) for a, b in zip(KINDS, KINDS, strict=True)]

SCRIPT = """
import json, os, sys, time
from pathlib import Path
os.sched_getaffinity = lambda process: {0, 1}
from cape.kernels import compiling, store
from tests.kernels import test_compiling as test
compiled_by_us, told = [], []
def listen(name, done, count):
    told.append((name, done, count))
    # Until the helper has made its first piece.
    end = time.monotonic() + 120
    while wait and not list(store.folder().glob("*.o")) and time.monotonic() < end:
        time.sleep(0.05)
compiling.listener = listen
wait = sys.argv[1] == "wait"
if sys.argv[1] not in ("wait", "alone"):
    compiling.sys.executable = sys.argv[1]
started = []
class Popen(compiling.subprocess.Popen):
    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        started.append(self)
compiling.subprocess.Popen = Popen
if sys.argv[1] == "alone":
    os.sched_getaffinity = lambda process: {0}
store.prepare(test.REQUESTS)
ended = [helper.poll() for helper in started]
before = len(store.compiled)
digests = [store.find(request)[:2] for request in test.REQUESTS]
missing = len(store.missing(test.REQUESTS))
results = [f(a, b) for f in (test.add, test.multiply, test.power) for a, b in ((2, 3), (0.5, 3.0))]
print(json.dumps({"ours": before, "told": told, "ended": ended, "missing": missing, "results": results}))
"""


class Seen(NamedTuple):
    ours: int
    told: list[list]
    ended: list[int]
    missing: int
    results: list[float]


def run(how: str, folder: Path) -> Seen:
    """Compile all requests into a folder, with a helper that works, is none, or is the file named."""
    seen = Seen(**json.loads(python(SCRIPT, how, NUMBA_CACHE_DIR=str(folder))))
    assert seen.missing == 0
    assert seen.results == [5, 3.5, 6, 1.5, 8, 0.125]
    return seen


def test_a_helper_takes_its_share_and_all_is_as_if_made_by_one(tmp_path: Path):
    shared, alone = run("wait", tmp_path / "shared"), run("alone", tmp_path / "alone")
    assert shared.ended == [0]
    assert alone.ended == []
    assert 0 < shared.ours < len(REQUESTS)
    assert alone.ours == len(REQUESTS)
    # Each piece is announced before this process compiles it, with how many were begun before.
    assert [name for name, _, _ in alone.told] == [request.name for request in REQUESTS]
    assert [done for _, done, _ in alone.told] == list(range(len(REQUESTS)))
    assert {count for _, _, count in (*alone.told, *shared.told)} == {len(REQUESTS)}
    assert len(shared.told) == shared.ours
    made = [{path.name: Piece_of(path) for path in (tmp_path / how / "cape").iterdir()} for how in ("shared", "alone")]
    assert made[0].keys() == made[1].keys()
    assert {name: piece.returns for name, piece in made[0].items()} == {
        name: piece.returns for name, piece in made[1].items()
    }


def Piece_of(path: Path) -> store.Piece:
    return store.Piece.unpack(path.read_bytes())


@pytest.mark.parametrize("begins", ["never", "and claims all"])
def test_a_helper_that_dies_is_made_up_for(tmp_path: Path, begins: str):
    helper = tmp_path / "helper"
    claims = " ".join(f'"$3/{request.file}"' for request in REQUESTS)
    # What it was sent comes to nobody; or it takes all pieces upon itself, and makes none.
    helper.write_text(f"#!/bin/sh\n{'touch ' + claims if begins == 'and claims all' else ''}\nexit 1\n")
    helper.chmod(helper.stat().st_mode | stat.S_IXUSR)
    seen = run(str(helper), tmp_path / "cache")
    assert seen.ended == [1]
    assert seen.ours == len(REQUESTS)


def test_without_a_program_to_start_there_are_no_helpers(tmp_path: Path):
    seen = run(str(tmp_path / "nothing"), tmp_path / "cache")
    assert seen.ended == []
    assert seen.ours == len(REQUESTS)


@pytest.mark.parametrize(
    "function",
    [
        units.keep_out,
        contact.collide,
        contact.stopped,
        formula_of(distance.to_box),
        shapes.gaps.around(formula_of(distance.to_plane)),
    ],
    ids=["unit", "routine", "inlined", "formula", "loop around a formula"],
)
def test_a_function_is_the_same_one_after_a_journey(function: Function):
    assert pickle.loads(pickle.dumps(function)) is function
    request = Request(function, ("int",), spread=True)
    assert pickle.loads(pickle.dumps(request)) == request
