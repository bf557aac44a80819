"""Robots that tests need: of a few links, made here, or with hitboxes that are fitted once for all runs."""

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
