"""Fitted hitboxes that are kept on disk: fitting takes seconds, and gives the same for the same robot.

Two files each, named for a digest of all that a fit is made of: the body's surfaces, bones and roles, the options, the
sources of this package, the versions of what it computes with. One holds the solids as `Hitboxes.save` writes them, the
other what else there is to tell; a file that is not whole, or not there, has the fit done again.
"""

import contextlib
import hashlib
import importlib.metadata
import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from motions import quaternions
from motions.border import checked
from motions.errors import FileError
from motions.files import write_text
from skeleton.model import Skeleton
from skeleton.robot.hitboxes import Hitboxes, Kind, Quality, hitboxes_of, load_hitboxes
from skeleton.robot.meshes.link_surfaces import link_surfaces

_PACKAGE = Path(__file__).parents[1]
_COMPUTED_WITH = ("numpy", "scipy", "trimesh", "coal")


@checked
def kept_hitboxes_of(
    body: Skeleton, folder: str | Path, *, which: Literal["limbs", "all"] = "limbs", kind: Kind | None = None
) -> Hitboxes:
    """What `hitboxes_of` gives, taken from a folder where it was left before.

    Args:
        body: the robot, or a character with a mesh.
        folder: where fits are kept; made if it isn't there. One that can't be written keeps nothing.
        which: as for `hitboxes_of`.
        kind: as for `hitboxes_of`.

    Raises:
        ValueRangeError: an option that doesn't exist.
        FileError: neither the collision nor the visual meshes can be read.
    """
    name = _name_of(body, which, kind)
    if name is None:
        return hitboxes_of(body, which=which, kind=kind)
    solids, rest = (Path(folder) / f"{name}.{suffix}" for suffix in ("toml", "json"))
    with contextlib.suppress(OSError, ValueError, FileError):
        return _read(solids, rest, body)
    hitboxes = hitboxes_of(body, which=which, kind=kind)
    with contextlib.suppress(OSError, FileError):
        _write(solids, rest, hitboxes)
    return hitboxes


def _read(solids: Path, rest: Path, body: Skeleton) -> Hitboxes:
    """The hitboxes in two files.

    Raises:
        OSError, ValueError, FileError: these are not what was written, to the last byte.
    """
    digest, _, text = rest.read_bytes().partition(b"\n")
    if digest.decode() != _digest([solids.read_bytes(), text]):
        raise ValueError(f"{rest} is not what was written, or {solids}")
    content: dict[str, Any] = json.loads(text)
    qualities = {link: Quality(**{**own, "solids": tuple(own["solids"])}) for link, own in content["qualities"].items()}
    return replace(
        load_hitboxes(solids, body),
        left_out=content["left_out"],
        qualities=qualities,
        decisions=tuple(content["decisions"]),
    )


def _write(solids: Path, rest: Path, hitboxes: Hitboxes) -> None:
    """Write the two files, the one that vouches for both at last."""
    solids.parent.mkdir(parents=True, exist_ok=True)
    hitboxes.save(solids)
    content = {
        "left_out": dict(hitboxes.left_out),
        "qualities": {link: asdict(quality) for link, quality in hitboxes.qualities.items()},
        "decisions": hitboxes.decisions,
    }
    text = json.dumps(content)
    write_text(rest, f"{_digest([solids.read_bytes(), text.encode()])}\n{text}")


def _name_of(body: Skeleton, which: str, kind: str | None) -> str | None:
    """What a fit goes by; None for a body whose surfaces can't all be read."""
    try:
        surfaces = [*link_surfaces(body, "collision"), *link_surfaces(body, "visual")] if body.is_robot else []
    except FileError:
        return None
    pieces = () if body.skin is None else body.skin.pieces
    if not surfaces and not pieces:
        return None

    def parts() -> Iterator[bytes]:
        yield repr((which, kind, _code(), body.name, body.bones, sorted(body.roles.items()))).encode()
        yield from map(_bytes, (body.parents, body.rest.positions, body.rest.rotations_wxyz))
        for surface in surfaces:
            yield repr((surface.name, surface.link, surface.bone, type(surface.primitive))).encode()
            yield from map(_bytes, (surface.vertices, surface.triangles))
        if body.skin is not None:
            yield repr(body.skin.bones).encode() + _bytes(body.skin.binds)
        for piece in pieces:
            yield from map(_bytes, (piece.vertices, piece.triangles, piece.binds, piece.weights))

    return f"hitboxes-{_digest(parts())[:32]}"


@cache
def _code() -> tuple[str, ...]:
    """What computes a fit: sources, versions."""
    sources = [path.read_bytes() for path in sorted(_PACKAGE.rglob("*.py"))]
    versions = (f"{name} {_version(name)}" for name in _COMPUTED_WITH)
    return (_digest([*sources, Path(quaternions.__file__).read_bytes()]), *versions)


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "missing"  # coal, where no robot is read


def _bytes(array: Any) -> bytes:
    return repr((array.shape, array.dtype.str)).encode() + np.ascontiguousarray(array).tobytes()


def _digest(parts: Any) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(str(len(part)).encode() + b":" + part)
    return digest.hexdigest()
