"""Inverse kinematics of a robot that follows places and rotations from frame to frame, by Pink."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import UserError
from skeleton.model import Skeleton
from skeleton.retargeting.arm_avoidance import Apart
from skeleton.shapes import Shape
from skeleton.urdf.carriers import Carriers
from skeleton.urdf.mimics import followed

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]

_ITERATIONS = 8
"""Steps for a frame, at most."""

_SETTLING = 30
"""Times that the first frame is solved, each from the last solution, before the robot moves on."""

_FIRST_STEP = 0.1
"""Most that a joint moves in a step towards the first frame [rad]: far from the solution, whole steps overshoot."""

_CONVERGED = 1e-3
"""The solver has converged where a further step moves no joint by more than this [rad, m]."""

_RECOVERY = 0.5
"""Joints that no target determines return to the neutral configuration with this time constant [s]."""

FASTEST = 30.0
"""Speed of a joint [rad/s] that none exceeds, whatever the model allows: faster than any that walks or kicks."""

_POSTURE_COST = 0.2
"""Cost of a radian that a joint moves in a frame: places that ask for much movement and gain little are given up."""
_DAMPING = 1e-4

_CAUTION = 0.03
"""Levenberg-Marquardt damping, as a share of the square of what being off costs: straight arms overshoot without."""


@dataclass(frozen=True, eq=False)
class Target:
    """What a frame of the robot should follow.

    Attributes:
        name: unique name.
        bone: index of the bone that carries the frame.
        place: origin of the frame in the bone's frame [m], shape (3,).
        axes_wxyz: axes of the frame, frame_to_bone, shape (4,).
        positions: wanted origins in the world [m], shape (F, 3), where a place is.
        rotations_wxyz: wanted frame_to_world, shape (F, 4), where a rotation is wanted.
        directions: wanted directions of the frame's z axis, shape (F, 3), where only that axis is.
        position_costs: cost of a metre in each frame, shape (F,).
        rotation_costs: cost of a radian in each frame, shape (F,).
        yields: how far off its place the frame is pulled back the harder, and no harder beyond [m]; None for no end.
        above_floor: points of the frame that stay above z = 0, in its axes [m], shape (P, 3).
    """

    name: str
    bone: int
    place: FloatArray
    axes_wxyz: FloatArray
    positions: FloatArray | None = None
    rotations_wxyz: FloatArray | None = None
    directions: FloatArray | None = None
    position_costs: FloatArray | None = None
    rotation_costs: FloatArray | None = None
    yields: float | None = None
    above_floor: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Followed:
    """What the robot did.

    Attributes:
        configurations: shape (F, nq).
        positions: origins of the targets' frames by name [m], shape (F, 3) each.
        rotations_wxyz: frame_to_world by name, shape (F, 4) each.
    """

    configurations: FloatArray
    positions: dict[str, FloatArray]
    rotations_wxyz: dict[str, FloatArray]


def follow(
    robot: Skeleton,
    targets: Sequence[Target],
    first_root: FloatArray,
    first_wxyz: FloatArray,
    fps: float,
    top_speed: float,
    solids: Sequence[Shape] = (),
) -> Followed:
    """Configurations that come nearest to the targets, by weighted least squares within the robot's limits.

    Each frame is solved by Gauss-Newton steps from the solution of the frame before, the first from the neutral
    configuration. A step is a quadratic program within the joints' limits, cut to where a joint can get from the frame
    before at its top speed (`top_speed_of`), with the points that have to be above the floor there, and with arms kept
    out of what they shouldn't be in (`skeleton.apart`).

    Args:
        robot: with a root that moves freely.
        targets: what to follow, all over the same F frames.
        first_root: where the root begins in the world [m], shape (3,).
        first_wxyz: root_to_world from which it begins, shape (4,).
        fps: frames per second.
        top_speed: of a joint, as a multiple of what the model allows.
        solids: around the robot's bones, to keep its arms out of; none by default.

    Raises:
        UnknownNameError: a solid's bone isn't one of the robot's; lists the bones.
        UserError: the extra `retarget` isn't installed.
    """
    try:
        import pink
        import pink.limits
        import pink.tasks

        # Pink asks for its solver by name only when it solves.
        importlib.import_module("daqp")
    except ImportError:
        raise UserError("retargeting needs the packages pink and daqp: pip install 'cape[retarget]'") from None
    import pinocchio as pin

    model = robot.model.copy()
    frames = [_add_frame(model, robot.carriers, target) for target in targets]
    lower, upper, reach = _bounds(model, fps, top_speed)
    neutral = followed(pin.neutral(model), robot.mimics, model)
    neutral[7:] = np.clip(neutral[7:], lower[7:], upper[7:])
    placement = model.jointPlacements[1].inverse() * pin.SE3(quaternions.to_matrix(first_wxyz), first_root)
    neutral[:7] = pin.SE3ToXYZQUAT(placement)

    state = pink.Configuration(model, model.createData(), neutral, copy_data=False)
    tasks = [pink.tasks.FrameTask(_frame_name(t), 0.0, 0.0, lm_damping=_CAUTION) for t in targets]
    posture = pink.tasks.PostureTask(cost=_POSTURE_COST)
    apart = [Apart(robot, solids, model)] if solids else []
    all_tasks: list[Any] = [*tasks, posture, *apart]
    limits: list[Any] = [pink.limits.ConfigurationLimit(model, config_limit_gain=1.0), *apart]
    limits += [
        _Floor(index, target.above_floor)
        for target, index in zip(targets, frames, strict=True)
        if target.above_floor is not None
    ]
    count = len(next(t.positions for t in targets if t.positions is not None))
    configurations = np.empty((count, model.nq))
    positions = np.empty((count, len(targets), 3))
    rotations = np.empty((count, len(targets), 3, 3))
    back = 1.0 - np.exp(-1.0 / (_RECOVERY * fps))
    for frame in [0] * _SETTLING + list(range(1, count)):
        before = state.q
        posture.set_target(pin.interpolate(model, before, neutral, back))
        for target, task, index in zip(targets, tasks, frames, strict=True):
            if target.rotation_costs is not None:
                task.set_orientation_cost(float(target.rotation_costs[frame]))
            task.set_target(_wanted_pose(target, frame, state.data.oMf[index]))
        for _ in range(_ITERATIONS):
            origin, most = (before, reach) if frame else (state.q, _FIRST_STEP)
            model.lowerPositionLimit = np.maximum(lower, origin - most)
            model.upperPositionLimit = np.minimum(upper, origin + most)
            _yield(targets, tasks, frames, frame, state)
            for arms in apart:
                arms.look_at(state)
            step = pink.solve_ik(state, all_tasks, 1.0, "daqp", damping=_DAMPING, limits=limits)
            q = followed(pin.integrate(model, state.q, step), robot.mimics, model)
            q[7:] = np.clip(q[7:], model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
            state.update(q)
            if np.abs(step).max() < _CONVERGED:
                break
        configurations[frame] = state.q
        for k, index in enumerate(frames):
            positions[frame, k] = state.data.oMf[index].translation
            rotations[frame, k] = state.data.oMf[index].rotation
    quats = quaternions.from_matrix(rotations)
    names = [target.name for target in targets]
    return Followed(
        followed(configurations, robot.mimics, model),
        {name: positions[:, k] for k, name in enumerate(names)},
        {name: quats[:, k] for k, name in enumerate(names)},
    )


def _yield(targets: Sequence[Target], tasks: Sequence[Any], frames: Sequence[int], frame: int, state: Any) -> None:
    """Set what places cost, so that what is farther off than it yields is pulled no harder for it.

    The weights of Huber's loss in iterated least squares (Huber 1964, "Robust estimation of a location parameter",
    Ann. Math. Stat. 35:73).
    """
    for target, task, index in zip(targets, tasks, frames, strict=True):
        if target.positions is None or target.position_costs is None:
            continue
        cost = float(target.position_costs[frame])
        if target.yields is not None:
            off = float(np.linalg.norm(target.positions[frame] - state.data.oMf[index].translation))
            cost *= math.sqrt(target.yields / max(off, target.yields))
        task.set_position_cost(cost)


class _Floor:
    """A limit of Pink's that keeps points of a frame above z = 0: z(q) + dz/dq step >= 0."""

    def __init__(self, frame: int, points: FloatArray):
        self.frame = frame
        self.points = points

    def compute_qp_inequalities(self, configuration: Any, dt: float) -> tuple[FloatArray, FloatArray]:
        """Matrix G, shape (P, nv), and vector h, shape (P,), of G step <= h."""
        import pinocchio as pin

        pose = configuration.data.oMf[self.frame]
        arms = self.points @ pose.rotation.T
        jacobian = pin.getFrameJacobian(
            configuration.model, configuration.data, self.frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        # The velocity of a point at the arm r is v + w x r, whose z is v_z + w_x r_y - w_y r_x.
        upwards = jacobian[2] + arms[:, 1:2] * jacobian[3] - arms[:, 0:1] * jacobian[4]
        return -upwards, pose.translation[2] + arms[:, 2]


def _frame_name(target: Target) -> str:
    """A name that no link of a robot has, such as "pelvis" would be."""
    return f"target of {target.name}"


def _add_frame(model: "pinocchio.Model", carriers: Carriers, target: Target) -> int:
    import pinocchio as pin

    turn = carriers.rotations[target.bone] @ quaternions.to_matrix(target.axes_wxyz)
    placement = pin.SE3(turn, carriers.in_joint(target.bone, target.place))
    joint = int(carriers.joints[target.bone])
    return model.addFrame(pin.Frame(_frame_name(target), joint, placement, pin.OP_FRAME))


def _bounds(model: "pinocchio.Model", fps: float, top_speed: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lowest and highest joint positions, and how far each gets in a frame, shapes (nq,)."""
    lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
    reach = np.full(model.nq, np.inf)
    for _, q, v in hinges(model):
        reach[q] = top_speed_of(model, v, top_speed) / fps
    return lower, upper, reach


def top_speed_of(model: "pinocchio.Model", velocity: int, multiple: float) -> float:
    """Top speed of a joint [rad/s or m/s] by its place in a velocity: a multiple of the model's, at most `FASTEST`."""
    allowed = float(model.velocityLimit[velocity])
    return min(multiple * allowed, FASTEST) if allowed > 0.0 else FASTEST


def hinges(model: "pinocchio.Model") -> list[tuple[str, int, int]]:
    """Name of each joint of one coordinate, with its places in a configuration and in a velocity."""
    return [
        (model.names[joint], int(model.idx_qs[joint]), int(model.idx_vs[joint]))
        for joint in range(1, model.njoints)
        if model.nqs[joint] == model.nvs[joint] == 1
    ]


def _wanted_pose(target: Target, frame: int, now: Any) -> Any:
    """The pose that a frame should take; what isn't wanted stays as it is now."""
    import pinocchio as pin

    rotation = now.rotation.copy()
    if target.rotations_wxyz is not None:
        rotation = quaternions.to_matrix(target.rotations_wxyz[frame])
    elif target.directions is not None:
        turn = pin.Quaternion.FromTwoVectors(rotation[:, 2], target.directions[frame])
        rotation = turn.toRotationMatrix() @ rotation
    position = now.translation.copy() if target.positions is None else target.positions[frame]
    return pin.SE3(rotation, position)
