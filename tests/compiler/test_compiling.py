"""Several pieces compiled at once, by this process and its helpers. They need the compiler."""

import json
import pickle
import stat
from pathlib import Path
from typing import NamedTuple

import pytest

from cape.kernels import store
from cape.kernels.contact import contact, shapes, units
from cape.kernels.jit import Function, formula_of
from cape.kernels.store import Request
from skeleton.shapes import Box, Plane
from tests.compiler.functions import REQUESTS
from tests.support.code import compiled_only
from tests.support.processes import python

pytestmark = compiled_only

SCRIPT = """
import json, sys, time
from cape.kernels import compiling, store
from tests.compiler import functions as test
how, told, started = sys.argv[1], [], []
compiling._cores = lambda: {"forked": 2, "together": 2}.get(how, 1)
if how == "together":
    import numba
elif how != "forked":
    sys.executable = how
def listen(name, done, count):
    told.append((name, done, count))
    # Until the helper has made its first piece.
    end = time.monotonic() + 120
    while how == "together" and not list(store.folder().glob("*.o")) and time.monotonic() < end:
        time.sleep(0.05)
compiling.listener = listen
class Popen(compiling.subprocess.Popen):
    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        started.append(self)
compiling.subprocess.Popen = Popen
store.prepare(test.REQUESTS)
compiling.listener = None
seen = {
    "ours": len(store.compiled), "told": list(told), "ended": [helper.poll() for helper in started],
    "missing": len(store.missing(test.REQUESTS)), "numba": "numba" in sys.modules,
}
results = [f(a, b) for f in (test.add, test.multiply, test.power) for a, b in ((2, 3), (0.5, 3.0))]
print(json.dumps({**seen, "results": results}))
"""


class Seen(NamedTuple):
    ours: int
    told: list[list]
    ended: list[int]
    missing: int
    numba: bool
    results: list[float]


def run(how: str, folder: Path) -> Seen:
    """Compile all into a folder: by two helpers, together with one, or by the file that is named."""
    seen = Seen(**json.loads(python(SCRIPT, how, NUMBA_CACHE_DIR=str(folder))))
    assert seen.missing == 0
    assert seen.results == [5, 3.5, 6, 1.5, 8, 0.125]
    # Each piece is announced as it is begun, with how many were begun before; and then the end.
    *told, end = seen.told
    assert end == ["", len(REQUESTS), len(REQUESTS)]
    assert [done for _, done, _ in told] == sorted({done for _, done, _ in told})
    assert {count for _, _, count in told} <= {len(REQUESTS)}
    return seen


def pieces(folder: Path) -> dict[str, store.Piece]:
    return {path.name: store.Piece.unpack(path.read_bytes()) for path in (folder / "cape").iterdir()}


def test_whoever_compiles_all_is_there_and_the_same(tmp_path: Path):
    # Without a program to start there are no helpers.
    alone, forked, together = (run(how, tmp_path / how) for how in (str(tmp_path / "nothing"), "forked", "together"))
    assert alone.ended == []
    assert forked.ended == together.ended == [0]
    # With nothing of numba loaded this process leaves all to the helpers; else it takes its share.
    assert (alone.ours, forked.ours) == (len(REQUESTS), 0)
    assert 0 < together.ours < len(REQUESTS)
    assert alone.numba
    assert not forked.numba
    for one in (alone, forked, together):
        assert sorted(name for name, _, _ in one.told[:-1]) == sorted(request.name for request in REQUESTS)
    made = {how: pieces(tmp_path / how) for how in ("nothing", "forked", "together")}
    requests = {request.file for request in REQUESTS}
    for how in ("forked", "together"):
        for name in requests:
            # But for the numbers in the symbols' names, which tell how many were made before in the same process.
            assert made[how][name].returns == made["nothing"][name].returns


@pytest.mark.few("and claims all")
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


@pytest.mark.parametrize(
    "function",
    [
        units.keep_out,
        contact.collide,
        contact.stopped,
        formula_of(Box.nearest),
        shapes.gaps.around(formula_of(Plane.nearest)),
    ],
    ids=["unit", "routine", "inlined", "formula", "loop around a formula"],
)
def test_a_function_is_the_same_one_after_a_journey(function: Function):
    assert pickle.loads(pickle.dumps(function)) is function
    request = Request(function, ("int",), spread=True)
    assert pickle.loads(pickle.dumps(request)) == request
