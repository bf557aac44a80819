"""What code a scene needs: once, and for more in it what belongs to that and nothing else. Needs the compiler."""

import json
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from cape.kernels import store
from tests.support.code import compiled_only
from tests.support.processes import python

pytestmark = compiled_only

SCRIPT = """
import json, sys
import numpy as np
import cape
from cape.kernels import calling, compiling, store
from skeleton.shapes import Ellipsoid

if sys.argv[1] == "alone":
    compiling._cores = lambda: 0  # no helpers: all is compiled here

asked, prepare = set(), store.prepare

def listening(requests):
    asked.update(requests)
    prepare(requests)

store.prepare = listening

def run(more):
    # As in a process that has just begun.
    asked.clear()
    store._loaded.clear()
    calling._entries.clear()
    cloth = cape.Cloth.rectangle(width=0.2, height=0.2, spacing=0.05)
    colliders = [cape.Sphere(radius=0.3, center=np.array([0.0, 1.0, 0.0]))]
    if more == "box":
        colliders.append(cape.Box(center=np.array([0.0, 1.0, 0.0])))
    if more == "ellipsoid":
        colliders.append(Ellipsoid(center=np.array([0.0, 1.0, 0.0]), thickness=0.03))
    bones, stiffness = {"blend": ({"rod": 1.0, "hook": 1.0}, None), "soft": ("rod", 50.0)}.get(more, ("rod", None))
    along = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]] if more == "sliding" else None
    holds = [
        cape.attach(cloth, bones, "top_left", stiffness=stiffness),
        cape.attach(cloth, "rod", "top_right", along=along),
    ]
    bounds = {"max distance": {"max_distance": 1.0}, "backstop": {"backstop": 0.1}}.get(more)
    scene = cape.Scene(
        cloth, holds, colliders,
        confinements=[] if bounds is None else [cape.confine(cloth, "rod", **bounds)],
        tethers=cape.Tethers() if more == "tethers" else None,
        wind={"wind": cape.Wind(), "eddies": cape.Wind(turbulence=0.5)}.get(more),
        self_contact=cape.SelfContact() if more == "self-contact" else None,
        strain_limit=more == "strain limit",
        tearing=cape.Tearing(strain=1.0) if more == "tearing" else None,
    )
    solver = {"xpbd": cape.XPBD(), "implicit": cape.BackwardEuler(precision="single")}
    chosen = solver.get(more, cape.SymplecticEuler(precision="single"))
    simulation = cape.Simulation(scene, solver=chosen, threads=2 if more == "thread" else 1)
    still = dict.fromkeys(("rod", "hook"), ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]))
    simulation.start(still)
    for _ in range(2):
        simulation.step(still, 1 / 60)
    height = float(simulation.positions[:, 2].min())
    return {"asked": {request.file: request.name for request in asked}, "height": height}

seen = {more: run(more) for more in sys.argv[2:]}
print(json.dumps({"seen": seen, "compiled": sorted(store.compiled), "numba": "numba" in sys.modules}))
"""


class Seen(NamedTuple):
    asked: dict[str, dict[str, str]]
    compiled: list[str]
    numba: bool


def run(*scenes: str, folder: Path | None = None) -> Seen:
    """Small cloths that hang beside a sphere, each with more in the scene: the code that they asked for, file and name.

    Also what was compiled: without a folder of their own, what the suite hasn't needed before.
    """
    environment = {} if folder is None else {"NUMBA_CACHE_DIR": str(folder)}
    told = json.loads(python(SCRIPT, "helped" if folder is None else "alone", *scenes, **environment))
    for one in told["seen"].values():
        assert -0.3 < one["height"] < -0.15
    return Seen({more: one["asked"] for more, one in told["seen"].items()}, told["compiled"], told["numba"])


BARE = {
    "run_frame", "begin_motion", "move_on", "grid_springs", "advance", "lift_attached", "hold_attached", "find_nearby",
    "watch_tiles", "keep_out", "nearest", "gaps of capsule", "whereabouts", "is_grid_strained",
}  # fmt: skip

OWN = {
    "wind": {"grid_air", "skin_drag"},
    "eddies": {"grid_air", "skin_drag", "blow_on", "against_stream"},  # the same two
    "box": {"nearest", "gaps of box", "planes of box", "wake_faces", "keep_faces_out"},
    "ellipsoid": {"nearest", "gaps of ellipsoid"},  # in so thick a skin that no triangle can touch it
    "self-contact": {"press", "keep_apart", "look_ahead", "search_pairs"},
    "blend": {"lift_attached", "hold_attached"},  # the same for several bones a vertex
    "tethers": {"keep_tethered"},
    "max distance": {"keep_near"},
    "backstop": {"keep_in_front"},
    "sliding": {"slide"},
    "soft": {"aim_pull", "pull_vertices"},
    # The last two with colliders.
    "strain limit": {"limit_down", "limit_across", "is_strained", "begin_drawing", "end_drawing"},
    "tearing": {"stray_springs", "gauge_grid", "bear"},
    "thread": {"wait_for_all"},
    "xpbd": {"fall_all", "drift_all", "prepare_grid", "solve_grid", "aim_attached"},
    "implicit": {
        "place_bones", "place_attached", "note_motion", "aim_backward", "solve_stage", "evaluate", "aim_newton_step",
        "linearise_springs", "set_own", "start_diagonal", "add_grid_diagonal", "invert_diagonal", "multiply_own",
        "multiply_grid", "find_touchable", "press_colliders", "add_contact_blocks",
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def asked() -> dict[str, dict[str, str]]:
    """The code that each scene asks for."""
    return run("nothing", *OWN).asked


def test_a_bare_scene_needs_no_more_than_this(asked: dict[str, dict[str, str]]):
    assert sorted(asked["nothing"].values()) == sorted(BARE)


@pytest.mark.parametrize("more", OWN)
def test_more_in_a_scene_needs_what_belongs_to_it_and_nothing_else(asked: dict[str, dict[str, str]], more: str):
    own = [name for file, name in asked[more].items() if file not in asked["nothing"]]
    assert sorted(own) == sorted(OWN[more])


def test_what_is_asked_for_and_missing_is_compiled_and_nothing_else(asked: dict[str, dict[str, str]], tmp_path: Path):
    kept = store.folder()
    assert kept is not None
    (tmp_path / "cape").mkdir()
    for file in asked["nothing"]:
        shutil.copy(kept / file, tmp_path / "cape")
    bare = run("nothing", folder=tmp_path)
    assert bare.compiled == []
    assert not bare.numba
    # What is cheapest to compile.
    more = run("thread", folder=tmp_path)
    assert more.compiled == sorted(OWN["thread"])
    assert {path.name for path in (tmp_path / "cape").iterdir()} == {*asked["nothing"], *asked["thread"]}
