"""The multigrid preconditioner as units: what sets it up, what applies it; see `cape.kernels.implicit.multigrid`."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.multigrid.levels import LinkBlocks, lay_out_levels
from cape.cloth.cloth import GridCloth
from cape.kernels.cloth.mesh_bending import SIDE
from cape.kernels.implicit.levels import Above, FirstLevel, gather_level, gather_links, gather_vertices
from cape.kernels.implicit.multigrid import (
    ByOne,
    by_one,
    find_left,
    finish,
    pack_residual,
    pull_grid,
    pull_left,
    pull_mesh,
    push_back,
    push_grid,
    push_mesh,
)
from cape.kernels.implicit.stiffness import Matrix
from cape.kernels.linking import Linker
from cape.kernels.program import Use
from cape.kernels.team import Team
from cape.solvers.order import wait
from cape.solvers.running import Thread


class Levels(NamedTuple):
    """The levels above a cloth: the first, and those above it, each with the one below."""

    first: FirstLevel
    above: tuple[Above, ...]


def levels_of(
    assembly: Assembly, matrix: Matrix, links: LinkBlocks | None, terms: NDArray[np.floating]
) -> Levels | None:
    """The levels above a cloth, None for one of few vertices, or without links.

    `terms` (L,) is room for those of a dot product.
    """
    if links is None:
        return None
    cloth = assembly.cloth
    columns = cloth.columns if isinstance(cloth, GridCloth) else None
    levels, between = lay_out_levels(
        links, cloth.positions, assembly.free, columns=columns, dtype=matrix.inverse.dtype.type,
        ranks=len(assembly.ranks),
    )  # fmt: skip
    if not levels:
        return None
    packed = np.zeros(0 if between is not None else SIDE * (cloth.vertices + 1), matrix.inverse.dtype)
    first = FirstLevel(matrix, levels[0], links.coefficients, links.stride, terms, between, packed)
    return Levels(first, tuple(Above(finer, level) for finer, level in pairwise(levels)))


def multigrid(thread: Thread, levels: Levels | None, linker: Linker) -> tuple[list[Use], list[Use]]:
    """What sets up the levels once the matrix is linearised, and what they add to a preconditioned residual.

    Threads share the work on the first level alone.
    """
    if levels is None:
        return [], []
    (first, above), pause = levels, wait(thread)
    pull, push = (pull_mesh, push_mesh) if first.between is None else (pull_grid, push_grid)
    gathering = [*pause, Use(gather_links, first), *pause, Use(gather_vertices, first)]
    correction = [*([Use(pack_residual, first)] if first.between is None else []), *pause, Use(pull, first)]
    if above:
        alone = Team.alone(0)
        gather = linker.program([Use(gather_level, level) for level in above])
        cycle = linker.program(_cycle(above))
        gathering += [*pause, Use(by_one, ByOne(gather, alone))]
        correction += [*pause, Use(find_left, first.level), *pause, Use(by_one, ByOne(cycle, alone))]
        correction.append(Use(push_back, above[0]))
    correction += [*pause, Use(finish, first.level), *pause, Use(push, first)]
    return gathering, correction


def _cycle(above: tuple[Above, ...]) -> list[Use]:
    """A V-cycle over the levels above the first: down to the coarsest, and back."""
    down: list[Use] = []
    up: list[Use] = []
    for here, coarser in zip(above, [*above[1:], None], strict=True):
        down.append(Use(pull_left, here))
        back = [Use(finish, here.level)]
        if coarser is not None:
            down.append(Use(find_left, here.level))
            back.insert(0, Use(push_back, coarser))
        up = [*back, *up]
    return down + up
