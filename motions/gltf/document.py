"""A glTF 2.0 file taken apart: what it describes, and the bytes that this names.

Section numbers are of the specification, Khronos 2021, registry.khronos.org/glTF. Read here since libraries hand out
parts alone: trimesh drops skins, pygltflib leaves accessors to its users.
"""

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from motions.errors import FileError, UserError
from motions.files import read_bytes
from motions.limits import LARGEST_ARRAYS, LARGEST_DESCRIPTION

SUFFIXES = (".glb", ".gltf", ".vrm", ".vrma")
JSON, BIN = 0x4E4F534A, 0x004E4942
COMPRESSED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
DAMAGED = (
    KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, struct.error, RecursionError,
)  # fmt: skip


@contextmanager
def reading(label: str, kind: str = "glTF") -> Iterator[None]:
    """Tell whatever is wrong with a file's structure as an error of that file.

    Raises:
        FileError: it is.
    """
    try:
        yield
    except UserError:
        raise
    except DAMAGED as error:
        raise FileError(f"{label} is no {kind} that can be read: {type(error).__name__}: {error}") from None


@dataclass(eq=False)
class Document:
    """A file's description, and what of its bytes was needed so far.

    Attributes:
        label: what errors call the file.
        top: the description.
        binary: bytes of the chunk that comes along, b"" for none.
        folder: where files lie that it names; None for none.
        room: bytes that its arrays may still take.
    """

    label: str
    top: dict[str, Any]
    binary: bytes = b""
    folder: Path | None = None
    room: int = LARGEST_ARRAYS
    _buffers: dict[int, bytes] = field(default_factory=dict)

    @staticmethod
    def of_glb(data: bytes, label: str, folder: Path | None = None) -> "Document":
        """The binary form: a head and chunks, each with its length and kind (4.4).

        Raises:
            FileError: it is none of version 2, its description is too long, or compressed.
        """
        magic, version, _ = struct.unpack_from("<4sII", data)
        if magic != b"glTF" or version != 2:
            raise FileError(f"{label} is no GLB of version 2")
        chunks: dict[int, bytes] = {}
        place = 12
        while place + 8 <= len(data):
            length, kind = struct.unpack_from("<II", data, place)
            chunks.setdefault(kind, data[place + 8 : place + 8 + length])
            place += 8 + length
        return Document(label, _description(chunks[JSON], label), chunks.get(BIN, b""), folder)

    @staticmethod
    def read(path: Path) -> "Document":
        """A .gltf file with what lies beside it, or a binary one of any suffix.

        Raises:
            FileError: the file is missing, too large, compressed or malformed.
        """
        data = read_bytes(path)
        if not data.strip():
            raise FileError(f"{path} is empty")
        with reading(str(path)):
            if data[:4] == b"glTF":
                return Document.of_glb(data, str(path), path.parent)
            return Document(str(path), _description(data, str(path)), b"", path.parent)

    @property
    def beside(self) -> tuple[Path, ...]:
        """Files that it names, as textures and buffers, in its own folder."""
        named = [each.get("uri") for kind in ("buffers", "images") for each in self.list_of(kind)]
        return tuple(
            self.folder / unquote(uri)
            for uri in named
            if self.folder is not None and isinstance(uri, str) and ":" not in uri.split("/")[0]
        )

    def list_of(self, kind: str) -> list[dict[str, Any]]:
        """All things of a kind that the file describes, such as "nodes"."""
        found = self.top.get(kind, [])
        if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
            raise TypeError(f"{kind} is no list of objects")
        return found

    def buffer(self, number: int) -> bytes:
        """The bytes of a buffer: of the chunk that comes along, of a text in the description, or of a file (3.6.1).

        Raises:
            FileError: it can't be had.
        """
        if number not in self._buffers:
            uri = self.list_of("buffers")[number].get("uri")
            self._buffers[number] = self.binary if uri is None and number == 0 else self.bytes_at(uri)
        return self._buffers[number]

    def view(self, number: int) -> tuple[bytes, int, int, int | None]:
        """A buffer, where in it a view starts and how long it is, and the step between its elements (3.6.1.2)."""
        view = self.list_of("bufferViews")[number]
        for extension, name in COMPRESSED.items():
            if extension in view.get("extensions", {}):
                raise FileError(f"{self.label} is compressed by {name}: save it without")
        data, start = self.buffer(view["buffer"]), view.get("byteOffset", 0)
        length = min(view["byteLength"], len(data) - start)
        return data, start, length, view.get("byteStride")

    def bytes_at(self, uri: str | None) -> bytes:
        """What a URI names: base64 in itself, or a file in the folder of this one (2.8).

        Raises:
            FileError: it is something else, or can't be read.
        """
        if not isinstance(uri, str):
            raise FileError(f"{self.label}: its numbers are missing, a buffer names no bytes")
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            if not head.endswith(";base64"):
                raise FileError(f"{self.label} holds data that is not in base64")
            try:
                return base64.b64decode(body, validate=True)
            except binascii.Error as error:
                raise FileError(f"{self.label} holds data that is no base64: {error}") from None
        # A file that came from somewhere must not fetch whatever else lies on this machine.
        folder = self.folder
        path = None if folder is None else folder / unquote(uri)
        if ":" in uri.split("/")[0] or folder is None or path is None or not _lies_in(path, folder):
            raise FileError(f"{self.label} names {uri[:100]!r}, which is no file in its folder")
        return read_bytes(path)

    def take(self, size: int, what: str) -> None:
        """Count bytes that are about to be needed.

        Raises:
            FileError: there would be too many.
        """
        if size > self.room:
            raise FileError(f"{self.label}: {what} asks for more memory than any character needs")
        self.room -= size


def _lies_in(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())


def _description(text: bytes, label: str) -> dict[str, Any]:
    if len(text) > LARGEST_DESCRIPTION:
        raise FileError(
            f"{label}: its description has {len(text) / 2**20:.0f} MB, more than {LARGEST_DESCRIPTION >> 20}"
            "; save it as .glb"
        )
    top = json.loads(text)
    if not isinstance(top, dict):
        raise TypeError("its description is no object")
    for extension in top.get("extensionsRequired", ()):
        if extension in COMPRESSED:
            raise FileError(
                f"{label} is compressed by {COMPRESSED[extension]} ({extension}): save it without, in Blender's export "
                "by Compression off, or by npx @gltf-transform/cli copy IN.glb OUT.glb"
            )
    return top
