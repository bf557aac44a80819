"""Small cloths on a regular or uneven grid, irregular meshes, and a bare run of a solver, for tests of the physics."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from cape.assembly.assemble import Assembly, assemble
from cape.assembly.springs import springs_of
from cape.bench.sheets import assemble_standing, sheet
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import locality_order, reordered
from cape.kernels.bones import Motion
from cape.kernels.state import State
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from cape.solvers import TRBDF2, XPBD, BackwardEuler, Solver, SymplecticEuler
from motions import load
from skeleton import Skeleton
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

MOVED = 0.2  # of a cell, of an irregular mesh: at 0.3 some triangles have hardly any height

DOUBLE = (SymplecticEuler(precision="double"), XPBD(precision="double"))
DEFAULTS = (SymplecticEuler(precision="single"), XPBD(precision="single"))

EVERY = (*DOUBLE, BackwardEuler(tolerance=1e-11, forcing=1e-6), TRBDF2(tolerance=1e-11, forcing=1e-6))

every_solver = pytest.mark.parametrize("solver", EVERY, ids=lambda s: s.name)
both_solvers = pytest.mark.parametrize("solver", DOUBLE, ids=lambda s: s.name)
both_by_default = pytest.mark.parametrize("solver", DEFAULTS, ids=lambda s: s.name)


def grid_cloth(
    u: ArrayLike,
    v: ArrayLike,
    fabric: Fabric,
    *,
    right: ArrayLike = (1.0, 0.0, 0.0),
    down: ArrayLike = (0.0, 0.0, -1.0),
    origin: ArrayLike = (0.0, 0.0, 0.0),
) -> GridCloth:
    """A cloth whose threads lie at the coordinates `u` across and `v` down [m], laid out along two world directions."""
    across, along = np.meshgrid(np.asarray(u, float), np.asarray(v, float))
    pattern = np.stack([across.ravel(), along.ravel()], axis=1)
    return GridCloth(
        rows=across.shape[0],
        columns=across.shape[1],
        pattern=pattern,
        positions=np.asarray(origin, float) + pattern @ np.array([right, down], float),
        fabric=fabric,
    )


def mesh_cloth(u: ArrayLike, v: ArrayLike, fabric: Fabric, **where: ArrayLike) -> MeshCloth:
    """The same as a triangle mesh."""
    grid = grid_cloth(u, v, fabric, **where)
    return Cloth.from_mesh(grid.positions, grid.triangles, pattern=grid.pattern, fabric=fabric)


def irregular(cloth: GridCloth, rng: np.random.Generator, moved: float = MOVED) -> MeshCloth:
    """A flat grid with cells split along random diagonals, and inner vertices moved by up to a share of a cell.

    No springs along its edges can be the fabric, so that its material is a membrane.
    """
    rows, columns = cloth.rows, cloth.columns
    y, x = np.divmod(np.arange(cloth.vertices), columns)
    inner = np.flatnonzero((x > 0) & (x < columns - 1) & (y > 0) & (y < rows - 1))
    by = moved * rng.uniform(-1.0, 1.0, (len(inner), 2))

    def places(start: FloatArray) -> FloatArray:
        across, down = start[inner + 1] - start[inner], start[inner + columns] - start[inner]
        found = start.copy()
        found[inner] += by[:, :1] * across + by[:, 1:] * down
        return found

    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    flip = rng.random(len(a))[:, None] < 0.5
    one = np.where(flip, np.stack([a, c, d], axis=1), np.stack([a, c, b], axis=1))
    two = np.where(flip, np.stack([a, d, b], axis=1), np.stack([d, b, c], axis=1))
    faces, fabric = np.concatenate([one, two]), cloth.fabric
    return Cloth.from_mesh(places(cloth.positions), faces, pattern=places(cloth.pattern), fabric=fabric)


def irregular_swing(vertices: int) -> tuple[Assembly, BoneTrack]:
    """The sheet of `cape bench` of about so many vertices as an irregular mesh, and the motion of its bones."""
    swinging = sheet(vertices)
    grid = swinging.scene.cloth
    assert isinstance(grid, GridCloth)
    cloth = irregular(grid, np.random.default_rng(0))
    cloth = reordered(cloth, locality_order(cloth.faces, cloth.positions))
    top = np.flatnonzero(cloth.pattern[:, 1] == 0.0)
    held = [attach(cloth, a.bone, top) for a in swinging.scene.attachments]
    assembly = assemble_standing(replace(swinging.scene, cloth=cloth, attachments=held))
    assert assembly.springs.membrane is not None
    return assembly, swinging.track


class Run:
    """A solver at work on a scene, with nothing in between: any initial velocity, any pose of the bones.

    Bones start at the origin of the world, unturned, so that they hold vertices where the cloth starts.
    """

    def __init__(self, scene: Scene, solver: Solver, *, velocities: ArrayLike = 0.0, threads: int = 1) -> None:
        self.solver, self.scene = solver, scene
        self.assembly = assemble(scene, [a.vertices for a in scene.attachments], threads=threads)
        self.threads = threads
        start = scene.cloth.positions
        speeds = np.broadcast_to(np.asarray(velocities, float), start.shape)
        start, speeds = self.assembly.inwards(start), self.assembly.inwards(speeds)
        self.state = State(*(np.array(c, dtype=solver.dtype(self.assembly)) for c in (*start.T, *speeds.T)))
        self.running = solver.init(self.assembly, self.state)
        attached = self.assembly.attached
        if attached is not None:
            attached.points[:] = start[attached.vertices]
        bones = len(scene.bones)
        self.pose = (np.zeros((bones, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (bones, 1)))

    def step(self, duration: float, substeps: int, pose: tuple[ArrayLike, ArrayLike] | None = None) -> int:
        """Advance by `duration` [s] while the bones move to `pose`: positions (B, 3) and rotations wxyz (B, 4)."""
        following = self.pose if pose is None else (np.array(pose[0], float), np.array(pose[1], float))
        motion = Motion(*(_with_world(*self.pose)), *(_with_world(*following)))
        unconverged = self.solver.step(self.running, motion, duration=duration, substeps=substeps, threads=self.threads)
        self.pose = following
        attached = self.assembly.attached
        if attached is not None:
            attached.lift[:] += duration * attached.drift
        return unconverged

    def settle(self, frames: int, substeps: int, *, damping: float = 0.9) -> None:
        """Let the cloth come to rest, its velocity damped after each frame at 60 Hz."""
        for _ in range(frames):
            self.step(1 / 60, substeps)
            for component in self.state[3:]:
                component *= damping

    def stable_substeps(self, duration: float = 1 / 60) -> int:
        """Number of substeps at which symplectic Euler is stable, whatever the run's own solver."""
        euler = SymplecticEuler(precision=self.solver.precision)
        return euler.choose_substeps(euler.init(self.assembly, self.state), duration)

    @property
    def positions(self) -> FloatArray:
        return self.assembly.outwards(np.stack(self.state[:3], axis=1).astype(float))

    @property
    def velocities(self) -> FloatArray:
        return self.assembly.outwards(np.stack(self.state[3:], axis=1).astype(float))

    @property
    def momentum(self) -> FloatArray:
        return self.assembly.mass @ self.velocities

    @property
    def angular_momentum(self) -> FloatArray:
        """About the world's origin [kg m2/s]."""
        return self.assembly.mass @ np.cross(self.positions, self.velocities)

    @property
    def kinetic_energy(self) -> float:
        return float(0.5 * self.assembly.mass @ np.sum(self.velocities**2, axis=1))

    @property
    def elastic_energy(self) -> float:
        return spring_energy(self.scene.cloth, self.positions) + bend_energy(self.scene.cloth, self.positions)


def spring_energy(cloth: Cloth, positions: FloatArray) -> float:
    """Energy of the springs between two vertices at the given positions [J]."""
    springs = springs_of(cloth)
    lengths = np.linalg.norm(positions[springs.second] - positions[springs.first], axis=1)
    return float(0.5 * springs.stiffness @ (lengths - springs.rest) ** 2)


def bend_energy(cloth: Cloth, positions: FloatArray) -> float:
    """Energy of the bend springs at the given positions [J]."""
    springs = springs_of(cloth)
    bend = np.einsum("km,kmc->kc", springs.bend_coefficients, positions[springs.bend_vertices])
    return float(0.5 * springs.bend_stiffness @ np.sum(bend**2, axis=1))


def turn_about(axis: Sequence[float], angle: float) -> FloatArray:
    """Unit quaternion wxyz of a turn by `angle` [rad] about a unit axis."""
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.asarray(axis))])


def _with_world(positions: FloatArray, rotations_wxyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Add the bone that stands for the world."""
    return np.vstack([positions, np.zeros((1, 3))]), np.vstack([rotations_wxyz, [[1.0, 0.0, 0.0, 0.0]]])


def walking(seconds: float) -> tuple[Skeleton, BoneTrack]:
    """Who walks in the shipped clip, and the beginning of that walk."""
    clip = load("walk").trim(0.0, seconds)
    body = Skeleton.from_clip(clip)
    return body, body.track(clip)
