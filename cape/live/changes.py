"""What can be changed of a cloth while it is simulated; whatever takes long is made ready beside the run."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assembly.fabrics import patchwork_of
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS
from cape.cloth.fabrics import fabric as fabric_named
from cape.live.builder import Builder
from cape.live.holds import corners, rim, tear_path
from cape.live.rig import PIN, Built, Rig
from cape.outfits.combined import of_fabric
from cape.scene.scene import Scene
from cape.scene.self_contact import SelfContact
from cape.solvers import Solver, SymplecticEuler
from cape.solvers import solver as solver_named
from motions import quaternions
from motions.errors import UnknownNameError, UserError, ValueRangeError

Change = Callable[[], str | None]

SCENE, READY = "scene", "what may be needed"
BREEZE = (-3.0, 0.0, 0.0)  # m/s, of a wind that is turned on where there was none
SHARES = (0.5, 0.7, 0.3, 0.6, 0.4, 0.8, 0.2)  # of the hem, where tears begin, one after the other


class Changes:
    """Asks the thread of the physics for changes; each is told in the status when it is done.

    What a change gives up on, such as an unknown name, is told there as well.

    Attributes:
        solver: that was asked for.
    """

    def __init__(self, rig: Rig, builder: Builder, do: Callable[[Change], None]) -> None:
        """Change a rig; `do` has things done between two frames."""
        self._rig, self._builder, self._do = rig, builder, do
        self.solver = rig.solver
        self._wanted = rig.scene
        self._coming = rig.solver
        self._asked = self._done = 0
        self._anew = False
        self._untold: list[tuple[int, str | Callable[[], str]]] = []
        self._calm = rig.scene.wind
        self._tears = 0
        self._led: dict[int, str] = {}  # what leads each vertex that was taken in the hand

    # -- wind --

    def set_wind(self, velocity: ArrayLike) -> None:
        """Have the air move at a velocity [m/s], shape (3,)."""
        self._do(lambda: self._blow(np.asarray(velocity, dtype=float)))

    def switch_wind(self) -> None:
        """Turn the wind off, or on again."""

        def switch() -> str | None:
            now = self._velocity()
            if now.any():
                self._calm = self._rig.wind
                return self._blow(np.zeros(3))
            before = np.zeros(3) if self._calm is None else np.array(self._calm.velocity)
            return self._blow(before if before.any() else np.array(BREEZE))

        self._do(switch)

    def turn_wind(self, degrees: float) -> None:
        """Turn the wind about the vertical, counter-clockwise as seen from above."""

        def turn() -> str | None:
            now = self._velocity()
            about = quaternions.from_rotation_vector(np.array([0.0, 0.0, np.radians(degrees)]))
            return self._blow(quaternions.rotate(about, now if now.any() else np.array(BREEZE)))

        self._do(turn)

    def _velocity(self) -> NDArray[np.float64]:
        return np.zeros(3) if self._rig.wind is None else np.array(self._rig.wind.velocity, dtype=float)

    def _blow(self, velocity: NDArray[np.float64]) -> str | None:
        if self._rig.wind is None:
            return "the scene has no air"
        x, y, z = (float(part) for part in velocity)
        self._rig.turn_wind(replace(self._rig.wind, velocity=(x, y, z)))
        return f"wind {x:.1f} {y:.1f} {z:.1f} m/s" if velocity.any() else "no wind"

    # -- solver --

    def set_solver(self, name: str | Solver, *, substeps: int | None = None) -> None:
        """Go on with a solver, by its name or as it is."""

        def change() -> str | None:
            asked = solver_named(name, substeps=substeps) if isinstance(name, str) else name
            self.solver = asked
            self.use(asked, f"solver {asked.name}")
            return None

        self._do(change)

    def set_substeps(self, factor: float) -> None:
        """Take so many times as many substeps as there are now."""

        def change() -> str | None:
            now = self._rig.simulation.substeps
            count = max(round(now * factor), now + 1) if factor > 1.0 else max(int(now * factor), 1)
            self.solver = replace(self._rig.solver, substeps=count)
            self.use(self.solver, f"{count} substep{'s' * (count > 1)}")
            return None

        self._do(change)

    def use(self, solver: Solver, told: str, *, must: bool = True) -> None:
        """Go on with a solver once a cloth stands ready for it; on the thread of the physics.

        Where a grid would have to go on as a mesh, from which it does not come back, that is done if it `must`.
        """

        def change() -> str | None:
            return self._go_on_with(solver, told) if must or self._rig.steps(solver) else None

        self._do(change)

    def _go_on_with(self, solver: Solver, told: str) -> str | None:
        rig = self._rig
        ready = rig.ready(solver)
        if not self.pending and ready is not None:
            rig.take_over(ready, solver)
            self._coming = solver
            return told
        if not self.pending and replace(solver, substeps=rig.solver.substeps) == rig.solver:
            return self._change_in_place(solver, told)
        self._ask(self._wanted, told, solver=solver)
        return None

    def _change_in_place(self, solver: Solver, told: str) -> str:
        self._rig.change_solver(solver)
        self._coming = solver
        return told

    def make_ready(self, solver: Solver) -> None:
        """Have a cloth stand by for a solver, in case it is wanted; on the thread of the physics."""
        rig, scene = self._rig, self._rig.scene
        pose = rig.first_pose_for(scene)

        def keep(built: Built) -> None:
            rig.keep_ready(built)

        self._builder.ask(READY, lambda: rig.build(scene, solver, pose, anew=False), keep)

    @property
    def pending(self) -> bool:
        """Whether something is being made ready to go on with."""
        return self._done != self._asked

    # -- scene --

    def set_fabric(self, fabric: str | Fabric) -> None:
        """Have the cloth be of another fabric."""

        def made(scene: Scene) -> tuple[Scene, str]:
            of = fabric_named(fabric) if isinstance(fabric, str) else fabric
            # The same threads as before, whatever they are limited by.
            return replace(scene, cloth=of_fabric(scene.cloth, of)), f"fabric {fabric}"

        self._change_scene(made)

    def set_self_contact(self, on: bool | None = None) -> None:
        """Have the cloth touch itself, or pass through itself; None for whichever it does not do."""

        def made(scene: Scene) -> tuple[Scene, str]:
            wanted = scene.self_contact is None if on is None else on
            return replace(scene, self_contact=SelfContact() if wanted else None), (
                "self-contact" if wanted else "no self-contact"
            )

        self._change_scene(made)

    def pin(self, place: str | int | ArrayLike) -> None:
        """Pin a part of the cloth where it is, or let go of it where it is held.

        Args:
            place: a corner or a region by its name, the number of a corner, or vertices.
        """

        def made(before: Scene) -> tuple[Scene, str]:
            vertices, name = self._part(place)
            scene, held = self._rig.with_pin(before, vertices, f"{PIN}{name}")
            return scene, f"{name} {'pinned' if held else 'let go'}"

        self._change_scene(made)

    def take_hold(self, vertex: int) -> None:
        """Take a vertex in the hand, for `reach` to lead it: what bones hold stays theirs, and the next one is taken.

        What is pinned already is led as it is, and stays pinned where it is let go.
        """

        def take_hold() -> str | None:
            name = self._led[vertex] = self._rig.take_hold(vertex)
            return f"{name.removeprefix(PIN)} in the hand"

        self._do(take_hold)

    def reach(self, vertex: int, place: ArrayLike) -> None:
        """Have a vertex that is pinned go to a place in the world [m], as fast as a hand."""

        def reach() -> str | None:
            name = self._led.get(vertex, f"{PIN}vertex {vertex}")
            # One that was let go meanwhile is not led anywhere.
            with suppress(KeyError):
                self._rig.hands.reach(name, place)
            return None

        self._do(reach)

    def let_go(self, vertex: int) -> None:
        """Let go of what `take_hold` has taken; nothing where it was not, or not by a hand."""

        def release() -> str | None:
            name = self._led.pop(vertex, "")
            return f"{name.removeprefix(PIN)} let go" if self._rig.let_go(name) else None

        self._do(release)

    def tear(self, path: ArrayLike | None = None) -> None:
        """Tear the cloth along a path of vertices, None for one from its rim inwards, each time at another place."""

        def tear() -> str | None:
            along = self._next_tear() if path is None else path
            if self._rig.scene.tearing is None:
                # Grids tear under this solver alone, and in half a second of building another may be tried.
                self.solver = SymplecticEuler()
                self._ask(self._rig.with_tearing(), lambda: _told_tears(self._rig.tear(along)), solver=self.solver)
                return None
            return _told_tears(self._rig.tear(along))

        self._do(tear)

    def reset(self) -> None:
        """Put the cloth of the first scene on anew where its bones are, with the fabric that it has now."""

        def reset() -> str | None:
            first, now = self._rig.first, self._wanted.cloth
            cloth = first.cloth if patchwork_of(now) is not None else of_fabric(first.cloth, now.fabric)
            self._ask(replace(first, cloth=cloth), "put on anew", anew=True)
            return None

        self._do(reset)

    def move(self, bone: str, by: ArrayLike) -> None:
        """Move a bone, or what is pinned, by a vector in the world [m]."""

        def move() -> str | None:
            try:
                self._rig.hands.move(bone, by)
            except KeyError:
                raise UnknownNameError("bone", bone, self._rig.hands.names) from None
            return None

        self._do(move)

    @property
    def fabric(self) -> str:
        """Name of the fabric that the cloth is all of, empty for one without a name or several."""
        cloth = self._wanted.cloth
        return next((n for n, f in FABRICS.items() if f == cloth.fabric and patchwork_of(cloth) is None), "")

    @property
    def coming(self) -> Solver:
        """The solver that it goes on with, now or once that stands ready."""
        return self._coming

    @property
    def self_contact(self) -> bool:
        """Whether the cloth touches itself, now or once that stands ready."""
        return self._wanted.self_contact is not None

    @property
    def corners(self) -> tuple[str, ...]:
        """Names of what can be pinned."""
        return tuple(corners(self._rig.first.cloth))

    @property
    def bones(self) -> tuple[str, ...]:
        """Names of what can be moved."""
        return self._rig.hands.names

    def _change_scene(self, made: Callable[[Scene], tuple[Scene, str]]) -> None:
        def change() -> str | None:
            self._ask(*made(self._wanted))
            return None

        self._do(change)

    def _ask(
        self,
        scene: Scene,
        told: str | Callable[[], str],
        *,
        solver: Solver | None = None,
        anew: bool = False,
    ) -> None:
        """Have another scene made ready, or another solver, and gone on with; several that wait become one.

        `told`, or what it gives, is told once it is gone on with.
        """
        rig = self._rig
        solver = self._coming if solver is None else solver
        self._asked = number = self._asked + 1
        self._wanted, self._coming, self._anew = scene, solver, anew or self._anew
        self._untold.append((number, told))
        anew = self._anew
        pose = rig.pose_for(scene) if anew and scene.cloth.frame == "wearer" else rig.first_pose_for(scene)

        def make() -> Built | UserError:
            try:
                return rig.build(scene, solver, pose, anew=anew)
            except UserError as error:
                return error

        def take_over(made: Built | UserError) -> str:
            then = [text for of, text in self._untold if of <= number]
            self._untold = [each for each in self._untold if each[0] > number]
            try:
                if isinstance(made, UserError):
                    raise made
                if made.anew:
                    rig.hands.take_back()
                rig.take_over(made, solver)
            finally:
                if number == self._asked:
                    self._done = number
                    self._wanted, self._coming, self._anew = rig.scene, rig.solver, False
            return ", ".join(filter(None, (text if isinstance(text, str) else text() for text in then)))

        self._builder.ask(SCENE, make, take_over)

    def _part(self, place: str | int | ArrayLike) -> tuple[NDArray[np.int64], str]:
        cloth = self._rig.first.cloth
        known = corners(cloth)
        if isinstance(place, int):
            if not 0 <= place < len(known):
                raise ValueRangeError(f"there are {len(known)} corners to pin: {', '.join(known)}")
            place = tuple(known)[place]
        if isinstance(place, str):
            if place not in known and place not in cloth.regions:
                raise UnknownNameError("corner", place, [*known, *cloth.regions])
            return np.asarray(known.get(place, cloth.regions.get(place)), np.int64), place
        vertices = cloth.region(np.asarray(place))
        return vertices, f"vertex {int(vertices[0])}"

    def _next_tear(self) -> NDArray[np.int64]:
        """Where to tear next: in turn along the hem, or all around the rim where there is none."""
        cloth = self._rig.first.cloth
        along = np.asarray(cloth.regions["bottom"]) if "bottom" in cloth.regions else rim(cloth)
        share = SHARES[self._tears % len(SHARES)]
        self._tears += 1
        return tear_path(cloth, int(along[round(share * (len(along) - 1))]))


def _told_tears(count: int) -> str:
    return f"{count} edges torn" if count else "nothing tears here any more"
