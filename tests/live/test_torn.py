"""A torn cloth that goes on in a live run, held by hand at its new edges, and changed: tears stay, nothing leaps."""

from collections.abc import Callable
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.typing import NDArray

import cape
from cape.live.changes import Changes
from cape.live.live import Live
from cape.live.rig import Rig
from cape.live.sources import ToldSource
from cape.results.take import Take
from cape.run.tearing.tears import Tears
from motions.errors import ValueRangeError
from tests.live.rigs import Later, advance, at_once

FPS = 60.0
SHEET = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.1)
SCENE = cape.Scene(
    SHEET, [cape.attach(SHEET, "rod", "top")], wind=cape.Wind(), tearing=cape.Tearing(strain=0.6),
    self_contact=cape.SelfContact(),
)  # fmt: skip
FIRST = SHEET.vertices  # the first vertex that is born of a tear
WAY = np.array([0.04, 0.0, 0.03])  # m, off the plane of the sheet and up, which a hand goes in a single frame
TORN, HELD, LED, LET_GO, ENDED = 10, 20, 30, 60, 80

Plan = dict[int, Callable[[Live], None]]


def ran(plan: Plan, *, scene: cape.Scene = SCENE, threads: int = 1, frames: int = ENDED, solver: str = "euler") -> Take:
    """A live run in which something is done after some frames, on the thread of the physics: it comes with the next.

    What is made ready beside the run is waited for, so that the same frames have it each time.
    """

    def act(run: Live) -> None:
        frame = run._frame
        if frame in plan:
            plan[frame](run)
            run._change()
            while run.changes.pending:
                run._change()
        if frame == frames:
            run.end("enough")

    rod = {"rod": (np.zeros(3), (1.0, 0.0, 0.0, 0.0))}
    run = Live(
        scene, lambda _: rod, viewer="none", keep=True, threads=threads, solver=cape.solver(solver), on_frame=act
    )
    with patch.object(run._savings, "note"), run:  # a machine that is busy is no reason for other steps
        run.wait(60.0)
    assert run.failed is None
    return run.take()


def tear(run: Live) -> None:
    run.changes.tear()


def lead(way: NDArray) -> Callable[[Live], None]:
    return lambda run: run.changes.reach(FIRST, run.positions[FIRST] + way)


BY_HAND: Plan = {
    TORN: tear,
    HELD: lambda run: run.changes.take_hold(FIRST),
    LED: lead(WAY),
    LET_GO: lambda run: run.changes.let_go(FIRST),
}


def speeds(take: Take, begin: int, end: int) -> NDArray:
    """How fast the fastest vertex of each frame is [m/s]."""
    return FPS * np.linalg.norm(np.diff(take.positions[begin:end], axis=0), axis=-1).max(axis=1)


@pytest.mark.parametrize("solver", ["euler", "xpbd", "backward_euler"])
def test_a_hand_leads_a_vertex_that_a_tear_has_made(solver: str):
    """It holds still what it takes, is followed within two frames, and lets it fall; the tears stay."""
    take = ran(BY_HAND, solver=solver)
    assert take.tears > 0
    assert len(take.topologies) == 2
    assert len(take.topologies[-1].parents) > FIRST
    way = take.positions[:, FIRST] - take.positions[LED, FIRST]
    # 50 g of cloth hang at it at most, which draw a hand of 200 N/m or more off by less than 3 mm.
    assert np.linalg.norm(way[HELD + 2 : LED], axis=1).max() < 0.003
    off = np.linalg.norm(way[LED + 2 : LET_GO] - WAY, axis=1)
    assert off[0] < 0.25 * np.linalg.norm(WAY)
    assert off[-1] < 0.1 * np.linalg.norm(WAY)
    assert np.linalg.norm(way[-1] - WAY) > 0.5 * np.linalg.norm(WAY)
    assert speeds(take, HELD, LED).max() < 0.3
    assert speeds(take, LED, LET_GO).max() < 1.5 * FPS * np.linalg.norm(WAY)


def test_a_hand_has_the_same_bits_on_any_number_of_threads():
    one, two = (ran(BY_HAND, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.positions, two.positions)


def test_it_tears_on_while_it_is_held():
    """What the hand has stays whole, and the cloth comes off around it or away from it."""
    scene = replace(SCENE, tearing=cape.Tearing(strain=0.1))
    pull = lead(np.array([1.0, 0.0, -1.0]))
    take = ran({TORN: tear, HELD: BY_HAND[HELD], LED: pull}, scene=scene, frames=LED + 30)
    assert [topology for topology in take.topologies if topology.frame > LED]
    cells = [np.count_nonzero((t.triangles == FIRST).any(axis=1)) for t in take.topologies[1:]]
    assert set(cells) == {cells[0]}
    assert np.isfinite(take.positions[-1]).all()


@pytest.mark.parametrize(
    "change",
    [
        lambda run: run.changes.set_fabric("denim"),
        lambda run: run.changes.set_self_contact(False),
        lambda run: run.changes.pin("bottom left"),
        lambda run: run.changes.pin("top left"),
        lambda run: run.changes.set_substeps(2.0),
        lambda run: run.changes.set_wind((0.0, 1.0, 0.0)),
    ],
    ids=["fabric", "self-contact", "pin", "let-go", "substeps", "wind"],
)
@pytest.mark.few("euler-fabric", "xpbd-pin")
@pytest.mark.parametrize("solver", ["euler", "xpbd"])
def test_what_is_changed_leaves_the_tears_and_the_hand(solver: str, change: Callable[[Live], None]):
    """Nothing leaps, as it would from where it was put on, and the hand still leads its vertex."""
    at = LED + 20
    plan = {TORN: tear, HELD: BY_HAND[HELD], LED: BY_HAND[LED]}
    usual, changed = (ran(each, solver=solver, frames=at + 20) for each in (plan, {**plan, at: change}))
    np.testing.assert_array_equal(changed.positions[: at + 1], usual.positions[: at + 1])
    assert changed.tears == usual.tears > 0
    assert len(changed.topologies) == len(usual.topologies) == 2
    assert changed.topologies[-1].is_as(usual.topologies[-1])
    densities = [take.cloth.fabric.density for take in (usual, changed) if take.cloth is not None]
    assert changed.mass[1] / usual.mass[1] == pytest.approx(densities[1] / densities[0], rel=1e-6)
    assert speeds(changed, at, at + 20).max() < 1.5 * speeds(usual, LED, at + 20).max()
    goal = usual.positions[LED, FIRST] + WAY
    np.testing.assert_allclose(changed.positions[at:, FIRST], np.tile(goal, (21, 1)), atol=0.006)


@pytest.mark.parametrize(("first", "then"), [("xpbd", "tr_bdf2"), ("euler", "xpbd")])
def test_another_solver_takes_over_what_has_torn(first: str, then: str):
    """A mesh in one that steps no spare vertices, and a grid as a mesh, by the same triangles; which tears on."""
    at = LED + 20
    plan = {TORN: tear, HELD: BY_HAND[HELD], LED: BY_HAND[LED]}
    usual = ran(plan, solver=first, frames=at + 20)
    plan[at] = lambda run: run.changes.set_solver(then)
    take = ran(plan, solver=first, frames=at + 20)
    assert take.solver == then
    assert take.tears == usual.tears
    assert len(take.topologies) == 2
    assert take.topologies[-1].is_as(usual.topologies[-1])
    assert take.mass == pytest.approx(usual.mass, rel=1e-6)
    assert speeds(take, at, at + 20).max() < 1.5 * speeds(usual, LED, at + 20).max()
    goal = take.positions[LED, FIRST] + WAY
    np.testing.assert_allclose(take.positions[at:, FIRST], np.tile(goal, (21, 1)), atol=0.006)
    plan[at + 5] = tear
    assert ran(plan, solver=first, frames=at + 20).tears > take.tears


def test_what_tears_while_a_change_is_made_ready_is_torn_in_what_goes_on():
    """The first tear is there when the other cloth is laid out, the second only when that goes on."""

    def change(run: Live) -> None:
        rig, changes = run._rig, run.changes
        scene = replace(rig.scene, self_contact=None)
        built = rig.build(scene, rig.solver, rig.first_pose_for(scene), anew=False)
        rig.tear(changes._next_tear())
        rig.take_over(built, rig.solver)

    take = ran({TORN: tear, LED: change})
    twice = ran({TORN: tear, LED: tear}, scene=replace(SCENE, self_contact=None))
    assert take.tears == twice.tears
    assert take.topologies[-1].is_as(replace(twice.topologies[-1], frame=take.topologies[-1].frame))
    assert speeds(take, LED, ENDED).max() < 3.0


def test_what_is_put_on_anew_meanwhile_is_not_taken_over_as_it_was_torn():
    """As where bones jump: the cloth that was made ready is given up, and the run goes on with its own."""
    rod, builder = {"rod": (np.zeros(3), (1.0, 0.0, 0.0, 0.0))}, Later()
    rig = Rig(SCENE, ToldSource(lambda _: rod, SCENE.bones), cape.SymplecticEuler(), threads=1)
    rig.start()
    changes = Changes(rig, builder, at_once)
    changes.tear()
    changes.set_fabric("denim")
    builder.work()
    rig.simulation.start(rod)
    with pytest.raises(ValueRangeError, match="torn otherwise"):
        builder.hand_over()
    assert not changes.pending
    advance(rig, 2)
    assert rig.scene is SCENE
    assert rig.topology is None


@pytest.mark.parametrize("solver", [cape.SymplecticEuler(), cape.XPBD()], ids=["grid", "mesh"])
def test_what_has_torn_is_torn_beside_the_run_and_knows_of_it_where_it_touches_itself(
    solver: cape.Solver, monkeypatch: pytest.MonkeyPatch
):
    rod, builder = {"rod": (np.zeros(3), (1.0, 0.0, 0.0, 0.0))}, Later()
    rig = Rig(SCENE, ToldSource(lambda _: rod, SCENE.bones), solver, threads=1)
    rig.start()
    changes = Changes(rig, builder, at_once)
    changes.tear()
    changes.set_fabric("denim")
    builder.work()

    def become(*_: object) -> None:
        raise AssertionError("a frame waits for what could have been made ready")

    monkeypatch.setattr(Tears, "become", become)
    assert builder.hand_over() == ["fabric denim"]
    assembly = rig.simulation.assembly
    assert assembly.layers is not None
    known = {tuple(sorted(corners)) for corners in assembly.layers.patches.triangles.T.tolist()}
    assert known == {tuple(sorted(corners)) for corners in assembly.cloth.triangles.tolist()}


def test_what_is_put_on_anew_is_whole_and_in_no_hand():
    take = ran({**BY_HAND, LED + 10: lambda run: run.changes.reset()})
    assert len(take.topologies[-1].parents) == FIRST
    falls = take.positions[LED + 12 :, FIRST - 1]
    assert np.isfinite(falls).all()
