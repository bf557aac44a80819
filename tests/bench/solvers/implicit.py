"""What a step of the implicit solvers costs, and the iterations that it takes, over the size of the cloth.

    python -m tests.bench.solvers.implicit [vertices ...]

The sheet of `cape bench` as a grid, as a mesh, and as a membrane: with cells split along random diagonals and vertices
moved by up to a fifth of a cell, where no springs can be the fabric. It is of fixed physical size, on one thread. Times
are CPU times, the least of some frames in turn, per vertex and step [ns]; iterations are means over the frames of one
round: of Newton's method in a stage, of conjugate gradients in a Newton step. `growth` is the cost over that of the
first size, `grid` that over the grid's.
"""

import math
import sys
import time

import numpy as np

from cape.bench.sheets import assembled
from cape.bench.subject import Subject
from cape.kernels.implicit.implicit import LINEAR, NEWTON, UNSOLVED
from cape.solvers import TRBDF2, BackwardEuler
from tests.support.scenes import irregular_swing

LAYOUTS = ("grid", "mesh", "membrane")
SIZES = (1_536, 4_704, 10_000, 20_000)
REPEATS, FRAMES = 5, 8  # rounds, and frames of each; the same frames in every round
STAGES = {BackwardEuler: 1, TRBDF2: 2}


def subject_of(vertices: int, layout: str, solver: BackwardEuler | TRBDF2) -> Subject:
    """A solver at work on the sheet."""
    return Subject(*(irregular_swing(vertices) if layout == "membrane" else assembled(vertices, layout)), solver)


def round_of(subject: Subject) -> tuple[float, np.ndarray]:
    """Mean CPU time of a vertex's step [ns] over some frames, and what was counted in them."""
    counts, spent = np.zeros(4), 0.0
    subject.rewind()
    for _ in range(max(1, round(FRAMES * subject.frame_substeps / subject.substeps))):
        begun = time.process_time()
        subject.call()
        spent += time.process_time() - begun
        counts += subject.running.arrays.counts[0]
    calls = counts[NEWTON] and max(1, round(FRAMES * subject.frame_substeps / subject.substeps))
    return 1e9 * spent / subject.units / calls, counts / calls


def main(sizes: tuple[int, ...] = SIZES) -> None:
    """Print a row for each solver, layout and size."""
    cases = [(kind, layout, size) for kind in STAGES for layout in LAYOUTS for size in sizes]
    subjects = [subject_of(size, layout, kind()) for kind, layout, size in cases]
    for subject in subjects:
        subject.call()
        subject.prepare()
    cost, counts = dict.fromkeys(cases, math.inf), {}
    for _ in range(REPEATS):
        for case, subject in zip(cases, subjects, strict=True):
            spent, counts[case] = round_of(subject)
            cost[case] = min(cost[case], spent)
    print("solver          layout   vertices      ns  growth    grid  newton  linear  unsolved")
    for (kind, layout, size), subject in zip(cases, subjects, strict=True):
        ns, found = cost[kind, layout, size], counts[kind, layout, size]
        print(
            f"{kind.name:15} {layout:8} {subject.assembly.cloth.vertices:8} {ns:7.0f} "
            f"{ns / cost[kind, layout, sizes[0]]:7.2f} {ns / cost[kind, LAYOUTS[0], size]:7.2f} "
            f"{found[NEWTON] / STAGES[kind] / subject.substeps:7.2f} {found[LINEAR] / found[NEWTON]:7.1f} "
            f"{found[UNSOLVED]:9.2f}"
        )


if __name__ == "__main__":
    main(tuple(map(int, sys.argv[1:])) or SIZES)
