"""The process that serves the page: it takes the newest frame as a viewer does, and prints what is asked for.

A browser that is slow, or many, cost the physics nothing.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from cape.cloth.fabrics import FABRICS
from cape.cloth.looks.registry import look_of
from cape.live.feed.mailbox import LiveFrame, Mailbox
from cape.live.feed.sending import arriving, read_setup
from cape.live.page.objects import Mesh, mesh_of
from cape.live.page.objects import handle as handle_mesh
from cape.record.figure.body import BODY_COLOR, body_parts, hull_of_balls
from cape.record.moments import Shown
from cape.scene.colliders import Collider
from cape.solvers import SOLVERS
from skeleton.shapes import Capsule

EYE = (-1.2, -0.7, 0.35)  # from the middle of the cloth, in sizes of it
MOVES_COLOR = (230, 170, 60)
VIEWED = ("middle", "low")  # bones of named scenes that only tell cameras where to look
SHOWN_EACH = 2  # frames: 30 a second are enough for a hand
FASTEST_WIND = 12.0  # [m/s] on the sliders


def main(folder: Path, host: str, port: int) -> int:
    """Serve until standard input is closed."""
    import viser

    server = viser.ViserServer(host=host, port=port, label="cape", verbose=False)
    # The server takes another port where this one is not free.
    _say("serving", server.get_port())
    page = _Page(server)
    box = Mailbox.open(folder / "frames")
    for frame in arriving(box):
        if frame.setup != page.setup:
            page.begin(read_setup(folder, frame.setup), frame)
        if frame.number % SHOWN_EACH == 0:
            page.show(frame)
    return 0


def _say(name: str, *values: Any) -> None:
    print(json.dumps([name, *values]), flush=True)


class _Page:
    """What is on the page."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self.setup = -1
        self._cloth: Any = None
        self._parts: dict[str, tuple[int, Any]] = {}
        self._positions = np.zeros((0, 3), np.float32)
        self._held: int | None = None
        self._led: np.ndarray | None = None
        self._bones: tuple[str, ...] = ()
        server.scene.set_up_direction("+z")
        server.scene.add_grid("/floor", infinite_grid=True, cell_size=0.5)
        self._add_controls()

    def begin(self, shown: Shown, frame: LiveFrame) -> None:
        """Show another set-up."""
        self.setup = frame.setup
        scene = self._server.scene
        triangles = shown.cloth.triangles if shown.topology is None else shown.topology.triangles
        color = look_of(shown.cloth.fabric).color
        self._cloth = scene.add_mesh_simple(
            "/cape", frame.positions, np.asarray(triangles, np.uint32), color=color, side="double"
        )
        self._cloth.on_drag(self._drag)
        self._bones = shown.bones
        names = {name: place for place, name in enumerate(shown.bones)}
        names |= {role: names[bone] for role, bone in shown.roles.items() if bone in names}
        for _, handle in self._parts.values():
            handle.remove()
        self._parts = {}
        parts = body_parts(shown.colliders) if shown.roles else {}
        for name, (bone, balls) in parts.items():
            vertices, _, faces = hull_of_balls(balls)
            self._add(f"/body/{name}", names.get(bone), (vertices, faces))
        for collider in shown.colliders:
            if collider.name not in parts and not _is_chest(collider) and (mesh := mesh_of(collider)) is not None:
                bone = None if collider.bone is None else names.get(collider.bone)
                self._add(f"/objects/{collider.name}", bone, mesh, moves=bone is not None and not shown.roles)
        if not shown.roles:
            carrying = {collider.bone for collider in shown.colliders}
            for bone in set(shown.bones) - carrying - set(VIEWED):
                self._add(f"/bones/{bone}", names[bone], handle_mesh(), moves=True)
        self._look_at(frame)

    def _add(self, path: str, bone: int | None, mesh: Mesh, *, moves: bool = False) -> None:
        """Add what a bone carries; what moves can be taken by hand."""
        handle = self._server.scene.add_mesh_simple(path, *mesh, color=MOVES_COLOR if moves else BODY_COLOR)
        if bone is not None:
            self._parts[path] = bone, handle
            if moves:
                handle.on_drag(lambda event: self._lead(self._bones[bone], event))

    def _look_at(self, frame: LiveFrame) -> None:
        """Have those who come stand behind and above it."""
        low, high = frame.positions.min(axis=0), frame.positions.max(axis=0)
        middle, size = (low + high) / 2.0, float(np.linalg.norm(high - low))
        self._server.initial_camera.look_at = middle
        self._server.initial_camera.position = middle + size * np.array(EYE)

    def _lead(self, bone: str, event: Any) -> None:
        """Lead an object."""
        there = np.asarray(event.end_position, dtype=float)
        if event.phase != "start" and self._led is not None:
            _say("move", bone, *(float(part) for part in there - self._led))
        self._led = None if event.phase == "end" else there

    def show(self, frame: LiveFrame) -> None:
        """Show a frame."""
        self._positions = frame.positions
        with self._server.atomic():
            self._cloth.vertices = frame.positions
            for bone, handle in self._parts.values():
                handle.position = frame.bone_positions[bone]
                handle.wxyz = frame.rotations_wxyz[bone]

    def _drag(self, event: Any) -> None:
        """Take hold of the vertex under the pointer, lead it, and let it go."""
        if event.phase == "start":
            off = np.linalg.norm(self._positions - np.asarray(event.start_position), axis=1)
            self._held = int(off.argmin())
            _say("grab", self._held)
        if self._held is None:
            return
        if event.phase == "end":
            _say("let_go", self._held)
            self._held = None
        else:
            _say("reach", self._held, *(float(part) for part in event.end_position))

    def _add_controls(self) -> None:
        gui = self._server.gui
        gui.add_markdown("Drag the cloth with the left button; elsewhere it turns the view.")
        wind = [gui.add_slider(f"wind {axis} [m/s]", -FASTEST_WIND, FASTEST_WIND, 0.5, 0.0) for axis in "xyz"]
        for slider in wind:
            slider.on_update(lambda _: _say("wind", *(float(each.value) for each in wind)))
        fabric = gui.add_dropdown("fabric", list(FABRICS), initial_value="cape")
        fabric.on_update(lambda _: _say("fabric", fabric.value))
        solver = gui.add_dropdown("solver", list(SOLVERS))
        solver.on_update(lambda _: _say("solver", solver.value))
        substeps = gui.add_button_group("substeps", ["fewer", "more"])
        substeps.on_click(lambda _: _say("substeps", 0.8 if substeps.value == "fewer" else 1.25))
        contact = gui.add_checkbox("self-contact", True)
        contact.on_update(lambda _: _say("self_contact", bool(contact.value)))
        speed = gui.add_slider("speed", 0.0625, 1.0, 0.0625, 1.0)
        speed.on_update(lambda _: _say("speed", float(speed.value)))
        paused = gui.add_checkbox("paused", False)
        paused.on_update(lambda _: _say("pause", bool(paused.value)))
        gui.add_button("tear").on_click(lambda _: _say("tear"))
        gui.add_button("put on anew").on_click(lambda _: _say("reset"))


def _is_chest(collider: Collider) -> bool:
    """Whether it is one of the halves of a chest, which are drawn as one."""
    return isinstance(collider, Capsule) and collider.bone is not None and "chest" in collider.name


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])))
