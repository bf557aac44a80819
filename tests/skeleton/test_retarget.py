"""Clips on robots: places and directions that scale, feet that stand, joints that keep their limits."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import itertools
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pink
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import motions
from motions import Clip, UnknownNameError, UserError, ValueRangeError, quaternions
from skeleton import Hitboxes, Skeleton, retarget
from skeleton.checks.crossings import crossings
from skeleton.placed_solids import as_capsules
from skeleton.retargeting import foot_contacts
from skeleton.retargeting.arm_avoidance import Apart
from skeleton.retargeting.inverse_kinematics import FASTEST, Followed
from skeleton.retargeting.retarget import _lifted
from skeleton.retargeting.scaled_source import bent_joint
from skeleton.robot.meshes.link_surfaces import link_surfaces
from tests.skeleton.robots import fitted_hitboxes

SIDES = ("left", "right")
NEAR = 0.05
"""Hands and feet have to come this close to the scaled source [m]."""


@cache
def robot(name: str) -> Skeleton:
    return Skeleton.from_urdf(name)


@cache
def hitboxes(name: str) -> Hitboxes:
    return fitted_hitboxes(robot(name))


@cache
def walk() -> Clip:
    return motions.load("walk").resample(30).trim(0.0, 2.5)


@cache
def steps() -> Clip:
    """A few frames of the walk, in which the left foot comes down and the right one leaves the floor."""
    return walk().trim(0.5, 1.0)


@cache
def walked(name: str):
    return retarget(walk(), robot(name))


@cache
def stepped(name: str):
    return retarget(steps(), robot(name))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def wanted(clip: Clip, body: Skeleton, ankle: float) -> dict[str, np.ndarray]:
    """Wrists and ankles of the scaled source [m], worked out anew from its definition."""
    roles = motions.find_roles(clip.joints, clip.parents.tolist())
    positions = clip.world_positions()
    at = {role: positions[:, clip.index(joint)] for role, joint in roles.items()}

    def lengths(*ends: str) -> float:
        """Along a limb of the robot, mean of both sides."""
        return sum(
            float(np.linalg.norm(joints[f"{side}_{a}"] - joints[f"{side}_{b}"]))
            for side in SIDES
            for a, b in itertools.pairwise(ends)
        ) / len(SIDES)

    rest = body.rest
    joints = {role: rest.joint(role) for role in rest.roles}
    joints |= {role: rest.origin(role) for role in rest.roles if role.endswith(("hand", "foot"))}
    source_leg = np.mean(
        [
            np.linalg.norm(at[f"{side}_{a}"][0] - at[f"{side}_{b}"][0]) * 2
            for side in SIDES
            for a, b in (("thigh", "shin"), ("shin", "foot"))
        ]
    )
    scale = lengths("thigh", "shin", "foot") / source_leg
    middle = {limb: (at[f"left_{limb}"] + at[f"right_{limb}"]) / 2 for limb in ("thigh", "upper_arm")}
    floor = np.sort(np.concatenate([at["left_foot"][:, 2], at["right_foot"][:, 2]]))[:20].mean()
    hips = scale * (middle["thigh"] - [0, 0, floor]) + [0, 0, ankle]
    trunk = np.linalg.norm(rest.middle("upper_arm") - rest.middle("thigh"))
    shoulders = hips + trunk * unit(middle["upper_arm"] - middle["thigh"])
    places = {}
    for side, sign in (("left", 1), ("right", -1)):
        width = np.linalg.norm(joints["left_thigh"] - joints["right_thigh"])
        hip = hips + sign * width / 2 * unit(at["left_thigh"] - at["right_thigh"])
        places[f"{side}_foot"] = hip + scale * (at[f"{side}_foot"] - at[f"{side}_thigh"])
        across = unit(at["left_upper_arm"] - at["right_upper_arm"])
        place = shoulders + sign * rest.shoulder_width / 2 * across
        for upper, lower in (("upper_arm", "forearm"), ("forearm", "hand")):
            along = unit(at[f"{side}_{lower}"] - at[f"{side}_{upper}"])
            place = place + lengths(upper, lower) * along
        places[f"{side}_hand"] = place
    return places


@pytest.mark.parametrize("name", ["g1", "talos", "human"])
@pytest.mark.few("g1")
def test_hands_and_feet_come_near_the_scaled_source_on_the_walk(name: str):
    body, result = robot(name), walked(name)
    roles = [f"{side}_{limb}" for side in SIDES for limb in ("hand", "foot")]
    track = body.track(result.motion, roles)
    soles = foot_contacts.soles_of(body, np.array([1.0, 0, 0, 0]))
    for role, places in wanted(walk(), body, soles.ankle_height).items():
        off = np.linalg.norm(track.positions[:, track.index(role)] - places, axis=1)
        assert off.max() < NEAR
        # The two definitions of the floor differ by millimetres, nothing else does.
        assert result.errors[role].max == pytest.approx(off.max(), abs=0.005)


@pytest.mark.parametrize("name", ["g1", "talos", "human"])
def test_joints_keep_their_limits_and_what_is_too_fast_is_told(name: str):
    model, motion = robot(name).model, walked(name).motion
    angles = motion.configurations[:, 7:]
    assert (angles >= model.lowerPositionLimit[7:] - 1e-6).all()
    assert (angles <= model.upperPositionLimit[7:] + 1e-6).all()
    speeds = np.abs(np.diff(angles, axis=0)) * motion.fps
    assert (speeds <= FASTEST * (1 + 1e-9)).all()
    too_fast = (speeds > model.velocityLimit[6:]).any(axis=0) & (model.velocityLimit[6:] > 0.0)
    assert {model.names[int(joint) + 2] for joint in np.flatnonzero(too_fast)} <= set(walked(name).at_top_speed)


def test_no_joint_jumps():
    # A robot with as many joints as a leg needs turns none much faster than the source turns its own.
    rotations = walk().rotations_wxyz
    turns = quaternions.multiply(quaternions.conjugate(rotations[:-1]), rotations[1:])
    source = np.linalg.norm(quaternions.to_rotation_vector(turns), axis=-1).max()
    assert np.abs(np.diff(walked("g1").motion.configurations[:, 7:], axis=0)).max() < 1.25 * source


def test_slower_joints_stay_slower():
    result = retarget(steps(), robot("human"), top_speed=0.3)
    speeds = np.abs(np.diff(result.motion.configurations[:, 7:], axis=0)) * result.motion.fps
    allowed = 0.3 * robot("human").model.velocityLimit[6:]
    assert (speeds <= allowed * (1 + 1e-9)).all()
    held_up = {
        robot("human").model.names[int(joint) + 2] for joint in np.flatnonzero((speeds > 0.9999 * allowed).any(0))
    }
    assert held_up
    assert held_up == set(result.at_top_speed)


@pytest.mark.parametrize("name", ["g1", "talos", "human"])
def test_soles_stand_still_and_level_on_the_floor(name: str):
    body, result = robot(name), walked(name)
    track = body.track(result.motion, ["left_foot", "right_foot"])
    lowest = []
    for side in SIDES:
        foot = track.index(f"{side}_foot")
        surfaces = link_surfaces(body, "visual", bones=[track.names[foot]])
        points = np.concatenate([surface.vertices for surface in surfaces])
        matrices = quaternions.to_matrix(track.rotations_wxyz[:, foot])
        heights = (matrices[:, 2] @ points.T).min(axis=1) + track.positions[:, foot, 2]
        lowest.append(heights.min())
        stands = result.stands[side]
        assert 0.3 < stands.mean() < 0.7
        assert heights[stands].max() < 0.003
        # Level: the sole's normal is where the rest pose has it, upright, within 0.02 rad.
        upright = quaternions.to_matrix(body.rest.rotations_wxyz[body.bone(f"{side}_foot")])[2]
        assert np.linalg.norm(matrices[stands][:, 2] - upright, axis=1).max() < 0.02
        for first, last in foot_contacts.runs(stands):
            spots = track.positions[first : last + 1, foot, :2]
            assert np.linalg.norm(spots - spots[0], axis=1).max() < 0.003
    # The points that are watched miss a vertex between them by 1.1 mm at most.
    assert -0.0012 < min(lowest) < 0.001
    assert result.clearance == pytest.approx(0, abs=1e-12)


CLOSER = 0.25
"""Share of its depth without hitboxes that an arm kept out of things may still be in them."""


@pytest.mark.parametrize("name", ["g1", "human"])
@pytest.mark.few("g1")
def test_arms_stay_out_of_the_rest_and_hands_near_the_source(name: str):
    body, clip = robot(name), motions.load("spin").resample(30).trim(0.0, 3.5)
    depths = []
    for kept in (None, hitboxes(name)):
        result = retarget(clip, body, hitboxes=kept)
        track = body.track(result.motion)
        found = crossings(track, as_capsules(hitboxes(name).solids))
        depths.append(max((f.figure for f in found if any(is_arm(part) for part in f.parts)), default=0.0))
        assert max(result.errors[f"{side}_hand"].max for side in SIDES) < NEAR
    assert depths[0] > 0.04
    assert depths[1] < CLOSER * depths[0]


def is_arm(solid: str) -> bool:
    return any(part in solid for part in ("hand", "forearm", "wrist"))


def test_how_far_arms_are_from_the_rest_changes_by_the_slopes_that_the_solver_gets():
    body = robot("g1")
    model = body.model
    apart = Apart(body, hitboxes("g1").solids, model)
    # Without hitboxes the hands go into the hips in the walk.
    configuration = pink.Configuration(model, model.createData(), walked("g1").motion.configurations[38])

    def gaps(step: np.ndarray) -> np.ndarray:
        moved = pink.Configuration(model, model.createData(), pin.integrate(model, configuration.q, step))
        apart.look_at(moved)
        return apart.compute_qp_inequalities(moved, 1.0)[1]

    apart.look_at(configuration)
    inequalities, rooms = apart.compute_qp_inequalities(configuration, 1.0)
    slopes, (hessian, gradient) = -inequalities, apart.compute_qp_objective(configuration)
    assert len(slopes) > 20
    h = 1e-4
    steps = [h * np.eye(model.nv)[k] for k in range(model.nv)]
    numeric = np.stack([(gaps(step) - gaps(-step)) / (2 * h) for step in steps], axis=1)
    # Solids that overlap may go a little farther in, whatever they do; the others' gaps change with each step. Coal
    # gives distances of polyhedra to 1e-6 m.
    open_gaps = np.abs(numeric).max(axis=1) > 0.0
    assert open_gaps.sum() > 10
    assert np.abs(numeric - slopes)[open_gaps].max() < 2 * 1e-6 / h
    # Without inequalities, the step that costs least takes apart what overlaps.
    overlaps = rooms == rooms.min()
    assert overlaps.sum() == 3
    step = -np.linalg.lstsq(hessian, gradient, rcond=1e-9)[0]
    assert (slopes[overlaps] @ step > 0.0).all()


def test_a_trunk_does_not_lean_after_hands_that_are_out_of_reach():
    # From here Talos's arms don't find their way across its chest, where this clip soon holds its hands.
    clip = motions.load("spin").resample(30).trim(0.0, 2.4)
    result = retarget(clip, robot("talos"))
    assert max(result.errors[f"{side}_hand"].max for side in SIDES) > NEAR
    assert result.errors["pelvis"].max < NEAR
    assert max(result.turns[role].max for role in ("pelvis", "chest")) < 0.1


def test_what_cannot_get_out_of_the_way_is_lifted_off_the_floor():
    # The limits of this robot's ankles don't let it level its soles in most of the walk, and its feet have no meshes.
    result = retarget(steps(), robot("simple_humanoid"))
    assert any("by proportion of the height" in decision for decision in result.motion.decisions)
    assert any(decision.startswith("at a limit: ") and "ANKLE_P" in decision for decision in result.motion.decisions)
    lift = next(decision for decision in result.motion.decisions if decision.startswith("floor: "))
    assert float(lift.split()[-2]) < 3.0


def test_a_motion_is_lifted_along_the_worlds_z_whatever_is_up_in_the_robots_file():
    body = robot("human")
    assert any(decision.startswith("up: y") for decision in body.decisions)
    configurations = np.tile(pin.neutral(body.model), (2, 1))
    lifted = _lifted(body, Followed(configurations, {"left_hand": np.zeros((2, 3))}, {}), 0.1)
    way = body.track(lifted.configurations, fps=1).positions - body.track(configurations, fps=1).positions
    assert np.abs(way - [0, 0, 0.1]).max() < 1e-12
    assert np.array_equal(lifted.positions["left_hand"], [[0, 0, 0.1]] * 2)


def test_trunk_head_and_hands_turn_as_the_sources_do():
    body, clip = robot("human"), motions.load("kick").resample(20).trim(0.5, 1.6)
    result = retarget(clip, body)
    roles = motions.find_roles(clip.joints, clip.parents.tolist())
    track = body.track(result.motion, ["pelvis", "chest", "head"])
    rotations = clip.world_poses()[1]

    def since_first(rotations):
        return quaternions.multiply(rotations, quaternions.conjugate(rotations[:1]))

    for role in ("pelvis", "chest", "head"):
        here = since_first(track.rotations_wxyz[:, track.index(role)])
        there = since_first(rotations[:, clip.index(roles[role])])
        apart = quaternions.multiply(here, quaternions.conjugate(there))
        turned = np.linalg.norm(quaternions.to_rotation_vector(there), axis=1).max()
        off = np.linalg.norm(quaternions.to_rotation_vector(apart), axis=1).max()
        # A trunk that may turn by 2 rad/s lags behind a kick by a tenth of a radian at most.
        assert off < 0.1
        assert turned > (0.0 if role == "head" else 0.3)
        assert result.turns[role].max < 0.1
    hand = clip.end_positions()[:, clip.end_parents.tolist().index(clip.index("LeftHand"))]
    along = unit(hand - clip.world_positions()[:, clip.index("LeftHand")])
    track = body.track(result.motion, ["left_hand"])
    # At rest this robot's arms hang down, its hands along them.
    down = quaternions.rotate(quaternions.conjugate(body.rest.rotations_wxyz[body.bone("left_hand")]), [0, 0, -1.0])
    assert np.linalg.norm(quaternions.rotate(track.rotations_wxyz[:, 0], down) - along, axis=1).max() < 0.1


def test_a_robots_own_motion_comes_back():
    # Hips and shoulders of this robot are each at one place, so the chain of its roles is its own. It runs forwards
    # with its joints swinging about the neutral configuration, so that no foot stands and the mean pose is neutral.
    body, frames, fps = robot("human"), 24, 60.0
    model = body.model
    phases = 2 * np.pi * np.arange(frames) / frames
    motion = np.tile(pin.neutral(model), (frames, 1))
    motion[:, 0] = 3.0 * np.arange(frames) / fps
    swings = {"hip_Z": 0.3, "hip_X": 0.1, "shoulder_Z": 0.3, "shoulder_X": 0.2}
    bends = {"knee_Z": 0.5, "elbow_Z": 0.7}
    for side, sign in (("left", 1), ("right", -1)):
        for joint, angle in swings.items():
            motion[:, model.joints[model.getJointId(f"{side}_{joint}")].idx_q] += sign * angle * np.sin(phases)
        for joint, angle in bends.items():
            motion[:, model.joints[model.getJointId(f"{side}_{joint}")].idx_q] = angle + 0.2 * sign * np.sin(phases)
    track = body.track(motion, fps=fps)
    clip = clip_of(body, track, fps)
    result = retarget(clip, body, roles=body.roles)
    back = body.track(result.motion)
    assert result.scale == pytest.approx(1, abs=1e-9)
    assert not any(stands.any() for stands in result.stands.values())
    # Heights are counted from where the ankles are lowest: what is common to both feet is where the floor is.
    feet = [track.index(f"{side}_foot") for side in SIDES]
    lift = np.median(back.positions[:, feet, 2] - track.positions[:, feet, 2])
    # The posture pulls a joint back by what it moved in a frame, up to 0.05 rad, and by 1/30 of its 0.9 rad from
    # neutral, at 0.2^2 = 0.04 a square radian. Against w^2 a square metre at 0.28 m from the joint that leaves
    # 0.04 (0.05 + 0.03) / 0.28 / w^2: 1.1 cm where w is 1, 0.3 mm where it is 6, less where it is 8. The last step, of
    # less than 1e-3 rad at 0.6 m from the shoulder or the hip, isn't taken any more: 0.6 mm.
    for limb, near in (("hand", 0.0009), ("foot", 0.0009), ("forearm", 0.0117), ("upper_arm", 0.0117)):
        for side in SIDES:
            bone = track.index(f"{side}_{limb}")
            off = back.positions[:, bone] - track.positions[:, bone]
            off[:, 2] -= lift
            assert np.abs(off).max() < near


def clip_of(body: Skeleton, track, fps: float) -> Clip:
    """A clip with a robot's bones as its joints."""
    parents = body.parents
    into = quaternions.conjugate(track.rotations_wxyz[:, parents])
    local = quaternions.rotate(into, track.positions - track.positions[:, parents])
    rotations = quaternions.multiply(into, track.rotations_wxyz)
    root = parents < 0
    local[:, root], rotations[:, root] = track.positions[:, root], track.rotations_wxyz[:, root]
    ends = np.array([body.bone(f"{side}_{limb}") for side in SIDES for limb in ("foot", "hand")])
    ahead = quaternions.rotate(quaternions.conjugate(body.rest.rotations_wxyz[ends[::2]]), body.rest.forward)
    along = quaternions.rotate(quaternions.conjugate(body.rest.rotations_wxyz[ends[1::2]]), -body.rest.up)
    return Clip(
        name="own",
        joints=body.bones,
        parents=parents,
        offsets=np.where(root[:, None], 0.0, local[0]),
        end_parents=ends,
        end_offsets=0.1 * np.stack([ahead, along], axis=1).reshape(-1, 3),
        fps=fps,
        root_positions=track.positions[:, 0],
        rotations_wxyz=rotations,
        local_positions=local,
    )


def test_a_source_twice_as_tall_gives_the_same_motion():
    clip = steps()
    tall = replace(
        clip, offsets=2 * clip.offsets, end_offsets=2 * clip.end_offsets, root_positions=2 * clip.root_positions
    )
    once, twice = stepped("human"), retarget(tall, robot("human"))
    assert twice.scale == pytest.approx(once.scale / 2, rel=1e-12)
    # Doubling is exact in binary numbers; what is left is the solver's own tolerance of 1e-6.
    assert np.abs(twice.motion.configurations - once.motion.configurations).max() < 1e-5


def test_a_source_turned_about_z_turns_the_motion():
    clip, turn = steps(), quaternions.from_rotation_vector([0.0, 0.0, 2.0])
    rotations = np.array(clip.rotations_wxyz)
    rotations[:, 0] = quaternions.multiply(turn, rotations[:, 0])
    turned = replace(clip, root_positions=quaternions.rotate(turn, clip.root_positions), rotations_wxyz=rotations)
    body = robot("human")
    once, again = (body.track(result.motion) for result in (stepped("human"), retarget(turned, body)))
    assert np.abs(quaternions.rotate(turn, once.positions) - again.positions).max() < 1e-5


def test_a_robot_that_faces_backwards_in_its_file_walks_forwards():
    body = robot("icub")
    assert body.rest.forward[0] < -0.9
    track = body.track(retarget(steps(), body).motion)
    ways = track.positions[-1] - track.positions[0]
    source = steps().root_positions[-1] - steps().root_positions[0]
    pelvis = track.index("pelvis")
    assert ways[pelvis] @ source > 0.9 * np.linalg.norm(ways[pelvis]) * np.linalg.norm(source)
    facing = quaternions.rotate(track.rotations_wxyz[:, pelvis], body.rest.forward)
    assert (facing @ unit(source) > 0.9).all()


def test_the_same_call_gives_the_same_bits():
    once, again = stepped("human").motion, retarget(steps(), robot("human")).motion
    assert once is not again
    assert np.array_equal(once.configurations, again.configurations)


def test_a_real_walk_with_a_body_of_its_own(mocap):
    clip = motions.load(mocap / "cmu_12_01_walk.bvh").resample(30).trim(1.0, 2.5)
    errors = retarget(clip, robot("g1")).errors
    assert max(errors[f"{side}_{limb}"].max for side in SIDES for limb in ("hand", "foot")) < NEAR


def test_what_cannot_be_retargeted_says_why(monkeypatch):
    body = robot("human")
    with pytest.raises(ValueRangeError, match="only a robot can be retargeted to"):
        retarget(steps(), Skeleton.from_clip(steps()))
    with pytest.raises(ValueRangeError, match="floating base"):
        retarget(steps(), Skeleton.from_urdf("human", floating_base=False))
    with pytest.raises(ValueRangeError, match="top speed must be more than 0, not -1"):
        retarget(steps(), body, top_speed=-1.0)
    with pytest.raises(UnknownNameError, match="no bone named 'Nose'; available: Hips"):
        retarget(steps(), body, roles={"left_hand": "Nose"})
    monkeypatch.setitem(sys.modules, "daqp", None)
    with pytest.raises(UserError, match=r"pip install 'cape\[retarget\]'"):
        retarget(steps(), body)


masks = hnp.arrays(bool, st.integers(1, 40))
vectors = hnp.arrays(float, (3,), elements=st.floats(-1, 1))


@given(masks)
@settings(deadline=None)
def test_runs_are_the_rows_of_true_frames(mask):
    covered = np.zeros_like(mask)
    for first, last in foot_contacts.runs(mask):
        assert first == 0 or not mask[first - 1]
        assert last == len(mask) - 1 or not mask[last + 1]
        covered[first : last + 1] = True
    assert np.array_equal(covered, mask)


@given(st.data())
@settings(deadline=None)
def test_corrections_are_kept_while_standing_and_lie_between_on_the_way(data):
    stands = data.draw(masks)
    corrections = data.draw(hnp.arrays(float, (len(stands), 2), elements=st.floats(-1, 1)))
    led = foot_contacts.carry_between(corrections, stands)
    assert np.abs(led[stands] - corrections[stands]).max(initial=0) < 1e-12
    known = np.flatnonzero(stands)
    for frame in range(len(stands) if len(known) else 0):
        around = [known[known <= frame][-1:], known[known >= frame][:1]]
        ends = corrections[np.concatenate(around)]
        assert (led[frame] >= ends.min(0) - 1e-12).all()
        assert (led[frame] <= ends.max(0) + 1e-12).all()


def test_a_foot_stands_where_it_is_low_and_slow():
    # Stands for 0.5 s, swings by half a leg in 0.5 s 0.1 m high, stands again; a dip of one frame counts for nothing.
    fps, leg = 120.0, 0.8
    t = np.clip((np.arange(180) / fps - 0.5) / 0.5, 0, 1)
    ankle = np.stack([0.4 * (3 * t**2 - 2 * t**3), 0 * t, 0.08 + 0.1 * np.sin(np.pi * t) ** 2], axis=1)
    ankle[20, 2] += 0.1
    height = foot_contacts.standing_height(ankle[None], leg, fps)
    assert height == pytest.approx(0.08, abs=1e-6)
    stands = foot_contacts.standing_frames(ankle, height, leg, fps)
    assert stands[:60].all()
    assert stands[124:].all()
    assert not stands[72:112].any()


@given(vectors, vectors, vectors, st.floats(0.2, 1), st.floats(0.2, 1))
@settings(deadline=None)
def test_a_knee_keeps_the_lengths_of_the_leg(start, end, towards, upper, lower):
    distance = np.linalg.norm(end - start)
    line = (end - start) / max(distance, 1e-12)
    across = towards - towards @ line * line
    if not (abs(upper - lower) + 0.01 < distance < upper + lower - 0.01) or np.linalg.norm(across) < 1e-3:
        return
    knee = bent_joint(start[None], end[None], towards[None], upper, lower)[0]
    assert np.linalg.norm(knee - start) == pytest.approx(upper, abs=1e-9)
    assert np.linalg.norm(knee - end) == pytest.approx(lower, abs=1e-9)
    assert (knee - start) @ across > 0


@given(vectors, st.floats(0.0, 0.3), st.booleans())
@settings(deadline=None)
def test_soles_never_tilt_into_the_floor(tilt, above, stands):
    sole = np.array([[x, y, -0.08] for x in (-0.05, 0.15) for y in (-0.04, 0.04)])
    wanted = quaternions.from_rotation_vector(tilt)[None]
    heights = np.array([0.08 + above])
    turned = foot_contacts.tilted_soles(wanted, heights, np.array([stands]), sole)
    assert foot_contacts.lowest_heights(heights, turned, sole)[0] > -1e-9
    if stands:
        assert foot_contacts.lowest_heights(heights, turned, sole)[0] == pytest.approx(above, abs=1e-9)
    elif foot_contacts.lowest_heights(heights, wanted, sole)[0] >= 0:
        assert np.abs(quaternions.to_matrix(turned) - quaternions.to_matrix(wanted)).max() < 1e-9
