"""Textures of a cloth as glTF 2.0 takes them: read from images, and written."""

import os
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions.border import checked, checked_first
from motions.errors import FileError, ValueRangeError
from motions.files import read_bytes, whole_file

TextureArray = NDArray[np.uint8]

MOST_TEXELS = 4096  # along a side: more than a viewer's memory is meant for


@checked_first
@dataclass(frozen=True, eq=False)
class Textures:
    """Images over texture coordinates, from the top left; both sides of the cloth have them.

    Attributes:
        albedo: sRGB, shape (height, width, 3).
        normal: x to the right, y up, z out of the cloth, -1 to 1 as 0 to 255, shape (height, width, 3); None for flat.
        metal_roughness: roughness in green and metalness in blue, 0 to 1 as 0 to 255, shape (height, width, 3); None
            for a rough cloth without metal.
    """

    albedo: TextureArray
    normal: TextureArray | None = None
    metal_roughness: TextureArray | None = None

    def write(self, folder: str | os.PathLike[str], name: str) -> list[Path]:
        """Save as PNG: `name`_albedo.png, `name`_normal.png and `name`_metal_roughness.png; gives the files.

        Raises:
            FileError: one can't be written.
        """
        from PIL import Image

        written = []
        for kind in ("albedo", "normal", "metal_roughness"):
            if (texture := getattr(self, kind)) is not None:
                path = Path(folder) / f"{name}_{kind}.png"
                with whole_file(path) as partial:
                    Image.fromarray(texture).save(partial, format="PNG")
                written.append(path)
        return written


@checked
def read_textures(
    albedo: str | os.PathLike[str],
    *,
    normal: str | os.PathLike[str] | None = None,
    metal_roughness: str | os.PathLike[str] | None = None,
) -> Textures:
    """Read textures from images of any format that Pillow reads.

    Raises:
        FileError: one can't be read, or is too large.
    """
    others = (None if path is None else read_image(path) for path in (normal, metal_roughness))
    return Textures(read_image(albedo), *others)


def read_image(path: str | os.PathLike[str]) -> TextureArray:
    """Read an image, sRGB, shape (height, width, 3).

    Raises:
        FileError: it can't be read, or is too large.
    """
    return decoded(read_bytes(Path(path)), str(path))


def decoded(data: bytes, label: str) -> TextureArray:
    """The image that is encoded in bytes, sRGB, shape (height, width, 3); `label` names it in errors.

    Raises:
        FileError: it is none, or too large.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data)) as image:
            if max(image.size) > MOST_TEXELS:
                raise ValueRangeError(
                    f"it has {image.size[0]} x {image.size[1]} texels, more than {MOST_TEXELS} a side"
                )
            return np.array(image.convert("RGB"))
    except UnidentifiedImageError:
        raise FileError(f"{label} is no image that can be read: it is of no format that Pillow knows") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise FileError(f"{label} is no image that can be read: {error}") from None


def sampled(texture: TextureArray, uv: NDArray[np.floating]) -> NDArray[np.float64]:
    """Brightness of a texture at texture coordinates (n, 2), 0 to 1, shape (n,); it repeats beyond them."""
    size = np.array([texture.shape[1], texture.shape[0]])
    within = np.where((uv > 0.0) & (uv % 1.0 == 0.0), 1.0, uv % 1.0)  # the far edge is the image's own
    across, down = np.minimum((within * size).astype(np.int64), size - 1).T
    return texture[down, across].mean(axis=1) / 255.0
