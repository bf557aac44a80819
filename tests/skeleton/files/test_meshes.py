"""Meshes of links as files have them: scaled, mirrored, in other units, with Y up, in folders of other names."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from skeleton import LinkSurface, Skeleton, link_surfaces

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
VOLUME = 1.0  # a sixth of the box around it
ROUNDING = 1e-6  # m: meshes are stored in single precision
MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def hinge(name: str, above: str, link: str, at: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{above}"/><child link="{link}"/><origin xyz="{at}"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="2"/></joint>'
    )


def surface_of(folder: Path, mesh: str, scale: str = "1 1 1", tip: str = "0 0 0") -> LinkSurface:
    """The surface of a link that is one mesh, with the next joint at its tip."""
    piece = f'<visual><geometry><mesh filename="{mesh}" scale="{scale}"/></geometry></visual>'
    (folder / "robot.urdf").write_text(
        f'<robot name="r"><link name="base">{MASS}</link><link name="rod">{MASS}{piece}</link><link name="end">{MASS}'
        f"</link>{hinge('first', 'base', 'rod', '0 0 0')}{hinge('second', 'rod', 'end', tip)}</robot>"
    )
    (surface,) = link_surfaces(Skeleton.from_urdf(folder / "robot.urdf"), "visual")
    return surface


def collada(path: Path, up: str = "Z_UP", unit: float = 1.0) -> None:
    """The tetrahedron as a Collada file."""
    numbers, corners = " ".join(map(str, CORNERS.ravel())), " ".join(map(str, FACES.ravel()))
    axes = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    path.write_text(
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
        f'<unit name="unit" meter="{unit}"/><up_axis>{up}</up_axis></asset><library_geometries><geometry id="g"><mesh>'
        f'<source id="p"><float_array id="pa" count="12">{numbers}</float_array><technique_common>'
        f'<accessor source="#pa" count="4" stride="3">{axes}</accessor></technique_common></source><vertices id="v">'
        '<input semantic="POSITION" source="#p"/></vertices><triangles count="4">'
        f'<input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles></mesh></geometry>'
        '</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/>'
        '</node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 2, 2), (0.001, 0.001, 0.001), (1, -1, 1), (-1, -1, -2), (-1, -1, 1)])
@pytest.mark.parametrize("ending", ["stl", "obj"])
def test_a_mesh_has_its_scale_and_its_outside_outside(tmp_path, ending, scale):
    trimesh.Trimesh(CORNERS, FACES).export(tmp_path / f"mesh.{ending}")
    surface = surface_of(tmp_path, f"mesh.{ending}", " ".join(map(str, scale)))
    scaled = CORNERS * scale
    assert np.abs(surface.vertices.min(axis=0) - scaled.min(axis=0)).max() < ROUNDING
    assert np.abs(surface.vertices.max(axis=0) - scaled.max(axis=0)).max() < ROUNDING
    # Positive where faces are counterclockwise seen from outside.
    volume = trimesh.Trimesh(surface.vertices, surface.triangles, process=False).volume
    assert volume == pytest.approx(VOLUME * abs(np.prod(scale)), rel=1e-6)


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.0254])
def test_a_unit_of_a_mesh_counts(tmp_path, unit):
    collada(tmp_path / "mesh.dae", unit=unit)
    surface = surface_of(tmp_path, "mesh.dae", "2 2 2")
    assert np.ptp(surface.vertices, axis=0) == pytest.approx(2.0 * unit * np.array([1.0, 2.0, 3.0]), rel=1e-6)


@pytest.mark.parametrize("up", ["Y_UP", "Z_UP"])
@pytest.mark.parametrize(("tip", "turned"), [("0 0 3", False), ("0 -3 0", True)])
def test_a_mesh_with_y_up_is_turned_where_the_next_joint_says_so(tmp_path, up, tip, turned):
    """A quarter about x brings y to z and z to -y."""
    collada(tmp_path / "mesh.dae", up=up)
    surface = surface_of(tmp_path, "mesh.dae", tip=tip)
    expected = CORNERS[:, [0, 2, 1]] * [1.0, -1.0, 1.0] if turned and up == "Y_UP" else CORNERS
    assert np.abs(surface.vertices.min(axis=0) - expected.min(axis=0)).max() < ROUNDING
    assert np.abs(surface.vertices.max(axis=0) - expected.max(axis=0)).max() < ROUNDING


@pytest.mark.parametrize("where", ["beside", "other name", "ros", "ament"])
def test_a_mesh_is_found_in_its_package(tmp_path, monkeypatch, where):
    """Above the robot's file, in a folder that a download has renamed, or where ROS keeps packages."""
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    places = {"beside": "walker", "other name": "walker-main", "ros": "ros/walker", "ament": "ament/share/walker"}
    meshes, robots = tmp_path / places[where] / "meshes", tmp_path / "elsewhere"
    meshes.mkdir(parents=True)
    if where in ("beside", "other name"):
        robots = meshes.parent / "urdf"
    robots.mkdir()
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros") if where == "ros" else "")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament") if where == "ament" else "")
    trimesh.Trimesh(CORNERS, FACES).export(tmp_path / "mesh.stl")
    shutil.move(tmp_path / "mesh.stl", meshes / "mesh.stl")
    surface = surface_of(robots, "package://walker/meshes/mesh.stl")
    assert np.ptp(surface.vertices, axis=0) == pytest.approx([1.0, 2.0, 3.0])
