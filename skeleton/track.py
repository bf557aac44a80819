"""The plug between whatever moves bones and the cloth: world poses of named bones over time, as plain arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BoneTrack:
    """World poses of B bones over F frames, right-handed and Z up.

    Attributes:
        names: names of the bones, unique.
        times: times of the frames [s], increasing, shape (F,).
        positions: origins of the bones in the world [m], shape (F, B, 3).
        rotations_wxyz: unit quaternions (w, x, y, z) bone_to_world, shape (F, B, 4), signs continuous over frames.
        parents: index of each bone's parent among `names`, -1 for none, shape (B,); only drawings need it.
        roles: name of the bone that plays each role, such as {"left_shoulder": "LeftCollar"}.
    """

    names: tuple[str, ...]
    times: FloatArray
    positions: FloatArray
    rotations_wxyz: FloatArray
    parents: NDArray[np.int64] | None = None
    roles: Mapping[str, str] = field(default_factory=dict)
