"""A live run: it shows what a loop of one's own computes, changes what it is told to, and waits for no viewer."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import cape
import motions
import skeleton
from cape.live.live import Live
from cape.live.pace.pacing import Pacer
from cape.live.sources import TrackSource
from cape.run.whereabouts import Diverged
from motions.errors import UnknownNameError, ValueRangeError
from skeleton.track import BoneTrack

FPS = 60.0
SHEET = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.1)
SCENE = cape.Scene(SHEET, [cape.attach(SHEET, "rod", "top")], wind=cape.Wind())
TURNED = (1.0, 0.0, 0.0, 0.0)
LONG = 60.0  # s that something may take on a machine that is busy


def rod(time: float) -> dict[str, tuple[NDArray, tuple[float, ...]]]:
    return {"rod": (np.array([0.1 * np.sin(3.0 * time), 0.0, 0.0]), TURNED)}


def live(scene: cape.Scene = SCENE, **options: object) -> Live:
    return Live(scene, rod, **{"viewer": "none", "keep": True, **options})  # pyright: ignore[reportArgumentType]


def until(true: Callable[[], object], run: Live) -> None:
    """Wait until something is so, while a run goes on."""
    end = time.monotonic() + LONG
    while not true():
        assert run.running, run.failed
        assert time.monotonic() < end, run.status
        time.sleep(0.005)


def test_it_computes_what_a_loop_of_ones_own_does():
    with live() as run:
        until(lambda: run.status.frame >= 20, run)
    take = run.take(frames=21)
    simulation = cape.Simulation(SCENE)
    simulation.start(rod(0.0))
    for frame in range(1, 21):
        simulation.step(rod(frame / FPS), 1.0 / FPS)
        np.testing.assert_array_equal(take.positions[frame], simulation.positions.astype(np.float32))
    np.testing.assert_allclose(take.bones.times, np.arange(21) / FPS, atol=1e-12)
    np.testing.assert_allclose(take.bones.positions[20], [rod(20 / FPS)["rod"][0]], atol=1e-12)
    assert take.stretch_max.shape == take.kinetic_energy.shape == (21,)


def test_what_is_kept_can_be_read_back(tmp_path: Path):
    with live() as run:
        until(lambda: run.status.frame >= 5, run)
    take = run.take()
    take.keep(tmp_path / "run.npz")
    np.testing.assert_array_equal(cape.Take.load(tmp_path / "run.npz").positions, take.positions)


def test_pause_and_single_frames():
    with live() as run:
        until(lambda: run.status.frame >= 3, run)
        run.pause(True)
        until(lambda: run.status.paused, run)
        before = run.status.frame
        run.step(3)
        until(lambda: run.status.frame == before + 3, run)
        run.wait(0.2)  # in which a run that went on would be frames ahead
        assert run.status.frame == before + 3
        assert run.status.paused
        run.pause(False)
        until(lambda: run.status.frame > before + 3, run)
        assert not run.status.paused


def test_slow_motion_takes_shorter_steps():
    with live() as run:
        run.set_speed(0.25)
        until(lambda: run.status.frame >= 20, run)
    steps = np.diff(run.take().bones.times)
    assert steps[-1] == pytest.approx(0.25 / FPS, abs=1e-12)


def test_the_wind_is_turned_on_and_carries_the_cloth_along():
    with live() as run:
        until(lambda: run.status.frame >= 2, run)
        run.changes.set_wind((0.0, 20.0, 0.0))
        begun = run.status.frame
        until(lambda: run.status.frame >= begun + 40, run)
    sideways = run.take().positions[:, -1, 1]
    assert np.abs(np.diff(sideways[:begun])).max(initial=0.0) < 1e-3
    assert abs(sideways[-1] - sideways[begun]) > 0.02


def changed(change: Callable[[Live], None], told: str, scene: cape.Scene = SCENE) -> tuple[Live, int]:
    """A run in which something has been changed that had to be built; and the frame at which it was."""
    with live(scene) as run:
        until(lambda: run.status.frame >= 10, run)
        change(run)
        until(lambda: told in run.status.message, run)
        frame = run.status.frame
        until(lambda: run.status.frame >= frame + 20, run)
    return run, frame


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda run: run.changes.set_fabric("denim"), "fabric denim"),
        (lambda run: run.changes.set_self_contact(True), "self-contact"),
        (lambda run: run.changes.set_solver("xpbd"), "solver xpbd"),
        (lambda run: run.changes.pin("bottom left"), "bottom left pinned"),
    ],
    ids=["fabric", "self-contact", "solver", "pin"],
)
@pytest.mark.few("fabric", "solver")
def test_what_is_changed_goes_on_from_where_the_cloth_is(change: Callable[[Live], None], told: str):
    """No vertex gets farther in a frame than cloth at 3 m/s, as it would be where it was put on anew."""
    run, _ = changed(change, told)
    steps = np.linalg.norm(np.diff(run.take().positions, axis=0), axis=-1)
    assert steps.max() < 3.0 / FPS
    assert steps[-1].max() > 0.0
    assert len(run.take().topologies) == 1  # so that it can be exported as any other


class Busy:
    """A clock that only frames and sleeping turn on, of a machine that is ever busier, and free again at last."""

    stages = ((1.0, "euler"), (2.0, "xpbd in 20"), (4.0, "xpbd in 10"), (8.0, "slower than real time"), (1.0, "euler"))

    def __init__(self) -> None:
        self.now, self.stage, self.frames = 0.0, 0, 0
        self.seen: list[tuple[str, int]] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def frame(self, run: Live) -> None:
        """A frame of symplectic Euler takes 0.6 of its time, one of XPBD in 20 steps 0.3, on a machine that is free."""
        now = run._rig.solver.name, run._rig.simulation.substeps
        if not self.seen or self.seen[-1] != now:
            self.seen.append(now)
        busy, told = self.stages[self.stage]
        self.frames += told in f"{now[0]} in {now[1]}, {run.status.given_up}"
        if self.frames == 200 and self.stage + 1 < len(self.stages):
            self.stage, self.frames = self.stage + 1, 0
        self.now += busy / FPS * {"euler": 0.6 / self.seen[0][1], "xpbd": 0.3 / 20.0}[now[0]] * now[1]


def test_it_falls_behind_step_by_step_and_catches_up_again():
    """Nothing leaps when another solver goes on, whenever its cloth is ready."""
    clock = Busy()
    run = live(on_frame=clock.frame)
    run._pacer = Pacer(1.0 / FPS, clock=clock, sleep=clock.sleep)
    with run:
        until(lambda: clock.stage == 4 and clock.frames >= 400, run)
        assert run.status.given_up == ""
    own = clock.seen[0]
    assert own[0] == "euler"
    assert clock.seen == [own, ("xpbd", 20), ("xpbd", 10), ("xpbd", 20), own]
    steps = np.linalg.norm(np.diff(run.take().positions, axis=0), axis=-1)
    assert steps.max() < 3.0 / FPS


def test_what_is_pinned_stays_where_it_was_and_is_let_go_again():
    run, frame = changed(lambda run: run.changes.pin("bottom left"), "pinned")
    corner = run.take().positions[frame:, SHEET.region("bottom")[0]]
    assert np.ptp(corner, axis=0).max() < 1e-6
    run, _ = changed(lambda run: run.changes.pin("top"), "let go")
    fallen = run.take().positions[:, SHEET.region("top")[0], 2]
    assert fallen[0] - fallen[-1] > 0.1


def test_it_tears_by_hand_and_is_put_on_anew():
    with live() as run:
        until(lambda: run.status.frame >= 5, run)
        run.changes.tear()
        until(lambda: "torn" in run.status.message, run)
        torn = run.status.frame
        until(lambda: run.status.frame >= torn + 5, run)
        run.changes.set_fabric("denim")
        until(lambda: "fabric denim" in run.status.message, run)
        changed = run.status.frame
        until(lambda: run.status.frame >= changed + 5, run)
        run.changes.reset()
        until(lambda: run.status.message == "put on anew", run)
        whole = run.status.frame
        until(lambda: run.status.frame >= whole + 5, run)
    take = run.take()
    assert take.tears > 0
    assert take.positions.shape[1] > SHEET.vertices
    assert [len(t.parents) for t in take.topologies][-1] == SHEET.vertices
    assert len(take.topologies) == 3


def test_mistakes_are_told_and_the_run_goes_on():
    with live() as run:
        run.changes.set_fabric("velvet rope")
        until(lambda: "velvet rope" in run.status.message, run)
        run.changes.pin("nowhere")
        until(lambda: "bottom left" in run.status.message, run)
        run.changes.move("nobody", (1.0, 0.0, 0.0))
        until(lambda: "rod" in run.status.message, run)
        before = run.status.frame
        until(lambda: run.status.frame > before, run)
        assert run.running
        assert run.failed is None
        assert run.status.solver == "euler"
    assert np.isfinite(run.take().positions).all()


def test_an_object_moves_by_hand():
    with live() as run:
        until(lambda: run.status.frame >= 2, run)
        run.changes.move("rod", (0.0, 0.0, 0.05))
        before = run.status.frame
        until(lambda: run.status.frame >= before + 3, run)
    heights = run.take().bones.positions[:, 0, 2]
    assert heights[0] == 0.0
    assert heights[-1] == pytest.approx(0.05, abs=1e-12)


def test_a_source_that_fails_ends_the_run_and_keeps_what_there_was():
    def told(time: float) -> dict[str, tuple[NDArray, tuple[float, ...]]]:
        if time > 0.2:
            raise RuntimeError("the tracker is gone")
        return rod(time)

    run = Live(SCENE, told, viewer="none", keep=True)
    with pytest.raises(RuntimeError, match="tracker is gone"), run:
        run.wait(LONG)
    assert run.take().result == "stopped at frame 13"
    assert len(run.take().positions) == 13  # the first one, and those up to 0.2 s


def test_bones_that_the_scene_lacks_are_told_at_once():
    with pytest.raises(UnknownNameError, match="rod"):
        Live(SCENE, lambda _: {"pole": (np.zeros(3), TURNED)}, viewer="none")
    with pytest.raises(ValueRangeError, match="fps"):
        Live(SCENE, rod, fps=0.0)
    with pytest.raises(ValueRangeError, match=r'viewer is "window", .* not \'browser\''):
        Live(SCENE, rod, viewer="browser")
    assert issubclass(Diverged, Exception)


def test_a_character_goes_on_where_its_motion_ends():
    """A walk of 1 m/s that turns by a right angle: rounds follow on each other, without a jump in place or turn."""
    times = np.linspace(0.0, 2.0, 121)
    angle = np.pi / 2.0 * times / 2.0
    places = np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle], axis=1)[:, None] * 4.0 / np.pi
    turns = np.stack([np.cos(angle / 2.0), 0.0 * angle, 0.0 * angle, np.sin(angle / 2.0)], axis=1)[:, None]
    source = TrackSource(BoneTrack(("hips",), times, places, turns, roles={"pelvis": "hips"}))
    there = np.array([source.pose(t).positions[0] for t in np.arange(0.0, 9.0, 0.1)])
    speeds = np.linalg.norm(np.diff(there, axis=0), axis=1) / 0.1
    assert speeds.min() > 0.9
    assert speeds.max() < 1.1
    # Once round is eight metres.
    assert np.linalg.norm(there[80] - there[0]) < 0.3


def test_what_is_no_character_goes_back_the_way_it_came():
    times = np.linspace(0.0, 1.0, 61)
    places = np.stack([times, 0.0 * times, 0.0 * times], axis=1)[:, None]
    source = TrackSource(BoneTrack(("cube",), times, places, np.tile(TURNED, (61, 1, 1))))
    at = [float(source.pose(t).positions[0, 0]) for t in (0.25, 1.25, 2.25, 3.75)]
    assert at == pytest.approx([0.25, 0.75, 0.25, 0.25], abs=1e-12)


@pytest.fixture
def deaf() -> Iterator[str]:
    """The URL of a viewer that takes connections and never reads."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        yield f"rerun+http://127.0.0.1:{server.getsockname()[1]}/proxy"


def test_a_viewer_that_reads_nothing_is_not_waited_for(deaf: str):
    with live(viewer=deaf, keep=False) as run:
        until(lambda: "not answer" in run.status.viewer, run)
        before = run.status.frame
        until(lambda: run.status.frame >= before + 30, run)
        process = run.sender_process
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_a_viewer_is_not_told_again_what_stays(deaf: str):
    """Another solver moves what is shown already; another fabric may be drawn otherwise."""
    with live(viewer=deaf, keep=False) as run:
        screen = run._screen
        assert screen is not None
        before = screen._setup
        run.changes.set_solver("xpbd")
        until(lambda: run.status.solver == "xpbd", run)
        assert screen._setup == before
        run.changes.set_fabric("denim")
        until(lambda: screen._setup != before, run)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals that stop a process")
def test_a_sender_that_is_stopped_is_not_waited_for(deaf: str):
    with live(viewer=deaf, keep=False) as run:
        os.kill(run.sender_process, signal.SIGSTOP)
        before = run.status.frame
        until(lambda: run.status.frame >= before + 30, run)
        assert Path(f"/proc/{run.sender_process}/stat").read_text().rpartition(")")[2].split()[0] == "T"
        assert run.running
        assert run.failed is None


def test_the_sender_ends_with_a_run_that_is_killed_and_leaves_nothing(tmp_path: Path, deaf: str):
    script = (
        "import sys, time, tests.live.test_live as t\n"
        "run = t.live(viewer=sys.argv[1], keep=False).start()\n"
        "print(run.sender_process, run._screen.sender._folder.name, flush=True); time.sleep(60)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, deaf], cwd=Path(__file__).parents[2], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    sender, folder = process.stdout.readline().split()
    process.kill()
    process.wait()
    end = time.monotonic() + LONG
    while Path(f"/proc/{sender}").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{sender}/cmdline").exists() or not Path(f"/proc/{sender}/cmdline").read_bytes()
    assert not Path(folder).exists()  # which is in memory


def test_no_thread_is_left_behind():
    with live().start() as run:  # twice, which is as once
        until(lambda: run.status.frame >= 2, run)
    assert not [thread.name for thread in threading.enumerate() if thread.name == "cape-physics"]


def test_a_cape_that_is_worn_can_be_taken_in_the_hand():
    """Its hem is led away from the body, and falls back when it is let go of."""
    clip = motions.load("idle")
    body = skeleton.Skeleton.from_clip(clip)
    scene = cape.dress(body, body.track(clip), garment="back_cape", spacing=0.08, self_contact=False)
    hem = int(scene.cloth.region("bottom")[len(scene.cloth.region("bottom")) // 2])
    with Live(scene, body.track(clip), viewer="none", keep=True) as run:
        until(lambda: run.status.frame >= 5, run)
        run.changes.pin([hem])
        until(lambda: "pinned" in run.status.message, run)
        held, there = run.status.frame, run.positions[hem]
        goal = there + np.array([-0.2, 0.0, 0.1])
        run.changes.reach(hem, goal)
        until(lambda: run.status.frame >= held + 30, run)
        led = run.status.frame
        run.changes.pin([hem])
        until(lambda: "let go" in run.status.message, run)
        free = run.status.frame
        until(lambda: run.status.frame >= free + 30, run)
    places = run.take().positions
    np.testing.assert_allclose(places[led, hem], goal, atol=0.02)
    assert np.linalg.norm(places[-1, hem] - places[led, hem]) > 0.03
    steps = np.linalg.norm(np.diff(places, axis=0), axis=-1)
    assert steps.max() < 5.0 / FPS  # nothing leaps, as it would from holds that were elsewhere
