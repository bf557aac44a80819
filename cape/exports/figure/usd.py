"""A character in USD: its bones as a skeleton, and each piece of its mesh bound to it, with its morph targets."""

# Its modules are compiled, and tell pyright little.
# pyright: reportAttributeAccessIssue=false, reportMissingModuleSource=false

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.exports.figure.joints import Joints, joints_of
from cape.exports.figure.looks import colour_of, image_of, normals_of
from cape.exports.usd_parts import identifiers, material, sample
from motions import quaternions
from motions.files import whole_file
from motions.skin import Skin, SkinPiece
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    from pxr import Usd

FloatArray = NDArray[np.float64]

FLAT = 1e-9
"""Least stretch [m for a unit of the mesh] that a binding keeps: what has lost a dimension has no inverse."""


def add_figure(stage: Usd.Stage, path: str, bones: BoneTrack, codes: Sequence[float], file: Path) -> tuple[Path, ...]:
    """Put a skeleton, and the mesh that it moves where there is one, below a path; gives the pictures beside the file.

    Joints are told from their parents. They are bound where the mesh is, others in the first frame, which is their rest
    pose as well.

    Raises:
        FileError: a picture can't be written.
    """
    from pxr import Gf, UsdSkel, Vt

    skin = bones.skin
    UsdSkel.Root.Define(stage, path)
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/skeleton")
    motion = UsdSkel.Animation.Define(stage, f"{path}/skeleton/motion")
    made = joints_of(bones, skin)
    order, joints = _ordered(made)
    translations, rotations = made.positions[:, order].astype(np.float32), made.rotations_wxyz[:, order]
    local = _matrices(translations[0].astype(float), rotations[0])
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateBindTransformsAttr(_gf(_binds(bones, made, skin)[order]))
    skeleton.CreateRestTransformsAttr(_gf(local))
    motion.CreateJointsAttr(joints)
    sample(motion.CreateTranslationsAttr(), map(Vt.Vec3fArray.FromNumpy, translations), codes)
    # Vt has the scalar of a quaternion last.
    turns = np.roll(rotations, -1, axis=2).astype(np.float32)
    sample(motion.CreateRotationsAttr(), map(Vt.QuatfArray.FromNumpy, turns), codes)
    motion.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * len(joints)))
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([motion.GetPath()])
    if skin is None:
        return ()
    if skin.morphs:
        motion.CreateBlendShapesAttr([_morph(k) for k in range(skin.morphs)])
        weights = np.zeros((bones.frames, skin.morphs)) if bones.morphs is None else bones.morphs
        sample(motion.CreateBlendShapeWeightsAttr(), map(Vt.FloatArray.FromNumpy, weights.astype(np.float32)), codes)
    at = np.argsort(order)[made.of_bindings]
    # What the skeleton's prim, and the cloth's picture beside the file, are called.
    taken = ("skeleton", "albedo")
    names = identifiers([*taken, *(piece.name for piece in skin.pieces)])[len(taken) :]
    pictures = []
    for name, piece in zip(names, skin.pieces, strict=True):
        _piece(stage, f"{path}/{name}", piece, at, skeleton)
        pictures += _look(stage, f"{path}/{name}", piece, file.with_name(f"{file.stem}_{name}"))
    return tuple(pictures)


def _ordered(made: Joints) -> tuple[list[int], list[str]]:
    """Joints in an order in which parents come first, and the path of each."""
    names, parents = identifiers(made.names), made.parents

    def lineage(joint: int) -> list[int]:
        line = [joint]
        while parents[line[-1]] >= 0:
            line.append(int(parents[line[-1]]))
        return line[::-1]

    lines = [lineage(joint) for joint in range(len(names))]
    order = sorted(range(len(names)), key=lambda joint: len(lines[joint]))
    return order, ["/".join(names[each] for each in lines[joint]) for joint in order]


def _binds(bones: BoneTrack, made: Joints, skin: Skin | None) -> FloatArray:
    """Where each joint is while the mesh is as it was made, as a matrix of rows, shape (J, 4, 4)."""
    found = np.zeros((len(made.names), 4, 4))
    found[: len(bones.names)] = _matrices(bones.positions[0], bones.rotations_wxyz[0])
    if skin is not None:
        u, stretch, v = np.linalg.svd(skin.binds[..., :3])
        whole = np.tile(np.eye(4), (len(skin.binds), 1, 1))
        whole[:, :3, :3] = u * np.maximum(stretch, FLAT)[:, None] @ v
        whole[:, :3, 3] = skin.binds[..., 3]
        found[made.of_bindings] = np.linalg.inv(whole).swapaxes(1, 2)
    return found


def _piece(stage: Usd.Stage, path: str, piece: SkinPiece, at: NDArray[np.int64], skeleton: Any) -> None:
    """A mesh as it was made, the joints by which it moves, and its morph targets as blend shapes."""
    from pxr import Sdf, UsdGeom, UsdSkel, Vt

    points, count = piece.vertices.astype(np.float32), piece.binds.shape[1]
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(piece.triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(piece.triangles.astype(np.int32).ravel()))
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals_of(piece)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    if piece.texcoords is not None:
        bottom_up = np.stack([piece.texcoords[:, 0], 1.0 - piece.texcoords[:, 1]], axis=1).astype(np.float32)
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex).Set(
            Vt.Vec2fArray.FromNumpy(bottom_up)
        )
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    joints, weights = at[piece.binds].astype(np.int32).ravel(), piece.weights.astype(np.float32).ravel()
    binding.CreateJointIndicesPrimvar(False, count).Set(Vt.IntArray.FromNumpy(joints))
    binding.CreateJointWeightsPrimvar(False, count).Set(Vt.FloatArray.FromNumpy(weights))
    if piece.targets is None or piece.target_morphs is None:
        return
    shapes = []
    for number, moved in enumerate(piece.targets.astype(np.float32)):
        shape = UsdSkel.BlendShape.Define(stage, f"{path}/target_{number}")
        shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(moved))
        if piece.normal_targets is not None:
            shape.CreateNormalOffsetsAttr(Vt.Vec3fArray.FromNumpy(piece.normal_targets[number].astype(np.float32)))
        shapes.append(shape.GetPath())
    binding.CreateBlendShapesAttr([_morph(k) for k in piece.target_morphs.tolist()])
    binding.CreateBlendShapeTargetsRel().SetTargets(shapes)


def _morph(number: int) -> str:
    return f"morph_{number}"


def _look(stage: Usd.Stage, path: str, piece: SkinPiece, file: Path) -> list[Path]:
    """The material of a piece, and its image beside the file, whose name still lacks its suffix."""
    pictures: list[Path] = []
    if (image := image_of(piece)) is not None:
        data, kind = image
        pictures = [file.with_name(f"{file.name}.{kind.replace('jpeg', 'jpg')}")]
        with whole_file(pictures[0]) as partial:
            partial.write_bytes(data)
    picture = pictures[0].name if pictures else None
    material(stage, f"{path}/material", path, picture=picture, colour=colour_of(piece))
    return pictures


def _matrices(positions: FloatArray, rotations_wxyz: FloatArray) -> FloatArray:
    """Poses as matrices that rows of coordinates are multiplied with, shape (B, 4, 4)."""
    matrices = np.zeros((len(positions), 4, 4))
    matrices[:, :3, :3] = quaternions.to_matrix(rotations_wxyz).swapaxes(1, 2)
    matrices[:, 3, :3], matrices[:, 3, 3] = positions, 1.0
    return matrices


def _gf(matrices: FloatArray) -> Any:
    from pxr import Gf, Vt

    return Vt.Matrix4dArray([Gf.Matrix4d(matrix.tolist()) for matrix in matrices])
