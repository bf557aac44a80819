"""How stiff edges and cross springs of a mesh are in its plane, from the fits of their patches.

See `cape.assembly.mesh.in_plane`, where all is by side, too.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int64]

# An edge keeps at least this share of what it would carry if the cloth were stretched along it and nothing else held.
LEAST_SHARE = 0.01
# A cross spring with less than this share is left out.
NEGLIGIBLE = 1e-3


class Fits(NamedTuple):
    """What `cape.assembly.mesh.in_plane.InPlane` holds under the same names, of T triangles and their 3 T sides."""

    area: FloatArray
    pull: FloatArray
    mate: Indices
    weight: FloatArray
    cross: FloatArray
    trust: FloatArray
    length: FloatArray
    cross_length: FloatArray
    alone: FloatArray


@routine
def edges_stiffness(fits, sides, found):
    """Set the stiffness of the edges that some sides (n,) are [N/m], shape (n,)."""
    for k in range(sides.size):
        found[k] = edge_stiffness(fits, sides[k])


@routine
def crosses_stiffness(fits, sides, found):
    """Set the stiffness of the cross springs over the edges that some sides (n,) are [N/m], shape (n,); 0 for none."""
    for k in range(sides.size):
        found[k] = cross_stiffness(fits, sides[k])


@routine
def areas_taken(fits, sides, found):
    """Set the area that the patches of edges get of their two triangles [m2], shape (n,); 0 at borders."""
    for k in range(sides.size):
        found[k] = area_taken(fits, sides[k])


@routine
def edge_stiffness(fits, side):
    """Stiffness of the edge that a side is [N/m]."""
    mate = fits.mate[side]
    carried = add_beside(fits, side, area_taken(fits, side) * fits.weight[side, 0])
    if mate != side:
        carried = add_beside(fits, mate, carried)
    return max(carried, LEAST_SHARE * drawn_along(fits, side)) / edge_length(fits, side) ** 2


@inlined
def add_beside(fits, side, carried):
    """Add what the patches of the other two sides of a side's triangle ask of it, and the triangle if it is alone."""
    for step in range(1, 3):
        before = next_side(side, 3 - step)
        carried += area_taken(fits, before) * fits.weight[before, step]
    return carried + carried_alone(fits, side)


@inlined
def carried_alone(fits, side):
    """What a side carries of a triangle without neighbours, which has no patches [N m]."""
    return fits.alone[side // 3, side % 3] if is_alone(fits, side // 3) else 0.0


@inlined
def is_alone(fits, t):
    """Whether a triangle has no neighbours."""
    return (fits.mate[3 * t] == 3 * t) & (fits.mate[3 * t + 1] == 3 * t + 1) & (fits.mate[3 * t + 2] == 3 * t + 2)


@routine
def cross_stiffness(fits, side):
    """Stiffness of the cross spring over the edge that a side is [N/m]; 0 for none."""
    carried = area_taken(fits, side) * fits.cross[side]
    return 0.0 if carried < NEGLIGIBLE * drawn_along(fits, side) else carried / fits.cross_length[side] ** 2


@routine
def area_taken(fits, side):
    """Area that the patch of an edge gets of its two triangles [m2]; 0 at a border."""
    return share_taken(fits, side, side) + share_taken(fits, side, fits.mate[side])


@inlined
def share_taken(fits, side, own):
    """Area that the patch of an edge gets of the triangle of one of its sides [m2]."""
    t = own // 3
    total = fits.trust[3 * t] + fits.trust[3 * t + 1] + fits.trust[3 * t + 2]
    return fits.trust[side] * fits.area[t] / (total if total > 0.0 else 1.0)


@inlined
def drawn_along(fits, side):
    """The lesser stiffness of threads times a third of the area beside an edge [N m]."""
    mate = fits.mate[side]
    beyond = 0.0 if mate == side else fits.area[mate // 3] / 3.0
    return fits.pull[side // 3] * (fits.area[side // 3] / 3.0 + beyond)


@inlined
def edge_length(fits, side):
    """Rest length of the edge that a side is [m]."""
    return 0.5 * (fits.length[side] + fits.length[fits.mate[side]])


@inlined
def next_side(side, step):
    """The side of the same triangle that many steps after one."""
    return side - side % 3 + (side + step) % 3
