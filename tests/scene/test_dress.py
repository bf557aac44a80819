"""A character's own cape, and the floor under its motion."""

from dataclasses import replace

import numpy as np
import pytest

import cape
import motions
from cape.assembly import putting_on
from cape.scene.floor import floor_under
from cape.scene.poses import poses_of, read_pose
from motions import quaternions
from motions.errors import UnknownNameError
from skeleton import BoneTrack, Capsule, Skeleton
from tests.support.figures import figure


def track_of(heights: np.ndarray) -> BoneTrack:
    """One upright bone at the given heights [m]."""
    positions = np.zeros((len(heights), 1, 3))
    positions[:, 0, 2] = heights
    rotations = np.zeros((len(heights), 1, 4))
    rotations[..., 0] = 1.0
    return BoneTrack(("foot",), np.arange(len(heights)) / 60.0, positions, rotations)


def test_the_floor_lies_under_the_lowest_capsule_but_for_rare_frames():
    heights = np.full(100, 0.5)
    heights[10] = -3.0
    capsule = Capsule("foot", "foot", np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, -0.2]), 0.05)
    # 0.5 m up, 0.2 m down to the lower end, 0.05 m of radius; one frame of a hundred is rarer than 2 %.
    assert floor_under([capsule], track_of(heights)).point == pytest.approx([0.0, 0.0, 0.25], abs=1e-12)


def test_a_floor_without_a_body_is_at_zero():
    assert floor_under([cape.Sphere(radius=1.0)], track_of(np.full(3, 5.0))).point[2] == 0.0


@pytest.fixture(scope="module")
def walker():
    clip = motions.load("walk")
    body = Skeleton.from_clip(clip)
    return body, body.track(clip)


def test_a_cape_comes_with_the_floor_under_the_motion(walker):
    body, track = walker
    (floor,) = (c for c in cape.dress(body, track).colliders if isinstance(c, cape.Plane))
    # The clip's own floor is at 0; at most the whole thickness of a foot's capsule may reach below the soles.
    foot = next(c for c in body.capsules() if c.name == "left_foot")
    assert -2.0 * foot.radius < floor.point[2] < 0.0


def test_a_cape_follows_the_bodys_measures(walker):
    body, track = walker
    clip = motions.load("walk", height=0.5 * body.height())
    small = Skeleton.from_clip(clip)
    big_cloth = cape.dress(body, track, garment="back_cape").cloth
    small_cloth = cape.dress(small, small.track(clip), garment="back_cape").cloth
    assert small_cloth.vertices == big_cloth.vertices
    np.testing.assert_allclose(2.0 * small_cloth.pattern, big_cloth.pattern, rtol=0.01, atol=1e-3)


def test_a_motion_without_shoulders_is_refused_by_name(walker):
    body, track = walker
    without = replace(track, roles={r: b for r, b in track.roles.items() if r != "left_shoulder"})
    with pytest.raises(UnknownNameError, match="left_shoulder"):
        cape.dress(body, without, garment="back_cape")


def test_a_floor_lies_under_solids_of_any_kind():
    track = track_of(np.full(5, 1.0))
    down = np.array([0.0, 0.0, -0.3])
    tapered = cape.TaperedCapsule(name="a", bone="foot", end=down, start_radius=0.2, end_radius=0.1)
    assert floor_under([tapered], track).point[2] == pytest.approx(1.0 - 0.3 - 0.1)
    sphere = cape.Sphere(name="b", bone="foot", center=down / 3, radius=0.2)
    assert floor_under([sphere], track).point[2] == pytest.approx(1.0 - 0.1 - 0.2)
    # A cube that stands on a corner reaches down by half of its diagonal.
    turn = quaternions.from_rotation_vector(np.arccos(1 / np.sqrt(3)) * np.array([1.0, -1.0, 0.0]) / np.sqrt(2))
    cube = cape.Box(name="c", bone="foot", half_sizes=np.full(3, 0.1), rotation_wxyz=turn)
    assert floor_under([cube, tapered, sphere], track).point[2] == pytest.approx(1.0 - 0.3 - 0.1)
    assert floor_under([cube], track).point[2] == pytest.approx(1.0 - 0.1 * np.sqrt(3))


@pytest.mark.parametrize(("radius", "lifted"), [(0.27, True), (0.38, False)])
def test_a_neckline_clears_a_trunk_upwards_or_else_backwards(walker, radius, lifted):
    body, track = walker
    ball = cape.Sphere(name="trunk", bone=body.role("chest"), radius=radius)
    scene = replace(cape.dress(body, track, garment="back_cape", colliders=[ball]), attachments=[])
    pose = read_pose(poses_of(track.first(1), scene.bones)[0], scene.bones)
    assert scene.cloth.neckline is not None
    count = len(scene.cloth.neckline)
    worn, start = putting_on.places_lifted(scene, pose, scene.cloth.positions), putting_on.placed(scene, pose)
    ahead, _, up = putting_on._wearer(scene, pose)[0].T
    shift = (worn - putting_on.places_worn(scene, pose, start))[:count]
    assert np.ptp(shift, axis=0).max() < 1e-12
    chest = scene.bones.index(ball.bone)
    assert np.linalg.norm(worn[:count] - pose.positions[chest], axis=1).min() >= radius + scene.thickness
    assert (abs(shift[0] @ ahead) < 1e-12) == lifted
    assert shift[0] @ up >= 0.0 >= shift[0] @ ahead - 1e-12


def test_a_bone_holds_the_parts_of_a_garment_that_it_is_asked_to():
    clip = motions.load("walk").trim(0.0, 0.1)
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    scene = cape.dress(body, track, hold={"collar": "neck", "left": "left_hand"})
    collar, left = scene.attachments
    np.testing.assert_array_equal(collar.vertices, scene.cloth.regions["collar"])
    # The left edge begins in the collar, which stays with the neck.
    np.testing.assert_array_equal(left.vertices, np.setdiff1d(scene.cloth.regions["left"], collar.vertices))
    assert len(left.vertices) < len(scene.cloth.regions["left"])
    assert (collar.bone, left.bone) == ("neck", "left_hand")
    assert {a.bone for a in cape.dress(body, track).attachments} == {"chest"}
    with pytest.raises(UnknownNameError, match="collar"):
        cape.dress(body, track, hold={"tail": "chest"})
    with pytest.raises(UnknownNameError, match="LeftHand"):
        cape.dress(body, track, hold={"collar": "wing"})


def cut_for(clip: motions.Clip, garment: str) -> np.ndarray:
    """The pattern of a garment for the body that moves in a clip [m], and where it is put on, shape (V, 5)."""
    body = Skeleton.from_clip(clip)
    cloth = cape.dress(body, body.track(clip), garment=garment, spacing=0.08).cloth
    return np.hstack([cloth.pattern, cloth.positions])


@pytest.mark.parametrize("garment", cape.GARMENTS)
def test_a_garment_is_cut_the_same_whichever_part_of_a_motion_is_shown(garment: str):
    """A spin begins with arms that hang, and goes on with arms stretched out."""
    spin = motions.load("spin")
    parts = [spin.trim(0.0, 0.3), spin.trim(1.0).resample(25.0)]
    whole = cut_for(spin, garment)
    assert all(np.array_equal(cut_for(part, garment), whole) for part in parts)


def test_so_is_a_cape_on_all_fours():
    """It crouches lower and lower, and so gets nearer to the floor."""
    clip = crawling(frames=30)
    clip = replace(clip, root_positions=clip.root_positions - np.linspace(0.0, 0.3, 30)[:, None] * [0.0, 0.0, 1.0])
    first, last = clip.trim(0.0, 0.2), clip.trim(0.3)
    whole = cut_for(clip, "back_cape")
    assert all(np.array_equal(cut_for(part, "back_cape"), whole) for part in (first, last))
    alone = [cut_for(replace(part, whole=None), "back_cape") for part in (first, last)]
    assert not any(np.array_equal(cut, whole) for cut in alone)
    # One that stands up in another part of the motion has all of its cape.
    upright = figure(frames=30)
    stands = replace(clip, rotations_wxyz=np.concatenate([clip.rotations_wxyz[:20], upright.rotations_wxyz[20:]]))
    assert np.array_equal(cut_for(stands.trim(0.0, 0.2), "back_cape"), cut_for(stands, "back_cape"))


def crawling(frames: int = 2) -> motions.Clip:
    """A person whose trunk is level, with arms and thighs straight down."""
    upright = figure(frames=frames)
    rotations, down = upright.rotations_wxyz.copy(), np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])
    rotations[:, 0] = down * [1, -1, 1, 1]
    for joint in ("LeftArm", "RightArm", "LeftUpLeg", "RightUpLeg"):
        rotations[:, upright.joints.index(joint)] = down
    return replace(upright, rotations_wxyz=rotations)


def on_all_fours(frames: int = 2) -> tuple[Skeleton, BoneTrack]:
    """One that crawls, with the roles and the measures of one that stands."""
    body = Skeleton.from_clip(figure(frames=frames))
    return body, body.track(crawling(frames))


def test_a_cape_on_all_fours_ends_above_the_floor():
    body, track = on_all_fours()
    scene = cape.dress(body, track, spacing=0.06)
    (floor,) = (c for c in scene.colliders if isinstance(c, cape.Plane))
    take = cape.simulate(scene, track)
    assert take.positions[..., 2].min() > floor.point[2] + 0.02
    # One that stands for a part of the motion has all of its cape, and so has one who asks for a length.
    standing = body.track(figure(frames=2))
    half = replace(
        track,
        positions=np.concatenate([track.positions[:1], standing.positions[1:]]),
        rotations_wxyz=np.concatenate([track.rotations_wxyz[:1], standing.rotations_wxyz[1:]]),
    )
    whole = cape.dress(body, half, spacing=0.06).cloth.vertices
    assert whole > 1.2 * scene.cloth.vertices
    own = 0.62 * body.height()
    assert cape.dress(body, track, spacing=0.06, length=own).cloth.vertices == whole


def test_all_missing_roles_are_named_at_once():
    body = Skeleton.from_clip(figure(frames=2, without=("LeftShoulder", "RightShoulder")))
    with pytest.raises(UnknownNameError) as told:
        cape.dress(body, body.track(figure(frames=2, without=("LeftShoulder", "RightShoulder"))))
    for role in ("left_upper_arm", "right_upper_arm"):
        assert repr(role) in str(told.value)
    assert "roles={" in str(told.value)
    assert "--attach " in told.value.at_command_line
    assert "roles={" not in told.value.at_command_line


def test_a_body_without_legs_wears_a_cape_above_a_floor_as_deep_as_its_legs():
    clip = figure(frames=2, without=("LeftUpLeg", "RightUpLeg"))
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    scene = cape.dress(body, track, spacing=0.06)
    (floor,) = (c for c in scene.colliders if isinstance(c, cape.Plane))
    # Shoulder joints are 0.46 m above the root, which is 1 m high, at 0.818 of the stature.
    assert floor.point[2] == pytest.approx(1.46 - 0.818 * body.height(), abs=1e-9)
    take = cape.simulate(scene, track)
    assert take.result == "finished"
    assert take.positions[..., 2].min() > floor.point[2] + 0.1
