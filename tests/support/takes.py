"""Takes made by hand, for what is measured from positions alone, and what is in a recording of one."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from cape.results.take import Take
from cape.scene.colliders import Collider
from skeleton.track import BoneTrack


def take_of(
    positions: ArrayLike,
    triangles: ArrayLike,
    colliders: Sequence[Collider],
    *,
    poses: dict[str, tuple[ArrayLike, ArrayLike]] | None = None,
) -> Take:
    """A take of positions (F, V, 3) or, for one frame, (V, 3); of each bone positions (F, 3), rotations wxyz (F, 4)."""
    places = np.array(positions, dtype=np.float32)
    places = places[None] if places.ndim == 2 else places
    frames, none = len(places), np.zeros(len(places))
    bones = {"world": (np.zeros((frames, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))), **(poses or {})}
    track = BoneTrack(
        tuple(bones),
        np.arange(frames) / 60.0,
        np.stack([np.asarray(p, float).reshape(frames, 3) for p, _ in bones.values()], axis=1),
        np.stack([np.asarray(r, float).reshape(frames, 4) for _, r in bones.values()], axis=1),
    )
    return Take(
        name="by hand",
        bones=track,
        colliders=tuple(colliders),
        triangles=np.array(triangles, dtype=np.int32).reshape(-1, 3),
        texcoords=np.zeros((places.shape[1], 2), dtype=np.float32),
        positions=places,
        stretch_max=none,
        stretch_p99=0.0,
        penetration=none,
        penetrated=np.full(frames, -1),
        kinetic_energy=none,
        solver="none",
        substeps=1,
        compile_s=0.0,
        settle_s=0.0,
        solve_s=0.0,
    )


def cloth_frames(path: Path) -> int:
    """How many frames of its cloth are in a recording."""
    chunks = rr.chunk.RrdReader(path).stream().filter(content="/world/cape")
    return sum(c.num_rows for c in chunks if "Mesh3D:vertex_positions" in c.to_record_batch().schema.names)
