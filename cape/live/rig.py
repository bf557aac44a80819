"""A simulation on its bones, and what hands change of it while it runs."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.air.wind import Wind
from cape.live.holds import held_where_they_are, let_go, pinned
from cape.live.sources import Hands, Source
from cape.results.topology import Topology
from cape.run.simulation import Simulation
from cape.run.tearing.simulation import tearable
from cape.run.whereabouts import Hold, Place, Snapshot
from cape.scene.poses import Pose, read_pose
from cape.scene.scene import Scene
from cape.scene.tearing import Tearing
from cape.solvers import Solver
from motions.errors import UnknownNameError, ValueRangeError

FloatArray = NDArray[np.float64]

PIN = "pin "  # what the names of bones begin with that pin something
BY_HAND = Tearing(strain=0.6)  # of a cloth that is torn by hand, at whose tips threads then part by themselves


class Built(NamedTuple):
    """A simulation that stands ready to go on where another one is, or to begin anew."""

    simulation: Simulation
    first_pose: Pose
    anew: bool


class Rig:
    """What is simulated, and where.

    Attributes:
        scene: as it is now.
        first: as it was at first.
        simulation: of it.
        hands: where the bones are.
        time: of the simulation [s].
        wind: that blows, None for no air.
        pins: vertices that were ever pinned, by the name of the bone that holds them.
    """

    def __init__(self, scene: Scene, source: Source, solver: Solver, *, threads: int | None) -> None:
        """Nothing hangs before `start`.

        Raises:
            UnknownNameError: the scene uses a bone that the source has not.
        """
        self.first = self.scene = scene
        self.hands, self.solver, self.threads = Hands(source), solver, threads
        self.simulation = Simulation(scene, solver=solver, threads=threads)
        self.time, self.wind = 0.0, scene.wind
        self.pins: dict[str, NDArray[np.int64]] = {}
        self._tears = 0
        self._ready: dict[Solver, Built] = {}
        self._first_pose = self.hands.now
        self.pose_for(scene)

    @property
    def bones(self) -> Pose:
        """Where the source's bones are, as they were last."""
        count = len(self.hands.source.names)
        now = self.hands.now
        return Pose(now.positions[:count], now.rotations_wxyz[:count])

    def first_pose_for(self, scene: Scene) -> Pose:
        """Where the bones were at first that a scene uses: what they hold is where it was then."""
        now, first = self.hands.now, self._first_pose
        count = len(first.positions)
        places = np.concatenate([first.positions, now.positions[count:]])
        turns = np.concatenate([first.rotations_wxyz, now.rotations_wxyz[count:]])
        return self.pose_for(scene, Pose(places, turns))

    def pose_for(self, scene: Scene, pose: Pose | None = None) -> Pose:
        """Where the bones are that a scene uses, in its order; in a pose of all of them, None for where they are now.

        Raises:
            UnknownNameError: one is not there.
        """
        pose = self.hands.now if pose is None else pose
        chosen = []
        for bone in scene.bones:
            try:
                chosen.append(self.hands.index(bone))
            except KeyError:
                raise UnknownNameError("bone", bone, self.hands.names, "The scene uses it") from None
        return Pose(pose.positions[chosen], pose.rotations_wxyz[chosen])

    def start(self, *, velocity: ArrayLike = (0.0, 0.0, 0.0), spin: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Compile what is needed, put the cloth on and let it settle, as `Simulation.start` does.

        Raises:
            UserError: the cloth can't be put on.
        """
        pose = self.pose_for(self.scene)
        self.simulation.compile(pose)
        self.simulation.start(pose, velocity=velocity, spin=spin)

    def step(self, dt: float) -> None:
        """Advance by `dt` [s] to where the bones then are.

        Raises:
            UserError: the bones' poses are none, or the cloth explodes.
        """
        self.hands.pose(self.time + dt)
        self.simulation.step(self.pose_for(self.scene), dt)
        self.time += dt
        if self.simulation.tears != self._tears and self.wind is not None:
            self._tears = self.simulation.tears
            self.simulation.turn_wind(self.wind)  # what was assembled anew has that of the scene

    @property
    def topology(self) -> Topology | None:
        """Which vertices the triangles have, where the cloth has torn."""
        return self.simulation.topology if self.simulation.tears else None

    # -- changes that cost nothing --

    def turn_wind(self, wind: Wind) -> None:
        """Have another wind blow.

        Raises:
            ValueRangeError: the scene has no air, or only a steady one.
        """
        self.simulation.turn_wind(wind)
        self.wind = wind

    def change_solver(self, solver: Solver) -> None:
        """Go on with another number of steps, or, of a cloth that has torn, with another solver, laid out anew.

        Raises:
            ValueRangeError: the cloth may tear, and can't go on otherwise.
        """
        self.simulation.change_solver(solver)
        self.solver = solver

    def require_may_use(self, solver: Solver) -> None:
        """Tell whether the cloth can go on with a solver.

        Raises:
            ValueRangeError: it is a grid that may tear, which only one solver steps.
        """
        scene = self.simulation.scene
        if tearable(scene, solver) is not scene:
            raise ValueRangeError(f"a grid that may tear was set out with {self.solver.name}: it can't go on otherwise")

    def tear(self, path: ArrayLike) -> int:
        """Part the edges along a path of vertices; gives how many have parted.

        Raises:
            ValueRangeError: the scene does not tear, or two are no neighbours.
        """
        return self.simulation.tear(path)

    # -- changes that are built beside the run --

    def build(self, scene: Scene, solver: Solver, pose: Pose, *, anew: bool) -> Built:
        """Make a simulation of a scene of this cloth ready, on whatever thread: compiled, laid out, and linked.

        Args:
            scene: with another fabric, other holds, or other forces; or as it is, for another solver.
            solver: for it.
            pose: of the scene's bones, as they were at first; as they are, where the cloth is put on anew.
            anew: put the cloth on and let it settle, instead of going on from where it is.

        Raises:
            UserError: the scene can't be.
        """
        own = self.simulation.scene if scene is self.scene else scene  # of what is a mesh where it may tear
        simulation = Simulation(own, solver=solver, threads=self.threads)
        if anew or scene.tearing is not None:
            simulation.compile(pose)  # all at once, and not one after the other
        simulation.start(pose, settle=None if anew else 0.0)
        simulation.read(simulation.meter(scene))
        return Built(simulation, pose, anew)

    def compile(self, scene: Scene, solver: Solver, pose: Pose) -> None:
        """Have the code that a solver needs for a scene compiled and loaded, on whatever thread.

        Raises:
            UserError: it can't be used for it.
        """
        Simulation(scene, solver=solver, threads=self.threads).compile(pose)

    def keep_ready(self, built: Built) -> None:
        """Have what was built for this scene stand by, in case its solver is wanted."""
        if built.simulation.scene is self.simulation.scene:
            self._ready[_method(built.simulation.solver)] = built

    def ready(self, solver: Solver) -> Built | None:
        """What stands by for a solver, in any number of steps; None for nothing."""
        return self._ready.get(_method(solver))

    def take_over(self, built: Built, solver: Solver) -> None:
        """Go on with what was built, from where the cloth is, unless it begins anew.

        What ran until now stands by, where only the solver is another one.

        Args:
            built: for this scene, or another one.
            solver: that it was built for, in as many steps as are to be taken.

        Raises:
            ValueRangeError: the cloth has torn, and can't go on otherwise.
        """
        new, old = built.simulation, self.simulation
        if built.anew or new.scene is not old.scene:
            self._ready = {}
            if not built.anew:
                self._go_on(built)
        else:
            new.go_back(old.mark())
            self._ready[_method(old.solver)] = Built(old, built.first_pose, anew=False)
            self._ready.pop(_method(solver), None)
        new.change_solver(solver)
        self.simulation, self.scene, self.solver, self._tears = new, new.scene, solver, 0
        if self.wind is not None:
            new.turn_wind(self.wind)

    def _go_on(self, built: Built) -> None:
        """Have a simulation of another scene be where the cloth is."""
        new = built.simulation
        fresh = [name for name in self.pins if not any(a.bone == name for a in self.scene.attachments)]
        for name in fresh:  # it is pinned from here on
            self.hands.put(name, self.simulation.positions[self.pins[name]].mean(axis=0), going=True)
        old = self.simulation.snapshot().place
        alike = all(a is b for a, b in zip(self.scene.attachments, new.scene.attachments, strict=False))
        alike = alike and len(self.scene.attachments) == len(new.scene.attachments)
        pose = read_pose(self.pose_for(new.scene), new.bones).moved(-old.origin)
        hold = old.hold if alike else tuple(_undrifted(each) for each in new.snapshot().place.hold)
        if not alike:
            held_where_they_are(new.assembly, hold, [name for name in fresh if name in new.bones], pose, old.state)
        new.start_from(Snapshot(new.scene, built.first_pose, Place(old.origin, pose, old.state, hold, old.time)))

    def with_tearing(self) -> Scene:
        """The scene as it is, of a cloth that can be torn."""
        if self.scene.tearing is not None:
            return self.scene
        return replace(self.scene, tearing=BY_HAND)

    def with_pin(self, scene: Scene, vertices: NDArray[np.int64], name: str) -> tuple[Scene, bool]:
        """A scene with some vertices pinned where they are, or let go where any is held; whether they are pinned.

        Raises:
            ValueRangeError: they can't be let go of.
        """
        if self.simulation.tears:
            raise ValueRangeError("a cloth that has torn stays held as it is, until it is put on anew")
        freed = let_go(scene, vertices)
        return (self._pinned(scene, vertices, name), True) if freed is None else (freed, False)

    def with_hand(self, scene: Scene, vertex: int) -> tuple[Scene, str]:
        """A scene in which a hand holds a vertex, or the nearest that no bone holds, and the name of what leads it.

        What is pinned already is led as it is, and stays so: the scene is the same.

        Raises:
            ValueRangeError: the cloth has torn, has no such vertex, or is held all over.
        """
        if self.simulation.tears:
            raise ValueRangeError("a cloth that has torn stays held as it is, until it is put on anew")
        if not 0 <= vertex < scene.cloth.vertices:
            raise ValueRangeError(f"the cloth has vertices 0 to {scene.cloth.vertices - 1}, and no {vertex}")
        held = {int(each): attachment.bone for attachment in scene.attachments for each in attachment.vertices}
        if held.get(vertex) in self.pins:
            return scene, held[vertex]
        free = np.setdiff1d(np.arange(scene.cloth.vertices), np.array([*held], np.int64))
        if not len(free):
            raise ValueRangeError("bones hold all of the cloth")
        places = self.simulation.positions
        chosen = free[[np.linalg.norm(places[free] - places[vertex], axis=1).argmin()]]
        name = f"{PIN}vertex {chosen[0]}"
        return self._pinned(scene, chosen, name), name

    def _pinned(self, scene: Scene, vertices: NDArray[np.int64], name: str) -> Scene:
        places = self.simulation.positions[vertices]
        self.hands.put(name, places.mean(axis=0))
        self.pins[name] = vertices
        return pinned(scene, vertices, name, places - places.mean(axis=0))


def _method(solver: Solver) -> Solver:
    """A solver in whatever number of steps."""
    return replace(solver, substeps=None)


def _undrifted(hold: Hold) -> Hold:
    """Points that are held, where colliders have not driven them off yet."""
    points, lift, drift = hold
    return points, np.zeros_like(lift), np.zeros_like(drift)
