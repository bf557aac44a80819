"""The manual: a chapter a file, which `cape manual NAME` prints and the README lists."""

from pathlib import Path

from motions.errors import UnknownNameError

FOLDER = Path(__file__).parent

NAMES = (
    "characters", "robots", "live", "meshes", "recordings", "pictures", "takes", "batch", "blender", "library",
    "accuracy",
)  # fmt: skip
"""Of the chapters, those first that most people need."""


def chapter(name: str) -> str:
    """The text of a chapter, in Markdown.

    Raises:
        UnknownNameError: there is no such chapter.
    """
    if name not in NAMES:
        raise UnknownNameError("chapter", name, NAMES)
    return (FOLDER / f"{name}.md").read_text(encoding="utf-8")


def title(name: str) -> str:
    """What a chapter is about.

    Raises:
        UnknownNameError: there is no such chapter.
    """
    return chapter(name).partition("\n")[0].removeprefix("# ")
