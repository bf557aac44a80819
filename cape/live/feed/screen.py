"""Where a live run is seen: a viewer and the feed to it, started anew where there is not enough room."""

import json
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from cape.live.feed.mailbox import LiveFrame
from cape.live.feed.sender import Sender
from cape.live.feed.viewers import STARTING, ViewerProcess, address, free_port
from cape.live.rig import Rig
from cape.live.sources import dressed_in
from cape.record.moments import Shown
from motions.errors import UserError
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface

FloatArray = NDArray[np.float64]

NOTHING = np.zeros(0)
ROOM = 4  # times as many vertices as there are, for those that tears add
TOLD = 4096  # bytes that a page may be told with a frame
STUCK = 2.0  # [s] without a frame, from which on it is said that the viewer does not answer


class Screen:
    """Shows a rig."""

    def __init__(
        self,
        rig: Rig,
        name: str,
        *,
        viewing: str,
        bind: str,
        surfaces: Sequence[LinkSurface] = (),
        skin: Skin | None = None,
        hear: Callable[[str], None] | None = None,
        begins: str = "{}",
    ) -> None:
        """Open the viewer.

        Args:
            rig: whose frames.
            name: what it is called.
            viewing: "window", "web", "page", or the URL of a viewer that runs.
            bind: address to listen on.
            hear: called with what is asked for on the page, a line each.
            begins: what its controls stand at, as JSON.
            surfaces: meshes that the bones carry.
            skin: mesh that they move.

        Raises:
            UserError: the viewer does not start.
        """
        self._rig, self._name, self._surfaces, self._skin = rig, name, tuple(surfaces), skin
        source = rig.hands.source
        self._dressed = dressed_in(source, skin)
        self._known: tuple[object, ...] = ()
        self._setup, self._told = 0, b""
        self._served = threading.Event()
        own = viewing in ("window", "web")
        self.viewer = ViewerProcess(web=viewing == "web", bind=bind) if own else None
        self._hear, self._page = hear, ""
        self._host = address(bind) if viewing == "page" else ""
        where = (viewing if self.viewer is None else self.viewer.url,)
        module = "cape.live.feed.sending"
        if viewing == "page":
            if find_spec("viser") is None:
                raise UserError("to take cloth in the hand needs viser: pip install 'cape[live]'")
            where, module = (bind, str(free_port(bind)), begins), "cape.live.page.serving"
        try:
            self.sender = Sender(
                *where,
                vertices=ROOM * rig.scene.cloth.vertices,
                bones=len(source.names),
                morphs=len(self._morphs),
                told=TOLD if viewing == "page" else 0,
                module=module,
                hear=self._take if viewing == "page" else None,
            )
            if viewing == "page" and not self._served.wait(STARTING):
                raise UserError(f"the page is not served; python -m cape.live.page.serving /tmp {bind} 8080 tells why")
        except BaseException:
            self.close()
            raise

    sender: Sender | None = None

    @property
    def page(self) -> str | None:
        """Where a browser finds it."""
        return self._page or (None if self.viewer is None else self.viewer.page)

    def _take(self, line: str) -> None:
        """Take what the page says: first where it is served, then what is asked for."""
        if not self._served.is_set():
            with suppress(ValueError, TypeError):
                self._page = f"http://{self._host}:{int(json.loads(line)[1])}"
                self._served.set()
        elif self._hear is not None:
            self._hear(line)

    @property
    def alive(self) -> bool:
        """Whether there is still a viewer that one knows of."""
        return self.viewer is None or self.viewer.alive

    @property
    def trouble(self) -> str:
        """What is wrong with it, empty for nothing."""
        if not self.alive:
            return "viewer closed"
        if self.sender is None or not self.sender.alive:
            return "nothing is sent any more"
        return "viewer does not answer" if self.sender.put > 1 and self.sender.stuck_s > STUCK else ""

    def tell(self, told: str) -> bool:
        """Have a page read this with the frames from now on; tells whether it is anything new."""
        text = told.encode()
        if text == self._told or len(text) > TOLD:
            return False
        self._told = text
        return True

    def show(self, number: int) -> None:
        """Have the frame that the rig is at be the newest one; returns at once."""
        if self.sender is None:
            return
        rig = self._rig
        known = (rig.scene, rig.simulation.tears)
        if any(a is not b for a, b in zip(known, self._known, strict=False)) or not self._known:
            self._known = known
            self._setup = self.sender.show(self._shown())
        positions = rig.simulation.positions.astype(np.float32)
        if len(positions) > self.sender.room:
            return
        pose = rig.bones
        places, turns = pose.positions, pose.rotations_wxyz
        self.sender.send(LiveFrame(number, rig.time, self._setup, positions, places, turns, self._morphs, self._told))

    @property
    def _morphs(self) -> FloatArray:
        return NOTHING if self._dressed is None else self._dressed.morphs

    def close(self) -> None:
        """End the feed, and the viewer that was opened."""
        if self.sender is not None:
            self.sender.close()
        if self.viewer is not None:
            self.viewer.close()

    def _shown(self) -> Shown:
        rig, source = self._rig, self._rig.hands.source
        return Shown(
            self._name, rig.scene.cloth, tuple(rig.scene.colliders), rig.scene.thickness, tuple(source.names),
            source.parents, dict(source.roles), self._surfaces, rig.topology, rig.simulation.tears, self._skin,
        )  # fmt: skip
