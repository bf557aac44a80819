"""Takes in files: an NPZ of arrays, and one text for all that is no array, from which nothing is ever unpickled.

The text is JSON. An object of a class that a take holds is `{"is": CLASS, "fields": {...}}`, a tuple
`{"tuple": [...]}`, a mapping `{"mapping": {...}}`, an array `{"array": NAME}`, or `{"numbers": [...], "of": TYPE}`
where it is small, and bytes, such as an encoded image, are `{"bytes": NAME}`, an array of these. What classes there are
follows from the types of a take's fields, so that a new field needs no line here.
"""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.results.take import Take
from cape.scene.colliders import Collider
from cape.version import VERSION
from motions.arrays import KINDS, read_arrays
from motions.errors import FileError, ValueRangeError
from motions.files import whole_file
from motions.gltf import document as gltf
from motions.limits import LARGEST_FILE
from motions.skin import Skin, SkinPiece
from skeleton.track import BoneTrack

TEXT = "take"  # name of the text among the arrays
SMALL = 16  # numbers of an array that stands in the text
ROOM = 2**22  # bytes of a file besides its arrays
POSITION = 12  # bytes of a vertex in a frame
MOTIONS = (".bvh", *gltf.SUFFIXES)  # what may be taken for a take

Arrays = dict[str, NDArray[Any]]


def keep(take: Take, path: str | PathLike[str]) -> None:
    """Write a take, whole; a file that is there is replaced when the new one is complete.

    Raises:
        ValueRangeError: it is larger than what can be read again, or holds an object that no field of a take allows.
        FileError: the file can't be written.
    """
    arrays: Arrays = {}
    content = {"cape": VERSION, TEXT: _plain(take, TEXT, arrays, _classes())}
    _require_size(sum(array.nbytes for array in arrays.values()))
    arrays[TEXT] = np.array(json.dumps(content).encode())
    with whole_file(Path(path)) as partial, partial.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)  # pyright: ignore[reportArgumentType]


def require_size(frames: int, vertices: int) -> None:
    """Check that the positions of so many vertices in so many frames can be kept.

    Raises:
        ValueRangeError: they can't.
    """
    _require_size(POSITION * frames * vertices)


def _require_size(size: int) -> None:
    if size > LARGEST_FILE - ROOM:
        raise ValueRangeError(
            f"a take of {size / 2**20:.0f} MB can't be kept: {LARGEST_FILE / 2**20:.0f} MB at most are read again"
        )


def load(path: str | PathLike[str]) -> Take:
    """Read a take that was kept.

    Raises:
        FileError: the file is missing or damaged, or holds no take.
    """
    path = Path(path)
    if path.suffix.lower() == ".rrd":
        raise FileError(
            f"{path} is a recording, which holds less than a take: cape replay CLIP -o {path.stem}.npz, or take.keep, "
            "keeps a take"
        )
    if path.suffix.lower() in MOTIONS and os.path.isfile(path):
        raise FileError(f"{path} is a motion, not a kept take: cape replay {path} -o {path.stem}.npz keeps one")
    arrays = read_arrays(path)
    if TEXT not in arrays or arrays[TEXT].dtype.kind != "S" or arrays[TEXT].ndim:
        raise FileError(f"{path} holds no take: there is no text named {TEXT!r} in it")
    try:
        content = json.loads(arrays[TEXT].item())
        take = _object(content[TEXT], arrays, _classes())
        _check(take)
    except (AttributeError, IndexError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise FileError(f"{path} holds no take that this version of cape ({VERSION}) can read: {error}") from None
    return take


def _classes() -> dict[str, type]:
    """Every class of which a take may hold objects, by its name."""
    found: dict[str, type] = {}
    ahead: list[type] = [Take]
    while ahead:
        kind = ahead.pop()
        if kind.__name__ not in found:  # those of a take itself before those of what derives from it
            found[kind.__name__] = kind
            ahead += kind.__subclasses__()
            ahead += [each for hint in get_type_hints(kind).values() for each in _mentioned(hint)]
    return found


def _mentioned(hint: Any) -> Iterator[type]:
    """The dataclasses in the type of a field, such as `Fit` in `tuple[Fit, ...] | None`."""
    if isinstance(hint, type) and is_dataclass(hint):
        yield hint
    for part in get_args(hint):
        yield from _mentioned(part)


def _plain(value: Any, path: str, arrays: Arrays, classes: Mapping[str, type]) -> Any:
    """What stands for a value in the text; its larger arrays go to `arrays`, by their paths.

    Raises:
        ValueRangeError: nothing does.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in KINDS:
        if 0 < value.size <= SMALL:
            return {"numbers": value.tolist(), "of": value.dtype.str}
        arrays[path] = value
        return {"array": path}
    if isinstance(value, bytes):
        arrays[path] = np.frombuffer(value, np.uint8)
        return {"bytes": path}
    if isinstance(value, list | tuple):
        plain = [_plain(each, f"{path}.{place}", arrays, classes) for place, each in enumerate(value)]
        return {"tuple": plain} if isinstance(value, tuple) else plain
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {"mapping": {key: _plain(each, f"{path}.{key}", arrays, classes) for key, each in value.items()}}
    name = type(value).__name__
    if is_dataclass(value) and classes.get(name) is type(value):
        own = [(each.name, getattr(value, each.name)) for each in fields(value) if each.init]
        return {"is": name, "fields": {key: _plain(each, f"{path}.{key}", arrays, classes) for key, each in own}}
    raise ValueRangeError(f"{path} can't be kept: it is of the type {name}")


def _object(plain: Any, arrays: Mapping[str, NDArray[Any]], classes: Mapping[str, type]) -> Any:
    """The value that something in the text stands for.

    What makes no sense ends in the error that it happens to lead to, of those that `load` knows.
    """
    if isinstance(plain, list):
        return [_object(each, arrays, classes) for each in plain]
    if not isinstance(plain, dict):
        return plain
    match plain:
        case {"array": name}:
            return arrays[name]
        case {"bytes": name}:
            return arrays[name].tobytes()
        case {"numbers": numbers, "of": kind}:
            return np.array(numbers, dtype=kind if np.dtype(kind).kind in KINDS else None)
        case {"tuple": values}:
            return tuple(_object(each, arrays, classes) for each in values)
        case {"mapping": values}:
            return {key: _object(each, arrays, classes) for key, each in values.items()}
        case {"is": name, "fields": values}:
            if name not in classes:
                raise ValueError(f"no class named {name!r}; available: {', '.join(classes)}")
            return classes[name](**{key: _object(each, arrays, classes) for key, each in values.items()})
    raise ValueError(f"nothing is told by {', '.join(map(repr, plain))}")


def _check(take: Any) -> None:
    """Look whether what was read fits together.

    Raises:
        ValueError: it does not.
    """
    kinds = {"bones": BoneTrack, "cloth": Cloth | None, "name": str, "result": str, "solver": str}
    if not isinstance(take, Take):
        raise ValueError(f"it holds a {type(take).__name__}")
    for name, kind in kinds.items():
        if not isinstance(getattr(take, name), kind):
            raise ValueError(f"{name} is a {type(getattr(take, name)).__name__}")
    if not all(isinstance(collider, Collider) for collider in take.colliders):
        raise ValueError("a collider is of another type")
    _check_skin(take.bones.skin)
    frames, vertices = take.bones.frames, len(take.texcoords)
    shapes = {"positions": (frames, vertices, 3), "texcoords": (vertices, 2), "triangles": (len(take.triangles), 3)}
    shapes |= dict.fromkeys(("stretch_max", "penetration", "penetrated", "kinetic_energy"), (frames,))
    for name, shape in shapes.items():
        array = getattr(take, name)
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or array.shape != shape:
            raise ValueError(f"{name} must be numbers of the shape {shape}, not {np.shape(array)}")
    if take.triangles.size and not (take.triangles.min() >= 0 and take.triangles.max() < vertices):
        raise ValueError(f"a triangle has a vertex that is not among the {vertices} there are")


def _check_skin(skin: Skin | None) -> None:
    """Look whether a skin is made of pieces; that their arrays fit each other they have seen to themselves.

    Raises:
        ValueError: it is not.
    """
    for piece in () if skin is None else skin.pieces:
        if not isinstance(piece, SkinPiece) or not isinstance(piece.name, str):
            raise ValueError(f"a piece of the skin is a {type(piece).__name__}")
        if not isinstance(piece.image, bytes | None):
            raise ValueError(f"the image of {piece.name!r} is a {type(piece.image).__name__}")
