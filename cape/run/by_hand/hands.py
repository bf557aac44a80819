"""Hands that take hold of vertices of a running cloth, lead them, and let them go.

There is room for them in the arrays from the start, so that none of this compiles or remakes anything: a hand is a
spring between a vertex and a place in the world, which holds nothing while it has no vertex. What has split off can be
taken like any other vertex. What a hand holds does not split, as what bones hold does not; the cloth around it may.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assembly.holding import NOTHING, hands_of
from cape.kernels.solve.soft import Pull
from cape.run.tearing.simulation import MayTear
from cape.scene.poses import Pose, read_vector
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions.errors import ValueRangeError, require_whole

FloatArray = NDArray[np.float64]

MOST_HANDS = 64


class ByHand(MayTear):
    """A running cloth, and the hands that may take hold of it.

    Attributes:
        solver: how it is advanced.
    """

    def __init__(self, scene: Scene, solver: Solver, *, hands: int) -> None:
        """Hold the scene, with so many hands that hold nothing; none of it hangs yet.

        Raises:
            ValueRangeError: there are more than `MOST_HANDS`, or fewer than none.
        """
        super().__init__(scene)
        require_whole("hands", hands, 0, MOST_HANDS)
        self.solver = solver
        self._hands = hands_of(scene, hands)
        self._in_hand = [NOTHING] * hands
        self._goals = np.zeros((hands, 3))

    @property
    def in_hand(self) -> tuple[int, ...]:
        """The vertex that each hand holds, -1 for none."""
        return tuple(self._in_hand)

    def take_hold(self, hand: int, vertex: int, *, at: ArrayLike | None = None) -> None:
        """Have a hand hold a vertex, also one that has split off, as far as `lead` leads it.

        Args:
            hand: its number, from 0 on.
            vertex: as in `positions`.
            at: where the hand is in the world [m], shape (3,); None for where the vertex is.

        Raises:
            ValueRangeError: the simulation has not been started, there is no such hand or vertex, or a bone holds it.
        """
        cloth = self._started
        pull = self._pull(hand)
        if not 0 <= vertex < cloth.assembly.in_use:
            raise ValueRangeError(f"the cloth has vertices 0 to {cloth.assembly.in_use - 1}, and no {vertex}")
        place = cloth.assembly.place_of(vertex)
        if not cloth.assembly.loose[place]:
            raise ValueRangeError(f"a bone holds vertex {vertex}")
        self.let_go(hand)
        self._in_hand[hand] = vertex
        self._goals[hand] = cloth.positions[vertex] if at is None else read_vector(at, "place of a hand")
        pull.attached.points[hand], pull.attached.drift[hand] = self._goals[hand], 0.0
        pull.attached.vertices[hand] = place
        pull.stiffness[hand], pull.damping[hand] = self.solver.grip(cloth.running, float(cloth.assembly.mass[place]))
        if self._tears is not None:
            self._tears.keep(vertex, whole=True)

    def lead(self, hand: int, place: ArrayLike) -> None:
        """Have a hand be at a place in the world [m], shape (3,), at the end of the next step.

        Raises:
            ValueRangeError: there is no such hand, or the place is none.
        """
        self._pull(hand)
        self._goals[hand] = read_vector(place, "place of a hand")

    def let_go(self, hand: int) -> None:
        """Have a hand let go of what it holds, if anything.

        Raises:
            ValueRangeError: there is no such hand.
        """
        pull, vertex = self._pull(hand), self._in_hand[hand]
        if vertex == NOTHING:
            return
        self._in_hand[hand] = pull.attached.vertices[hand] = NOTHING
        pull.stiffness[hand] = pull.damping[hand] = 0.0
        if self._tears is not None and vertex not in self._in_hand:
            self._tears.keep(vertex, whole=False)

    def _pull(self, hand: int) -> Pull:
        if self._hands is None or not 0 <= hand < len(self._in_hand):
            raise ValueRangeError(f"there are {len(self._in_hand)} hands: give Simulation more with hands=")
        return self._hands

    def _let_go_of_all(self) -> None:
        for hand in range(len(self._in_hand)):
            self.let_go(hand)

    def _go_on_with(self, solver: Solver) -> None:
        super()._go_on_with(solver)
        self.solver = solver
        for hand, vertex in enumerate(self._in_hand):
            if vertex != NOTHING:
                self.take_hold(hand, vertex, at=self._goals[hand])

    def _move_on_and_tear(self, pose: Pose, dt: float) -> None:
        if self._hands is not None:
            attached = self._hands.attached
            attached.drift[:] = (self._goals - attached.points) / dt
        super()._move_on_and_tear(pose, dt)
        if self._hands is not None:
            self._hands.attached.points[:] = self._goals  # without what rounding has left of the way

    def _move_hands(self, dt: float) -> None:
        """Have hands be where a frame of `dt` [s], or a part of one, has led them."""
        if self._hands is not None:
            attached = self._hands.attached
            attached.points[:] += dt * attached.drift
