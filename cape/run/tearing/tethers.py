"""How the tethers of a grid follow what has split, in place."""

import numpy as np

from cape.assembly.assemble import Assembly
from cape.assembly.holding import tethers_along
from cape.kernels.calling import Bound
from cape.kernels.store import Request
from cape.kernels.tearing.ways import Ways, measure_ways


def requests(assembly: Assembly) -> list[Request]:
    """The code that `let_go` needs, to be compiled together with other code."""
    return [] if assembly.tethers is None else [Bound(measure_ways, _ways(assembly)).request]


def let_go(assembly: Assembly) -> None:
    """Measure tethers anew along the springs that are left, and let go what none of them joins to what is held."""
    scene, tethers = assembly.scene, assembly.tethers
    if scene.tethers is None or tethers is None:
        return
    ways = _ways(assembly)
    Bound(measure_ways, ways)()
    tethers.anchor[:], tethers.length[:] = tethers_along(scene.tethers, ways.distances, ways.nearest, ways.held)


def _ways(assembly: Assembly) -> Ways:
    """The springs of an assembly as they are now, and room for how far vertices are from what is held hard."""
    springs, attached, count = assembly.springs, assembly.attached, assembly.cloth.vertices
    assert attached is not None
    ends = springs.first, springs.second, springs.rest
    return Ways(*ends, attached.vertices, np.zeros(count), np.zeros(count, np.int64))
