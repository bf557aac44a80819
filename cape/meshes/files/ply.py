"""PLY through trimesh, with a map for each further property of its vertices."""

from io import BytesIO
from typing import Any

import numpy as np

from cape.meshes.source import FloatArray, Source, upright
from motions.errors import FileError

OWN = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha"}
PLACES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))


def read_ply(data: bytes, label: str, *, up: str = "y") -> Source:
    """The mesh in a PLY file; whole numbers of a property of its vertices count as shares of their largest.

    Args:
        data: the file's bytes.
        label: what errors call the file.
        up: its up axis, "y" or "z".

    Raises:
        FileError: it can't be read, or has no face.
        UnknownNameError: there is no such up axis.
    """
    import trimesh

    try:
        mesh: Any = trimesh.load(BytesIO(data), file_type="ply", process=False)
        raw = mesh.metadata["_ply_raw"]["vertex"]["data"]
    except Exception as error:  # a parser of anything that calls itself PLY: whatever it raises, the file is to blame
        raise FileError(f"{label} is no PLY that can be read: {type(error).__name__}: {error}") from None
    triangles = np.asarray(getattr(mesh, "faces", ()), dtype=np.int64).reshape(-1, 3)
    if not len(triangles):
        raise FileError(f"{label} has no face")
    values = {name: np.asarray(raw[name]).reshape(len(mesh.vertices), -1)[:, 0] for name in _scalars(raw)}
    if triangles.min() < 0 or triangles.max() >= len(mesh.vertices):
        raise FileError(f"{label} has a face with a vertex that is not among its {len(mesh.vertices)}")
    uv = None
    for names in PLACES:
        if all(name in values for name in names):
            uv = np.stack([values.pop(names[0]), 1.0 - values.pop(names[1])], axis=1).astype(float)
            break
    weights: dict[str, FloatArray] = {}
    for name, given in values.items():
        most = np.iinfo(given.dtype).max if given.dtype.kind in "iu" else 1.0
        if name not in OWN and np.isfinite(given).all():
            weights[name] = np.clip(given.astype(float) / most, 0.0, 1.0)
    return Source(upright(mesh.vertices, up), triangles, uv, weights)


def _scalars(raw: Any) -> list[str]:
    """Names of the properties that are a number a vertex."""
    names = raw.dtype.names if isinstance(raw, np.ndarray) else list(raw)
    return [name for name in names or () if np.asarray(raw[name]).dtype.kind in "fiu"]
