"""What all formats write of a take: a mesh that moves, its texture, and the skeleton and solids beside it."""

import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cape.cloth.looks.look import Look
from cape.cloth.looks.registry import LOOKS, look_of
from cape.cloth.looks.sewn import texture_of
from cape.results.take import Take
from cape.scene.colliders import Collider
from motions.errors import ValueRangeError
from motions.files import whole_file
from skeleton.track import BoneTrack

STILL_FPS = 24.0  # what formats that need a frame rate tell of a single frame


@dataclass(frozen=True, eq=False)
class MovingMesh:
    """A take's cloth over those F frames that can be drawn, right-handed and Z up.

    Attributes:
        name: of the take.
        times: of the frames, from the first one on [s], shape (F,).
        fps: frames per second.
        positions: of the vertices in the world [m], shape (F, V, 3).
        triangles: vertex indices, counter-clockwise from outside, shape (T, 3).
        texcoords: texture coordinates, (0, 0) the texture's upper left corner, shape (V, 2).
        texture: the cloth's albedo, sRGB, shape (height, width, 3).
        look: how rough it is, and of what colour.
        bones: the character's poses at the frames.
        colliders: what the cloth couldn't enter.
    """

    name: str
    times: NDArray[np.float64]
    fps: float
    positions: NDArray[np.float32]
    triangles: NDArray[np.int32]
    texcoords: NDArray[np.float32]
    texture: NDArray[np.uint8]
    look: Look
    bones: BoneTrack
    colliders: Sequence[Collider]

    @property
    def bottom_up(self) -> NDArray[np.float32]:
        """Texture coordinates for formats whose textures begin at their lower left corner, shape (V, 2)."""
        return np.stack([self.texcoords[:, 0], 1.0 - self.texcoords[:, 1]], axis=1)

    def texture_png(self) -> bytes:
        """The texture as a PNG file."""
        from PIL import Image

        file = io.BytesIO()
        Image.fromarray(self.texture).save(file, "PNG", compress_level=1)
        return file.getvalue()

    def write_texture(self, path: Path) -> Path:
        """Write the texture beside a file, under that file's name and `_albedo.png`, and give its path.

        Raises:
            FileError: it can't be written.
        """
        picture = path.with_name(f"{path.stem}_albedo.png")
        with whole_file(picture) as partial:
            partial.write_bytes(self.texture_png())
        return picture


def moving_mesh(take: Take) -> MovingMesh:
    """What there is to export of a take; it ends, with a warning, before a frame that isn't finite.

    Raises:
        ValueRangeError: its first frame isn't finite, or it has no triangle.
    """
    if not len(take.triangles):
        raise ValueRangeError(f"nothing to export: {take.name!r} has no triangle")
    finite = np.asarray(np.isfinite(take.positions).all(axis=(1, 2)))
    frames = len(finite) if finite.all() else int(finite.argmin())
    if frames == 0:
        raise ValueRangeError(f"nothing to export: the first frame of {take.name!r} isn't finite")
    if frames < len(finite):
        warnings.warn(
            f"the export of {take.name!r} ends at frame {frames - 1} of {len(finite) - 1}: "
            f"positions aren't finite from frame {frames}",
            stacklevel=3,
        )
    bones = take.bones.first(frames)
    look = LOOKS["cape"] if take.cloth is None else look_of(take.cloth.fabric)
    return MovingMesh(
        name=take.name,
        times=bones.times - bones.times[0],
        fps=_rate(bones) if frames > 1 else STILL_FPS,
        positions=np.asarray(take.positions[:frames], dtype=np.float32),
        triangles=take.triangles_at(len(take.positions) - 1),
        texcoords=np.asarray(take.texcoords, dtype=np.float32),
        texture=np.full((2, 2, 3), look.color, np.uint8) if take.cloth is None else texture_of(take.cloth, look),
        look=look,
        bones=bones,
        colliders=take.colliders,
    )


def _rate(bones: BoneTrack) -> float:
    """Frames per second, without the last digits that times of 53 bits leave: who cuts them off reads 59 of 59.9999."""
    plain, slack = round(bones.fps, 6), 2.0 * float(np.spacing(np.abs(bones.times).max()))
    duration = float(bones.times[-1] - bones.times[0])
    return plain if abs(plain * duration - (bones.frames - 1)) <= slack * plain else bones.fps


def y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Vectors of a Z-up world in the Y-up one of BVH files, glTF and OBJ, (x, y, z) to (x, z, -y), shape (..., 3).

    It undoes how BVH files are read: what is exported lies on the motion as its file has it, and who faces +Z there
    faces +Z again, as glTF has it.
    """
    turned = np.empty(vectors.shape, np.float32)
    turned[..., 0], turned[..., 1] = vectors[..., 0], vectors[..., 2]
    np.negative(vectors[..., 1], out=turned[..., 2])
    return turned
