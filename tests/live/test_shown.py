"""A live run as it is seen: in the real viewer, and in a browser. Needs Vulkan, and Chromium."""

import base64
import json
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import motions
import skeleton
from cape.live.character import CharacterSource
from cape.live.feed.viewers import LOOPBACK, ViewerProcess
from cape.live.live import Live
from cape.scene.dress import dress
from motions.errors import UserError

pytestmark = pytest.mark.extra

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
LONG = 180.0  # s
RED = (3.0, 60)  # how many times as red as green, and how red at least, the cape's pixels are


def steered(viewer: str, on_frame: Callable[[Live], None] | None = None) -> tuple[Live, CharacterSource]:
    clips = [motions.load(name) for name in ("idle", "walk")]
    body = skeleton.Skeleton.from_clip(clips[0])
    source = CharacterSource(clips, body, "idle")
    scene = dress(body, body.track(clips[0]), spacing=0.05)
    return Live(scene, source, viewer=viewer, on_frame=on_frame), source


def red(picture: bytes) -> float:
    """Share of a picture that has the colour of the cape."""
    pixels = np.asarray(Image.open(BytesIO(picture)).convert("RGB")).astype(float)
    return float(((pixels[..., 0] > RED[0] * pixels[..., 1]) & (pixels[..., 0] > RED[1])).mean())


def seen(picture: Callable[[], bytes], what: Callable[[bytes], bool]) -> bytes:
    """The first picture that shows something."""
    end, shown = time.monotonic() + LONG, b""
    while time.monotonic() < end:
        with suppress(Exception):
            shown = picture()
            if what(shown):
                return shown
        time.sleep(0.5)
    Path(tempfile.gettempdir(), "cape-not-seen.png").write_bytes(shown)
    raise AssertionError("it is not to be seen; the last picture is cape-not-seen.png in the folder of temporary files")


@pytest.fixture
def window() -> Iterator[ViewerProcess]:
    """A viewer that draws without a display."""
    renderer = ("--renderer", "vulkan") if sys.platform == "linux" else ()
    try:
        viewer = ViewerProcess(arguments=("--headless", *renderer, "--window-size", "600x700"))
    except UserError as error:
        pytest.skip(f"{error}: apt-get install mesa-vulkan-drivers")
    yield viewer
    viewer.close()


def test_the_viewer_shows_the_cape_and_follows_who_walks(window: ViewerProcess):
    from rerun.experimental import ViewerClient

    client = ViewerClient.connect(window.url)

    def picture() -> bytes:
        # Views come in any order, and of one that is a tab away there is no picture.
        return client.take_screenshot(next(v.view_id for v in client.get_state().views if v.name == "cape"))

    live, source = steered(window.url)
    with live:
        seen(picture, lambda shown: red(shown) > 0.02)
        source.go("walk")
        begun = live.status.frame
        while live.status.frame < begun + 300:
            live.wait(0.5)
        # Metres on, it is still in the middle of the picture.
        seen(picture, lambda shown: red(shown) > 0.02)
        moving = np.asarray(Image.open(BytesIO(picture())))
        seen(picture, lambda shown: bool(np.any(np.asarray(Image.open(BytesIO(shown))) != moving)))
        assert not live.status.viewer


def test_a_viewer_that_is_closed_ends_the_run():
    if not sys.platform.startswith("linux"):
        pytest.skip("needs a viewer that draws without a display")
    live, _ = steered("web")
    with live:
        assert live._screen is not None
        assert live._screen.viewer is not None
        live._screen.viewer.close()
        assert live.wait(LONG).ended == "the viewer was closed"


@contextmanager
def browser(page: str) -> Iterator[Callable[..., Any]]:
    """Chromium at a page, without a display; gives what asks it for something, by the names of its own protocol."""
    if CHROMIUM is None:
        pytest.skip("apt-get install chromium")
    connect: Any = pytest.importorskip("websockets.sync.client", reason="pip install websockets").connect
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        process = subprocess.Popen(
            [CHROMIUM, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--window-size=760,560", "--remote-debugging-port=0", f"--user-data-dir={folder}", page],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            told, end = Path(folder, "DevToolsActivePort"), time.monotonic() + LONG
            while not told.exists() and time.monotonic() < end:
                time.sleep(0.1)
            port = told.read_text().split()[0]
            tabs = json.load(urllib.request.urlopen(f"http://{LOOPBACK}:{port}/json"))
            url = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
            numbers = count(1)
            with connect(url, max_size=None) as there:

                def ask(method: str, **parameters: Any) -> dict[str, Any]:
                    number = next(numbers)
                    there.send(json.dumps({"id": number, "method": method, "params": parameters}))
                    while (answer := json.loads(there.recv(timeout=LONG))).get("id") != number:
                        pass
                    return answer["result"]

                yield ask
        finally:
            process.kill()
            process.wait()


def picture_of(ask: Callable[..., Any]) -> bytes:
    return base64.b64decode(ask("Page.captureScreenshot")["data"])


def test_a_browser_shows_the_cape():
    live, _ = steered("web")
    with live:
        assert live.page is not None
        assert live.page.startswith(f"http://{LOOPBACK}:")
        with browser(live.page) as ask:
            seen(lambda: picture_of(ask), lambda shown: red(shown) > 0.02)


def test_cloth_is_dragged_in_a_browser():
    """It is taken where it is red, led to the left, and let go.

    What is said is listened to all the time: it goes after a few seconds, which a browser without a graphics card may
    take to look at the pointer.
    """
    pytest.importorskip("viser", reason="pip install 'cape[live]'")
    said: dict[str, None] = {}
    live, _ = steered("page", on_frame=lambda live: said.setdefault(live.status.message))
    with live:
        assert live.page is not None
        with browser(live.page) as ask:
            shown = seen(lambda: picture_of(ask), lambda shown: red(shown) > 0.01)
            pixels = np.asarray(Image.open(BytesIO(shown)).convert("RGB")).astype(float)
            rows, columns = np.nonzero((pixels[..., 0] > RED[0] * pixels[..., 1]) & (pixels[..., 0] > RED[1]))
            # Right of the middle there is the panel.
            chosen = columns < pixels.shape[1] // 2
            x, y = int(np.median(columns[chosen])), int(np.quantile(rows[chosen], 0.7))
            mouse = {"button": "left", "clickCount": 1}
            ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
            time.sleep(1.0)  # the page looks what is under the pointer
            ask("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, buttons=1, **mouse)
            for k in range(1, 7):
                time.sleep(0.1)
                ask("Input.dispatchMouseEvent", type="mouseMoved", x=x - 15 * k, y=y, buttons=1, button="left")
            until(live, said, "in the hand")
            before = live.positions.copy()
            live.wait(2.0)
            led = np.linalg.norm(live.positions - before, axis=1).max()
            assert not any("let go" in each for each in said)
            ask("Input.dispatchMouseEvent", type="mouseReleased", x=x - 90, y=y, buttons=0, **mouse)
            until(live, said, "let go")
    assert led > 0.05


def until(live: Live, said: dict[str, None], what: str) -> None:
    end = time.monotonic() + LONG
    while not any(what in each for each in [*said]):
        assert time.monotonic() < end, (live.status, [*said])
        live.wait(0.05)
