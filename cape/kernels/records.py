"""The arrays that kernels work on, in named groups. N vertices, B bones; a group that a scene lacks is None."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Indices = NDArray[np.int64]


class State(NamedTuple):
    """Positions [m] and velocities [m/s] of the vertices, each of shape (N,), in the cloth's precision."""

    x: Array
    y: Array
    z: Array
    vx: Array
    vy: Array
    vz: Array


class GridSprings(NamedTuple):
    """Springs of a grid cloth by family, zero where a spring would leave the grid.

    `offsets` (4,) to the right, down and along both diagonals; `stiffness` [N/m] and `rest` [m] (4, N); `bend_offsets`
    (2,) and `bend_stiffness` [N/m] (2, N); `inverse_mass` [1/kg] (N,), zero for attached vertices; damping times [s].
    """

    offsets: Indices
    stiffness: Array
    rest: Array
    bend_offsets: Indices
    bend_stiffness: Array
    inverse_mass: Array
    damping_time: float
    bend_damping_time: float
    gravity: Array


class Constraints(NamedTuple):
    """XPBD constraints, sorted by colour: E stretch constraints between two vertices with rest lengths [m] and K bend
    constraints on three, compliances [m/N], room for their multipliers (E,) and (3, K); the rest as in GridSprings."""

    first: Indices
    second: Indices
    rest: Array
    compliance: Array
    lagrange: Array
    bend_first: Indices
    bend_middle: Indices
    bend_last: Indices
    bend_compliance: Array
    bend_lagrange: Array
    inverse_mass: Array
    damping_time: float
    bend_damping_time: float
    gravity: Array


class Motion(NamedTuple):
    """Poses of the bones at a frame's start (positions [m] (B, 3), rotations bone_to_world wxyz (B, 4)) and its end."""

    position0: Array
    rotation0: Array
    position1: Array
    rotation1: Array


class MotionRoom(NamedTuple):
    """What `bones.start_motion` and `bones.move_bones` fill: see there."""

    matrices: Array
    turns: Array
    velocity: Array
    spin: Array
    positions: Array


class Attached(NamedTuple):
    """Vertices (n,) held at points [m] (n, 3) of their bones (n,)."""

    vertices: Indices
    bones: Indices
    points: Array


class Air(NamedTuple):
    """Uniform wind [m/s] (3,), rho Cd / 12 and rho Cl / 12 [kg/m3], and 1 where a grid cell starts, (N,)."""

    wind: Array
    drag: float
    lift: float
    cells: Array
    columns: int
    room: Array


class Capsules(NamedTuple):
    """Capsules by bone (C,), ends in the bone's frame [m] (C, 3), radius [m] and friction (C,); room for where
    they are in the world (C, 8), for those near each block of vertices (blocks, C + 1) and for a block (BLOCK,)."""

    bones: Indices
    starts: Array
    ends: Array
    radius: Array
    friction: Array
    placed: Array
    near: Indices
    touched: Indices


class Planes(NamedTuple):
    """Planes by bone (P,), points [m] and unit normals in the bone's frame (P, 3), friction (P,)."""

    bones: Indices
    points: Array
    normals: Array
    friction: Array


class Boxes(NamedTuple):
    """Boxes by bone (K,), centres in the bone's frame [m] (K, 3), half sizes [m] (K, 3), box_to_bone (K, 3, 3),
    friction (K,), and room for a box_to_world (3, 3)."""

    bones: Indices
    centers: Array
    halves: Array
    frames: Array
    friction: Array
    room: Array


class Contacts(NamedTuple):
    """What the cloth can't enter, at a distance of `thickness` [m]; `free` (N,) is False for attached vertices."""

    free: NDArray[np.bool_]
    thickness: float
    capsules: Capsules | None
    planes: Planes | None
    boxes: Boxes | None
