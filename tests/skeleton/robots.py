"""Robots that tests need: of a few links, made here, or with hitboxes that are fitted once for all runs."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from cape.kernels import store
from skeleton import Hitboxes, Skeleton, hitboxes_of, kept_hitboxes_of


def fitted_hitboxes(body: Skeleton, **options: Any) -> Hitboxes:
    """What `hitboxes_of` gives."""
    place = store.folder()
    return hitboxes_of(body, **options) if place is None else kept_hitboxes_of(body, place, **options)


def urdf_of(folder: Path, base: list[str]) -> Path:
    """A robot of two links: a base of some shapes, and an arm that is a cylinder."""
    shapes = "".join(f"<collision><geometry>{shape}</geometry></collision>" for shape in base)
    inertia = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    path = folder / "robot.urdf"
    path.write_text(
        f'<robot name="two"><link name="base">{inertia}{shapes}</link><link name="arm">{inertia}<collision><geometry>'
        '<cylinder radius="0.1" length="0.5"/></geometry></collision></link><joint name="hinge" type="revolute">'
        '<parent link="base"/><child link="arm"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    return path


_ROD = '<collision><origin xyz="0 0 -0.1"/><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>'
_PARTS = {
    # link: the one above, its joint, where that is in the frame of the link above [m]
    "chest": ("pelvis", "waist_yaw", (0.0, 0.0, 0.15)),
    "head": ("chest", "neck_pitch", (0.0, 0.0, 0.4)),
    **{
        f"{side}_{link}": (above.format(side), f"{side}_{joint}", (0.0, sign * across, down))
        for side, sign in (("left", 1.0), ("right", -1.0))
        for link, above, joint, across, down in (
            ("arm", "chest", "shoulder_pitch", 0.2, 0.3),
            ("forearm", "{}_arm", "elbow", 0.0, -0.3),
            ("hand", "{}_forearm", "wrist_pitch", 0.0, -0.25),
            ("thigh", "pelvis", "hip_pitch", 0.1, -0.05),
            ("shin", "{}_thigh", "knee", 0.0, -0.4),
            ("foot", "{}_shin", "ankle_pitch", 0.0, -0.4),
        )
    },
}


def person_urdf(folder: Path, *, fixed: Collection[str] = (), mimics: Mapping[str, str] | None = None) -> Path:
    """A robot of a person's shape, 1.75 m tall; each joint turns about y, but for those which are fixed.

    Args:
        folder: to write to.
        fixed: names of joints that don't move.
        mimics: by joint, the attributes of its element `mimic`.
    """
    inertia = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = "".join(f'<link name="{link}">{inertia}{_ROD}</link>' for link in ("pelvis", *_PARTS))
    joints = "".join(
        f'<joint name="{joint}" type="{"fixed" if joint in fixed else "revolute"}"><parent link="{above}"/>'
        f'<child link="{link}"/><origin xyz="{at[0]} {at[1]} {at[2]}"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" effort="9" velocity="9"/>'
        + (f"<mimic {mimics[joint]}/>" if mimics and joint in mimics else "")
        + "</joint>"
        for link, (above, joint, at) in _PARTS.items()
    )
    path = folder / "person.urdf"
    path.write_text(f'<robot name="person">{links}{joints}</robot>')
    return path
