"""The matrix of a Newton step in double precision, for tests of the implicit solvers' kernels."""

import numpy as np

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.forces.elastic import Elastic
from cape.kernels.linking import Linker
from cape.kernels.program import run
from cape.kernels.state import State
from cape.kernels.team import Team
from cape.scene.holding.attachments import Attachment
from cape.scene.scene import Scene
from cape.solvers import TRBDF2
from cape.solvers.matrix import link_blocks, matrix_of
from cape.solvers.multigrid import levels_of
from cape.solvers.running import Running, Thread
from tests.support.scenes import Run, grid_cloth

B = 2e-3  # s
LAYOUTS = ("grid", "mesh", "membrane")
FABRIC = Fabric(stretch=300.0, shear=60.0, bend=1e-3, damping_time=1e-3, bend_damping_time=3e-3)


class Linear:
    """A cloth, its matrix at a state, and products with it and its preconditioner in double precision.

    The cloth has 4 rows of 5 vertices, two of them held, or any other number of `rows` and `columns`, 7.5 cm apart.
    """

    def __init__(
        self,
        layout: str,
        stretched: float,
        rng: np.random.Generator,
        *,
        rows: int = 4,
        columns: int = 5,
        fabric: Fabric = FABRIC,
    ) -> None:
        cloth: Cloth = grid_cloth(0.075 * np.arange(columns), 0.075 * np.arange(rows), fabric)
        if layout != "grid":
            # With the threads at an angle to the edges springs can't be the fabric, and a membrane is.
            angle = 0.4 if layout == "membrane" else 0.0
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            cloth = Cloth.from_mesh(cloth.positions, cloth.triangles, pattern=cloth.pattern @ turn, fabric=fabric)
        scene = Scene(cloth, [Attachment(vertices=np.array([0, columns - 1]), bone="hand")])
        solver = TRBDF2()
        bare = Run(scene, solver)
        self.assembly, self.count = bare.assembly, cloth.vertices
        assert (self.assembly.springs.membrane is not None) == (layout == "membrane")
        positions = stretched * bare.positions + 0.002 * rng.standard_normal(bare.positions.shape)
        self.x = bare.assembly.inwards(positions).T.copy()
        self.state = State(*self.x.copy(), *np.zeros((3, self.count)))
        arrays = solver.arrays(bare.assembly)
        links = arrays.forces[Elastic]
        self.matrix, room = matrix_of(bare.assembly, links, np.float64)
        size = self.matrix.mass.size
        terms, self.blocks = np.zeros(size), link_blocks(self.matrix, room, links)
        self.levels = levels_of(bare.assembly, self.matrix, self.blocks, terms)
        arrays = arrays._replace(
            matrix=self.matrix,
            layout=room,
            levels=self.levels,
            work=arrays.work._replace(terms=terms),
            scratch=(np.zeros((3, size)),),
        )
        self.linker, self.team = Linker(), Team.alone(self.count)
        thread = Thread(Running(bare.assembly, self.state, arrays), 0, 1, None)
        self.system = solver._problem(thread, self.linker, None).system
        self.linker.link()
        self.own = slice(self.matrix.front, self.matrix.front + self.count)
        # Of a membrane the matrix has what the forces have found.
        run(self.system.residual, self.team, 0, 1, B)
        run(self.system.linearise, self.team, 0, 1, B)

    def times(self, p: np.ndarray) -> np.ndarray:
        self.matrix.vectors[3][:, self.own] = p
        run(self.system.product, self.team, 0, 1, B)
        return self.matrix.vectors[4][:, self.own].copy()

    def preconditioned(self, r: np.ndarray) -> np.ndarray:
        """What is added to a residual times the inverse of the block diagonal."""
        self.matrix.vectors[1][:, self.own], self.matrix.vectors[2][:] = r, 0.0
        run(self.system.precondition, self.team, 0, 1, B)
        return self.matrix.vectors[2][:, self.own].copy()

    def dense(self) -> np.ndarray:
        """The matrix, rows and columns by coordinate and vertex."""
        unit = np.eye(3 * self.count).reshape(-1, 3, self.count)
        return np.stack([self.times(p).ravel() for p in unit])

    def forces(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        for kept, given in zip(self.state, (*x, *v), strict=True):
            kept[:] = given
        run(self.system.residual, self.team, 0, 1, B)
        return self.system.work.forces.copy()
