"""A joint tree as a Pinocchio model, and the world poses of its bones in a motion."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions.bodies.roles import ROLES, SIDES, find_roles, require_role, require_roles
from motions.bodies.shape import roles_by_shape
from motions.border import checked
from motions.clip import Clip
from motions.conventions import to_z_up
from motions.errors import UnknownNameError, ValueRangeError, require_package
from motions.kinematics import forward_kinematics
from motions.skin import Skin
from skeleton.capsules import Capsule, body_capsules
from skeleton.clip_model import ClipModel, constant_offsets
from skeleton.known_robots import RobotSource, find_urdf, known_roles, package_folders
from skeleton.rest import FRAME_ROLES, RestPose, mean_rotations, missing_roles
from skeleton.robot_motion import RobotMotion
from skeleton.track import BoneTrack, nearest_parents, worn_by
from skeleton.urdf.carriers import Carriers, RobotBones, poses_in
from skeleton.urdf.mimics import Mimic, followed, read_mimics
from skeleton.urdf.reader import model_of_urdf, read_urdf
from skeleton.urdf.roles import roles_of_robot

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]


@checked
@dataclass(frozen=True, eq=False)
class Skeleton:
    """A body: a tree of bones, each named after the joint that carries it.

    A robot's bones are its joints, and whatever is fixed to them by fixed joints.

    Attributes:
        name: what it is called, as its model is.
        bones: names of the B bones, parents first.
        parents: index of each bone's parent, -1 for none, shape (B,).
        carriers: which joint of the model carries each bone, and where.
        roles: name of the bone of each role that was found, such as {"left_shoulder": "LeftCollar"}.
        rest: the bones in a typical pose.
        source: the files of a robot, whose motion is an array of configurations; None for the body of a clip.
        decisions: what had to be decided about a robot's files, a sentence each.
        mimics: joints of a robot that follow others.
        links: the bone that each of a robot's links is on, by the link's name.
        skin: the mesh that the bones of a clip's body carry; None for none.
        whole: the motion that a clip's body was measured by, where the clip is a part of it; None for the clip itself.
    """

    name: str
    bones: tuple[str, ...]
    parents: NDArray[np.int64]
    carriers: Carriers
    roles: Mapping[str, str]
    rest: RestPose
    source: RobotSource | None = None
    decisions: tuple[str, ...] = ()
    mimics: tuple[Mimic, ...] = ()
    links: Mapping[str, str] = field(default_factory=dict)
    skin: Skin | None = field(default=None, repr=False)
    whole: Clip | None = field(default=None, repr=False)
    _made: "pinocchio.Model | ClipModel | None" = field(default=None, repr=False)

    @cached_property
    def model(self) -> "pinocchio.Model":
        """The Pinocchio model.

        Raises:
            UserError: Pinocchio isn't installed.
        """
        return self._made.build() if isinstance(self._made, ClipModel) else self._made

    @staticmethod
    def from_clip(clip: Clip, *, roles: Mapping[str, str] | None = None) -> "Skeleton":
        """The body that a clip moves; as a model it has a free-flying root, and a ball joint for every other joint.

        A joint whose position in its parent's frame varies over the clip is free-flying too. End sites become
        operational frames named after their joint. None of it takes Pinocchio but the model itself.

        Args:
            clip: any motion of the body; all of its frames serve to find a typical pose, and where it was trimmed those
                of the whole as well, so that it is the same body whichever part of a motion that is.
            roles: joint names for roles that aren't found or are found wrongly; they win.

        Raises:
            UnknownNameError: an override's role or joint doesn't exist.
        """
        whole = clip if clip.whole is None else clip.whole
        placed = clip if clip.local_positions is None else whole
        found, decisions = _roles_of_clip(whole, {**clip.roles, **(roles or {})})
        local = np.array(placed.offsets if placed.local_positions is None else placed.local_positions.mean(axis=0))
        local[0] = 0.0
        # Not by Pinocchio, whose data grow with the cube of the number of joints that turn freely.
        typical = forward_kinematics(clip.parents, local[None], mean_rotations(whole.rotations_wxyz)[None])
        rest = RestPose(
            bones=clip.joints,
            parents=clip.parents,
            roles=found,
            positions=typical[0][0],
            rotations_wxyz=typical[1][0],
            end_parents=clip.end_parents,
            end_offsets=clip.end_offsets,
            single_axis=np.zeros(len(clip.joints), dtype=bool),
            fixed=np.zeros(len(clip.joints), dtype=bool),
        )
        carriers = Carriers.of_joints(len(clip.joints))
        decisions = (*decisions, *_on_legs(rest))
        return Skeleton(
            clip.name,
            rest.bones,
            rest.parents,
            carriers,
            found,
            rest,
            decisions=decisions,
            skin=clip.skin,
            whole=clip.whole if np.array_equal(clip.offsets, whole.offsets) else None,
            _made=replace(ClipModel.of(placed), name=clip.name),
        )

    @staticmethod
    def from_urdf(
        path_or_name: str | Path,
        *,
        roles: Mapping[str, str] | None = None,
        floating_base: bool = True,
        up: str | None = None,
        package_dirs: Sequence[str | Path] = (),
    ) -> "Skeleton":
        """A robot from a URDF file, or by its name in example-robot-data (`skeleton.ROBOTS`).

        Args:
            path_or_name: "walker.urdf", "package://walker_description/urdf/walker.urdf" or "g1".
            roles: joint names for roles that aren't found or are found wrongly; they win.
            floating_base: whether the root moves freely, by a joint that is added where the file has none; it is then
                the bone "root_joint" and the first seven numbers of a configuration, position [m] and quaternion
                (x, y, z, w).
            up: "x", "y", "z", "-x", "-y" or "-z", the axis of the robot's world that points up, which is turned to +Z;
                None compares the shoulders with the hips in the neutral configuration.
            package_dirs: folders that hold the packages that the file names, such as those with its meshes.

        Raises:
            UnknownNameError: no robot of that name, no such axis, or an override's role or joint doesn't exist.
            FileError: the file is missing or Pinocchio can't read it.
            UserError: Pinocchio isn't installed.
        """
        require_package("pinocchio", "a robot")
        path = find_urdf(path_or_name, package_dirs)
        robot = read_urdf(path)
        model = model_of_urdf(path, floating_base=floating_base)
        bones = RobotBones.of(model)
        mimics, unfollowed = read_mimics(robot, model)
        given = {role: joint for role, joint in known_roles(path_or_name).items() if joint in bones.names}
        found = roles_of_robot(bones, {**given, **(roles or {})})
        chosen, decisions = (up, ()) if up else _choose_up(_robot_rest(model, bones, mimics, found))
        _stand_up(model, chosen)
        rest = _robot_rest(model, bones, mimics, found)
        return Skeleton(
            model.name,
            bones.names,
            bones.parents,
            bones.carriers,
            found,
            rest,
            RobotSource(path, tuple(package_folders(path, package_dirs))),
            (*decisions, *unfollowed, *_on_legs(rest)),
            mimics,
            bones.links,
            _made=model,
        )

    @property
    def is_robot(self) -> bool:
        """Whether a motion is an array of configurations; otherwise it is a Clip."""
        return self.source is not None

    def role(self, name: str) -> str:
        """Name of the bone that plays a role.

        Raises:
            UnknownNameError: there is no such role or no bone for it; lists the bones and says how to name one by hand.
        """
        return require_role(name, self.roles, self.bones)

    def require_roles(self, names: Iterable[str]) -> None:
        """Check that bones play all of some roles.

        Raises:
            UnknownNameError: there is no such role, or no bone for some; names all of these, and lists the bones.
        """
        require_roles(names, self.roles, self.bones)

    def bone(self, bone_or_role: str) -> int:
        """Index of a bone given by its name, its role or the name of a link on it; a name wins over a role.

        Raises:
            UnknownNameError: there is neither; lists the bones.
        """
        name = bone_or_role if bone_or_role in self.bones else self.roles.get(bone_or_role)
        name = name or self.links.get(bone_or_role)
        if name is None:
            raise UnknownNameError("bone", bone_or_role, self.bones, f"Roles: {', '.join(self.roles) or 'none'}")
        return self.bones.index(name)

    def height(self) -> float:
        """Standing height [m] from the lengths of legs, trunk and neck.

        Raises:
            UnknownNameError: a leg's or an arm's role has no bone.
        """
        return self.rest.height

    def shoulder_width(self) -> float:
        """Distance between the two upper-arm joints [m].

        Raises:
            UnknownNameError: an upper arm's role has no bone.
        """
        return self.rest.shoulder_width

    def capsules(
        self,
        *,
        radii: Mapping[str, float] | None = None,
        only: Sequence[str] | None = None,
        scale: float = 1.0,
        height: float | None = None,
        friction: float | None = None,
    ) -> tuple[Capsule, ...]:
        """Capsules around head, trunk and limbs; see `skeleton.capsules.body_capsules`."""
        return body_capsules(self.rest, radii=radii, only=only, scale=scale, height=height, friction=friction)[0]

    def capsules_left_out(self) -> dict[str, str]:
        """Why each capsule that a whole body would have is missing, such as {"head": "no bone for the role 'head'"}."""
        return body_capsules(self.rest)[1]

    def track(
        self,
        motion: Clip | RobotMotion | ArrayLike,
        bones: Sequence[str] | None = None,
        *,
        fps: float | None = None,
        times: ArrayLike | None = None,
    ) -> BoneTrack:
        """World poses of bones in a motion, by Pinocchio's forward kinematics.

        Args:
            motion: a clip with the body's joints; for a robot a motion of its own, or its configurations, shape
                (F, nq), in Pinocchio's order.
            bones: names or roles of the bones to read out, all by default. What isn't asked for isn't read.
            fps: frames per second of the configurations; a clip and a robot's motion have their own.
            times: times of the configurations [s], increasing, shape (F,), instead of `fps`.

        Raises:
            UnknownNameError: there is no such bone.
            ValueRangeError: the motion doesn't fit the body, holds NaN, or `fps` and `times` are missing or contradict.
        """
        chosen = range(len(self.bones)) if bones is None else dict.fromkeys(self.bone(bone) for bone in bones)
        chosen = list(chosen)
        if isinstance(motion, RobotMotion):
            if fps is not None or times is not None:
                raise ValueRangeError("fps and times are for configurations; a robot's motion has its own times")
            motion, times = motion.configurations, motion.times
        if isinstance(motion, Clip):
            if self.is_robot:
                raise ValueRangeError(f"a robot's motion is an array of configurations, got the clip {motion.name!r}")
            if fps is not None or times is not None:
                raise ValueRangeError("fps and times are for configurations; a clip has its own, see Clip.resample")
            order = np.array(self._fit_clip(motion))[chosen]
            times = np.arange(motion.frames) / motion.fps
            positions, rotations = (poses[:, order] for poses in motion.world_poses())
        else:
            configurations = self._fit_configurations(motion)
            times = _times_of(len(configurations), fps, times)
            positions, rotations = poses_in(self.model, self.carriers, configurations, chosen)
        names = tuple(self.bones[i] for i in chosen)
        roles = {role: bone for role, bone in self.roles.items() if bone in names}
        worn = worn_by(
            names, self.skin, motion.morphs if isinstance(motion, Clip) and motion.skin is self.skin else None
        )
        return BoneTrack(names, times, positions, rotations, nearest_parents(self.parents, chosen), roles, **worn)

    def _fit_clip(self, clip: Clip) -> list[int]:
        """Where each bone is among the joints of a clip, which may come in another order."""
        if missing := [bone for bone in self.bones if bone not in clip.joints]:
            raise ValueRangeError(
                f"the clip {clip.name!r} doesn't move this body: it lacks {', '.join(missing)}; "
                f"its joints: {', '.join(clip.joints)}"
            )
        order = [clip.joints.index(bone) for bone in self.bones]
        moving = np.isnan(constant_offsets(clip)[order]).any(axis=1)
        free = self._made.free if isinstance(self._made, ClipModel) else np.ones(len(order), dtype=bool)
        if stray := [bone for bone, is_stray in zip(self.bones, moving & ~free, strict=True) if is_stray]:
            raise ValueRangeError(
                f"in the clip {clip.name!r} these joints change their place, in the clip that this body was made from "
                f"they don't: {', '.join(stray)}"
            )
        return order

    def _fit_configurations(self, motion: ArrayLike) -> FloatArray:
        """Configurations given as an array, checked, their quaternions brought to unit length."""
        import pinocchio as pin

        configurations = np.array(motion, dtype=float)
        if configurations.ndim != 2 or configurations.shape[1] != self.model.nq or not len(configurations):
            raise ValueRangeError(
                f"configurations must have the shape (frames, {self.model.nq}), got {configurations.shape}"
            )
        if not np.isfinite(configurations).all():
            frame = int(np.argwhere(~np.isfinite(configurations))[0, 0])
            raise ValueRangeError(f"the configuration of frame {frame} holds NaN or infinity")
        configurations = np.array([pin.normalize(self.model, q) for q in configurations])
        return followed(configurations, self.mimics, self.model)


def _roles_of_clip(clip: Clip, given: Mapping[str, str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """The joint that plays each role, by names, and where these don't tell of limbs by the shape of the body."""
    named = find_roles(clip.joints, clip.parents.tolist(), {**clip.roles, **given})
    if all(f"{side}_{limb}" in named for side in SIDES for limb in ("upper_arm", "hand", "thigh")):
        return named, ()
    points = clip.sampled().world_points()
    above = [*clip.parents.tolist(), *clip.end_parents.tolist()]
    shaped = {role: clip.joints[joint] for role, joint in roles_by_shape(above, len(clip.joints), points).items()}
    guessed = {role: joint for role, joint in shaped.items() if role not in named and joint not in named.values()}
    for hand, forearm in ((f"{side}_hand", f"{side}_forearm") for side in SIDES):
        if hand in guessed and named.get(forearm, shaped[forearm]) != shaped[forearm]:
            del guessed[hand]  # of an arm that is another one by its shape than by its names
    if not guessed:
        return named, ()
    found = {role: {**guessed, **named}[role] for role in ROLES if role in guessed or role in named}
    told = ", ".join(f"{role}={joint}" for role, joint in guessed.items())
    return found, (f"roles guessed from the shape of the body: {told}; name others by --attach ROLE=BONE",)


def _robot_rest(
    model: "pinocchio.Model", bones: RobotBones, mimics: tuple[Mimic, ...], roles: Mapping[str, str]
) -> RestPose:
    """The bones in the neutral configuration; a joint of one axis is one of several that turn a limb."""
    import pinocchio as pin

    neutral = followed(pin.neutral(model)[None], mimics, model)
    positions, rotations = poses_in(model, bones.carriers, neutral, range(len(bones.names)))
    axes = np.array(model.nvs.tolist())[bones.carriers.joints]
    return RestPose(
        bones=bones.names,
        parents=bones.parents,
        roles=roles,
        positions=positions[0],
        rotations_wxyz=rotations[0],
        end_parents=np.zeros(0, dtype=np.int64),
        end_offsets=np.zeros((0, 3)),
        single_axis=(axes == 1) & ~bones.carriers.fixed,
        fixed=bones.carriers.fixed,
    )


def _on_legs(rest: RestPose) -> tuple[str, ...]:
    """A sentence on a body that has shoulders, and no legs to measure it by."""
    if rest.has_legs or missing_roles(rest, FRAME_ROLES):
        return ()
    return (f"no legs: by its arms it is taken for one that is {rest.height:.2f} m tall",)


def _choose_up(rest: RestPose) -> tuple[str, tuple[str, ...]]:
    """The axis that points from the hips to the shoulders, +Z where there are none, and a sentence on any other."""
    if missing_roles(rest, ("left_upper_arm", "right_upper_arm", "left_thigh", "right_thigh")):
        return "z", ()
    axis = int(np.argmax(np.abs(rest.up)))
    up = ("-" if rest.up[axis] < 0.0 else "") + "xyz"[axis]
    return up, () if up == "z" else (f"up: {up} in the robot's file, turned to +Z",)


def _stand_up(model: "pinocchio.Model", up: str) -> None:
    """Turn the world of a model, so that one of its axes points along +Z."""
    import pinocchio as pin

    turn = pin.SE3(to_z_up(up), np.zeros(3))
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            model.jointPlacements[joint] = turn * model.jointPlacements[joint]


def _times_of(frames: int, fps: float | None, times: ArrayLike | None) -> FloatArray:
    """Times of the frames of an array of configurations [s], shape (F,)."""
    if (fps is None) == (times is None):
        raise ValueRangeError("configurations need either fps or times, got " + ("none" if fps is None else "both"))
    if fps is None:
        times = np.asarray(times, dtype=float)
        if times.shape != (frames,):
            raise ValueRangeError(f"times must have the shape {(frames,)}, one for each frame, got {times.shape}")
        return times
    if not (np.isfinite(fps) and fps > 0):
        raise ValueRangeError(f"the frame rate must be positive, got {fps}")
    return np.arange(frames) / fps
