"""The arrays that kernels work on, in named groups. N vertices, B bones; a group that a scene lacks is None."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.contact.shapes import Faces, Shapes
from cape.kernels.self_contact.self_contact import Layers, Pressure

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

    @classmethod
    def at_rest(cls, positions: Array, dtype: type[np.floating]) -> "State":
        """Vertices at positions [m], shape (N, 3), without velocity; six arrays that share no memory."""
        still = (np.zeros(len(positions), dtype) for _ in range(3))
        return cls(*(np.array(p, dtype=dtype) for p in positions.T), *still)


class GridSprings(NamedTuple):
    """Springs of a grid cloth by family, zero where a spring would leave the grid.

    `offsets` (4,) to the right, down and along both diagonals; `stiffness` [N/m] and `rest` [m] (4, N).
    """

    offsets: Indices
    stiffness: Array
    rest: Array


class GridBends(NamedTuple):
    """Bend springs of a grid cloth, across and down: `offsets` (2,), `stiffness` [N/m] (2, N)."""

    offsets: Indices
    stiffness: Array


class GridAir(NamedTuple):
    """Uniform wind [m/s] (3,), rho Cd / 12 and rho Cl / 12 [kg/m3], and 1 where a grid cell starts, (N,)."""

    wind: Array
    drag: float
    lift: float
    cells: Array
    columns: int


class MeshSprings(NamedTuple):
    """Links between vertices of a mesh, each owned by one end: D rows for each block of vertices.

    `second`, the other ends, `stiffness` [N/m] and `rest` [m] of their springs, 0 and 1 for no spring, (blocks, D,
    BLOCK); `sorted_vertices` (N,), those of each block by the number of links that others own, `start` (slices + 1,)
    and `incoming`, for each of them in slices the places of those links in `forces`. Room: `words` for coordinates with
    their velocities (3, N); `room` for a block's own ends, other ends and sums, each rank using the line of its first
    block; `forces` on the other ends [N], flat, three components of BLOCK for each row of each block and of a row of
    zeros, for padding.
    """

    second: NDArray[np.uint32]
    stiffness: Array
    rest: Array
    sorted_vertices: NDArray[np.uint32]
    start: Indices
    incoming: NDArray[np.uint32]
    words: NDArray[np.generic]
    room: NDArray[np.generic]
    forces: Array


class MeshBends(NamedTuple):
    """Bending of a mesh: its force on a link's owner is `weight` [N/m] times the vector to the other end, as `rest`."""

    weight: Array


class MeshAir(NamedTuple):
    """Uniform wind [m/s] (3,), rho Cd / 12 and rho Cl / 12 [kg/m3], on triangles that one corner owns, D rows a block.

    `second` and `third` (blocks, D, BLOCK) are the other corners; the rest as in MeshSprings.
    """

    wind: Array
    drag: float
    lift: float
    second: NDArray[np.uint32]
    third: NDArray[np.uint32]
    sorted_vertices: NDArray[np.uint32]
    start: Indices
    incoming: NDArray[np.uint32]
    words: NDArray[np.generic]
    room: NDArray[np.generic]
    forces: Array


class Skin(NamedTuple):
    """Uniform wind [m/s] (3,), and the force per speed against it of air that sticks to each vertex [N s/m] (N,)."""

    wind: Array
    drag: Array


class ForceModel(NamedTuple):
    """What acts between the vertices, in the solver's precision; what a scene lacks is None.

    A cloth is either a grid or a mesh. `damping` and `bend_damping` are damping times [s].
    """

    grid: GridSprings | None
    grid_bends: GridBends | None
    grid_air: GridAir | None
    mesh: MeshSprings | None
    mesh_bends: MeshBends | None
    mesh_air: MeshAir | None
    skin: Skin | None
    damping: float | None
    bend_damping: float | None


class Team(NamedTuple):
    """One of the threads that share a cloth: its rank, how many there are, and where they meet."""

    rank: int
    size: int
    arrivals: NDArray[np.int64]


class Inertia(NamedTuple):
    """What every vertex has: `mass` [kg], `inverse_mass` [1/kg] and `free`, both zero for attached ones, all of shape
    (N,), and `gravity` [m/s2] (3,)."""

    mass: Array
    inverse_mass: Array
    free: Array
    gravity: Array


class Constraints(NamedTuple):
    """E XPBD constraints, in any arrangement: stiffness [N/m], rest length [m] (None for bend springs), the sum of
    w |grad C|^2 [1/kg], room for the gains [N s/m] of a step; and where a step has several sweeps, for what share of an
    impulse a sweep gives up and for the impulses [N s], of bend springs along all three axes."""

    stiffness: Array
    rest: Array | None
    mobility: Array
    gain: Array
    slack: Array | None
    impulse: Array | None


class GridConstraints(NamedTuple):
    """Constraints of a grid cloth by family, each at its first vertex: arrays (3, n) by hand, see `xpbd.grid`; room for
    positions and velocities there (3, 3, n)."""

    columns: int
    inverse_mass: Array
    positions: Array
    velocities: Array
    across: Constraints
    down: Constraints
    diagonal: Constraints | None
    anti: Constraints | None
    bend_across: Constraints | None
    bend_down: Constraints | None


class MeshConstraints(NamedTuple):
    """Constraints of a mesh sorted by colour: springs between two vertices each (E,), bend springs on four (K, 4);
    each colour goes from its place in `starts` to the next."""

    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    starts: Indices
    stretch: Constraints
    vertices: NDArray[np.uint32]
    coefficients: Array
    bend_starts: Indices
    bend: Constraints | None


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
    """Vertices (n,) held at points [m] (n, 3) of their bones (n,).

    `lift` [m] is how far they are held off there at a frame's start, out of colliders or where a jump of the bones has
    left them, and `drift` [m/s] how that changes in it, both (n, 3) and in the bones' frames.
    """

    vertices: Indices
    bones: Indices
    points: Array
    lift: Array
    drift: Array


class Contacts(NamedTuple):
    """What the cloth can't enter, by kind, and which vertices (N,) are `free`: False for attached ones.

    `faces` is what could poke through between vertices, None where nothing could. `layers` is what keeps the cloth off
    itself, `pressure` what acts between them, None where nothing does.
    """

    free: NDArray[np.bool_]
    groups: tuple[Shapes, ...] | None
    faces: tuple[Faces, ...] | None
    layers: Layers | None
    pressure: Pressure | None
