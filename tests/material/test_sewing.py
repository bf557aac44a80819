"""Panels sewn together: against the same cloth in one piece, however they lie, and what a seam joins."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cape
from cape.assembly.mesh.springs import mesh_springs
from cape.cloth.cloth import areas
from cape.cloth.sewing import Panel, sewn
from cape.cloth.triangle_mesh import edges_of
from motions import quaternions

FABRIC = cape.Fabric(stretch=(900.0, 400.0), shear=30.0, bend=(8e-6, 3e-6))


def panel(across: np.ndarray, down: np.ndarray, *, mirrored: bool = False, **options: Any) -> Panel:
    """A flat panel in the plane x = 0: `across` [m] to the right (or, with its threads alone, to the left), `down`."""
    u, v = np.meshgrid(across, down)
    threads = np.stack([-u if mirrored else u, v], axis=-1)
    layers = np.ones((len(down) - 1, len(across) - 1))
    return Panel(places=np.stack([0.0 * u, -u, -v], axis=-1), threads=threads, layers=layers, **options)


def borders(cloth: cape.MeshCloth) -> int:
    return int((edges_of(cloth.triangles).triangles == 1).sum())


@pytest.mark.parametrize("mirrored", [False, True])
def test_two_panels_are_as_one(mirrored: bool):
    """A sheet of 4 x 3 cells in two panels, the threads of one counted the other way round."""
    across, down = np.linspace(0.0, 0.4, 5), np.linspace(0.0, 0.3, 4)
    whole = sewn([panel(across, down)], fabric=FABRIC)
    halves = sewn([panel(across[:3], down), panel(across[2:], down, mirrored=mirrored)], fabric=FABRIC)
    assert halves.vertices == whole.vertices == 20
    assert borders(halves) == borders(whole) == 14
    assert halves.masses().sum() == pytest.approx(0.4 * 0.3 * FABRIC.density, rel=1e-12)
    # Stretched along the weft, along the warp, and sheared: the same energy, whichever way diagonals lean.
    for change in ([[1.02, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 1.02]], [[1.0, 0.02], [0.0, 1.0]]):
        energies = []
        for cloth in (whole, halves):
            moved = cloth.positions.copy()
            moved[:, 1:] = moved[:, 1:] @ np.array(change).T
            springs = mesh_springs(cloth)
            lengths = np.linalg.norm(moved[springs.second] - moved[springs.first], axis=1)
            energies.append(0.5 * float(springs.stiffness @ (lengths - springs.rest) ** 2))
        assert energies[1] == pytest.approx(energies[0], rel=1e-9)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.floats(0.5, 2.0))
def test_threads_are_the_panel_s_own_wherever_it_lies(turn, scale):
    """Turned in space, and with thread coordinates of another scale, triangles lie flat as they did."""
    across, down = np.array([0.0, 0.1, 0.25]), np.array([0.0, 0.07, 0.2])
    flat = panel(across, down)
    rotation = quaternions.from_rotation_vector(np.array(turn))
    moved = Panel(
        places=quaternions.rotate(rotation, flat.places.reshape(-1, 3)).reshape(3, 3, 3),
        threads=scale * flat.threads,
        layers=flat.layers,
    )
    one, other = (sewn([p], fabric=FABRIC) for p in (flat, moved))
    np.testing.assert_allclose(other.corners, one.corners, atol=1e-12)
    # Weft is across, warp is down, as the panel was laid out.
    laid = np.stack([-one.positions[:, 1], -one.positions[:, 2]], axis=1)[one.faces]
    np.testing.assert_allclose(np.abs(one.corners), np.abs(laid - laid[:, :1]), atol=1e-12)


@given(st.integers(4, 12), st.floats(0.0, 0.3))
def test_ends_that_meet_make_a_ring_that_faces_outwards(around, flare):
    angles = np.linspace(0.0, 2.0 * np.pi, around + 1)
    rows = np.arange(4)
    radii = 0.3 + flare * 0.1 * rows[:, None]
    x, y, z = np.broadcast_arrays(radii * np.cos(angles), radii * np.sin(angles), -0.1 * rows[:, None])
    places = np.stack([x, y, z], axis=-1)
    threads = np.array(np.stack(np.meshgrid(angles, 0.1 * rows), axis=-1), dtype=float)
    index = np.arange(places[..., 0].size).reshape(places.shape[:2])
    ring = sewn(
        [Panel(places=places, threads=threads, layers=np.ones((3, around)), regions={"hem": index[-1]})], fabric=FABRIC
    )
    assert ring.vertices == 4 * around
    assert borders(ring) == 2 * around  # of the two rims alone
    assert len(ring.region("hem")) == around  # the vertex of the seam once
    corners = ring.positions[ring.faces]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum(outwards * corners.mean(axis=1), axis=1) > 0.0).all()
    # Each triangle is as large flat as in space.
    assert areas(ring.corners) == pytest.approx(np.linalg.norm(outwards, axis=1) / 2.0, rel=1e-9)


def test_what_is_cut_out_is_in_no_triangle_and_no_region():
    line = np.linspace(0.0, 0.5, 6)
    kept = np.ones((5, 5), dtype=bool)
    kept[1:4, 1:4] = False  # leaves four vertices in its middle to no cell
    cloth = sewn([panel(line, line, kept=kept, regions={"all": np.arange(36)})], fabric=FABRIC)
    assert cloth.vertices == len(cloth.region("all")) == 36 - 4
    assert len(cloth.faces) == 2 * (25 - 9)
    assert borders(cloth) == 20 + 12


def test_layers_go_with_their_cells():
    line = np.linspace(0.0, 0.2, 3)
    flat = panel(line, line)
    thick = Panel(places=flat.places, threads=flat.threads, layers=np.array([[1.0, 2.0], [3.0, 4.0]]))
    cloth = sewn([thick], fabric=FABRIC)
    middles = cloth.positions[cloth.faces].mean(axis=1)
    expected = 1.0 + (middles[:, 1] < -0.1) + 2.0 * (middles[:, 2] < -0.1)
    np.testing.assert_array_equal(cloth.layers, expected)
