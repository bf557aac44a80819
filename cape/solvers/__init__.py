"""Solvers: immutable descriptions of how a cloth is advanced in time."""

from cape.solvers.base import Solver
from cape.solvers.euler import SymplecticEuler
from cape.solvers.implicit import TRBDF2, BackwardEuler
from cape.solvers.xpbd import XPBD
from motions.border import checked
from motions.errors import UnknownNameError

SOLVERS: dict[str, type[Solver]] = {
    "euler": SymplecticEuler,
    "xpbd": XPBD,
    "backward_euler": BackwardEuler,
    "tr_bdf2": TRBDF2,
}


@checked
def solver(name: str, *, substeps: int | None = None) -> Solver:
    """Give the solver of that name with its defaults, or with a number of substeps per frame.

    Raises:
        UnknownNameError: there is no such solver.
        ValueRangeError: the number of substeps is not positive.
    """
    if name not in SOLVERS:
        raise UnknownNameError("solver", name, SOLVERS)
    return SOLVERS[name](substeps=substeps)


__all__ = ["SOLVERS", "TRBDF2", "XPBD", "BackwardEuler", "Solver", "SymplecticEuler", "solver"]
