"""Many characters at once: independent simulations, one cape a core at a time."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.kernels.linking import arrivals_for
from cape.run.simulation import MOST_THREADS, Simulation
from cape.run.whereabouts import Diverged
from cape.scene.poses import Bones
from cape.solvers.threads import available_cores, run
from motions.border import checked_first
from motions.errors import UserError, ValueRangeError, require_whole


@checked_first
class Batch:
    """Simulations that are started and stepped together, each with the same bits as if it were stepped alone.

    Every core takes the next cape that none has taken, the longest first, until all are done. A cape that diverges does
    not hold up the others: it stays at its last good state, is not stepped again until the next `start`, and
    `failures` tells why.
    """

    def __init__(self, simulations: Sequence[Simulation], *, threads: int | None = None) -> None:
        """Hold the simulations; nothing is computed before `start`.

        Args:
            simulations: one a character; scenes and solvers may be shared.
            threads: how many capes are stepped at a time, None for one on every core.

        Raises:
            ValueRangeError: a simulation is listed twice, or the number of threads is not positive.
        """
        if threads is not None:
            require_whole("threads", threads, 1, MOST_THREADS)
        if len({id(simulation) for simulation in simulations}) < len(simulations):
            raise ValueRangeError("a simulation is listed twice: each cape of a batch needs its own")
        self.simulations = tuple(simulations)
        self.threads = threads or available_cores()
        self.failures: dict[int, Diverged] = {}
        self._costs = [float(simulation.scene.cloth.vertices) for simulation in simulations]

    def __len__(self) -> int:
        """Number of capes, whether they failed or not."""
        return len(self.simulations)

    @property
    def positions(self) -> list[NDArray[np.float64]]:
        """Positions of the vertices of every cape in the world [m], each of shape (V, 3).

        Raises:
            ValueRangeError: a simulation has not been started.
        """
        return [simulation.positions for simulation in self.simulations]

    def start(
        self,
        poses: Sequence[Bones],
        *,
        settle: float | None = None,
        velocities: ArrayLike = (0.0, 0.0, 0.0),
        spins: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Start every simulation anew, as `Simulation.start` does.

        Args:
            poses: the first pose of each character.
            settle: time to let every cloth come to rest [s]; None for as long as each needs.
            velocities: with which the bones that hold a cloth move on [m/s], shape (N, 3), or (3,) for all alike.
            spins: with which they turn [rad/s], of the same shape.

        Raises:
            UserError: what `Simulation.start` raises, with the number of the cape; the other capes are started.
            ValueRangeError: there is not one pose, velocity and spin for each cape.
        """
        self._require_one_each(poses)
        moves, turns = self._one_each(velocities, "velocity"), self._one_each(spins, "spin")
        self.failures.clear()

        def start(index: int) -> None:
            self.simulations[index].start(poses[index], settle=settle, velocity=moves[index], spin=turns[index])

        self._for_all(start)

    def step(self, poses: Sequence[Bones], dt: float) -> None:
        """Advance every cape that has not failed by `dt` [s], as `Simulation.step` does.

        After an interrupt some capes are a step further than others.

        Raises:
            UserError: what `Simulation.step` raises, with the number of the cape; the other capes are stepped.
            ValueRangeError: there is not one pose for each cape, or a simulation has not been started.
        """
        self._require_one_each(poses)
        for index, simulation in enumerate(self.simulations):
            with _named(index):
                _ = simulation.assembly

        def step(index: int) -> None:
            begun = time.perf_counter()
            self.simulations[index].step(poses[index], dt)
            self._costs[index] = time.perf_counter() - begun

        self._for_all(step)

    def _for_all(self, act: Callable[[int], None]) -> None:
        """Call `act` with the number of every cape that has not failed, the dearest first."""
        order = sorted(set(range(len(self))) - set(self.failures), key=lambda index: -self._costs[index])
        turns = iter(order)
        errors: dict[int, UserError] = {}

        def take_turns() -> None:
            try:
                for index in turns:  # shared by all threads
                    try:
                        act(index)
                    except Diverged as error:
                        self.failures[index] = error
                    except UserError as error:
                        errors[index] = error
            except BaseException:
                for _ in turns:  # nothing is left for the other threads
                    pass
                raise

        run(lambda _: take_turns(), take_turns, arrivals_for(min(self.threads, len(order))))
        for index, error in sorted(errors.items()):
            with _named(index):
                raise error

    def _require_one_each(self, poses: Sequence[Bones]) -> None:
        if len(poses) != len(self):
            raise ValueRangeError(f"a pose for each of the {len(self)} capes is needed, not {len(poses)}")

    def _one_each(self, vectors: ArrayLike, name: str) -> NDArray[np.float64]:
        try:
            given = np.asarray(vectors, dtype=float)
        except (ValueError, TypeError) as error:
            raise ValueRangeError(f"a {name} for each of the {len(self)} capes is needed: {error}") from error
        if given.shape not in ((3,), (len(self), 3)):
            raise ValueRangeError(f"a {name} for each of the {len(self)} capes is needed, not shape {given.shape}")
        return np.broadcast_to(given, (len(self), 3))


@contextmanager
def _named(index: int) -> Iterator[None]:
    """Put the number of a cape before the text of an error."""
    try:
        yield
    except UserError as error:
        error.args = (f"cape {index}: {error}",)
        raise
