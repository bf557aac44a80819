"""What a simulation does with a cloth that may tear."""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cape.cloth.cloth import GridCloth
from cape.cloth.meshing import as_mesh
from cape.results.topology import Topology
from cape.run.hanging import Hanging
from cape.run.tearing.refit_mesh import give_up_spares
from cape.run.tearing.sheets import in_triangles
from cape.run.tearing.tears import Tears
from cape.run.whereabouts import Place
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions.errors import ValueRangeError


class MayTear(ABC):
    """A running cloth, and its tears.

    Attributes:
        scene: cloth, attachments, colliders, forces.
        substeps: steps of the last frame, as chosen first.
    """

    def __init__(self, scene: Scene) -> None:
        """Hold the scene; nothing hangs yet."""
        self.scene = scene
        self.substeps = 0
        self._cloth: Hanging | None = None
        self._tears: Tears | None = None
        self._torn_as: Tears | None = None  # the tears of another one, that these go on from

    @property
    def _started(self) -> Hanging:
        if self._cloth is None:
            raise ValueRangeError("the simulation has not been started: call start with the first pose of the bones")
        return self._cloth

    @property
    def tears(self) -> int:
        """How many edges have parted since the start."""
        return 0 if self._tears is None else self._tears.sheet.tears

    @property
    def mass(self) -> float:
        """Mass of the cloth as it is now [kg]."""
        return float(self._started.assembly.mass.sum())

    @property
    def released(self) -> float:
        """Energy that was stored in what bent across edges which have parted [J]."""
        return 0.0 if self._tears is None else self._tears.released

    @property
    def topology(self) -> Topology:
        """Which vertices the triangles of the cloth have as it is now.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        vertices, cloth = len(self._started.positions), self.scene.cloth
        if self._tears is None:
            return Topology(0, cloth.triangles, np.arange(vertices))
        return Topology(0, self._tears.triangles, self._tears.sheet.parents)

    def place(self) -> Place:
        """Where the cloth is now, whether it has torn or not, for `go_on_at`.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        return self._started.place()

    def go_on_at(self, place: Place) -> None:
        """Go on from where another simulation is, of a cloth of as many vertices; see `tear_like`.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        self._started.go_to(place)

    def tear_like(self, other: "MayTear") -> None:
        """Have the cloth be torn as that of another simulation is, where it is, and count those tears as its own.

        Args:
            other: of a cloth of the same triangles, maybe a grid where this is a mesh, which has torn at least where
                this one has.

        Raises:
            ValueRangeError: one of them has not been started, this one may not tear, or has torn otherwise, or the
                triangles are others.
        """
        cloth, torn = self._started, other._tears
        if self.tears and torn is not self._torn_as:
            raise ValueRangeError("a cloth that has torn can't go on as one that has torn otherwise, or is whole")
        if torn is None or not other.tears:
            return
        if self._tears is None or len(self._tears.triangles) != len(torn.triangles):
            raise ValueRangeError("a cloth that has torn can only go on as one that may tear, of the same triangles")
        sheet = torn.sheet
        if isinstance(other.scene.cloth, GridCloth) and not isinstance(self.scene.cloth, GridCloth):
            sheet = in_triangles(other.scene.cloth, sheet, self._tears.sheet)
        if self._tears.sheet.vertices < sheet.vertices:
            self._tears.become(cloth, sheet)
            cloth.prepare()
        self._tears.released, self._torn_as = torn.released, torn

    def own_substeps(self, dt: float) -> int:
        """Steps in `dt` [s] that the solver would choose, whatever was asked for.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        return self._started.own_choice(dt, strained=self._started.strained)

    def tear(self, vertices: ArrayLike) -> int:
        """Part the edges from each of some vertices to the next.

        The cloth splits at all of them that no bone holds, but for ends that lie within it. Vertices that it gets
        stand behind the others in `positions`.

        Args:
            vertices: indices of n vertices, each a neighbour of the one before, shape (n,).

        Returns:
            How many edges have parted.

        Raises:
            ValueRangeError: the simulation has not been started, its scene has no `tearing`, a vertex is none, or two
                are no neighbours.
        """
        if self._tears is None:
            raise ValueRangeError("only a cloth that may tear can be torn by hand: give its scene a Tearing")
        return self._tears.part(self._started, vertices)

    def _go_on_with(self, solver: Solver) -> None:
        """Have the cloth go on with another solver, without spare vertices where that steps none."""
        cloth = self._started
        if not solver.splits:
            give_up_spares(cloth)
        cloth.change_solver(solver)

    def _require_whole(self) -> None:
        if self.tears:
            raise ValueRangeError("a cloth that has torn can't be taken back to before, nor another one to where it is")

    def _move_on_and_tear(self, pose: Pose, dt: float) -> None:
        """Advance by `dt` [s] to a pose about the cloth's origin: in parts, where the cloth may part within."""
        cloth, tears = self._started, self._tears
        substeps = self.substeps = cloth.choose_substeps(dt, strained=cloth.strained)
        if tears is None:
            self._move_on(pose, dt, substeps)
            return
        begin, parts = cloth.pose, tears.parts(cloth, substeps)
        for part in range(1, parts + 1):
            there = pose if part == parts else begin.towards(pose, part / parts)
            self._move_on(there, dt / parts, -(-substeps // parts))
            tears.look(cloth)
        tears.end_frame(cloth)

    @abstractmethod
    def _move_on(self, pose: Pose, dt: float, substeps: int) -> None:
        """Take a frame of `dt` [s], or a part of one, to a pose about the cloth's origin."""


def tearable(scene: Scene, solver: Solver) -> Scene:
    """The scene with a cloth that splits under a solver: not all step grids that have split."""
    if scene.tearing is None or solver.splits_grids or not isinstance(scene.cloth, GridCloth):
        return scene
    return replace(scene, cloth=as_mesh(scene.cloth))
