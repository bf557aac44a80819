"""What is dragged on the page, without a browser: drags as orders, what of them reaches the cloth, and what a server
tells those who look."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

import cape
from cape.live.feed.mailbox import LiveFrame
from cape.live.feed.viewers import LOOPBACK, free_port
from cape.live.page.controls import OWN, QUIET, add_controls
from cape.live.page.grips import REMEMBERED, Grips
from cape.live.page.orders import beginning_of
from cape.record.moments import Shown
from cape.scene.standard_scenes import swing

ROWS = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1).astype(np.float32)  # vertices a metre apart


class Pull(NamedTuple):
    """A drag as viser tells it."""

    phase: str
    end_position: tuple[float, float, float]
    client_id: int = 1


def gripping(*positions: np.ndarray, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple[Grips, list[Any]]:
    said: list[Any] = []
    grips = Grips(lambda *order: said.append(order))
    for each in positions:
        grips.show(each, offset)
    return grips, said


def test_the_vertex_under_the_pointer_is_led_and_let_go():
    grips, said = gripping(ROWS)
    for pull in (Pull("start", (3.2, 0, 0)), Pull("update", (3.0, 1, 0)), Pull("end", (3.0, 2, 0))):
        grips.cloth(pull)
    assert said == [("grab", 3), ("reach", 3, 3.2, 0, 0), ("reach", 3, 3.0, 1, 0), ("let_go", 3)]


def test_a_browser_that_draws_late_takes_the_vertex_that_it_shows():
    """The cloth moves on by 0.7 m a frame; what was grabbed is where vertex 1 was ten frames ago."""
    frames = [ROWS + np.array([0.7 * k, 0.1 * k, 0.0], np.float32) for k in range(20)]
    grips, said = gripping(*frames)
    grips.cloth(Pull("start", tuple(frames[9][1] + np.array([0.02, 0.01, 0.0]))))
    assert said[0] == ("grab", 1)
    for _ in range(REMEMBERED):
        grips.show(ROWS)
    grips.cloth(Pull("start", tuple(frames[9][1])))  # nobody shows that any more
    assert said[-2] == ("grab", 4)
    assert ("let_go", 1) in said  # its end was never told


def test_where_the_page_shows_the_world_elsewhere_orders_are_of_the_world():
    grips, said = gripping(ROWS - np.array([10.0, 0.0, 0.0], np.float32), offset=(-10.0, 0.0, 0.0))
    grips.cloth(Pull("start", (-8.0, 0.0, 0.0)))
    assert said == [("grab", 2), ("reach", 2, 2.0, 0.0, 0.0)]
    grips.show(ROWS, (-11.0, 0.5, 0.0))  # who walks goes on, and the pointer stays
    grips.show(ROWS, (-11.0, 0.5, 0.0))
    assert said[2:] == [("reach", 2, 3.0, -0.5, 0.0)]


def test_two_who_drag_are_not_in_each_others_way():
    grips, said = gripping(ROWS)
    grips.cloth(Pull("start", (0, 0, 0), 1))
    grips.cloth(Pull("start", (4, 0, 0), 2))
    grips.cloth(Pull("end", (0, 0, 0), 1))
    grips.cloth(Pull("update", (4, 1, 0), 2))
    assert said[-2:] == [("let_go", 0), ("reach", 4, 4, 1, 0)]
    for who, x in ((1, 0.0), (2, 5.0), (1, 1.0), (2, 7.0)):
        grips.object("cube", Pull("start" if x in (0.0, 5.0) else "update", (x, 0, 0), who))
    assert said[-2:] == [("move", "cube", 1, 0, 0), ("move", "cube", 2, 0, 0)]


def test_what_is_no_place_and_what_never_began_is_ignored():
    grips, said = gripping(ROWS)
    grips.cloth(Pull("start", (float("nan"), 0, 0)))
    grips.cloth(Pull("update", (1, 0, 0)))
    grips.cloth(Pull("end", (1, 0, 0)))
    grips.object("cube", Pull("update", (float("inf"), 0, 0)))
    nothing, unsaid = gripping()
    nothing.cloth(Pull("start", (1, 0, 0)))
    assert said == unsaid == []


@contextmanager
def page() -> Iterator[tuple[Any, Any, list[Any]]]:
    """A page that is served, what is shown on it, and what is asked for there."""
    viser = pytest.importorskip("viser", reason="pip install 'cape[live]'")
    from cape.live.page.stage import Stage

    server, said = viser.ViserServer(host=LOOPBACK, port=free_port(), verbose=False), []
    try:
        yield server, Stage(server, Grips(lambda *order: said.append(order))), said
    finally:
        server.stop()


def test_controls_stand_at_what_the_run_begins_with():
    cloth = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.5, fabric=cape.fabric("denim"))
    scene = cape.Scene(cloth, [cape.attach(cloth, "rod", "top")], wind=cape.Wind(velocity=(-3.0, 0.0, 20.0)))
    run = cape.Live(scene, lambda _: {"rod": (np.zeros(3), (1.0, 0.0, 0.0, 0.0))}, solver=cape.XPBD(), viewer="none")
    begins = json.loads(beginning_of(run._rig, run.changes.fabric))
    wind = [("wind x [m/s]", -3.0), ("wind y [m/s]", 0.0), ("wind z [m/s]", 20.0)]
    rest = [("speed", 1.0), ("paused", False)]
    assert controls(begins) == [*wind, ("fabric", "denim"), ("solver", "xpbd"), ("self-contact", False), *rest]
    assert ("fabric", OWN) in controls({**begins, "fabric": ""})


def controls(begins: dict[str, Any]) -> list[tuple[str, Any]]:
    """What stands on a page's controls."""
    with page() as (server, _, said):
        add_controls(server.gui, begins, lambda *order: said.append(order))
        handles = server.gui._gui_input_handle_from_uuid.values()
        assert said == []
        return [(h.label, h.value) for h in handles if h.label not in ("substeps", "tear", "put on anew")]


def swinging() -> tuple[Shown, LiveFrame]:
    standard = swing(spacing=0.25)
    scene, track = standard.scene, standard.track
    shown = Shown("swing", scene.cloth, tuple(scene.colliders), scene.thickness, tuple(track.names))
    cloth = scene.cloth.pattern.astype(np.float32)
    positions = np.stack([cloth[:, 0], np.zeros(len(cloth)), cloth[:, 1]], axis=1).astype(np.float32)
    return shown, LiveFrame(0, 0.0, 0, positions, track.positions[0], track.rotations_wxyz[0])


def test_what_stays_the_same_is_not_sent_again_with_another_set_up():
    """Else a drag would end as it begins: what is taken hold of makes another set-up, and viser ends the drag of a node
    that is added anew."""
    shown, frame = swinging()
    with page() as (server, stage, _):
        stage.begin(shown, frame)
        known = server.scene._handle_from_node_name
        before = dict(known)
        denim = replace(
            shown, cloth=cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.25, fabric=cape.fabric("denim"))
        )
        stage.begin(denim, frame._replace(setup=1))
        assert stage.setup == 1
        assert len(before) > 4
        assert all(known[name] is handle and not handle._impl.removed for name, handle in before.items())
        stage.begin(replace(shown, bones=shown.bones[1:]), frame._replace(setup=2))  # one has gone
        assert 0 < len(before) - len(known) < len(before)


def test_drags_reach_the_run_in_the_order_in_which_they_happened():
    """Through the server as a browser tells of them, all at once, again and again."""
    shown, frame = swinging()
    with page() as (server, stage, said):
        stage.begin(shown, frame)
        stage.show(frame)
        with connected(server) as send:
            place = frame.positions[7].tolist()
            for phase in ("start", "update", "update", "end") * 30:
                send(
                    type="SceneNodeDragMessage", phase=phase, name="/cape", instance_index=None, button="left",
                    modifier=None, owner="", start_position=place, start_screen_pos=[0.5, 0.5], end_position=place,
                    end_screen_pos=[0.5, 0.5],
                )  # fmt: skip
            until(lambda: len(said) >= 30 * 5)
    assert [order[0] for order in said] == ["grab", "reach", "reach", "reach", "let_go"] * 30
    assert {order[1] for order in said} == {7}


def test_what_is_chosen_on_the_page_is_asked_for():
    """One wind slider is moved again and again, and then each of the others: all three are told each time, in order."""
    with page() as (server, _, said):
        add_controls(server.gui, {"wind": [1.0, 2.0, 3.0]}, lambda *order: said.append(order))
        known = {h.label: h._impl.uuid for h in server.gui._gui_input_handle_from_uuid.values()}
        chosen = [("wind x [m/s]", v) for v in np.arange(0.5, 12.5, 0.5).tolist()]
        chosen += [("wind z [m/s]", -4.0), ("fabric", "denim"), ("solver", "xpbd"), ("self-contact", False)]
        chosen += [("speed", 0.5), ("paused", True)]
        with connected(server) as send:
            for label, value in chosen:
                send(type="GuiUpdateMessage", uuid=known[label], updates={"value": value})
            until(lambda: len(said) >= len(chosen))
    assert said[:24] == [("wind", x, 2.0, 3.0) for x in np.arange(0.5, 12.5, 0.5)]
    assert said[24:] == [
        ("wind", 12.0, 2.0, -4.0), ("fabric", "denim"), ("solver", "xpbd"), ("self_contact", False), ("speed", 0.5),
        ("pause", True),
    ]  # fmt: skip


STATE = {
    "wind": [1.0, -2.0, 30.0], "fabric": "denim", "solver": "tr_bdf2", "self_contact": False, "speed": 0.25,
    "paused": True, "line": "frame 7 | 6.5 ms, 0.98x | euler 75, 0.50 mm",
}  # fmt: skip


def test_controls_follow_what_else_changes_the_run_and_ask_for_nothing():
    """A wind that is faster than a slider goes stands at its end; a fabric without a name is one of its own."""
    with page() as (server, _, said):
        controls = add_controls(server.gui, {}, lambda *order: said.append(order))
        controls.follow(STATE)
        known = {h.label: h for h in server.gui._gui_input_handle_from_uuid.values()}
        wanted = {"fabric": "denim", "solver": "tr_bdf2", "self-contact": False, "speed": 0.25, "paused": True}
        wanted |= {"wind x [m/s]": 1.0, "wind y [m/s]": -2.0, "wind z [m/s]": 12.0}
        assert {label: known[label].value for label in wanted} == wanted
        assert controls._line.content == f"`{STATE['line']}`"
        controls.follow({**STATE, "fabric": "", "wind": None})
        assert known["fabric"].value == OWN
        assert OWN in known["fabric"].options
        assert known["wind x [m/s]"].value == 1.0
        time.sleep(0.05)  # in which the server would have called what asks
    assert said == []


def test_what_somebody_has_just_moved_stays_until_the_run_can_have_followed():
    now = [100.0]
    with page() as (server, _, said):
        controls = add_controls(server.gui, {}, lambda *order: said.append(order), clock=lambda: now[0])
        known = {h.label: h for h in server.gui._gui_input_handle_from_uuid.values()}
        with connected(server) as send:
            send(type="GuiUpdateMessage", uuid=known["speed"]._impl.uuid, updates={"value": 0.5})
            until(lambda: bool(said))
        controls.follow(STATE)
        assert known["speed"].value == 0.5
        assert known["solver"].value == "tr_bdf2"
        now[0] += QUIET
        controls.follow(STATE)
        assert known["speed"].value == 0.25
    assert said == [("speed", 0.5)]


def test_a_page_shows_how_the_run_goes_and_what_its_keys_have_changed():
    """Through its own process, as a browser sees it; also while it stands still."""
    cloth = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.25)
    scene = cape.Scene(cloth, [cape.attach(cloth, "rod", "top")], wind=cape.Wind())
    rod = {"rod": (np.zeros(3), (1.0, 0.0, 0.0, 0.0))}
    pytest.importorskip("viser", reason="pip install 'cape[live]'")
    with cape.Live(scene, lambda _: rod, viewer="page") as run:
        assert run.page is not None
        with watched(run.page) as told:
            assert told(lambda updates: "ms, " in str(updates.get("_markdown", "")))
            run.changes.set_wind((-3.0, 0.0, 0.0))
            assert told(lambda updates: updates.get("value") == -3.0)
            run.pause(True)
            assert told(lambda updates: updates.get("value") is True)
            run.set_speed(0.25)
            assert told(lambda updates: updates.get("value") == 0.25)
            assert told(lambda updates: "paused" in str(updates.get("_markdown", "")))


def test_a_vertex_that_a_tear_has_made_is_dragged_on_the_page():
    """Through its own process: it follows the pointer, as the recording tells, and the tears stay."""
    pytest.importorskip("viser", reason="pip install 'cape[live]'")
    cloth = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.1)
    scene = cape.Scene(cloth, [cape.attach(cloth, "rod", "top")], tearing=cape.Tearing(strain=0.6))
    rod = {"rod": (np.zeros(3), (1.0, 0.0, 0.0, 0.0))}
    with cape.Live(scene, lambda _: rod, viewer="page", keep=True) as run:
        assert run.page is not None
        run.changes.tear()
        until(lambda: len(run.positions) > cloth.vertices)
        born = len(run.positions) - 1
        # Off its twin: where both are in one place either of them may be taken.
        run.changes.take_hold(born)
        run.changes.reach(born, run.positions[born] + np.array([0.1, 0.0, 0.0]))
        until(lambda: run.positions[born, 0] > 0.08)
        run.changes.let_go(born)
        place = run.positions[born]
        goal = place + np.array([0.1, 0.0, 0.05])
        with sending(run.page) as send:
            drag: dict[str, Any] = {
                "type": "SceneNodeDragMessage", "name": "/cape", "instance_index": None, "button": "left",
                "modifier": None, "owner": "", "start_position": place.tolist(), "start_screen_pos": [0.5, 0.5],
                "end_screen_pos": [0.5, 0.5],
            }  # fmt: skip
            send(**drag, phase="start", end_position=place.tolist())
            until(lambda: f"vertex {born} in the hand" in run.status.message)
            send(**drag, phase="update", end_position=goal.tolist())
            until(lambda: bool(np.linalg.norm(run.positions[born] - goal) < 0.02))
            assert np.linalg.norm(run.positions[born] - goal) < 0.02
            send(**drag, phase="end", end_position=place.tolist())
            until(lambda: f"vertex {born} let go" in run.status.message)
            assert f"vertex {born} let go" in run.status.message
    assert run.take().tears > 0
    assert len(run.take().topologies) == 2


@contextmanager
def watched(url: str) -> Iterator[Callable[[Callable[[dict[str, Any]], object]], bool]]:
    """A connection to a page; gives what tells whether updates of its controls come that are so, within a while."""
    import msgspec
    import viser
    import zstandard
    from websockets.sync.client import connect

    protocol: Any = f"viser-v{viser.__version__}"
    with connect(url.replace("http", "ws"), subprotocols=[protocol], max_size=None, compression=None) as there:
        seen: list[dict[str, Any]] = []

        def told(wanted: Callable[[dict[str, Any]], object]) -> bool:
            end = time.monotonic() + 30.0
            while not any(wanted(updates) for updates in seen):
                if time.monotonic() > end:
                    return False
                message = there.recv(timeout=30.0)
                assert isinstance(message, bytes)
                length = int.from_bytes(message[8:16], "little")  # after its length unpacked; arrays come behind
                batch = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(message[16 : 16 + length]))
                seen.extend(m["updates"] for m in batch["messages"] if m.get("type") == "GuiUpdateMessage")
            return True

        yield told


def until(done: Callable[[], bool]) -> None:
    for _ in range(1000):
        if done():
            return
        time.sleep(0.01)


@contextmanager
def connected(server: Any) -> Iterator[Callable[..., None]]:
    """A connection as a browser has one; gives what tells something there."""
    with sending(f"http://{LOOPBACK}:{server.get_port()}") as send:
        yield send


@contextmanager
def sending(page: str) -> Iterator[Callable[..., None]]:
    """The same at a page's address."""
    import msgspec
    import viser
    from websockets.sync.client import connect

    protocol: Any = f"viser-v{viser.__version__}"
    with connect(page.replace("http", "ws"), subprotocols=[protocol], max_size=None, compression=None) as there:

        def send(**message: Any) -> None:
            there.send(msgspec.msgpack.encode(message))

        # A browser is not known before it has told how it looks.
        send(
            type="ViewerCameraMessage", wxyz=[1, 0, 0, 0], position=[0, 0, 0], fov=1, near=0.1, far=9, image_height=9,
            image_width=9, look_at=[0, 0, 1], up_direction=[0, 0, 1],
        )  # fmt: skip
        yield send
