"""The Rerun viewer without a display: a process of its own that opens recordings and gives pictures of them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from cape.pictures.eye import look_from
from motions.errors import FileError, UnknownNameError, UserError, ValueRangeError, require_package
from motions.files import scratch_folder

if TYPE_CHECKING:
    from PIL.Image import Image
    from rerun.experimental import ViewerClient

Answer = TypeVar("Answer")

LOOPBACK = "127.0.0.1"
STARTING, LOADING, ENDING = 60.0, 120.0, 5.0  # [s] to wait for the viewer
NOTES = 2.5  # [s] from its start, in which the viewer shows notes on top of the picture
MOST_TRIES = 20  # of a picture, until it doesn't change
PATIENCE = 8  # questions in a row that the viewer may leave unanswered, each for the 15 s that its client waits
MARGINS = (16, 120)  # [pixels] of the window around a view that fills it, or more: bars above and below
NO_GRAPHICS = (
    "pictures need a Vulkan driver, and there is none: apt-get install mesa-vulkan-drivers (Debian, Ubuntu) or "
    "dnf install mesa-vulkan-drivers (Fedora) brings one that needs no graphics card"
)
OF_GRAPHICS = ("graphics adapter", "render context", "render state")  # in what the viewer says when it lacks one


@contextmanager
def viewer(size: tuple[int, int]) -> Iterator[Viewer]:
    """Start a viewer, which listens on loopback alone, and end it with the block, however that ends.

    Args:
        size: width and height of the pictures [pixels].

    Raises:
        UserError: the viewer doesn't start; the text says what to install where a Vulkan driver is missing.
    """
    with scratch_folder() as folder:
        log, port, started = folder / "log", _free_port(), time.monotonic()
        with log.open("wb") as said:
            process = subprocess.Popen(
                [*_program(), "--bind", LOOPBACK, "--port", str(port), "--window-size", _window(size)],
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                # What the viewer logs it also shows, on top of the picture.
                env={**os.environ, "XDG_RUNTIME_DIR": str(folder), "RUST_LOG": "error"},
            )
        try:
            yield Viewer(_connected(process, port, log), size, clear_at=started + NOTES)
        finally:
            _end(process)


def require_recording(path: str | os.PathLike[str]) -> Path:
    """The path of a recording.

    Raises:
        FileError: there is no such file.
    """
    if not os.path.isfile(path):
        raise FileError(f"can't read {path}: there is no such file")
    return Path(path)


def require_viewer() -> None:
    """Check that a viewer starts here, which takes a second.

    Raises:
        UserError: it doesn't; the text says what to install where a Vulkan driver is missing.
    """
    with viewer((64, 64)):
        pass


class Viewer:
    """A running viewer for one recording: a second one would be shown in the layout of the first."""

    def __init__(self, client: ViewerClient, size: tuple[int, int], *, clear_at: float):
        """Made by `viewer`; pictures are clear from a time of the monotonic clock on [s]."""
        self._client = client
        self._clear_at = clear_at
        self._size = size
        self._layout: dict[str, Any] = {}
        self._shown = ""
        self._settled = False
        self.views: dict[str, str] = {}
        self.begin = self.end = 0.0

    def open(self, recording: str | os.PathLike[str]) -> None:
        """Show a recording, in the layout that it brings along.

        Sets `views`, the ids of its views by their names, those that show the world first, and `begin` and `end`, its
        times [s].

        Raises:
            FileError: it can't be read.
        """
        path = require_recording(recording).resolve()
        opened = self._ask(lambda client: client.open(str(path)))
        if not opened.store_ids and not opened.loading:
            raise FileError(f"can't read {recording}: it is no recording of Rerun's")
        state = self._loaded(recording)
        # The active tab comes first: the viewer lists views by their ids, which mean nothing.
        self._layout = self._ask(lambda client: client.get_blueprint()).blueprint
        tabs = [tab for part in self._layout.values() if (tab := part.get("ContainerBlueprint", {}).get("active_tab"))]
        order = sorted(state.views, key=lambda v: (f"view/{v.view_id}" not in tabs, v.view_class != "3D", v.name))
        self.views = {view.name: view.view_id for view in order}
        times = [line for line in state.recordings[0].timelines if line.name == "time"]
        if not times or not self.views:
            raise FileError(f"can't draw {recording}: it has no {'timeline time' if self.views else 'layout'}")
        self.begin, self.end = 1e-9 * times[0].start, 1e-9 * times[0].end
        self.choose()

    def choose(self, view: str | None = None, *, side: float | None = None) -> None:
        """Show one view alone.

        Args:
            view: its name; None for what the recording shows first.
            side: angle [degrees] about the vertical at which the eye stands around what it looks at, 0 ahead of the
                character and 90 to its left; None for where the layout has it.

        Raises:
            UnknownNameError: there is no such view.
            ValueRangeError: the view has no eye.
        """
        if view is not None and view not in self.views:
            raise UnknownNameError("view", view, self.views)
        self._shown = self.views[view or next(iter(self.views))]
        layout = dict(self._layout)
        layout["/viewport"] = {
            "ViewportBlueprint": layout["/viewport"]["ViewportBlueprint"] | {"maximized": self._shown}
        }
        if side is not None:
            layout = look_from(layout, self._shown, side)
        self._ask(lambda client: client.set_blueprint(layout, of="recording"))
        self._settled = False

    def picture(self, seconds: float) -> Image:
        """What the chosen view shows at a time of the recording [s], in RGB and the viewer's size.

        Raises:
            ValueRangeError: the recording doesn't reach there.
        """
        from PIL import Image, ImageOps

        # Times are kept in nanoseconds, and told in milliseconds.
        if not self.begin - 5e-4 <= seconds <= self.end + 5e-4:
            raise ValueRangeError(
                f"{seconds:g} s is outside of the recording, which goes from {self.begin:g} to {self.end:g} s"
            )
        self._ask(lambda client: client.set_time("time", duration=seconds, play_state="paused"))
        time.sleep(max(self._clear_at - time.monotonic(), 0.0))
        drawn, tries = self._drawn(), 1
        # Just after a view was chosen it may lack what the viewer is still to load or to lay out.
        while not self._settled and tries < MOST_TRIES:
            before, drawn, tries = drawn, self._drawn(), tries + 1
            self._settled = drawn == before
        return ImageOps.fit(Image.open(BytesIO(drawn)).convert("RGB"), self._size)

    def _drawn(self) -> bytes:
        return self._ask(lambda client: client.take_screenshot(self._shown))

    def _loaded(self, recording: str | os.PathLike[str]) -> Any:
        """The viewer's state once the recording is there."""
        until = time.monotonic() + LOADING
        while time.monotonic() < until:
            state = self._ask(lambda client: client.get_state())
            if not state.loading and state.recordings and state.recordings[0].timelines and state.views:
                return state
            time.sleep(0.1)
        raise FileError(f"can't draw {recording}: the viewer did not load it within {LOADING:g} s, or it has no layout")

    def _ask(self, question: Callable[[ViewerClient], Answer]) -> Answer:
        # A machine with other work draws late; whatever is asked here may be asked again.
        for _ in range(PATIENCE):
            try:
                return question(self._client)
            except TimeoutError:
                continue
            except (ConnectionError, RuntimeError) as error:
                raise UserError(f"the viewer failed: {error}") from error
        raise UserError(f"the viewer failed: it left {PATIENCE} questions in a row unanswered; is the machine busy?")


def _program() -> list[str]:
    """The viewer and what makes it draw without a display."""
    require_package("rerun_cli", "a picture")
    import rerun_cli

    # The command `rerun` is a wrapper that passes no signals on.
    program = Path(rerun_cli.__file__).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")
    if not program.is_file():
        raise UserError(f"the Rerun viewer is missing at {program}: pip install --force-reinstall rerun-sdk")
    # By other ways than Vulkan the viewer starts on Linux, and fails as it draws.
    renderer = ["--renderer", "vulkan"] if sys.platform == "linux" else []
    return [str(program), "--headless", "--hide-welcome-screen", *renderer]


def _window(size: tuple[int, int]) -> str:
    return "x".join(str(side + margin) for side, margin in zip(size, MARGINS, strict=True))


def _free_port() -> int:
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        return taken.getsockname()[1]


def _connected(process: subprocess.Popen[bytes], port: int, log: Path) -> ViewerClient:
    from rerun.experimental import ViewerClient

    until = time.monotonic() + STARTING
    while process.poll() is None and time.monotonic() < until:
        with suppress(ConnectionError, RuntimeError):
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            client.get_state()
            return client
        time.sleep(0.1)
    raise UserError(_reason(log.read_text(errors="replace")))


def _reason(said: str) -> str:
    """Why the viewer did not start, from what it said."""
    if any(words in said for words in OF_GRAPHICS):
        return NO_GRAPHICS
    lines = [line for line in said.splitlines() if "panicked" in line or "rror" in line] or said.splitlines()
    return f"the Rerun viewer does not start: {lines[0].strip() if lines else 'it says nothing'}"


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(ENDING)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
