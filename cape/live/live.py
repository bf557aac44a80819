"""`Live`: a cloth on moving bones, simulated as the clock runs, shown in a viewer that it never waits for."""

import gc
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Literal, Self

import numpy as np

from cape.air.wind import Wind
from cape.live.builder import Builder
from cape.live.changes import Changes
from cape.live.error_watch import ErrorWatch
from cape.live.feed.screen import Screen
from cape.live.feed.viewers import require_viewing
from cape.live.keeping import Keeper
from cape.live.pace.pacing import Pacer, Step
from cape.live.pace.savings import Savings
from cape.live.page.orders import beginning_of, obey, state_of
from cape.live.rig import Rig
from cape.live.sources import Dressed, Source, Told, ToldSource, TrackSource
from cape.live.status import Status
from cape.results.take import Take
from cape.run.simulate import first_motion
from cape.run.whereabouts import Diverged
from cape.scene.scene import Scene
from cape.solvers import Solver, SymplecticEuler
from motions.border import checked_first
from motions.errors import UnknownNameError, UserError, ValueRangeError
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import BoneTrack

FPS = 60.0
SWITCH = 0.0001  # [s] after which a thread that computes in Python lets the physics on
TOLD_EACH = 6  # frames between looks at what changes slowly
READ = 5.0  # [s] for which something that was said can be read
Viewing = Literal["window", "web", "page", "none"] | str


@checked_first
class Live:
    """A running cloth: physics on a thread of its own, a step for each frame, in time with the clock.

    `with cape.Live(scene, source) as live: live.wait()` runs until the viewer is closed. All methods may be called from
    any thread.

    Attributes:
        fps: frames a second.
        name: of what is shown.
        changes: what can be changed while it runs.
    """

    def __init__(
        self,
        scene: Scene,
        source: Source | BoneTrack | Told | None = None,
        *,
        name: str = "live",
        fps: float = FPS,
        solver: Solver | None = None,
        threads: int | None = None,
        viewer: Viewing = "window",
        bind: str = "127.0.0.1",
        keep: bool = False,
        end_with_viewer: bool = True,
        surfaces: Sequence[LinkSurface] = (),
        skin: Skin | None = None,
        on_frame: Callable[["Live"], None] | None = None,
    ) -> None:
        """Hold what is to run; nothing is computed before `start`.

        Args:
            scene: cloth, attachments, colliders, forces.
            source: where the bones are: a function of the time [s] that gives them by name, as `Simulation.step` takes
                them; a motion, which is played over and over; or a `Source`. None for a scene without bones.
            name: what the viewer calls it.
            fps: frames a second.
            solver: None for symplectic Euler with the step that the scene needs.
            threads: how many share the cloth, None for as many as pay off.
            viewer: "window", "web" for a browser, "page" for one on which the cloth is taken in the hand, "none", or
                the URL of a viewer that runs already.
            bind: the address that a viewer listens on.
            keep: keep all frames, for `take`.
            end_with_viewer: end the run when the viewer that it has opened is closed.
            surfaces: meshes that the bones carry.
            skin: mesh that they move, drawn in place of a body by proportions; None for the motion's own, if any.
            on_frame: called after each frame, on the thread of the physics, which waits for it.

        Raises:
            UnknownNameError: the scene uses a bone that the source has not, or the skin one.
            ValueRangeError: fps is not above 0 and at most 1000, the source gives no poses, or there is no such viewer.
        """
        if not 0.0 < fps <= 1000.0:
            raise ValueRangeError(f"fps must be above 0 and at most 1000, not {fps}")
        require_viewing(viewer)
        self.fps, self.name = fps, name
        self._source = source_of(source, scene)
        self._first_motion = _first_motion(source, scene, fps)
        self._rig = Rig(scene, self._source, solver or SymplecticEuler(), threads=threads)
        self._builder, self._todo = Builder(), SimpleQueue[Callable[[], str | None]]()
        self.changes = Changes(self._rig, self._builder, self._do)
        self._viewing, self._bind, self._surfaces, self._keep = viewer, bind, tuple(surfaces), keep
        self._skin = _skin_on(skin, self._source)
        self._on_frame, self._end_with_viewer = on_frame, end_with_viewer
        self._pacer = Pacer(1.0 / fps)
        self._over, self._awake = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._screen: Screen | None = None
        self._keeper: Keeper | None = None
        self._status = Status(solver=self._rig.solver.name)
        self._frame, self._speed, self._paused, self._single = 0, 1.0, False, 0
        self._savings, self._errors = Savings(self._rig, self.changes), ErrorWatch(self._rig, self._builder)
        self._failed: Exception | None = None
        self._kept_enough = False
        self._begun = self._said = 0.0
        self.steps: list[Step] | None = None
        """How each step went, once this is a list; for measuring."""

    # -- running --

    def start(self) -> Self:
        """Compile, put the cloth on, open the viewer, and begin to run; nothing where that was done before.

        Raises:
            UserError: the cloth can't be put on, or the viewer does not start.
        """
        if self._thread is not None:
            return self
        velocity, spin = self._first_motion
        self._rig.start(velocity=velocity, spin=spin)
        if self._keep:
            self._keeper = Keeper(self._rig, self.name, skin=self._skin)
        if self._viewing != "none":
            self._screen = Screen(
                self._rig, self.name, viewing=self._viewing, bind=self._bind, surfaces=self._surfaces, skin=self._skin,
                hear=lambda line: obey(self, line), begins=beginning_of(self._rig, self.changes.fabric),
            )  # fmt: skip
            self._screen.show(0)
        self._thread = threading.Thread(target=self._run, name="cape-physics", daemon=True)
        self._thread.start()
        return self

    def wait(self, seconds: float | None = None) -> Status:
        """Wait until the run ends, or for so long [s]; gives the status.

        Raises:
            Exception: what has ended the physics.
        """
        until = None if seconds is None else time.monotonic() + seconds
        while self.running and (until is None or time.monotonic() < until):
            left = 0.1 if until is None else min(0.1, max(until - time.monotonic(), 0.0))
            self._over.wait(left)
            self.look()
        if self._failed is not None:
            raise self._failed
        return self.status

    def look(self) -> None:
        """Look after the viewer: once it was closed, the run ends."""
        if self._end_with_viewer and self._screen is not None and not self._screen.alive:
            viewer = self._screen.viewer
            if self.running and viewer is not None and viewer.failure:
                self._failed = UserError(f"the Rerun viewer has ended: {viewer.failure}")
            self.end("the viewer was closed")

    @property
    def failed(self) -> Exception | None:
        """What has ended the physics, None for nothing."""
        return self._failed

    def close(self) -> None:
        """End the run, and the viewer that it has opened."""
        self.end("")
        if self._thread is not None:
            self._thread.join()
        self._builder.close()
        if self._screen is not None:
            self._screen.close()

    def end(self, why: str) -> None:
        """End the run with the frame that is being computed, and say why."""
        if not self._over.is_set():
            self._status = self._status.but(ended=why)
            self._over.set()
            self._awake.set()

    def __enter__(self) -> Self:
        """Start."""
        return self.start()

    def __exit__(self, *_: object) -> None:
        """End."""
        self.close()

    @property
    def running(self) -> bool:
        """Whether the physics goes on."""
        return self._thread is not None and self._thread.is_alive() and not self._over.is_set()

    @property
    def status(self) -> Status:
        """How it goes."""
        return self._status

    @property
    def sender_process(self) -> int:
        """Number of the process that sends frames to the viewer, 0 for none."""
        sender = None if self._screen is None else self._screen.sender
        return 0 if sender is None else sender.process

    @property
    def page(self) -> str | None:
        """Where a browser finds the viewer, None for a window."""
        return None if self._screen is None else self._screen.page

    @property
    def used_bones(self) -> frozenset[str]:
        """Names of the bones that the scene uses."""
        hands = self._rig.hands
        return frozenset(hands.names[hands.index(bone)] for bone in self._rig.scene.bones)

    @property
    def positions(self) -> np.ndarray:
        """Where the cloth's vertices are in the world [m], shape (V, 3), as of the newest frame or the one before."""
        return self._rig.simulation.positions

    def take(self, *, frames: int | None = None) -> Take:
        """All frames so far, or the first ones, as a take.

        Raises:
            ValueRangeError: they are not kept.
        """
        if self._keeper is None:
            raise ValueRangeError("nothing is kept: give Live keep=True")
        failed = self._failed
        ended = "diverged" if isinstance(failed, Diverged) else "stopped"
        result = "finished" if failed is None else f"{ended} at frame {self._keeper.frames}"
        return self._keeper.take(frames, result=result, warnings=() if failed is None else (str(failed),))

    @property
    def keeper(self) -> Keeper | None:
        """What keeps the frames, None where none are kept."""
        return self._keeper

    # -- by hand --

    def pause(self, on: bool | None = None) -> None:
        """Stand still, or go on; None for whichever it does not do."""
        self._paused = not self._paused if on is None else on
        self._awake.set()

    def step(self, frames: int = 1) -> None:
        """Stand still, but for so many frames."""
        self._paused = True
        self._single += frames
        self._awake.set()

    def set_speed(self, speed: float) -> None:
        """Run at a share of real time, from 1/16 to 1."""
        self._speed = min(max(speed, 1.0 / 16.0), 1.0)

    @property
    def paused(self) -> bool:
        """Whether it is to stand still."""
        return self._paused

    @property
    def wind(self) -> Wind | None:
        """What blows, None where there is no air."""
        return self._rig.wind

    @property
    def speed(self) -> float:
        """The share of real time at which it is to run."""
        return self._speed

    def say(self, text: str) -> None:
        """Tell something in the status."""
        self._said = time.monotonic()
        self._status = self._status.but(message=text)

    @property
    def kept_enough(self) -> bool:
        """Whether no more frames are kept."""
        return self._kept_enough

    def stop_keeping(self, told: str = "recording stopped") -> None:
        """Keep no more frames than there are."""
        if not self._kept_enough:
            self._kept_enough = True
            self.say(told)

    # -- the thread of the physics --

    def _do(self, change: Callable[[], str | None]) -> None:
        """Have something done between two frames; what it gives is told."""
        self._todo.put(change)
        self._awake.set()

    def _run(self) -> None:
        switch = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH)
        # What is there now is never garbage: looking through all of it takes longer than a frame.
        gc.collect()
        gc.freeze()
        try:
            self._pacer.begin()
            self._begun = time.monotonic()
            while self._pacer.wait(self._over):
                self._change()
                if self._paused and not self._single:
                    self._stand_still()
                    continue
                self._single = max(self._single - 1, 0)
                self._advance()
                step = self._pacer.done()
                if self.steps is not None:
                    self.steps.append(step)
                self._keep_pace(step)
        except Exception as error:
            self._failed = error
            self.end(str(error))
        finally:
            gc.unfreeze()
            sys.setswitchinterval(switch)
            self._over.set()

    def _advance(self) -> None:
        self._rig.step(self._speed / self.fps)
        self._frame += 1
        if self._screen is not None:
            if self._frame % TOLD_EACH == 0:
                self._tell()
            self._screen.show(self._frame)
        if self._keeper is not None and not self._kept_enough:
            self._keeper.keep()
        if self._on_frame is not None:
            self._on_frame(self)
        simulation = self._rig.simulation
        self._status = self._status.but(
            frame=self._frame, time=self._rig.time, clock=time.monotonic() - self._begun,
            paused=self._paused, speed=self._speed,
            solver=simulation.solver.name, substeps=simulation.substeps,
        )  # fmt: skip

    def _change(self) -> None:
        """Do what was asked for since the last frame, and take over what was built."""
        said: list[str] = []
        while True:
            try:
                change = self._todo.get_nowait()
            except Empty:
                break
            try:
                text = change()
            except UserError as error:
                text = str(error)
            if text is not None:
                said.append(text)
        for text, error in self._builder.deliver():
            if error is not None and not isinstance(error, UserError):
                raise error
            told = text if error is None else str(error)
            if told is not None:
                said.append(told)
        if said:
            self.say(", ".join(said))

    def _stand_still(self) -> None:
        """Wait until there is something to do."""
        clock = time.monotonic() - self._begun
        self._status = self._status.but(paused=True, building=self._builder.making, clock=clock)
        if self._tell() and self._screen is not None:
            self._screen.show(self._frame)
        self._awake.wait(0.05)
        self._awake.clear()
        self._status = self._status.but(paused=self._paused)
        self._pacer.begin()

    def _tell(self) -> bool:
        """Have the page know how it goes; tells whether there is anything new to read."""
        return self._viewing == "page" and self._screen is not None and self._screen.tell(state_of(self))

    def _keep_pace(self, step: Step) -> None:
        self._savings.note(step.took, self._pacer.period)
        self._errors.note(self._speed / self.fps)
        if self._frame % TOLD_EACH == 0:
            if self._status.message and time.monotonic() > self._said + READ:
                self._status = self._status.but(message="")
            took, rate = self._pacer.mean_took, self._pacer.rate
            self._status = self._status.but(
                step_ms=1e3 * took, late_ms=1e3 * self._pacer.mean_late, factor=rate,
                error_mm=1e3 * self._errors.rms, given_up=self._savings.told(rate), building=self._builder.making,
                viewer="" if self._screen is None else self._screen.trouble,
            )  # fmt: skip


def source_of(source: "Source | BoneTrack | Told | None", scene: Scene) -> Source:
    """What tells where bones are, whatever was given.

    Raises:
        ValueRangeError: it gives no poses.
    """
    if isinstance(source, BoneTrack):
        return TrackSource(source)
    if source is None:
        return ToldSource(lambda _: {}, scene.bones)
    return ToldSource(source, scene.bones) if callable(source) else source


def _skin_on(skin: Skin | None, source: Source) -> Skin | None:
    """A skin, if the bones that it hangs at are all there; the source's own, if any, for None.

    Raises:
        UnknownNameError: one is not.
    """
    if skin is None and isinstance(source, Dressed):
        skin = source.skin
    for bone in () if skin is None else skin.bones:
        if bone not in source.names:
            raise UnknownNameError("bone", bone, source.names, "The skin hangs at it")
    return skin


def _first_motion(source: object, scene: Scene, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """With what velocity [m/s] and spin [rad/s] a motion sets out, which other sources do not tell."""
    if isinstance(source, TrackSource):
        source = source.track
    if not isinstance(source, BoneTrack) or source.frames < 2:
        return np.zeros(3), np.zeros(3)
    with suppress(UserError):
        return first_motion(scene, source, None)
    return np.zeros(3), np.zeros(3)
