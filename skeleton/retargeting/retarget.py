"""A clip's motion on a robot: retargeting by inverse kinematics on matched roles."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bodies.roles import SIDES
from motions.border import checked
from motions.clip import Clip
from motions.errors import ValueRangeError
from skeleton.model import Skeleton
from skeleton.rest import FRAME_ROLES, LEG_ROLES, RestPose
from skeleton.retargeting import foot_contacts
from skeleton.retargeting.inverse_kinematics import Followed, Target, follow, hinges, top_speed_of
from skeleton.retargeting.scaled_source import ScaledSource, body_axes, scaled_source, standing_axes, target_point
from skeleton.robot.hitboxes import Hitboxes
from skeleton.robot_motion import RobotMotion

FloatArray = NDArray[np.float64]

_POSITION_COSTS = {
    "pelvis": 12.0,
    "upper_arm": 1.0,
    "forearm": 1.0,
    "hand": 10.0,
    "shin": 6.0,
    "foot": 18.0,
}
"""Cost of a metre: feet and hands before what leads to them. The legs' costs are high against the arms': where
arms of robots lose their way, at the limits of their joints, the trunk is not to lean after them."""

_HAND_YIELDS = 0.04
"""A hand that is farther off than this [m] pulls no harder."""

_STANDING_COST = 120.0
"""Cost of a metre of a foot that stands: it stays, whatever else does not."""

_ROTATION_COSTS = {"pelvis": 4.0, "chest": 4.0, "head": 0.3, "foot": 0.9, "hand": 0.15}
"""Cost of a radian."""

_LEVEL_COST = 3.0
"""Cost of a radian of a foot that stands."""

_AT_LIMIT = 1e-4
"""A joint this close to a limit [rad] is at it."""


_OFTEN = 0.1
"""Share of the frames from which on it is said that a joint is at a limit."""


_NAMED = 4
"""At most so many of these joints are named."""


@dataclass(frozen=True)
class Deviation:
    """How far the robot is off over the frames: root mean square and maximum, [m] for places, [rad] for rotations."""

    rms: float
    max: float


@checked
@dataclass(frozen=True, eq=False)
class Retargeted:
    """A clip's motion on a robot, and how well it fits.

    Attributes:
        motion: the robot's motion, at the clip's times.
        scale: the robot's leg over the source's.
        errors: distance of the robot's joint from the scaled source by role [m]; "pelvis" is the middle of the hips,
            "left_upper_arm" the shoulder, "left_hand" the wrist and so on, see `scaled_source`.
        turns: angle between the robot's and the source's "pelvis", "chest", "head" and hands [rad]; of a hand only its
            direction counts.
        at_limits: share of the frames at which a joint is at one of its limits, by its name, those that ever are.
        at_top_speed: share of the frames at which a joint moves as fast as the model allows or faster, likewise.
        sliding: farthest that a foot gets from where it came down while it stands [m].
        clearance: height of the lowest point of the soles in the whole motion [m].
        hover: largest height of the lowest point of a standing foot's sole [m].
        stands: whether the foot of a side stands, shape (F,) each.
    """

    motion: RobotMotion
    scale: float
    errors: Mapping[str, Deviation]
    turns: Mapping[str, Deviation]
    at_limits: Mapping[str, float]
    at_top_speed: Mapping[str, float]
    sliding: float
    clearance: float
    hover: float
    stands: Mapping[str, NDArray[np.bool_]]


@checked
def retarget(
    clip: Clip,
    robot: Skeleton,
    *,
    hitboxes: Hitboxes | None = None,
    roles: Mapping[str, str] | None = None,
    top_speed: float = math.inf,
) -> Retargeted:
    """Make a robot move as a clip does.

    The clip is scaled to the robot (`scaled_source`), its standing feet are held still and level
    (`foot_contacts`), and the robot follows frame after frame within the limits of its joints
    (`inverse_kinematics.follow`). Then the whole is lifted or lowered until the lowest point of the soles is on z = 0.

    Args:
        clip: a motion of a body with legs and arms.
        robot: from `Skeleton.from_urdf`, with a floating base, standing level in its neutral configuration.
        hitboxes: of the robot, which its arms are kept out of as far as the places of its hands allow; None to let them
            pass through it. A narrow actor's hands are closer to the hips than a wide robot's can be.
        roles: joint names for the clip's roles that aren't found or are found wrongly.
        top_speed: of a joint, as a multiple of what the robot's model allows; what is more than
            `inverse_kinematics.FASTEST` is cut to it. By default the robot follows as an actor would, and what it could
            not do is told.

    Raises:
        UnknownNameError: a shoulder or a part of a leg has no joint in the clip or in the robot, or an override's role
            or joint doesn't exist, or a hitbox is on a bone that the robot doesn't have.
        ValueRangeError: the robot is the body of a clip, or has a fixed base; a top speed of 0 or less.
        FileError: a mesh of the robot's feet can't be read.
        UserError: the extra `retarget` isn't installed.
    """
    if not robot.is_robot:
        raise ValueRangeError("only a robot can be retargeted to; the body of a clip moves by Skeleton.track")
    if robot.model.joints[1].shortname() != "JointModelFreeFlyer":
        raise ValueRangeError("only a robot with a floating base can follow a clip, not one whose root is fixed")
    if not top_speed > 0.0:
        raise ValueRangeError(f"the top speed must be more than 0, not {top_speed:g}")
    robot.require_roles(("pelvis", *FRAME_ROLES, *LEG_ROLES))
    standing = standing_axes(robot.rest)
    soles = foot_contacts.soles_of(robot, standing)
    source = scaled_source(clip, robot, soles.ankle_height, roles=roles)
    targets = _targets(robot.rest, source, soles, standing, clip.fps)
    root = _root_pose(robot.rest, source.points["pelvis"][0], source.rotations["pelvis"][0])
    followed = follow(robot, targets, *root, clip.fps, top_speed, solids=() if hitboxes is None else hitboxes.solids)

    feet = {side: f"{side}_foot" for side in SIDES}
    heights = {
        side: foot_contacts.lowest_heights(
            followed.positions[foot][:, 2], followed.rotations_wxyz[foot], soles.points[side]
        )
        for side, foot in feet.items()
    }
    lift = -min(float(height.min()) for height in heights.values())
    followed = _lifted(robot, followed, lift)
    configurations = followed.configurations
    errors = _errors(followed, source)
    at_limits = _shares_at_limits(robot, configurations)
    at_top_speed = _shares_at_speed(robot, configurations, clip.fps, top_speed)
    decisions = (
        f"scale: the robot's legs are {source.scale:.3f} times as long as those of the clip {clip.name!r}",
        f"floor: the whole motion moved {'up' if lift > 0.0 else 'down'} by {1000.0 * abs(lift):.1f} mm",
        "fit: " + ", ".join(f"{part} within {100.0 * _worst(errors, part):.1f} cm" for part in ("hand", "foot")),
        *_named("at a limit", at_limits),
        *_named("at top speed", at_top_speed),
        *soles.decisions,
    )
    return Retargeted(
        motion=RobotMotion(clip.name, configurations, clip.times, decisions),
        scale=source.scale,
        errors=errors,
        turns=_turns(followed, source),
        at_limits=at_limits,
        at_top_speed=at_top_speed,
        sliding=max(_sliding(followed.positions[foot], source.stands[side]) for side, foot in feet.items()),
        clearance=min(float(height.min()) for height in heights.values()) + lift,
        hover=max(float((height[source.stands[side]] + lift).max(initial=0.0)) for side, height in heights.items()),
        stands=source.stands,
    )


def _targets(
    rest: RestPose, source: ScaledSource, soles: foot_contacts.Soles, standing: FloatArray, fps: float
) -> list[Target]:
    """What each of the robot's frames should follow."""
    points, rotations = dict(source.points), dict(source.rotations)
    axes = {role: body_axes(rest, role) for role in ("pelvis", "chest", "head")}
    for side in SIDES:
        foot, stands = f"{side}_foot", source.stands[side]
        axes[foot] = standing
        points[foot] = foot_contacts.planted(points[foot], stands, soles.ankle_height)
        rotations[foot] = foot_contacts.tilted_soles(rotations[foot], points[foot][:, 2], stands, soles.points[side])
        # A robot's hand seldom has joints that tell its direction: at rest it is taken for the forearm's.
        if (hand := f"{side}_hand") in source.directions:
            forearm = rest.origin(hand) - target_point(rest, f"{side}_forearm")[1]
            axes[hand] = quaternions.from_z_axis(forearm)
    targets = []
    for role in dict.fromkeys([*points, *rotations]):
        part = _part(role)
        # The pelvis holds the hips.
        if part == "thigh":
            continue
        bone, place = target_point(rest, role)
        held, ground = np.zeros(len(points["pelvis"])), None
        if part == "foot":
            side = role.removesuffix("_foot")
            held, ground = foot_contacts.hold(source.stands[side], fps), foot_contacts.ground_points(soles.points[side])
        to_bone = quaternions.conjugate(rest.rotations_wxyz[bone])
        targets.append(
            Target(
                role,
                bone,
                rest.into_bone(bone, place),
                quaternions.multiply(to_bone, axes[role]) if role in axes else np.array([1.0, 0.0, 0.0, 0.0]),
                positions=points.get(role),
                rotations_wxyz=rotations.get(role),
                directions=source.directions.get(role),
                position_costs=_blend(_POSITION_COSTS[part], _STANDING_COST, held) if role in points else None,
                rotation_costs=_blend(_ROTATION_COSTS[part], _LEVEL_COST, held) if part in _ROTATION_COSTS else None,
                yields=_HAND_YIELDS if part == "hand" else None,
                above_floor=ground,
            )
        )
    return targets


def _blend(cost: float, held_cost: float, held: FloatArray) -> FloatArray:
    """Cost in each frame, shape (F,), of what is held from 0, not at all, to 1, firmly."""
    return cost + held * (held_cost - cost)


def _part(role: str) -> str:
    """A role without its side."""
    return role.removeprefix("left_").removeprefix("right_")


def _root_pose(rest: RestPose, pelvis: FloatArray, pelvis_wxyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place [m] and rotation wxyz of the root, all joints at rest, for the middle of the hips and the pelvis's axes."""
    turn = quaternions.multiply(pelvis_wxyz, quaternions.conjugate(body_axes(rest, "pelvis")))
    root = pelvis + quaternions.rotate(turn, rest.positions[0] - rest.middle("thigh"))
    return root, quaternions.multiply(turn, rest.rotations_wxyz[0])


def _lifted(robot: Skeleton, followed: Followed, lift: float) -> Followed:
    """The same motion, moved up [m]; a configuration counts the root's place in the axes of the robot's file."""
    up = np.array([0.0, 0.0, lift])
    configurations = followed.configurations.copy()
    configurations[:, :3] += robot.model.jointPlacements[1].rotation.T @ up
    positions = {role: places + up for role, places in followed.positions.items()}
    return Followed(configurations, positions, followed.rotations_wxyz)


def _deviation(off: FloatArray) -> Deviation:
    return Deviation(rms=float(np.sqrt(np.mean(off**2))), max=float(off.max()))


def _worst(errors: Mapping[str, Deviation], part: str) -> float:
    """Largest error of a part on either side [m]; zero where it has none."""
    return max((error.max for role, error in errors.items() if _part(role) == part), default=0.0)


def _named(what: str, shares: Mapping[str, float]) -> list[str]:
    """A sentence on the joints that are held up often, the most often first."""
    often = sorted((name for name, share in shares.items() if share >= _OFTEN), key=lambda name: -shares[name])
    listed = ", ".join(f"{name} in {shares[name]:.0%} of the frames" for name in often[:_NAMED])
    more = f", and {len(often) - _NAMED} more joints" if len(often) > _NAMED else ""
    return [f"{what}: {listed}{more}"] if often else []


def _errors(followed: Followed, source: ScaledSource) -> dict[str, Deviation]:
    return {
        role: _deviation(np.linalg.norm(followed.positions[role] - points, axis=1))
        for role, points in source.points.items()
        if role in followed.positions
    }


def _turns(followed: Followed, source: ScaledSource) -> dict[str, Deviation]:
    turns = {}
    for role in ("pelvis", "chest", "head"):
        if role in source.rotations:
            back = quaternions.conjugate(source.rotations[role])
            between = quaternions.multiply(back, followed.rotations_wxyz[role])
            turns[role] = np.linalg.norm(quaternions.to_rotation_vector(between), axis=1)
    for role, wanted in source.directions.items():
        along = quaternions.rotate(followed.rotations_wxyz[role], np.array([0.0, 0.0, 1.0]))
        turns[role] = 2.0 * np.arcsin(np.clip(np.linalg.norm(along - wanted, axis=1) / 2.0, 0.0, 1.0))
    return {role: _deviation(off) for role, off in turns.items()}


def _shares_at_limits(robot: Skeleton, configurations: FloatArray) -> dict[str, float]:
    """Shares of the frames at which joints are at a limit; those that never move have nothing to do and don't count."""
    shares = {}
    for name, q, _ in hinges(robot.model):
        positions = configurations[:, q]
        room = np.minimum(positions - robot.model.lowerPositionLimit[q], robot.model.upperPositionLimit[q] - positions)
        if np.ptp(positions) > _AT_LIMIT and (at_limit := room < _AT_LIMIT).any():
            shares[name] = float(at_limit.mean())
    return shares


def _shares_at_speed(robot: Skeleton, configurations: FloatArray, fps: float, top_speed: float) -> dict[str, float]:
    """Shares of the steps between frames in which joints move as fast as they may, or as the model allows."""
    shares = {}
    for name, q, v in hinges(robot.model):
        speeds = np.abs(np.diff(configurations[:, q])) * fps
        if (as_fast := speeds > 0.999 * top_speed_of(robot.model, v, min(top_speed, 1.0))).any():
            shares[name] = float(as_fast.mean())
    return shares


def _sliding(foot: FloatArray, stands: NDArray[np.bool_]) -> float:
    """Farthest way over the ground of a standing foot from where it came down [m]."""
    ways = [
        np.linalg.norm(foot[first : last + 1, :2] - foot[first, :2], axis=1).max()
        for first, last in foot_contacts.runs(stands)
    ]
    return float(max(ways, default=0.0))
