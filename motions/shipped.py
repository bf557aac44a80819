"""The clips that come with the package, as BVH files in `motions/clips`."""

from pathlib import Path

from motions.border import checked
from motions.errors import UnknownNameError

_FOLDER = Path(__file__).parent / "clips"


@checked
def clip_names() -> tuple[str, ...]:
    """Names of the shipped clips, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.bvh")))


@checked
def clip_path(name: str) -> Path:
    """The file of a shipped clip.

    Raises:
        UnknownNameError: there is none of that name; lists them.
    """
    if name not in clip_names():
        raise UnknownNameError("shipped clip", name, clip_names())
    return _FOLDER / f"{name}.bvh"
