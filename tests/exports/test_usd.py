"""USD, read back by Pixar's own library."""

# Its modules are compiled, and tell pyright little.
# pyright: reportAttributeAccessIssue=false, reportMissingModuleSource=false

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdShade, UsdSkel

from cape.results.take import Take
from motions import quaternions
from skeleton.shapes import Capsule
from tests.exports.a_take import FPS, FRAMES, make_take

CLOSE = 1e-5  # m


@pytest.fixture(scope="module")
def take() -> Take:
    return make_take()


@pytest.fixture(scope="module")
def stage(take: Take, tmp_path_factory: pytest.TempPathFactory) -> Usd.Stage:
    path = tmp_path_factory.mktemp("usd") / "walk.usd"
    assert [f.name for f in take.export(path)] == ["walk.usd", "walk_albedo.png"]
    return Usd.Stage.Open(str(path))


def same(a: object, b: object) -> None:
    np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=0.0, atol=CLOSE)


def test_axes_unit_and_rate_are_stated(stage: Usd.Stage):
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == pytest.approx(FPS)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, FRAMES - 1.0)
    assert stage.GetDefaultPrim().GetPath() == "/take"


def test_the_cloth_of_each_frame(take: Take, stage: Usd.Stage):
    cloth = UsdGeom.Mesh(stage.GetPrimAtPath("/take/cape"))
    assert np.array_equal(np.reshape(cloth.GetFaceVertexIndicesAttr().Get(), (-1, 3)), take.triangles)
    assert cloth.GetPointsAttr().GetTimeSamples() == list(range(FRAMES))
    for frame in range(FRAMES):
        same(cloth.GetPointsAttr().Get(frame), take.positions[frame])
        same(cloth.GetExtentAttr().Get(frame), [take.positions[frame].min(axis=0), take.positions[frame].max(axis=0)])
    same(UsdGeom.PrimvarsAPI(cloth).GetPrimvar("st").Get(), take.texcoords * [1, -1] + [0, 1])


def test_the_cloth_has_its_texture(stage: Usd.Stage):
    material, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/take/cape")).ComputeBoundMaterial()
    surface, _, _ = material.ComputeSurfaceSource()
    texture = UsdShade.Shader(surface.GetInput("diffuseColor").GetConnectedSource()[0].GetPrim())
    assert Path(texture.GetInput("file").Get().resolvedPath).name == "walk_albedo.png"
    assert 0.0 < surface.GetInput("roughness").Get() <= 1.0


def test_joints_are_where_the_bones_are(take: Take, stage: Usd.Stage):
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/take/figure/skeleton"))
    joints = list(skeleton.GetJointsAttr().Get())
    assert joints == ["hip", "hip/left_arm", "hip/left_arm/left_hand"]
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root(stage.GetPrimAtPath("/take/figure")), Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(skeleton)
    order = [0, 2, 1]
    for frame in range(FRAMES):
        world = np.array(query.ComputeJointSkelTransforms(frame))
        same(world[:, 3, :3], take.bones.positions[frame, order])
        # A row vector times the matrix is the matrix's transpose times a column.
        same(world[:, :3, :3].swapaxes(1, 2), quaternions.to_matrix(take.bones.rotations_wxyz[frame, order]))
    same(skeleton.GetBindTransformsAttr().Get(), query.ComputeJointSkelTransforms(0))


def test_hitboxes_move_with_their_bones(take: Take, stage: Usd.Stage):
    names = [prim.GetName() for prim in stage.GetPrimAtPath("/take/hitboxes").GetChildren()]
    assert names == ["arm", "arm_", "bench", "club", "drum", "egg"]
    arm = take.colliders[0]
    assert isinstance(arm, Capsule)
    solid = UsdGeom.Capsule(stage.GetPrimAtPath("/take/hitboxes/arm"))
    assert solid.GetPurposeAttr().Get() == "guide"
    half = 0.5 * solid.GetHeightAttr().Get()
    assert solid.GetRadiusAttr().Get() == pytest.approx(arm.radius)
    bone = take.bones.index("left arm")
    for frame in range(FRAMES):
        to_world = UsdGeom.Xformable(solid).ComputeLocalToWorldTransform(frame)
        turn, place = take.bones.rotations_wxyz[frame, bone], take.bones.positions[frame, bone]
        for end, local in ((arm.start, -half), (arm.end, half)):
            same(to_world.Transform(Gf.Vec3d(0, 0, local)), place + quaternions.rotate(turn, end))


def test_solids_of_other_shapes(take: Take, stage: Usd.Stage):
    bench = UsdGeom.Xformable(stage.GetPrimAtPath("/take/hitboxes/bench"))
    assert UsdGeom.Cube(bench).GetSizeAttr().Get() == 2.0
    same(bench.ComputeLocalToWorldTransform(0).Transform(Gf.Vec3d(1, 1, 1)), [1.5, 0.2, 0.1])
    egg = UsdGeom.Xformable(stage.GetPrimAtPath("/take/hitboxes/egg"))
    turn, place = take.bones.rotations_wxyz[5, 0], take.bones.positions[5, 0]
    expected = place + quaternions.rotate(turn, [0.0, 0.0, 1.3])
    same(egg.ComputeLocalToWorldTransform(5).Transform(Gf.Vec3d(0, 0, 1)), expected)


def test_text_and_crate_tell_the_same(take: Take, tmp_path: Path):
    for suffix in ("usda", "usdc"):
        take.export(tmp_path / f"walk.{suffix}")
        read = Usd.Stage.Open(str(tmp_path / f"walk.{suffix}"))  # prims go with their stage
        points = UsdGeom.Mesh(read.GetPrimAtPath("/take/cape"))
        same(points.GetPointsAttr().Get(2), take.positions[2])
    assert (tmp_path / "walk.usda").read_bytes().startswith(b"#usda 1.0")
    assert (tmp_path / "walk.usdc").read_bytes().startswith(b"PXR-USDC")


@pytest.mark.extra
def test_pixars_validators_find_nothing(stage: Usd.Stage):
    from pxr import UsdValidation

    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadAllValidators()
    assert len(validators) > 20
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in found] == []
