"""What is compiled: for a scene once, and for more in it what belongs to that and nothing else. Needs the compiler."""

import json
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.code import compiled_only
from tests.support.processes import python

pytestmark = compiled_only

SCRIPT = """
import json, sys
import numpy as np
import cape
from cape.kernels import compiling, store
compiling._cores = lambda: 0  # no helpers: all is compiled here
from skeleton.shapes import Ellipsoid
more = set(sys.argv[1:])
cloth = cape.Cloth.rectangle(width=0.2, height=0.2, spacing=0.05)
colliders = [cape.Sphere(radius=0.3, center=np.array([0.0, 1.0, 0.0]))]
if "box" in more:
    colliders.append(cape.Box(center=np.array([0.0, 1.0, 0.0])))
if "ellipsoid" in more:
    colliders.append(Ellipsoid(center=np.array([0.0, 1.0, 0.0]), thickness=0.03))
scene = cape.Scene(
    cloth, [cape.attach(cloth, "rod", "top")], colliders,
    wind=cape.Wind() if "wind" in more else None,
    self_contact=cape.SelfContact() if "self-contact" in more else None,
)
solver = {"xpbd": cape.XPBD(), "implicit": cape.BackwardEuler(precision="single")}
chosen = next((solver[name] for name in more if name in solver), cape.SymplecticEuler(precision="single"))
simulation = cape.Simulation(scene, solver=chosen, threads=2 if "thread" in more else 1)
still = {"rod": ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}
simulation.start(still)
for _ in range(2):
    simulation.step(still, 1 / 60)
height = float(simulation.positions[:, 2].min())
print(json.dumps({"compiled": sorted(store.compiled), "numba": "numba" in sys.modules, "height": height}))
"""


class Seen(NamedTuple):
    compiled: list[str]
    numba: bool
    height: float


def run(folder: Path, *more: str) -> Seen:
    """A small cloth that hangs beside a sphere, and what was compiled for it, with code kept in a folder."""
    seen = Seen(**json.loads(python(SCRIPT, *more, NUMBA_CACHE_DIR=str(folder))))
    assert -0.3 < seen.height < -0.15
    return seen


BARE = {
    "run_frame", "begin_motion", "move_on", "grid_springs", "advance", "lift_attached", "hold_attached", "find_nearby",
    "watch_tiles", "keep_out", "nearest", "gaps of capsule", "whereabouts", "is_strained",
}  # fmt: skip


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the code of the bare scene."""
    folder = tmp_path_factory.mktemp("code")
    first = run(folder)
    assert first.compiled == sorted(BARE)
    again = run(folder)
    assert again.compiled == []
    assert not again.numba
    return folder


OWN = {
    "wind": {"grid_air", "skin_drag"},
    "box": {"nearest", "gaps of box", "planes of box", "wake_faces", "keep_faces_out"},
    "ellipsoid": {"nearest", "gaps of ellipsoid"},  # in so thick a skin that no triangle can touch it
    "self-contact": {"press", "keep_apart", "search_pairs"},
    "thread": {"wait_for_all"},
    "xpbd": {"fall_all", "drift_all", "prepare_grid", "solve_grid", "aim_attached"},
    "implicit": {
        "place_bones", "place_attached", "note_motion", "aim_backward", "solve_stage", "evaluate", "aim_newton_step",
        "linearise_springs", "set_own", "start_diagonal", "add_grid_diagonal", "invert_diagonal", "multiply_own",
        "multiply_grid", "find_touchable", "press_colliders", "add_contact_blocks",
    },
}  # fmt: skip


@pytest.mark.parametrize("more", OWN)
def test_more_in_a_scene_compiles_what_belongs_to_it_and_nothing_else(known: Path, more: str):
    seen = run(known, more)
    assert seen.compiled == sorted(OWN[more])
