"""What is drawn of a cloth: what was simulated, or the finer mesh that it carries."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.drawn.visual import Visual
from cape.cloth.looks.look import Look
from cape.cloth.looks.sewn import texture_of
from cape.cloth.normals import vertex_normals
from cape.record.surfaces.textures import plain

if TYPE_CHECKING:
    from cape.results.take import Take

FloatArray = NDArray[np.float32]


class Drawn(NamedTuple):
    """A mesh with its texture.

    Attributes:
        triangles: vertex indices, shape (T, 3).
        texcoords: from the top left, shape (V, 2).
        texture: sRGB, shape (height, width, 3).
        visual: what carries its vertices along; None where they are the simulated ones.
    """

    triangles: NDArray[np.int32]
    texcoords: FloatArray
    texture: NDArray[np.uint8]
    visual: Visual | None

    def at(self, positions: FloatArray, triangles: NDArray[np.int32] | None = None) -> tuple[FloatArray, FloatArray]:
        """Places [m] and unit normals of its vertices, (F, V, 3) each, from those of the simulated ones, (F, n, 3).

        `triangles` are the simulated ones in those frames, where tears change them.
        """
        if self.visual is None:
            return positions, vertex_normals(positions, self.triangles if triangles is None else triangles)
        places, whole = self.visual.places(positions), self.visual.whole
        return places, vertex_normals(places, whole[self.triangles])[:, whole]

    @property
    def vertices(self) -> int:
        """Number of its vertices."""
        return len(self.texcoords)


def drawn_of(take: Take, look: Look) -> Drawn:
    """What is drawn of a take's cloth; of the fabric's look where the cloth has no textures of its own.

    A fabric is drawn to measure over the cloth's pattern, an image over the texture coordinates that were made for it.
    """
    cloth = take.cloth
    if cloth is None:
        return Drawn(take.triangles, take.texcoords, plain(look.color), None)
    texture = texture_of(cloth, look) if cloth.textures is None else cloth.textures.albedo
    visual = None if take.tears else cloth.visual  # its triangles would span the tears
    if visual is None:
        return Drawn(take.triangles, take.texcoords, texture, None)
    texcoords = visual.uv if cloth.textures is not None else None
    if texcoords is None:
        texcoords = np.einsum("vck,vc->vk", take.texcoords[visual.corners], visual.shares).astype(np.float32)
    return Drawn(visual.triangles, texcoords, texture, visual)
