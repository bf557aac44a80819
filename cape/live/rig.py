"""A simulation on its bones, and what hands change of it while it runs."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.air.wind import Wind
from cape.cloth.cloth import GridCloth, MeshCloth
from cape.cloth.meshing import as_mesh
from cape.live.holds import held_where_they_are, let_go, pinned
from cape.live.sources import Hands, Source
from cape.results.topology import Topology
from cape.run.simulation import Simulation
from cape.run.tearing.simulation import tearable
from cape.run.whereabouts import Hold, Place
from cape.scene.poses import Pose, read_pose
from cape.scene.scene import Scene
from cape.scene.tearing import Tearing
from cape.solvers import Solver
from motions.errors import UnknownNameError, ValueRangeError

FloatArray = NDArray[np.float64]

PIN = "pin "  # what the names of bones begin with that pin something
HANDS = 16  # that may hold the cloth at the same time
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
        self.simulation = self._simulation(scene, solver)
        self.time, self.wind = 0.0, scene.wind
        self.pins: dict[str, NDArray[np.int64]] = {}
        self._tears = 0
        self._in_hand: dict[str, int] = {}  # which hand, by the name of what is led with it
        self._ready: dict[Solver, Built] = {}
        self._first_pose = self.hands.now
        self.pose_for(scene)

    def _simulation(self, scene: Scene, solver: Solver) -> Simulation:
        return Simulation(scene, solver=solver, threads=self.threads, hands=HANDS)

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
        for name, hand in self._in_hand.items():
            self.simulation.lead(hand, self.hands.place(name))
        self.simulation.step(self.pose_for(self.scene), dt)
        self.time += dt
        for name in [name for name, hand in self._in_hand.items() if self.simulation.in_hand[hand] < 0]:
            self.let_go(name)  # of what was put on anew where bones have jumped
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

    def steps(self, solver: Solver) -> bool:
        """Whether a solver steps the cloth as it is laid out: not all step a grid that may tear, but a mesh of it."""
        scene = self.simulation.scene
        return tearable(scene, solver) is scene

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
        before = self.simulation
        own = before.scene if scene is self.scene else scene  # of what is a mesh where it may tear
        if before.tears and not anew and isinstance(own.cloth, GridCloth) and isinstance(before.scene.cloth, MeshCloth):
            own = replace(own, cloth=as_mesh(own.cloth))  # that may tear as a grid, too, but has not
        simulation = self._simulation(own, solver)
        if anew or scene.tearing is not None:
            simulation.compile(pose)  # all at once, and not one after the other
        simulation.start(pose, settle=None if anew else 0.0)
        if not anew:
            simulation.tear_like(before)
        simulation.read(simulation.meter(scene))
        return Built(simulation, pose, anew)

    def keep_ready(self, built: Built) -> None:
        """Have what was built for this scene stand by, in case its solver is wanted; not what has torn."""
        if built.simulation.scene is self.simulation.scene and not built.simulation.tears:
            self._ready[_method(built.simulation.solver)] = built

    def ready(self, solver: Solver) -> Built | None:
        """What stands by for a solver, in any number of steps; None for nothing, as for a cloth that has torn."""
        return None if self.simulation.tears else self._ready.get(_method(solver))

    def take_over(self, built: Built, solver: Solver) -> None:
        """Go on with what was built, from where the cloth is, torn as it is, unless it begins anew.

        What ran until now stands by, where only the solver is another one. Hands hold on to what they hold, unless it
        begins anew, or a bone holds it from here on.

        Args:
            built: for this scene, or another one.
            solver: that it was built for, in as many steps as are to be taken.

        Raises:
            ValueRangeError: the cloth has torn, and can't go on otherwise.
        """
        new, old = built.simulation, self.simulation
        if built.anew or old.tears or new.scene is not old.scene:
            self._ready = {}
            if not built.anew:
                self._go_on(built)
        else:
            new.go_back(old.mark())
            self._ready[_method(old.solver)] = Built(old, built.first_pose, anew=False)
            self._ready.pop(_method(solver), None)
        new.change_solver(solver)
        self._hold_on(new, None if built.anew else old)
        self.simulation, self.scene, self.solver, self._tears = new, new.scene, solver, new.tears
        if self.wind is not None:
            new.turn_wind(self.wind)

    def _go_on(self, built: Built) -> None:
        """Have a simulation of another scene be where the cloth is."""
        new = built.simulation
        fresh = [name for name in self.pins if not any(a.bone == name for a in self.scene.attachments)]
        for name in fresh:  # it is pinned from here on
            self.hands.put(name, self.simulation.positions[self.pins[name]].mean(axis=0), going=True)
        new.tear_like(self.simulation)  # also where it has torn since that was built
        old = self.simulation.place()
        alike = all(a is b for a, b in zip(self.scene.attachments, new.scene.attachments, strict=False))
        alike = alike and len(self.scene.attachments) == len(new.scene.attachments)
        pose = read_pose(self.pose_for(new.scene), new.bones).moved(-old.origin)
        hold = old.hold if alike else tuple(_undrifted(each) for each in new.place().hold)
        if not alike:
            held_where_they_are(new.assembly, hold, [name for name in fresh if name in new.bones], pose, old.state)
        new.go_on_at(Place(old.origin, pose, old.state, hold, old.time))

    def _hold_on(self, new: Simulation, old: Simulation | None) -> None:
        """Have hands hold in another simulation what they hold in an old one; None for nothing of that."""
        for hand in range(HANDS):
            new.let_go(hand)  # what it held when it ran last
        for name, hand in [*self._in_hand.items()]:
            vertex = -1 if old is None else old.in_hand[hand]
            try:
                new.take_hold(hand, vertex, at=self.hands.place(name))
            except ValueRangeError:  # there is no such vertex, or a bone has it
                self.let_go(name)

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
        freed = let_go(scene, vertices)
        return (self._pinned(scene, vertices, name), True) if freed is None else (freed, False)

    # -- hands --

    @property
    def in_hand(self) -> bool:
        """Whether any hand holds the cloth."""
        return bool(self._in_hand)

    def take_hold(self, vertex: int) -> str:
        """Have a hand hold a vertex, or the nearest that no bone holds; gives the name of what leads it.

        What is pinned, or held by another hand, is led as it is.

        Raises:
            ValueRangeError: the cloth has no such vertex, or is held all over, or no hand is left.
        """
        simulation, assembly = self.simulation, self.simulation.assembly
        count = len(simulation.positions)
        if not 0 <= vertex < count:
            raise ValueRangeError(f"the cloth has vertices 0 to {count - 1}, and no {vertex}")
        held = {int(each): attachment.bone for attachment in self.scene.attachments for each in attachment.vertices}
        if held.get(vertex) in self.pins:
            return held[vertex]
        free = np.flatnonzero(assembly.outwards(assembly.loose))
        free = np.setdiff1d(free, np.array([*held], np.int64))
        if not len(free):
            raise ValueRangeError("bones hold all of the cloth")
        places = simulation.positions
        chosen = int(free[np.linalg.norm(places[free] - places[vertex], axis=1).argmin()])
        name = f"{PIN}vertex {chosen}"
        if name not in self._in_hand:
            left = set(range(HANDS)) - set(self._in_hand.values())
            if not left:
                raise ValueRangeError(f"{HANDS} hands hold the cloth, and no more can")
            simulation.take_hold(min(left), chosen)
            self._in_hand[name] = min(left)
            self.hands.put(name, places[chosen])
        return name

    def let_go(self, name: str) -> bool:
        """Have the hand let go that leads what is called so; tells whether one did."""
        hand = self._in_hand.pop(name, None)
        if hand is not None:
            self.simulation.let_go(hand)
            self.hands.take_away(name)
        return hand is not None

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
