"""What a live run is built of: an error that is estimated, hands that lead, orders that a page gives."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import cape
from cape.live.error_watch import FRAMES, ErrorWatch
from cape.live.holds import corners, let_go, rim, tear_path
from cape.live.live import Live
from cape.live.page.orders import obey, orders_of
from cape.live.rig import Rig
from cape.live.sources import FASTEST, Hands, ToldSource, TrackSource
from cape.live.status import Status
from cape.run.hanging import Hanging
from cape.scene.standard_scenes import swing
from cape.solvers.base import Programs
from motions.errors import ValueRangeError
from tests.live.rigs import AtOnce, advance, swinging

TURNED = (1.0, 0.0, 0.0, 0.0)
SHEET = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.1)


def test_a_solver_that_stands_ready_goes_on_as_one_that_is_laid_out_in_place():
    """To the last bit, of a cloth in contact with itself: nothing that was known is lost."""
    rig, changes, builder = swinging()
    other, _, _ = swinging()
    np.testing.assert_array_equal(rig.simulation.positions, other.simulation.positions)
    changes.set_solver("xpbd")
    builder.work()
    before = rig.simulation
    assert builder.hand_over() == ["solver xpbd"]
    assert rig.simulation is not before
    other.simulation.change_solver(cape.XPBD())
    for _ in range(10):
        advance(rig, 1)
        advance(other, 1)
        np.testing.assert_array_equal(rig.simulation.positions, other.simulation.positions)
        np.testing.assert_array_equal(rig.simulation.velocities, other.simulation.velocities)
    changes.set_solver("euler")  # for which the first one stands by
    assert rig.simulation is before
    other.simulation.change_solver(cape.SymplecticEuler())
    advance(rig, 5)
    advance(other, 5)
    np.testing.assert_array_equal(rig.simulation.positions, other.simulation.positions)


def test_nothing_that_takes_long_is_left_to_the_frames(monkeypatch: pytest.MonkeyPatch):
    """A cloth is laid out, and its programs are made, before it is handed over."""
    rig, changes, builder = swinging()
    made: list[str] = []
    for of in (Hanging, Programs):

        def begin(self: Any, *given: Any, of: Any = of, begun: Any = of.__init__, **named: Any) -> None:
            made.append(of.__name__)
            begun(self, *given, **named)

        monkeypatch.setattr(of, "__init__", begin)
    for change in (
        lambda: changes.set_fabric("denim"),
        lambda: changes.set_self_contact(False),
        lambda: changes.set_solver("xpbd"),
        lambda: changes.set_solver("backward_euler", substeps=2),
        lambda: changes.pin("bottom left"),
        changes.reset,
    ):
        change()
        builder.work()
        assert {"Hanging", "Programs"} <= set(made)
        made.clear()
        builder.hand_over()
        advance(rig, 3)
        changes.set_substeps(2.0)
        advance(rig, 3)
        assert made == []


def test_what_is_pinned_is_held_where_it_is_by_then():
    """However far it has swung since that was asked for."""
    rig, changes, builder = swinging(self_contact=False)
    bottom, asked = rig.scene.cloth.region("bottom"), rig.simulation.positions
    changes.pin("bottom")
    builder.work()
    advance(rig, 20)
    there = rig.simulation.positions[bottom]
    assert np.ptp(there - asked[bottom], axis=0).max() > 0.005  # it has another shape now
    builder.hand_over()
    advance(rig, 5)
    np.testing.assert_allclose(rig.simulation.positions[bottom], there, atol=1e-6)


def test_changes_that_wait_for_each_other_are_all_made_and_told():
    rig, changes, builder = swinging()
    changes.set_fabric("denim")
    changes.set_solver("xpbd")
    changes.reset()
    changes.set_self_contact(False)
    assert changes.pending
    builder.work()
    assert builder.hand_over() == ["fabric denim, solver xpbd, put on anew, no self-contact"]
    assert not changes.pending
    assert rig.scene.cloth.fabric == cape.fabric("denim")
    assert rig.scene.self_contact is None
    assert rig.solver == cape.XPBD()
    assert rig.simulation.positions[:, 2].min() > -1.0


def test_what_can_not_be_built_leaves_all_as_it_was():
    rig, changes, builder = swinging()
    before = rig.simulation
    changes.set_fabric(replace(cape.fabric("denim"), stretch=1e15))
    builder.work()
    with pytest.raises(ValueRangeError):
        builder.hand_over()
    assert rig.simulation is before
    changes.set_fabric("denim")
    builder.work()
    assert builder.hand_over() == ["fabric denim"]


def test_the_estimate_of_the_error_is_that_of_ever_shorter_steps():
    """Of a swinging sheet, against sixteen times as many steps from one state; of first order, within 10 %."""
    standard = swing(spacing=0.1)
    rig = Rig(standard.scene, TrackSource(standard.track), cape.SymplecticEuler(), threads=1)
    rig.start()
    for _ in range(60):
        rig.step(1.0 / 60.0)
    begin = rig.simulation.snapshot()
    watch, poses = ErrorWatch(rig, AtOnce()), []
    watch._begin, watch._simulation = begin, rig.simulation
    for _ in range(FRAMES):
        rig.step(1.0 / 60.0)
        poses.append(rig.pose_for(rig.scene))
        watch.note(1.0 / 60.0)
    exact = cape.Simulation(standard.scene, solver=rig.solver.in_steps(16 * rig.simulation.substeps, 1.0 / 60.0))
    exact.start_from(begin)
    for pose in poses:
        exact.step(pose, 1.0 / 60.0)
    off = np.sqrt(np.mean(np.sum((rig.simulation.positions - exact.positions) ** 2, axis=1)))
    assert watch.rms == pytest.approx(off, rel=0.1)


def test_a_hand_leads_no_faster_than_it_can():
    hands = Hands(ToldSource(lambda _: {"rod": (np.zeros(3), TURNED)}, ("rod",)))
    hands.put("pin", (0.0, 0.0, 1.0))
    hands.reach("pin", (1.0, 0.0, 1.0))
    places = [hands.pose(k / 60.0).positions[hands.index("pin")] for k in range(60)]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1) * 60.0
    assert steps.max() == pytest.approx(FASTEST, rel=1e-9)
    np.testing.assert_array_equal(places[-1], (1.0, 0.0, 1.0))
    with pytest.raises(KeyError):
        hands.reach("rod", np.zeros(3))


def test_corners_and_what_can_be_let_go_of():
    assert set(corners(SHEET)) == {"top left", "top right", "bottom left", "bottom right"}
    scene = cape.Scene(SHEET, [cape.attach(SHEET, "rod", "top")], wind=cape.Wind())
    assert let_go(scene, SHEET.region("bottom")) is None
    freed = let_go(scene, SHEET.region("top_left"))
    assert freed is not None
    held = np.concatenate([attachment.vertices for attachment in freed.attachments])
    assert set(held) == set(SHEET.region("top")) - set(SHEET.region("top_left"))
    empty = let_go(scene, SHEET.region("top"))
    assert empty is not None
    assert list(empty.attachments) == []


def test_what_keeps_a_cloth_short_does_so_when_it_can_be_torn():
    standard = swing(spacing=0.1)
    scene = replace(standard.scene, strain_limit=True, tethers=cape.Tethers())
    rig = Rig(scene, TrackSource(standard.track), cape.SymplecticEuler(), threads=1)
    tearable = rig.with_tearing()
    assert tearable.tearing is not None
    assert tearable.strain_limit
    assert tearable.tethers is scene.tethers


def test_a_tear_runs_straight_in_from_the_rim():
    edges = rim(SHEET)
    outer = {name: set(SHEET.region(name)) for name in ("top", "bottom", "left", "right")}
    assert set(edges) == set().union(*outer.values())
    path = tear_path(SHEET, int(SHEET.region("bottom")[5]), 4)
    along = np.diff(SHEET.pattern[path], axis=0)
    np.testing.assert_allclose(along, np.tile([0.0, -0.1], (4, 1)), atol=1e-9)


def test_the_page_is_obeyed_in_what_there_is_and_in_nothing_else():
    scene = cape.Scene(SHEET, [cape.attach(SHEET, "rod", "top")], wind=cape.Wind())
    run = Live(scene, lambda _: {"rod": (np.zeros(3), TURNED)}, viewer="none")
    obey(run, '["speed", 0.5]\n')
    assert run.speed == 0.5
    for line in ("", "speed 0.5", '["__class__"]', '["speed"]', '{"speed": 1}', '["speed", "fast"]', "[" * 100_000):
        obey(run, line)
        assert "unknown" in run.status.message, line[:20]
        run.say("")
    assert run.speed == 0.5
    assert {"grab", "reach", "let_go", "wind", "fabric", "solver", "tear", "reset"} <= set(orders_of(run))


def test_the_line_of_status_fits_and_says_what_there_is():
    status = Status(frame=7, step_ms=6.5, solver="euler", substeps=75, error_mm=0.5, message="wind " * 40)
    assert status.line(80).startswith("frame 7 | 6.5 ms, 1.00x | euler 75, 0.50 mm | wind")
    assert len(status.line(80)) == 79
    assert "mm" not in replace(status, error_mm=float("nan")).line(200)
    assert "paused" in replace(status, paused=True).line(80)


def test_more_substeps_are_more_from_one_on():
    rig, changes, builder = swinging(self_contact=False)
    changes.set_solver("xpbd", substeps=1)
    builder.work()
    builder.hand_over()
    counts = []
    for factor in (1.25, 1.25, 1.25, 1.25, 0.8, 0.8, 0.8, 0.8, 0.8):
        advance(rig, 1)
        changes.set_substeps(factor)
        counts.append(rig.solver.substeps)
    assert counts == [2, 3, 4, 5, 4, 3, 2, 1, 1]
