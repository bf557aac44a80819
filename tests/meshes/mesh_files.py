"""Mesh files as text or bytes, and meshes by formula."""

import json
import struct
from collections.abc import Mapping

import numpy as np


def sheet(rows: int, columns: int, step: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) of a grid that hangs in the plane x = 0, and its triangles (T, 3)."""
    y, z = np.meshgrid(step * np.arange(columns), -step * np.arange(rows))
    points = np.stack([np.zeros(rows * columns), y.ravel(), z.ravel()], axis=1)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + columns, corner + columns + 1
    return points, np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])


def tube(around: int, rings: int, radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """An open tube around the Z axis, down from z = 0, its outside outwards."""
    angles, heights = 2.0 * np.pi * np.arange(around) / around, np.linspace(0.0, -length, rings)
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(around)], axis=1)
    points = (ring[None] + heights[:, None, None] * [0.0, 0.0, 1.0]).reshape(-1, 3)
    k, ahead = np.arange(around), (np.arange(around) + 1) % around
    faces = [
        np.concatenate([np.stack([k, k + around, ahead], 1), np.stack([ahead, k + around, ahead + around], 1)])
        + r * around
        for r in range(rings - 1)
    ]
    return points, np.concatenate(faces)


def box(side: float) -> tuple[np.ndarray, np.ndarray]:
    """A closed cube."""
    import trimesh

    mesh = trimesh.creation.box(extents=(side, side, side))
    return np.array(mesh.vertices), np.array(mesh.faces)


def obj(points: np.ndarray, faces: np.ndarray, *, uv: np.ndarray | None = None, before: str = "") -> str:
    """An OBJ file with positions as they are given; faces may have any number of corners."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [] if uv is None else [f"vt {u!r} {v!r}" for u, v in uv.tolist()]
    form = (lambda k: f"{k + 1}") if uv is None else (lambda k: f"{k + 1}/{k + 1}")
    lines += [before, *("f " + " ".join(form(k) for k in face) for face in faces.tolist())]
    return "\n".join(lines) + "\n"


def ply(points: np.ndarray, faces: np.ndarray, **properties: np.ndarray) -> str:
    """A PLY file in text, with further properties of the vertices."""
    kinds = {name: "uchar" if values.dtype == np.uint8 else "float" for name, values in properties.items()}
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property double {a}" for a in "xyz")]
    head += [f"property {kind} {name}" for name, kind in kinds.items()]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = zip(points.tolist(), *(values.tolist() for values in properties.values()), strict=True)
    body = [" ".join(repr(value) for value in (*point, *others)) for point, *others in rows]
    return "\n".join([*head, *body, *("3 " + " ".join(map(str, face)) for face in faces.tolist())]) + "\n"


def glb(
    points: np.ndarray,
    faces: np.ndarray,
    attributes: Mapping[str, np.ndarray] | None = None,
    *,
    node: Mapping[str, object] | None = None,
    joints: tuple[str, ...] = (),
    image: bytes | None = None,
) -> bytes:
    """A GLB file: of single-precision positions and attributes, with unsigned 2-byte indices, a skin and an albedo."""
    kinds = {"f": (5126, "<f4"), "u": (5123, "<u2")}
    views, accessors, blob = [], [], b""

    def put(array: np.ndarray) -> int:
        nonlocal blob
        component, dtype = kinds["f" if array.dtype.kind == "f" else "u"]
        data = np.ascontiguousarray(array, dtype=dtype).tobytes()
        blob += b"\0" * (-len(blob) % 4)
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob += data
        width = {0: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[0 if array.ndim == 1 else array.shape[1]]
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": width})
        return len(accessors) - 1

    primitive: dict[str, object] = {
        "attributes": {"POSITION": put(points.astype(np.float32))}
        | {name: put(values) for name, values in (attributes or {}).items()},
        "indices": put(faces.ravel().astype(np.uint16)),
    }
    top: dict[str, object] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "coat", **(node or {})}, *({"name": name} for name in joints)],
        "meshes": [{"primitives": [primitive]}],
    }
    if joints:
        top["skins"] = [{"joints": list(range(1, len(joints) + 1))}]
    if image is not None:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(image)})
        blob += image + b"\0" * (-len(image) % 4)
        primitive["material"] = 0
        top["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        top["textures"] = [{"source": 0}]
        top["images"] = [{"bufferView": len(views) - 1, "mimeType": "image/png"}]
    blob += b"\0" * (-len(blob) % 4)
    top |= {"bufferViews": views, "accessors": accessors, "buffers": [{"byteLength": len(blob)}]}
    text = json.dumps(top).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
