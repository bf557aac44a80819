"""GLB files of characters, written by pygltflib, and where their vertices are by a plain computation of its own."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gl
from scipy.spatial.transform import Rotation

import motions

KINDS = {"f4": gl.FLOAT, "u1": gl.UNSIGNED_BYTE, "u2": gl.UNSIGNED_SHORT, "u4": gl.UNSIGNED_INT, "i2": gl.SHORT}
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


@dataclass
class Glb:
    """A file in the making: put arrays, then nodes, then write."""

    top: gl.GLTF2 = field(default_factory=lambda: gl.GLTF2(scenes=[gl.Scene(nodes=[0])], scene=0))
    blob: bytes = b""

    def view(self, data: bytes, stride: int | None = None) -> int:
        self.blob += b"\0" * (-len(self.blob) % 4)
        self.top.bufferViews.append(
            gl.BufferView(buffer=0, byteOffset=len(self.blob), byteLength=len(data), byteStride=stride)
        )
        self.blob += data
        return len(self.top.bufferViews) - 1

    def accessor(self, view: int | None, kind: str, count: int, width: int, **more: Any) -> int:
        self.top.accessors.append(
            gl.Accessor(bufferView=view, componentType=KINDS[kind], count=count, type=SHAPES[width], **more)
        )
        return len(self.top.accessors) - 1

    def put(self, array: np.ndarray, kind: str = "f4", *, normalized: bool = False) -> int:
        rows = np.asarray(array).reshape(len(array), -1)
        top = {"u1": 255, "u2": 65535, "i2": 32767}.get(kind, 1) if normalized else 1
        data = (np.rint(rows * top) if normalized else rows).astype("<" + kind)
        return self.accessor(self.view(data.tobytes()), kind, len(rows), rows.shape[1], normalized=normalized)

    def put_interleaved(self, arrays: Mapping[str, np.ndarray]) -> dict[str, int]:
        """Attributes of single precision, all of a vertex side by side."""
        rows = np.concatenate([np.asarray(a, "<f4") for a in arrays.values()], axis=1)
        view, place, found = self.view(rows.tobytes(), stride=4 * rows.shape[1]), 0, {}
        for name, array in arrays.items():
            found[name] = self.accessor(view, "f4", len(rows), array.shape[1], byteOffset=place)
            place += 4 * array.shape[1]
        return found

    def put_sparse(self, array: np.ndarray, base: np.ndarray | None) -> int:
        """Elements that differ from a base, of zeros where there is none."""
        array = np.asarray(array, "<f4")
        start = np.zeros_like(array) if base is None else np.asarray(base, "<f4")
        at = np.flatnonzero((array != start).any(axis=1))
        sparse = gl.Sparse(
            count=len(at),
            indices=gl.AccessorSparseIndices(
                bufferView=self.view(at.astype("<u2").tobytes()), componentType=KINDS["u2"]
            ),
            values=gl.AccessorSparseValues(bufferView=self.view(array[at].tobytes())),
        )
        view = None if base is None else self.view(start.tobytes())
        return self.accessor(view, "f4", len(array), array.shape[1], sparse=sparse)

    def animate(self, name: str, channels: Sequence[tuple[int, str, np.ndarray, np.ndarray, str]]) -> None:
        """An animation of channels: node, path, times, values and interpolation."""
        animation = gl.Animation(name=name)
        for node, path, times, values, way in channels:
            animation.samplers.append(
                gl.AnimationSampler(input=self.put(times), output=self.put(values), interpolation=way)
            )
            target = gl.AnimationChannelTarget(node=node, path=path)
            animation.channels.append(gl.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))
        self.top.animations.append(animation)

    def write(self, path: Path) -> Path:
        """As .glb (or .vrm), or as .gltf with its bytes in itself, or beside it where the stem ends with "apart"."""
        self.top.buffers = [gl.Buffer(byteLength=len(self.blob))]
        if path.suffix != ".gltf":
            self.top.set_binary_blob(self.blob)
            self.top.save_binary(str(path))
            return path
        if path.stem.endswith("apart"):
            (path.parent / "hero bytes.bin").write_bytes(self.blob)
            self.top.buffers[0].uri = "hero%20bytes.bin"
        else:
            self.top.buffers[0].uri = "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
        path.write_text(self.top.to_json())
        return path


@dataclass
class Body:
    """A mesh of tubes around bones that stand in a T-pose, feet at the origin, facing +Z, Y up [m]."""

    names: list[str]
    parents: list[int]
    places: np.ndarray
    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    joints: np.ndarray
    weights: np.ndarray


def body(*, fingers: bool = False) -> Body:
    """The shipped clips' body, with a mesh, Mixamo's names, and three joints to each finger where asked."""
    clip = motions.load("walk")
    names, parents = [f"mixamorig:{name}" for name in clip.joints], clip.parents.tolist()
    offsets = clip.offsets[:, [1, 2, 0]].tolist()  # X to the body's left, Y up, Z ahead
    for side, sign in (("Left", 1.0), ("Right", -1.0)) if fingers else ():
        for number, finger in enumerate(("Thumb", "Index", "Middle", "Ring", "Pinky")):
            above = names.index(f"mixamorig:{side}Hand")
            for joint in range(1, 4):
                names.append(f"mixamorig:{side}Hand{finger}{joint}")
                parents.append(above)
                offsets.append([sign * (0.09 if joint == 1 else 0.03), 0.0, 0.02 * (2 - number) if joint == 1 else 0.0])
                above = len(names) - 1
    places = np.zeros((len(names), 3))
    for joint, parent in enumerate(parents):
        places[joint] = np.array(offsets[joint]) + (places[parent] if parent >= 0 else 0.0)
    places[:, 1] -= places[:, 1].min() - 0.03
    ends = {"Head": (0.0, 0.17, 0.0), "LeftHand": (0.15, 0.0, 0.0), "RightHand": (-0.15, 0.0, 0.0)}
    ends |= {"LeftToeBase": (0.0, 0.0, 0.09), "RightToeBase": (0.0, 0.0, 0.09)}
    links = [(parent, places[parent], places[joint]) for joint, parent in enumerate(parents) if parent >= 0]
    links += [(k, places[k], places[k] + ends[short]) for k, n in enumerate(names) if (short := n[10:]) in ends]
    pieces = [_tube(joint, parents[joint], start, end, names[joint]) for joint, start, end in links]
    firsts = np.cumsum([0, *(len(piece[0]) for piece in pieces)])
    vertices, normals, joints, weights = (np.concatenate(each) for each in list(zip(*pieces, strict=True))[:4])
    triangles = np.concatenate([piece[4] + first for piece, first in zip(pieces, firsts, strict=False)])
    return Body(names, parents, places, vertices, normals, triangles, joints, weights)


RINGS, AROUND = 7, 12


def _tube(
    joint: int, parent: int, start: np.ndarray, end: np.ndarray, name: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A closed tube along a bone, whose first third goes along with the bone above as well."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    across = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    other = np.cross(along, across)
    trunk = any(word in name for word in ("Spine", "Hips"))
    radius = 0.1 if trunk else 0.09 if name.endswith("Head") else 0.008 if "Hand" in name[-8:-1] else 0.05
    angles = 2.0 * np.pi * np.arange(AROUND) / AROUND
    circle = np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * other
    share = np.linspace(0.0, 1.0, RINGS)
    round_ = np.sqrt(np.clip(1.0 - (2.0 * share - 1.0) ** 6, 0.02, 1.0))
    vertices = (start + share[:, None] * (end - start))[:, None] + radius * round_[:, None, None] * circle
    normals = np.broadcast_to(circle, vertices.shape)
    above = np.repeat(np.clip(0.5 - 1.5 * share, 0.0, 0.5), AROUND) * (parent >= 0)
    joints = np.zeros((RINGS * AROUND, 4), int)
    joints[:, 0], joints[:, 1] = joint, max(parent, 0)
    weights = np.stack([1.0 - above, above, 0.0 * above, 0.0 * above], axis=1)
    k, ahead = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
    rings = [
        np.concatenate([np.stack([k, ahead, k + AROUND], 1), np.stack([ahead, ahead + AROUND, k + AROUND], 1)])
        + AROUND * ring
        for ring in range(RINGS - 1)
    ]
    caps = [
        np.stack([0 * k[1:-1], k[2:], k[1:-1]], 1),
        np.stack([0 * k[1:-1], k[1:-1], k[2:]], 1) + (RINGS - 1) * AROUND,
    ]
    return vertices.reshape(-1, 3), normals.reshape(-1, 3), joints, weights, np.concatenate([*rings, *caps])


def walking(who: Body, frames: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The shipped walk for a body of `body`: times [s] (F,), the hips' places (F, 3), local turns xyzw (F, J, 4)."""
    clip = motions.load("walk")
    clip = clip if not frames else clip.trim(0.0, (frames - 1) / clip.fps)
    turns = np.zeros((clip.frames, len(who.names), 4))
    turns[..., 3] = 1.0
    turns[:, : len(clip.joints)] = clip.rotations_wxyz[..., [2, 3, 1, 0]]
    return clip.times, clip.root_positions[:, [1, 2, 0]], turns


def character(
    path: Path,
    who: Body | None = None,
    *,
    frames: int = 2,
    root: Mapping[str, Any] | None = None,
    unit: float = 1.0,
    weights: str = "f4",
    interleaved: bool = False,
    clips: Sequence[str] = ("Walk",),
    names: Mapping[str, str] | None = None,
    material: gl.Material | None = None,
    axes: np.ndarray | None = None,
    extensions: Mapping[str, Any] | None = None,
) -> Path:
    """A character that walks, below a node "Armature" with a transform of its own.

    Args:
        path: the file.
        who: the body.
        frames: of the walk, 0 for all of them.
        root: the Armature's translation, rotation or scale.
        unit: metres in the unit of bones and mesh, which the Armature's scale should make good.
        weights: how skin weights are kept: "f4", "u1" or "u2".
        interleaved: whether a vertex' position, normal and weights lie side by side.
        clips: names of animations; each is a little slower than the one before.
        names: other names of joints, by these.
        material: of the mesh.
        axes: how each joint's frame is turned in the T-pose, xyzw, shape (J, 4); it then has no animation.
        extensions: of the file.
    """
    who = who or body()
    file = Glb()
    file.top.extensions = dict(extensions or {})
    local = who.places - np.array([who.places[p] if p >= 0 else np.zeros(3) for p in who.parents])
    nodes = [gl.Node(name="Armature", children=[1, 1 + len(who.names)], **(root or {}))]
    for joint, name in enumerate(who.names):
        children = [1 + k for k, parent in enumerate(who.parents) if parent == joint]
        nodes.append(
            gl.Node(name=(names or {}).get(name, name), children=children, translation=(local[joint] / unit).tolist())
        )
    nodes.append(gl.Node(name="Body", mesh=0, skin=0))
    file.top.nodes = nodes
    inverse = np.tile(np.eye(4), (len(who.names), 1, 1))
    inverse[:, :3, 3] = -who.places / unit
    if axes is not None:
        clips = ()
        frames_of = Rotation.from_quat(axes)
        for joint, parent in enumerate(who.parents):
            above = frames_of[parent].inv() if parent >= 0 else Rotation.identity()
            nodes[1 + joint].rotation = (above * frames_of[joint]).as_quat().tolist()
            nodes[1 + joint].translation = above.apply(local[joint] / unit).tolist()
        inverse = np.stack([np.eye(4)] * len(who.names))
        inverse[:, :3, :3] = frames_of.inv().as_matrix()
        inverse[:, :3, 3] = -frames_of.inv().apply(who.places / unit)
    matrices = file.put(inverse.transpose(0, 2, 1))
    file.top.skins = [gl.Skin(joints=list(range(1, len(who.names) + 1)), inverseBindMatrices=matrices)]
    plain = {"POSITION": who.vertices / unit, "NORMAL": who.normals}
    if interleaved:
        found = file.put_interleaved({**plain, "WEIGHTS_0": who.weights})
    else:
        found = {name: file.put(values) for name, values in plain.items()}
        found["WEIGHTS_0"] = file.put(who.weights, weights, normalized=weights != "f4")
    found["JOINTS_0"] = file.put(who.joints, "u1")
    indices = file.put(who.triangles.reshape(-1, 1), "u4")
    primitive = gl.Primitive(attributes=gl.Attributes(**found), indices=indices, material=None)
    if material is not None:
        file.top.materials, primitive.material = [material], 0
    file.top.meshes = [gl.Mesh(name="Body", primitives=[primitive])]
    times, places, turns = walking(who, frames)
    for number, name in enumerate(clips):
        slower = times * (1.0 + 0.25 * number)
        channels = [(1, "translation", slower, places / unit, "LINEAR")]
        channels += [(1 + k, "rotation", slower, turns[:, k], "LINEAR") for k in range(len(who.names))]
        file.animate(name, channels)
    return file.write(path)


def skinned(who: Body, places: np.ndarray, turns: np.ndarray, root: np.ndarray | None = None) -> np.ndarray:
    """Where a walking body's vertices are, Y up [m], shape (F, V, 3), vertex by vertex from 4 x 4 matrices.

    Args:
        who: the body.
        places: of the hips, in the Armature (F, 3).
        turns: local ones, xyzw, shape (F, J, 4).
        root: the Armature's matrix but for its scale, shape (4, 4).
    """
    rest = who.places - np.array([who.places[p] if p >= 0 else np.zeros(3) for p in who.parents])
    found = np.zeros((len(places), len(who.vertices), 3))
    for frame in range(len(places)):
        world: list[np.ndarray] = []
        for joint, parent in enumerate(who.parents):
            x, y, z, w = turns[frame, joint] / np.linalg.norm(turns[frame, joint])
            own = np.eye(4)
            own[:3, :3] = [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
            own[:3, 3] = places[frame] if parent < 0 else rest[joint]
            world.append((np.eye(4) if root is None else root) @ own if parent < 0 else world[parent] @ own)
        for k in range(4):
            for joint in range(len(who.names)):
                back = np.eye(4)
                back[:3, 3] = -who.places[joint]
                matrix = world[joint] @ back
                counted = who.weights[:, k] * (who.joints[:, k] == joint)
                found[frame] += counted[:, None] * (who.vertices @ matrix[:3, :3].T + matrix[:3, 3])
    return found
