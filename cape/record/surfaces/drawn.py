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
from cape.results.topology import Topology

if TYPE_CHECKING:
    from cape.results.take import Take

FloatArray = NDArray[np.float32]


class Drawn(NamedTuple):
    """A mesh that is drawn.

    Attributes:
        triangles: vertex indices, shape (T, 3).
        texcoords: from the top left, shape (V, 2).
        visual: what carries its vertices along; None where they are the simulated ones.
    """

    triangles: NDArray[np.int32]
    texcoords: FloatArray
    visual: Visual | None

    def at(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places [m] and unit normals of its vertices, (F, V, 3) each, from those of the simulated ones, (F, n, 3).

        There may be more of the latter than there are in these frames.
        """
        if self.visual is None:
            places = positions[:, : self.vertices]
            return places, vertex_normals(places, self.triangles)
        places, whole = self.visual.places(positions), self.visual.whole
        return places, vertex_normals(places, whole[self.triangles])[:, whole]

    @property
    def vertices(self) -> int:
        """Number of its vertices."""
        return len(self.texcoords)


def drawn_of(take: Take, topology: Topology | None = None) -> Drawn:
    """The mesh that is drawn for a take's cloth, in the frames of one of its topologies where it has several."""
    cloth, triangles, texcoords = take.cloth, take.triangles, take.texcoords
    if topology is not None:
        triangles, texcoords = topology.triangles, take.texcoords[: len(topology.parents)]
    # The triangles of a finer mesh would span tears.
    visual = None if cloth is None or len(texcoords) > cloth.vertices else cloth.visual
    if cloth is None or visual is None:
        return Drawn(triangles, texcoords, None)
    own = visual.uv if cloth.textures is not None else None
    if own is None:
        own = np.einsum("vck,vc->vk", texcoords[visual.corners], visual.shares).astype(np.float32)
    return Drawn(visual.triangles, own, visual)


def texture_drawn(take: Take, look: Look) -> NDArray[np.uint8]:
    """The texture of a take's cloth, sRGB, shape (height, width, 3): of a look where the cloth has none of its own.

    A fabric is drawn to measure over the cloth's pattern, an image over the texture coordinates that were made for it.
    """
    return plain(look.color) if take.cloth is None else texture_of(take.cloth, look)
