"""Which textile tests there are, and what each is done with."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

from cape.cloth.fabrics import FABRICS, MEASUREMENTS
from cape.report.measured.world import cantilever, drape, pendulum, stretch
from cape.report.measured.world.pieces import GRID
from cape.report.measured.world.rows import Row
from cape.report.measured.world.triangulations import DISC_KINDS, KINDS
from cape.solvers import SOLVERS
from motions.errors import UnknownNameError

# Cut from meshes too, besides the softest and the stiffest: one that bends and stretches by its threads most unlike.
UNEVEN = "tablecloth"
FEW_STARTS = 2  # of drapes that nothing is expected of
DIRECTIONS = ("warp", "weft")


class Trial(NamedTuple):
    """A part of a test: `run` gives its rows."""

    name: str
    run: Callable[[], list[Row]]


def trials_of(tests: Sequence[str]) -> list[Trial]:
    """All parts of these tests.

    Raises:
        UnknownNameError: there is no such test.
    """
    for name in tests:
        if name not in TESTS:
            raise UnknownNameError("textile test", name, tuple(TESTS))
    return [trial for name in tests for trial in TESTS[name]()]


def summed_up(rows: list[Row]) -> list[Row]:
    """The rows, and what only several of them tell."""
    return [*rows, *drape.agreement([row for row in rows if row.test == drape.TEST])]


def _meshed() -> tuple[str, ...]:
    return tuple(dict.fromkeys((*drape.softest_and_stiffest(), UNEVEN)))


def _pieces() -> Iterator[tuple[str, str]]:
    """Each fabric on a grid, and some on each kind of mesh."""
    for name in FABRICS:
        for variant in (GRID, *(KINDS if name in _meshed() else ())):
            yield name, variant


def _cantilevers() -> Iterator[Trial]:
    for name, variant in _pieces():
        for direction in DIRECTIONS:
            run = partial(cantilever.measure, name, direction, variant)
            yield Trial(f"cantilever of {name}, {direction}, {variant}", partial(_alone, run))


def _drapes() -> Iterator[Trial]:
    both = drape.softest_and_stiffest()
    for name in FABRICS:
        measured = name in MEASUREMENTS and MEASUREMENTS[name].drape is not None
        starts = drape.STARTS if name in both or measured else FEW_STARTS
        for variant in DISC_KINDS if name in both else (drape.SINGLE,):
            yield Trial(f"drape of {name}, {variant}", partial(drape.measure, name, variant, starts))
        if name in both:
            run = partial(drape.measure, name, drape.SINGLE, FEW_STARTS, spacing=drape.FINER)
            yield Trial(f"drape of {name}, finer", run)
        if measured:
            yield Trial(f"drape of {name}, {drape.RUBBING}", partial(drape.with_friction, name))


def _tensions() -> Iterator[Trial]:
    for name, variant in _pieces():
        for direction in (*DIRECTIONS, *(() if variant == GRID else ("bias",))):
            yield Trial(
                f"tension of {name}, {direction}, {variant}", partial(stretch.tension, name, direction, variant)
            )


def _shears() -> Iterator[Trial]:
    for name, variant in _pieces():
        yield Trial(f"shear of {name}, {variant}", partial(_alone, partial(stretch.shear, name, variant)))


def _pendulums() -> Iterator[Trial]:
    for angle in pendulum.ANGLES:
        for solver in SOLVERS:
            run = partial(pendulum.measure, angle, solver)
            yield Trial(f"pendulum from {angle:g} degrees, {solver}", partial(_alone, run))


def _alone(run: Callable[[], Row]) -> list[Row]:
    return [run()]


TESTS: dict[str, Callable[[], Iterator[Trial]]] = {
    cantilever.TEST: _cantilevers,
    drape.TEST: _drapes,
    stretch.TENSION: _tensions,
    stretch.SHEAR: _shears,
    pendulum.TEST: _pendulums,
}
