"""The surfaces of a robot's links: the meshes and primitives that its URDF names."""

# Pinocchio and coal lie in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from motions.conventions import to_z_up
from motions.errors import FileError, ValueRangeError
from skeleton.model import Skeleton
from skeleton.robot.meshes.missing_meshes import Kind, mended
from skeleton.shapes import Box, Capsule, Sphere

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]


_ASSET = 20_000  # characters of a Collada file's beginning, of which its head takes some hundreds


@checked
@dataclass(frozen=True, eq=False)
class LinkSurface:
    """A piece of a link: a triangle mesh that a bone carries.

    Attributes:
        name: unique name, the link's followed by a number.
        link: name of the link.
        bone: name of the bone that carries it, None for one that stands still in the world.
        vertices: in the bone's frame, in the world's without a bone [m], read-only, shape (V, 3).
        triangles: indices of the vertices, counterclockwise seen from outside, read-only, shape (T, 3).
        rgba: colour, each from 0 to 1, shape (4,); None where the file names none.
        primitive: the same as a solid, where the file has a sphere, a capsule or a box.
    """

    name: str
    link: str
    bone: str | None
    vertices: FloatArray
    triangles: NDArray[np.uint32]
    rgba: FloatArray | None = None
    primitive: Sphere | Capsule | Box | None = None


@checked
def link_surfaces(body: Skeleton, kind: Kind, *, bones: Collection[str] | None = None) -> tuple[LinkSurface, ...]:
    """The pieces of a robot's links, as seen or as meant for collisions; files are read once for each body.

    Args:
        body: the robot.
        kind: which of the two.
        bones: names of the bones whose links are wanted, all by default.

    Collada files say which of their axes points up, and Y does in those of glTF. Some robots' files count on meshes
    being turned by it (as Gazebo does), others on its being ignored (as RViz does): the meshes are turned if that
    brings them nearer to the joints at the far ends of their links. Collada's unit of length counts. Pinocchio ignores
    both, so these surfaces may differ from `geometry_model`. A mesh that is mirrored is turned outside out. One whose
    triangles leave out vertices is garbled, and its convex hull stands for it. For one that is missing the link's shape
    of the other kind does, or nothing (`missing_meshes`).

    Raises:
        ValueRangeError: the body is no robot, so it has no links.
        FileError: a mesh can't be read, or most are missing; names the folders that were looked in.
    """
    pieces = _PIECES.setdefault(body, {}).get(kind)
    if pieces is None:
        pieces = _PIECES[body][kind] = _Pieces(body, kind)
    return pieces.surfaces(body, bones)


class _Pieces:
    """Geometry of a robot as its files have it, and the surfaces that were made of it so far."""

    def __init__(self, body: Skeleton, kind: Kind):
        import coal

        # The boxes around a mesh's triangles are for collisions and take most of the time: here the plainest will do.
        solids = _geometry(body, kind, mesh_loader=coal.MeshLoader(coal.NODE_TYPE.BV_OBB)).geometryObjects
        self._solids = [(solid, collada_up(solid.meshPath)) for solid in solids]
        self._plain: list[LinkSurface | None] = [None] * len(self._solids)
        self._chosen: tuple[LinkSurface, ...] = ()

    def surfaces(self, body: Skeleton, bones: Collection[str] | None) -> tuple[LinkSurface, ...]:
        """Those of some bones, all by default."""
        if all(up == "z" for _, up in self._solids):
            wanted = [k for k, (solid, _) in enumerate(self._solids) if bones is None or _bone(body, solid) in bones]
            return tuple(self._surface(body, k) for k in wanted)
        if not self._chosen:
            plain = tuple(self._surface(body, k) for k in range(len(self._solids)))
            turned = tuple(
                surface if up == "z" else _with_vertices(surface, _turned(surface.vertices, solid.placement, up))
                for surface, (solid, up) in zip(plain, self._solids, strict=True)
            )
            self._chosen = min((plain, turned), key=lambda surfaces: _gaps(body, surfaces))
        return tuple(surface for surface in self._chosen if bones is None or surface.bone in bones)

    def _surface(self, body: Skeleton, number: int) -> LinkSurface:
        found = self._plain[number]
        if found is None:
            found = self._plain[number] = _surface(body, self._solids[number][0])
        return found


_PIECES: WeakKeyDictionary[Skeleton, dict[Kind, _Pieces]] = WeakKeyDictionary()
"""What was read of each body, for as long as there is that body."""


def geometry_model(body: Skeleton, kind: Kind) -> "pinocchio.GeometryModel":
    """Pinocchio's own geometry of a robot, whose placements are in the frames of its joints.

    Raises:
        ValueRangeError: the body is no robot.
        FileError: a mesh is missing or can't be read; names the folders that were looked in.
    """
    return _geometry(body, kind)


def _geometry(body: Skeleton, kind: Kind, **options: Any) -> "pinocchio.GeometryModel":
    import pinocchio as pin

    if body.source is None:
        raise ValueRangeError("only a robot has links with surfaces; the body of a clip has none")
    which = pin.GeometryType.VISUAL if kind == "visual" else pin.GeometryType.COLLISION
    folders = list(body.source.package_folders)
    with_stand_ins = mended(body.source.urdf, folders, kind)
    try:
        if with_stand_ins.text is not None:
            return pin.buildGeomFromUrdfString(body.model, with_stand_ins.text, which, package_dirs=folders, **options)
        return pin.buildGeomFromUrdf(body.model, str(body.source.urdf), which, package_dirs=folders, **options)
    except (ValueError, RuntimeError) as error:
        problem = " ".join(str(error).split())
        raise FileError(
            f"the {kind} meshes of {body.source.urdf} can't be read: {problem}; packages were looked for in "
            + ", ".join(folders)
        ) from None


@checked
def missing_meshes(body: Skeleton, kind: Kind) -> tuple[str, ...]:
    """A sentence on each mesh of a robot that is missing, and what `link_surfaces` shows in its place.

    Raises:
        FileError: the robot's file can't be read.
    """
    return () if body.source is None else mended(body.source.urdf, body.source.package_folders, kind).missing


def collada_up(path: str | Path) -> str:
    """The axis of a mesh file that points up, "x", "y" or "z": z but for glTF, and Collada files that name another."""
    if Path(path).suffix.lower() in (".glb", ".gltf"):
        return "y"
    if Path(path).suffix.lower() != ".dae":
        return "z"
    found = re.search(r"<up_axis>\s*([XYZ])_UP", _beginning(path))
    return found.group(1).lower() if found else "z"


def collada_unit(path: str | Path) -> float:
    """Metres per unit of length of a mesh file: 1 for all but Collada files that tell another."""
    if Path(path).suffix.lower() != ".dae":
        return 1.0
    found = re.search(r"<unit\b[^>]*\bmeter\s*=\s*[\"']([0-9.eE+-]+)[\"']", _beginning(path))
    try:
        unit = float(found.group(1)) if found else 1.0
    except ValueError:
        return 1.0
    return unit if 0.0 < unit < np.inf else 1.0


def _beginning(path: str | Path) -> str:
    """Of a mesh file, where a Collada file tells of its axes and its unit."""
    with Path(path).open(encoding="utf-8", errors="replace") as file:
        return file.read(_ASSET)


def _turned(vertices: FloatArray, placement: Any, up: str) -> FloatArray:
    """Vertices of a mesh in its bone's frame, turned in the mesh's own frame so that an axis of it becomes z."""
    own = (vertices - placement.translation) @ placement.rotation
    return own @ to_z_up(up).T @ placement.rotation.T + placement.translation


def _gaps(body: Skeleton, surfaces: Sequence[LinkSurface]) -> float:
    """Sum of the distances of joints from the nearest vertex of the bones that carry them [m]."""
    gaps = 0.0
    for joint, parent in enumerate(body.model.parents.tolist()[1:], start=1):
        own = [s.vertices for s in surfaces if parent > 0 and s.bone == body.model.names[parent] and len(s.vertices)]
        if own:
            place = body.model.jointPlacements[joint].translation
            gaps += float(np.linalg.norm(np.concatenate(own) - place, axis=1).min())
    return gaps


def _bone(body: Skeleton, solid: Any) -> str | None:
    """Name of the joint that carries a piece, also where its link is fixed to it."""
    return body.model.names[solid.parentJoint] if solid.parentJoint > 0 else None


def _surface(body: Skeleton, solid: Any) -> LinkSurface:
    bone = _bone(body, solid)
    rotation, origin = solid.placement.rotation, solid.placement.translation
    vertices, triangles = _mesh(solid.geometry)
    if np.prod(solid.meshScale) < 0.0:
        triangles = triangles[:, ::-1].copy()  # what is mirrored is inside out
    surface = LinkSurface(
        name=solid.name,
        link=body.model.frames[int(solid.parentFrame)].name,
        bone=bone,
        vertices=vertices,
        triangles=triangles,
        rgba=np.array(solid.meshColor, dtype=float) if solid.overrideMaterial else None,
        primitive=_primitive(solid, bone),
    )
    triangles.flags.writeable = False
    # Coal has scaled a mesh already as the robot's file asks, but not by a unit of the mesh's own.
    return _with_vertices(surface, collada_unit(solid.meshPath) * vertices @ rotation.T + origin)


def _with_vertices(surface: LinkSurface, vertices: FloatArray) -> LinkSurface:
    """The surface with other vertices, which nobody may change from now on."""
    vertices.flags.writeable = False
    return replace(surface, vertices=vertices)


def _primitive(solid: Any, bone: str | None) -> Sphere | Capsule | Box | None:
    """A solid of the file as a collider in the bone's frame."""
    import coal

    shape, placement = solid.geometry, solid.placement
    if isinstance(shape, coal.Sphere):
        return Sphere(name=solid.name, bone=bone, center=placement.translation, radius=shape.radius)
    if isinstance(shape, coal.Capsule):
        half = shape.halfLength * placement.rotation[:, 2]
        return Capsule(solid.name, bone, placement.translation - half, placement.translation + half, shape.radius)
    if isinstance(shape, coal.Box):
        turn = quaternions.from_matrix(placement.rotation)
        center, half_sizes = placement.translation, np.array(shape.halfSide)
        return Box(name=solid.name, bone=bone, center=center, half_sizes=half_sizes, rotation_wxyz=turn)
    return None


def _mesh(shape: Any) -> tuple[FloatArray, NDArray[np.uint32]]:
    """Vertices [m] and triangles of one of coal's solids, in its own frame."""
    import coal
    import trimesh

    if isinstance(shape, coal.BVHModelBase):
        corners = map(itemgetter(0, 1, 2), map(shape.tri_indices, range(shape.num_tris)))
        triangles = np.array(list(corners), dtype=np.int64).reshape(-1, 3)
        if len(np.unique(triangles)) < shape.num_vertices:
            # Coal 3.0 numbers the vertices of a Collada file's nodes so that triangles join wrong ones and leave others
            # out. The places of all vertices are right.
            mesh = trimesh.convex.convex_hull(shape.vertices())
        else:
            mesh = trimesh.Trimesh(shape.vertices(), triangles)
    elif isinstance(shape, coal.Sphere):
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=shape.radius)
    elif isinstance(shape, coal.Capsule):
        mesh = trimesh.creation.capsule(height=2.0 * shape.halfLength, radius=shape.radius)
    elif isinstance(shape, coal.Cylinder):
        mesh = trimesh.creation.cylinder(height=2.0 * shape.halfLength, radius=shape.radius)
    elif isinstance(shape, coal.Box):
        mesh = trimesh.creation.box(extents=2.0 * np.array(shape.halfSide))
    elif isinstance(shape, coal.Convex):
        corners = (shape.polygons(i) for i in range(shape.num_polygons))
        mesh = trimesh.Trimesh(shape.points(), [(t[0], t[1], t[2]) for t in corners])
    else:
        raise FileError(f"a link's geometry is a {type(shape).__name__}, of which no surface is known")
    return np.array(mesh.vertices, dtype=float), np.array(mesh.faces, dtype=np.uint32)
