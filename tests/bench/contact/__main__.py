"""How good contact is: depths on real motions, rest, its cost, fast limbs, many colliders.

    python -m tests.bench.contact [--case clips rest cost limb many] [--clip walk run] [--solver euler] [--json FILE]

Depths are measured by `cape.results.penetration`, apart from what a solver believes. `clips` takes the shipped clips
and the BVH files of the folder CAPE_CLIPS, where it is set. Without `--solver` the default one steps all cases but
`limb`, which takes all solvers. See `cases` for what each figure is.
"""

import argparse
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import cape
from cape import SOLVERS, Solver
from tests.bench.contact import cases
from tests.bench.contact.cases import ClipRow, CostRow, LimbRow, ManyRow, RestRow

Row = ClipRow | RestRow | CostRow | LimbRow | ManyRow
NESTED = {"by_collider"}  # for the JSON alone
WIDTHS = {"clip": 24, "scene": 20, "solver": 14, "worst_collider": 15}

TITLES = {
    "clips": "A cape on moving bodies: depths of free vertices and faces, and of all",
    "rest": "Left alone for 60 s: speeds, root mean square over the vertices",
    "cost": "What contact adds to the solver's steps on the walk",
    "limb": "A limb of 1 m driven into a hanging sheet at 60 frames a second",
    "many": "1000 colliders of which 20 are near, against those 20",
}


def clips(arguments: argparse.Namespace) -> Iterator[Row]:
    """Every clip with every solver asked for."""
    folder = os.environ.get("CAPE_CLIPS")
    for clip in cases.clip_paths(Path(folder) if folder else None, arguments.clip):
        for solver in chosen(arguments):
            yield cases.measure_clip(clip, solver)


def rest(arguments: argparse.Namespace) -> Iterator[Row]:
    """On a sphere, a cube and shoulders."""
    for name in cases.REST:
        for solver in chosen(arguments):
            yield cases.measure_rest(name, solver)


def cost(arguments: argparse.Namespace) -> Iterator[Row]:
    """With and without colliders."""
    for solver in chosen(arguments):
        yield from cases.measure_cost(solver)


def limb(arguments: argparse.Namespace) -> Iterator[Row]:
    """Two limbs at all speeds."""
    for solver in chosen(arguments) if arguments.solver else [cape.solver(name) for name in SOLVERS]:
        for name in cases.RADII:
            for speed in cases.SPEEDS:
                yield cases.measure_limb(name, speed, solver)


def many(arguments: argparse.Namespace) -> Iterator[Row]:
    """Few and many."""
    for solver in chosen(arguments):
        yield cases.measure_many(solver)


CASES: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "clips": clips, "rest": rest, "cost": cost, "limb": limb, "many": many,
}  # fmt: skip


def chosen(arguments: argparse.Namespace) -> list[Solver]:
    """The solvers asked for, the default one otherwise."""
    return [cape.solver(name) for name in arguments.solver or ("euler",)]


def print_row(row: Row, *, head: bool) -> None:
    """Print a row, with the columns' names before the first."""
    cells = {f.name: getattr(row, f.name) for f in fields(row) if f.name not in NESTED}
    texts = {name: f"{value:.3g}" if isinstance(value, float) else str(value) for name, value in cells.items()}
    widths = {name: max(len(name), WIDTHS.get(name, 7)) for name in texts}
    if head:
        print("  ".join(name.rjust(width) for name, width in widths.items()))
    print("  ".join(text.rjust(widths[name]) for name, text in texts.items()), flush=True)


def main() -> None:
    """Measure what is asked for, a table a case."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--case", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--clip", nargs="+", default=[], help="names of clips, without .bvh; all by default")
    parser.add_argument("--solver", nargs="+", choices=SOLVERS, default=[])
    parser.add_argument("--json", type=Path, help="file to write all figures to")
    arguments = parser.parse_args()
    found: dict[str, list[dict[str, Any]]] = {}
    for case in arguments.case:
        print(f"\n{TITLES[case]}\n")
        found[case] = []
        for row in CASES[case](arguments):
            print_row(row, head=not found[case])
            found[case].append(asdict(row))
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
