"""Where robots' files are, those of the package example-robot-data by name, and which joints play their roles."""

import importlib.metadata
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from motions.errors import FileError, MissingPackageError, UnknownNameError

_URDF_OF = {
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "talos": "talos_data/robots/talos_reduced.urdf",
    "romeo": "romeo_description/urdf/romeo.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "human": "human_description/robots/human.urdf",
    "simple_humanoid": "simple_humanoid_description/urdf/simple_humanoid.urdf",
}


@dataclass(frozen=True)
class RobotSource:
    """The files that a robot was read from.

    Attributes:
        urdf: its URDF file.
        package_folders: folders in which the packages may lie that the URDF file names.
    """

    urdf: Path
    package_folders: tuple[str, ...]


ROBOTS: tuple[str, ...] = tuple(_URDF_OF)
"""Names that `find_urdf` knows."""


_PACKAGE = "package://"


def find_urdf(path_or_name: str | Path, package_dirs: Sequence[str | Path] = ()) -> Path:
    """The URDF file of a robot given by its path, its path in a package, or its name in example-robot-data.

    Args:
        path_or_name: "walker.urdf", "package://walker_description/urdf/walker.urdf" or "g1".
        package_dirs: folders that hold packages, looked into before those of the environment's ROS_PACKAGE_PATH
            and AMENT_PREFIX_PATH.

    Raises:
        UnknownNameError: neither a file nor the name of a robot; lists the robots.
        FileError: the path is a directory, or no folder holds the package's file.
        MissingPackageError: a name is given, and example-robot-data isn't installed.
    """
    name = str(path_or_name)
    if name in _URDF_OF:
        return _robots_folder() / _URDF_OF[name]
    if name.startswith(_PACKAGE):
        folders = [*map(Path, package_dirs), *_ros_folders(), *_data_folders()]
        for folder in folders:
            if os.path.isfile(path := folder / name.removeprefix(_PACKAGE)):
                return path
        looked = ", ".join(map(str, folders))
        raise FileError(f"no folder holds {name}; looked in: {looked}")
    path = Path(path_or_name)
    if os.path.isdir(path):  # and not as a `Path` would: that fails where a name is too long
        raise FileError(f"{path} is a directory, not a URDF file")
    if os.path.isfile(path):
        return path
    if path.suffix or len(path.parts) > 1:
        raise FileError(f"there is no file {path}; robots known by name: {', '.join(ROBOTS)}")
    raise UnknownNameError("robot", name, ROBOTS, "Or give the path of a URDF file")


def package_folders(urdf: Path, package_dirs: Sequence[str | Path] = ()) -> list[str]:
    """Folders in which the packages that a URDF file names may lie: given ones, those above the file, known ones."""
    above = [str(folder) for folder in urdf.resolve().parents]
    return [*map(str, package_dirs), *above, *map(str, _ros_folders()), *map(str, _data_folders())]


def known_roles(path_or_name: str | Path) -> Mapping[str, str]:
    """Joints of the roles of a robot whose joints' names don't tell, empty for any other."""
    return _ROLES_OF.get(str(path_or_name), {})


def _ros_folders() -> list[Path]:
    """Folders of packages as ROS knows them: its first version by one variable, its second one by another."""
    first, second = (os.environ.get(name, "").split(os.pathsep) for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
    return [*(Path(folder) for folder in first if folder), *(Path(folder) / "share" for folder in second if folder)]


def _robots_folder() -> Path:
    for folder in _data_folders():
        return folder / "example-robot-data" / "robots"
    raise MissingPackageError(
        "a robot known by name needs its files: pip install example-robot-data (a URDF file of your own needs nothing)"
    )


def _data_folders() -> list[Path]:
    """The folder of example-robot-data's packages; none where it isn't installed."""
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        return []
    return [Path(str(distribution.locate_file("cmeel.prefix/share")))]


def _both_sides(limbs: Mapping[str, str]) -> dict[str, str]:
    """Roles of both sides from a pattern of each limb's joint, with {side} for left or right and {S} for L or R."""
    return {
        f"{side}_{limb}": joint.format(side=side, S=side[0].upper())
        for side in ("left", "right")
        for limb, joint in limbs.items()
    }


_ROLES_OF: dict[str, dict[str, str]] = {
    "talos": {
        "pelvis": "root_joint",
        "chest": "torso_2_joint",
        "head": "head_2_joint",
        **_both_sides(
            {
                # The first of the arm's joints swings the whole shoulder, farther than any collar bone.
                "shoulder": "torso_2_joint",
                "upper_arm": "arm_{side}_3_joint",
                "forearm": "arm_{side}_4_joint",
                "hand": "arm_{side}_7_joint",
                "thigh": "leg_{side}_3_joint",
                "shin": "leg_{side}_4_joint",
                "foot": "leg_{side}_6_joint",
            }
        ),
    },
    "human": {
        "pelvis": "root_joint",
        "chest": "middle_thoracic_Y",
        "neck": "middle_cervical_Y",
        **_both_sides(
            {
                "shoulder": "{side}_clavicle_joint_X",
                "upper_arm": "{side}_shoulder_Y",
                "forearm": "{side}_elbow_Y",
                "hand": "{side}_wrist_X",
                "thigh": "{side}_hip_Y",
                "shin": "{side}_knee_Z",
                "foot": "{side}_ankle_X",
            }
        ),
    },
    "simple_humanoid": {
        "pelvis": "root_joint",
        "chest": "CHEST",
        **_both_sides(
            {
                "shoulder": "CHEST",
                "upper_arm": "{S}ARM_SHOULDER_Y",
                "forearm": "{S}ARM_ELBOW",
                "hand": "{S}ARM_WRIST_R",
                "thigh": "{S}LEG_HIP_Y",
                "shin": "{S}LEG_KNEE",
                "foot": "{S}LEG_ANKLE_R",
            }
        ),
    },
}
