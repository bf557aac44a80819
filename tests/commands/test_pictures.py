"""Pictures and films through the installed command; those that are drawn need Vulkan, and are marked extra."""

import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from PIL import Image

from cape.cloth.fabrics import FABRICS
from cape.garments.registry import DEFAULT, GARMENTS
from cape.pictures import films, stills
from cape.pictures.eye import look_from, side_of
from cape.pictures.gallery import page, plan
from cape.pictures.gallery.page import Shown
from cape.pictures.gallery.plan import PLAIN_FABRIC, Costume
from cape.pictures.viewer import NO_GRAPHICS, PATIENCE, Viewer, require_viewer
from motions.errors import UnknownNameError, UserError, ValueRangeError
from tests.support.command import CAPE, Forks, cape
from tests.support.processes import mistake_told

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

WITHOUT_VULKAN = {"VK_DRIVER_FILES": "/none", "VK_ICD_FILENAMES": "/none"}


@pytest.fixture(scope="module")
def bare(tmp_path_factory, forks: Forks) -> Path:
    """A folder with a recording, bare.rrd, of the hitboxes alone; its only view is called so."""
    folder = tmp_path_factory.mktemp("bare")
    done = forks("hitboxes", "walk", "--bare", "--end", "0.5", "-o", "bare.rrd", folder=folder)
    assert done.returncode == 0, done.stderr
    (folder / "kept.png").write_text("kept")
    return folder


BAD = {
    "a missing recording": (["render", "missing.rrd"], "missing.rrd"),
    "another kind of file": (["render", "bare.rrd", "-o", "walk.tiff"], ".mp4"),
    "no kind of file": (["render", "bare.rrd", "-o", "walk"], ".png"),
    "an output that is a folder": (["render", "bare.rrd", "-o", "."], "directory"),
    "a folder that is not there": (["render", "bare.rrd", "-o", "nowhere/walk.png"], "nowhere"),
    "no size": (["render", "bare.rrd", "--size", "large"], "WxH"),
    "a size of nothing": (["render", "bare.rrd", "--size", "0x10"], "WxH"),
    "a size beyond all bounds": (["render", "bare.rrd", "--size", "100000x100"], "4096"),
    "an unknown side": (["render", "bare.rrd", "--from", "above"], "front"),
    "a side that is no number": (["render", "bare.rrd", "--from", "nan"], "front"),
    "no time": (["render", "bare.rrd", "--at", "nan"], "--at"),
    "times of a film": (["render", "bare.rrd", "-o", "walk.gif", "--at", "1"], "--start"),
    "a part of a still": (["render", "bare.rrd", "--start", "0.1"], "--at"),
    "a film without frames": (["render", "bare.rrd", "-o", "walk.gif", "--film-fps", "0"], "frames"),
    "a fabric of what is recorded": (["render", "bare.rrd", "--fabric", "denim"], "recorded already"),
    "a robot in what is recorded": (["render", "bare.rrd", "--skeleton", "g1"], "recorded already"),
    "an unknown garment": (["render", "walk", "--garment", "toga"], "shoulder_cape"),
    "an unknown way to treat cuts": (["render", "walk", "--cuts", "tear"], "carry"),
    "a gallery of an unknown garment": (["gallery", "--garment", "toga"], "shoulder_cape"),
    "a gallery of an unknown fabric": (["gallery", "--fabric", "steel"], "denim"),
    "a gallery of an unknown clip": (["gallery", "--clip", "dance"], "spin"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_mistake_is_one_line_and_status_2(case: str, bare: Path, forks: Forks):
    arguments, word = BAD[case]
    if arguments[0] == "render" and "-o" not in arguments:
        arguments = [*arguments, "-o", "kept.png"]
    before = sorted(path.name for path in bare.iterdir())
    done = forks(*arguments, folder=bare)
    said, line = mistake_told(done)
    assert said == []
    assert word in line
    assert (bare / "kept.png").read_text() == "kept"
    assert sorted(path.name for path in bare.iterdir()) == before


@pytest.mark.few("asked0", "asked2")
@pytest.mark.parametrize("asked", [["render", "bare.rrd"], ["render", "walk"], ["gallery", "-o", "pages"]])
def test_without_vulkan_one_line_says_what_to_install(asked: list[str], bare: Path):
    done = cape(*asked, folder=bare, timeout=60.0, **WITHOUT_VULKAN)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.splitlines() == ["cape: " + NO_GRAPHICS]
    assert "mesa-vulkan-drivers" in NO_GRAPHICS
    assert not list(bare.glob("bare.png"))


def test_an_mp4_needs_an_encoder(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    films.require_encoder(".gif")
    with pytest.raises(UserError, match=re.escape("pip install 'cape[film]'")):
        films.require_encoder(".mp4")


def test_a_side_is_a_name_or_an_angle():
    assert [side_of(name) for name in ("front", "left", "back", "right", "-30.5")] == [0.0, 90.0, 180.0, 270.0, -30.5]
    with pytest.raises(UnknownNameError, match="front, left, back, right"):
        side_of("inf")


def test_the_eye_goes_round_what_it_looks_at():
    eye = {"position": [-2.0, 1.0, 0.7], "look_target": [1.0, 1.0, 0.2]}
    layout = {"/viewport": {}, "/view/a/EyeControls3D": {"EyeControls3D": eye}}
    seen = {side: look_from(layout, "a", side)["/view/a/EyeControls3D"]["EyeControls3D"] for side in (0.0, 90.0, 180.0)}
    np.testing.assert_allclose(seen[0.0]["position"], [4.0, 1.0, 0.7], atol=1e-12)
    np.testing.assert_allclose(seen[90.0]["position"], [1.0, 4.0, 0.7], atol=1e-12)
    np.testing.assert_allclose(seen[180.0]["position"], eye["position"], atol=1e-12)
    assert all(each["look_target"] == eye["look_target"] for each in seen.values())
    assert eye["position"] == [-2.0, 1.0, 0.7]
    with pytest.raises(ValueRangeError, match="eye"):
        look_from(layout, "b", 0.0)


class SlowClient:
    """Leaves a number of questions unanswered, as the real one does where drawing takes over 15 seconds."""

    def __init__(self, late: int):
        self.late, self.asked = late, 0

    def open(self, path: str) -> object:
        self.asked += 1
        if self.asked <= self.late:
            raise TimeoutError("Deadline expired before operation could complete")
        return type("Opened", (), {"store_ids": [], "loading": False})


@pytest.mark.parametrize(("late", "told"), [(PATIENCE - 1, "no recording of"), (PATIENCE, "unanswered")])
def test_a_viewer_that_draws_late_is_asked_again(late: int, told: str, tmp_path: Path):
    (tmp_path / "empty.rrd").touch()
    viewer = Viewer(cast("ViewerClient", SlowClient(late)), (64, 64), clear_at=0.0)
    with pytest.raises(UserError, match=told):
        viewer.open(tmp_path / "empty.rrd")


def test_frames_of_a_film_stand_at_equal_times():
    np.testing.assert_allclose(films.frame_times(0.2, 0.6, 10.0), [0.2, 0.3, 0.4, 0.5, 0.6])
    assert len(films.frame_times(0.0, 0.59, 10.0)) == 6
    with pytest.raises(ValueRangeError):
        films.frame_times(1.0, 0.5, 10.0)


class Painter:
    """Draws a plain picture whose colour tells view, side and time, in a viewer's stead."""

    def __init__(self) -> None:
        """Nothing is chosen."""
        self.side = 0.0

    def choose(self, view: str | None = None, *, side: float | None = None) -> None:
        self.side = side or 0.0

    def picture(self, seconds: float) -> Image.Image:
        return Image.new("RGB", (4, 6), (int(self.side), int(10 * seconds), 0))


def colours(picture: Image.Image) -> list[list[tuple[int, int]]]:
    """Side and tenths of a second of each picture on a sheet, row by row."""
    pixels = np.asarray(picture)[3::6, 2::4]
    return [[(int(pixel[0]), int(pixel[1])) for pixel in row] for row in pixels]


def test_a_sheet_has_a_column_for_each_time_and_a_row_for_each_side():
    painter, drawn = Painter(), []
    sheet = stills.sheet(painter, [1.0, 2.0, 3.0], [30.0, 60.0], drawn=lambda: drawn.append(1))  # pyright: ignore
    assert colours(sheet) == [[(30, 10), (30, 20), (30, 30)], [(60, 10), (60, 20), (60, 30)]]
    assert len(drawn) == 6
    assert colours(stills.sheet(painter, [1.0], [30.0, 60.0])) == [[(30, 10), (60, 10)]]  # pyright: ignore


def test_a_gif_plays_all_frames_in_their_time(tmp_path):
    pictures = [Image.new("RGB", (8, 6), (40 * k, 0, 0)) for k in range(5)]
    films.save(iter(pictures), tmp_path / "film.gif", fps=25.0)
    with Image.open(tmp_path / "film.gif") as film:
        assert getattr(film, "n_frames") == 5  # noqa: B009
        assert film.info["duration"] == 40
        assert film.info["loop"] == 0
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]


@pytest.mark.parametrize("name", ["film.gif", "film.mp4"])
def test_a_film_that_breaks_off_leaves_the_one_before(name: str, tmp_path: Path):
    if name.endswith(".mp4"):
        pytest.importorskip("imageio_ffmpeg", reason="pip install 'cape[film]'")

    def breaks() -> Iterator[Image.Image]:
        yield Image.new("RGB", (8, 6))
        raise KeyboardInterrupt

    (tmp_path / name).write_text("kept")
    with pytest.raises(KeyboardInterrupt):
        films.save(breaks(), tmp_path / name)
    assert (tmp_path / name).read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_gallery_shows_every_garment_and_every_fabric():
    shown = plan.costumes([], [], list(FABRICS))
    assert {costume.garment for costume in shown if costume.fabric == PLAIN_FABRIC} == set(GARMENTS)
    assert {costume.fabric for costume in shown if costume.garment == DEFAULT} == set(FABRICS)
    assert len(shown) == len(set(shown)) == len(GARMENTS) + len(FABRICS) - 1
    assert plan.clips([]) == ("walk", "run", "spin")
    assert plan.clips(["kick", "kick"]) == ("kick",)
    files = [costume.file(clip) for costume in shown for clip in plan.CLIPS]
    assert len(files) == len(set(files))


def test_a_gallery_of_some_shows_each_garment_of_each_fabric():
    names = list(FABRICS)
    assert plan.costumes(["cloak"], [], names) == (Costume("cloak", PLAIN_FABRIC),)
    assert plan.costumes([], ["denim"], names) == (Costume(DEFAULT, "denim"),)
    both = plan.costumes(["cloak", "half_cape"], ["denim", "worsted"], names)
    assert {(c.garment, c.fabric) for c in both} == {
        (g, f) for g in ("cloak", "half_cape") for f in ("denim", "worsted")
    }


class Tags(HTMLParser):
    """Collects the tags of a page, and sees that each is closed."""

    def __init__(self) -> None:
        """Nothing is read."""
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in {"meta", "img"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_of_a_gallery_needs_nothing_but_its_pictures():
    costume = Costume("half_cape", "denim")
    pictures = {costume: [Shown("walk: 1 < 2", "a.jpg", (960, 800)), Shown("spin: can't be put on")]}
    text = page.html(pictures, titles={"half_cape": "over one & the other"}, who="g1", command="cape gallery")
    read = Tags()
    read.feed(text)
    assert read.open == []
    assert (
        "img",
        {"src": "a.jpg", "alt": "walk: 1 < 2", "width": "960", "height": "800", "loading": "lazy"},
    ) in read.tags
    assert sum(tag == "figure" for tag, _ in read.tags) == 2
    assert {tag for tag, _ in read.tags}.isdisjoint({"script", "link", "iframe"})
    assert "://" not in text
    assert "url(" not in text
    assert ("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}) in read.tags
    ids = {attributes["id"] for _, attributes in read.tags if "id" in attributes}
    assert {attributes["href"] for tag, attributes in read.tags if tag == "a"} == {
        "a.jpg",
        *(f"#{name}" for name in ids),
    }
    assert "half cape of denim" in text
    assert "can&#x27;t be put on" in text


# From here on pictures are drawn.


@pytest.fixture(scope="module")
def drawing() -> None:
    """Skip where nothing can be drawn."""
    try:
        require_viewer()
    except UserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def replayed(drawing: None, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("replayed")
    done = cape("replay", "walk", "--end", "0.6", "--garment", "back_cape", "-o", "walk.rrd", folder=folder)
    assert done.returncode == 0, done.stderr
    return folder


def red(picture: Image.Image) -> int:
    """Number of pixels in which the outside of the cape is seen."""
    r, g, b = np.moveaxis(np.asarray(picture).astype(int), -1, 0)
    return int(((r > 80) & (r > 2.5 * g) & (r > 2.5 * b)).sum())


@pytest.mark.extra
def test_a_cape_is_seen_from_behind_and_hidden_from_in_front(replayed: Path):
    asked = ("render", "walk.rrd", "--at", "0.2", "--at", "0.5", "--from", "back", "--from", "front")
    done = cape(*asked, "--size", "200x220", "-o", "walk.png", folder=replayed)
    assert done.returncode == 0, done.stderr
    assert "drawing: 4 of 4" in done.stderr
    with Image.open(replayed / "walk.png") as whole:
        assert whole.size == (400, 440)
        behind = [whole.crop((200 * k, 0, 200 * k + 200, 220)) for k in range(2)]
        in_front = [whole.crop((200 * k, 220, 200 * k + 200, 440)) for k in range(2)]
    assert min(map(red, behind)) > 3 * max(map(red, in_front))
    assert behind[0].tobytes() != behind[1].tobytes()


@pytest.mark.extra
def test_the_same_moment_is_the_same_picture(replayed: Path):
    for name in ("first.png", "second.png"):
        done = cape("render", "walk.rrd", "--at", "0.3", "--size", "160x160", "-o", name, folder=replayed)
        assert done.returncode == 0, done.stderr
    assert Image.open(replayed / "first.png").tobytes() == Image.open(replayed / "second.png").tobytes()


@pytest.mark.extra
@pytest.mark.parametrize(
    ("options", "word"), [(["--view", "kitchen"], "hitboxes"), (["--at", "7"], "0.6"), (["--at", "-1"], "from 0")]
)
def test_views_and_times_that_are_not_there_are_told(options: list[str], word: str, replayed: Path):
    done = cape("render", "walk.rrd", *options, "-o", "none.png", folder=replayed)
    assert done.returncode == 2
    line = done.stderr.splitlines()[-1]
    assert line.startswith("cape: ")
    assert word in line
    assert not (replayed / "none.png").exists()


@pytest.mark.extra
def test_what_is_no_recording_is_told(drawing: None, tmp_path: Path):
    (tmp_path / "words.rrd").write_text("words")
    done = cape("render", "words.rrd", folder=tmp_path)
    assert done.returncode == 2
    assert "words.rrd" in done.stderr.splitlines()[-1]


@pytest.mark.extra
def test_a_film_goes_through_the_part_that_was_asked_for(replayed: Path):
    asked = ("render", "walk.rrd", "--start", "0.1", "--end", "0.4", "--film-fps", "10", "--size", "80x80")
    done = cape(*asked, "-o", "walk.gif", folder=replayed)
    assert done.returncode == 0, done.stderr
    with Image.open(replayed / "walk.gif") as film:
        assert (film.size, getattr(film, "n_frames")) == ((80, 80), 4)  # noqa: B009


@pytest.mark.extra
def test_an_mp4_plays(replayed: Path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="pip install 'cape[film]'")
    asked = ("render", "walk.rrd", "--end", "0.4", "--film-fps", "10", "--size", "81x81")
    done = cape(*asked, "-o", "walk.mp4", folder=replayed)
    assert done.returncode == 0, done.stderr
    facts = next(ffmpeg.read_frames(str(replayed / "walk.mp4")))
    assert (facts["size"], facts["fps"], ffmpeg.count_frames_and_secs(str(replayed / "walk.mp4"))[0]) == (
        (80, 80),
        10,
        5,
    )


@pytest.mark.extra
def test_a_clip_is_replayed_with_what_was_asked_for(drawing: None, tmp_path: Path):
    asked = ("render", "walk", "--end", "0.2", "--fabric", "denim", "--spacing", "0.06", "--size", "100x100")
    done = cape(*asked, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "finished" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["walk.png"]
    pixels = np.asarray(Image.open(tmp_path / "walk.png").convert("RGB")).astype(int)
    coloured = np.ptp(pixels, axis=2) > 0.4 * pixels.max(axis=2)  # denim is blue; stage and body hardly have a colour
    assert (coloured & (pixels.argmax(axis=2) == 2)).sum() > 100


@pytest.mark.extra
def test_a_gallery_is_a_page_with_its_pictures(drawing: None, tmp_path: Path):
    done = cape("gallery", "-o", "pages", "--garment", "half_cape", "--clip", "idle", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    (file,) = (path.name for path in (tmp_path / "pages").glob("*.jpg"))
    assert f'src="{file}"' in (tmp_path / "pages" / "index.html").read_text()
    assert red(Image.open(tmp_path / "pages" / file)) > 1000


@pytest.mark.extra
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_film_leaves_neither_file_nor_viewer(number: signal.Signals, replayed: Path, tmp_path: Path):
    shutil.copy(replayed / "walk.rrd", tmp_path)
    command = [CAPE, "render", "walk.rrd", "-o", "walk.gif", "--film-fps", "100"]
    running = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    assert running.stderr.readline().startswith("filming")
    (drawing,) = viewers_of(running.pid)
    running.send_signal(number)
    running.communicate(timeout=60)
    assert running.returncode == 128 + number
    assert [path.name for path in tmp_path.iterdir()] == ["walk.rrd"]
    until = time.monotonic() + 10.0
    while Path("/proc", drawing).exists():
        assert time.monotonic() < until
        time.sleep(0.1)


def viewers_of(parent: int) -> list[str]:
    """Numbers of the processes that a process has started."""
    return Path("/proc", str(parent), "task", str(parent), "children").read_text().split()
