"""`cape warm-up`: code compiled ahead, of the same scenes that commands simulate."""

import json as json_format
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from cape.cli.character import Character, read_character
from cape.cli.commands.replay import Cut
from cape.cli.figures.rows import print_rows
from cape.cli.reading import Reading
from cape.kernels import store
from cape.kernels.jit import COMPILER_OFF
from cape.kernels.store import Request
from cape.run.simulate import requests_of
from cape.scene.scene import Scene
from cape.solvers import SOLVERS, Solver, SymplecticEuler
from cape.solvers.threads import available_cores
from skeleton.shapes import SHAPES, Shape

COARSE = 0.06  # m between vertices: code is the same for a cloth of any size
THIN = 0.01  # m: what pokes through between vertices


def run(*, everything: bool, json: bool) -> int:
    """Compile what is missing for the default replay, or for all there is; gives the exit status."""
    begun = time.perf_counter()
    who = read_character(Reading("walk", end=0.1))
    wanted = list(dict.fromkeys(_all_requests(who) if everything else _usual_requests(who)))
    lacking = [] if COMPILER_OFF else store.missing(wanted)
    store.prepare(lacking)
    folder = store.folder()
    facts = {
        "pieces": len(wanted),
        "compiled": len(lacking),
        "seconds": round(time.perf_counter() - begun, 3),
        "folder": None if folder is None else str(folder),
    }
    if json:
        print(json_format.dumps(facts))
    else:
        where = "nowhere: the folder can't be written" if folder is None else str(folder)
        rows = [("pieces of code", f"{facts['pieces']}, {facts['compiled']} of them compiled now")]
        print_rows([*rows, ("time", f"{facts['seconds']:.1f} s"), ("kept in", where)])
    return 0


def _usual_requests(who: Character) -> list[Request]:
    """What `cape replay` asks for."""
    cut = Cut()
    return requests_of(cut.scene(who), who.track, solver=cut.method())


def _all_requests(who: Character) -> Iterator[Request]:
    """What commands may ask for: capes as they are dressed, on any solids or none, with any solver, on any threads."""
    yield from _usual_requests(who)
    for self_contact in (False, True):
        scene = Cut(spacing=COARSE, self_contact=self_contact).scene(who)
        for colliders in ((*scene.colliders, *_shapes()), ()):
            for solver in _solvers():
                yield from _requests(replace(scene, colliders=colliders), who, solver)


def _requests(scene: Scene, who: Character, solver: Solver) -> Iterator[Request]:
    """What a scene asks for with a solver, on one thread and on several, and where hands may take hold of it."""
    for threads in sorted({1, min(2, available_cores())}):
        yield from requests_of(scene, who.track, solver=solver, threads=threads, cull=False, hands=1)


def _solvers() -> Iterator[Solver]:
    """Each solver; symplectic Euler also as it chooses to be where steps are very short."""
    for solver in SOLVERS.values():
        yield solver()
    yield SymplecticEuler(precision="double")


def _shapes() -> Iterator[Shape]:
    """A thin solid of each kind that there is."""
    for word, shape in SHAPES.items():
        values: dict[str, Any] = {"name": word, "bone": None}
        for label, size in shape.numbers.items():
            if label not in shape.optional:
                value = THIN * len(values)  # each another one: a solid may not end where it starts
                values[label] = np.full(size, value) if size else value
        yield shape(**values)
