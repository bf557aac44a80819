"""Fabrics: conversions against the sources' own models and units, and what is told of each."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from cape import FABRICS, MEASUREMENTS, Fabric
from cape.cloth import conversions
from cape.cloth.measurement import bending_lengths

# -- ARCSim's model, from its description: energies and forces of its own, with its tables for denim and an interlock --

STRETCHING = {
    "denim": [
        [205.352, 10.2341, 1013.89, 53.3872],
        [232.028, 40.6463, 1052.84, 64.9805],
        [224.592, 40.3846, 1054.43, 67.1848],
        [225.951, 62.0957, 1059.6, 83.992],
        [226.04, 40.5028, 1058.28, 75.1184],
        [225.767, 40.9179, 1051.56, 71.8106],
    ],
    "jersey": [
        [16.5938, -14.696, 34.4771, 36.8603],
        [46.3648, 53.6947, 261.014, -29.6913],
        [49.2851, 87.5961, 206.374, 22.7685],
        [123.989, 105.182, 365.966, 44.2176],
        [139.686, 73.5926, 413.553, -174.439],
        [127.444, 85.8486, 405.873, 32.2384],
    ],
}
BENDING = {
    "denim": [
        [64.1965, 60.2862, 60.9434, 62.4337, 19.8247],
        [73.3846, 59.672, 61.0808, 68.2426, 36.0335],
        [96.9516, 107.848, 113.061, 120.57, 79.781],
    ],
    "jersey": [
        [23.1917, 32.9322, 34.4065, 39.0144, 23.3828],
        [24.75, 18.6513, 16.3706, 25.0958, 8.86017],
        [14.2676, 7.05291, 14.5152, 24.6651, 19.3837],
    ],
}
DIGITS = 2e-5  # relative: the tables above have six


def moduli(table: list[list[float]], strain: np.ndarray) -> np.ndarray:
    """k00, k01, k11, k22 [N/m] at Green's strain: rows mixed by the larger principal stretch and its direction."""
    values, vectors = np.linalg.eigh(strain)
    share = np.clip(6.0 * (np.sqrt(2.0 * values[1] + 1.0) - 1.0), 0.0, 1.0)
    direction = np.degrees(np.arctan2(*np.abs(vectors[::-1, 1]))) / 22.5
    low = min(int(direction), 3)
    rows = np.array(table)
    strained = rows[1 + low] + (direction - low) * (rows[2 + low] - rows[1 + low])
    return 2.0 * np.maximum(rows[0] + share * (strained - rows[0]), 0.0)


CORNERS = np.array([[0.0, 0.0], [0.3, 0.0], [0.3, 0.2], [0.0, 0.2]])
HALVES = [(0, 1, 2), (0, 2, 3)]


def forces(table: list[list[float]], places: np.ndarray) -> np.ndarray:
    """On the corners of two triangles [N], (4, 2): minus the gradient of the energy, with its moduli held."""
    result = np.zeros_like(places)
    for triangle in HALVES:
        rest = np.diff(CORNERS[list(triangle)], axis=0).T
        inverse = np.linalg.inv(rest)
        gradient = np.diff(places[list(triangle)], axis=0).T @ inverse
        strain = (gradient.T @ gradient - np.eye(2)) / 2.0
        k = moduli(table, strain)
        # Of k0 G00^2 / 2 + k1 G00 G11 + k2 G11^2 / 2 + k3 G01^2, G01 and G10 having half of the last term each.
        stress = np.array(
            [
                [k[0] * strain[0, 0] + k[1] * strain[1, 1], k[3] * strain[0, 1]],
                [k[3] * strain[0, 1], k[1] * strain[0, 0] + k[2] * strain[1, 1]],
            ]
        )
        pull = -abs(np.linalg.det(rest)) / 2.0 * gradient @ stress @ inverse.T  # on either edge of the triangle
        for edge in (0, 1):
            result[triangle[edge + 1]] += pull[:, edge]
            result[triangle[edge]] -= pull[:, edge]
    return result


def tension(table: list[list[float]], gradient: np.ndarray, way: np.ndarray) -> float:
    """What the forces of a uniform deformation resist a further one `way` with, per area [N/m]."""
    work = np.sum(forces(table, CORNERS @ gradient.T) * (CORNERS @ way.T))
    return -float(work) / (0.3 * 0.2)


WAYS = {"c11": ([[1, 0], [0, 0]],) * 2, "c22": ([[0, 0], [0, 1]],) * 2, "c12": ([[1, 0], [0, 0]], [[0, 0], [0, 1]]),
        "shear": ([[0, 1], [0, 0]],) * 2}  # fmt: skip


@pytest.mark.parametrize("name", STRETCHING)
@pytest.mark.parametrize("figure", WAYS)
def test_arcsim_rows_are_what_its_forces_do_at_small_strain(name: str, figure: str):
    strained, resisting = (np.array(way, float) for way in WAYS[figure])
    step = 1e-6
    ends = [tension(STRETCHING[name], np.eye(2) + s * strained, resisting) for s in (-step, step)]
    plane = MEASUREMENTS[name].plane
    assert plane is not None
    # Of central differences by 1e-6 what the rows change by, 6 times the step on one side only, is the larger error.
    found = (ends[1] - ends[0]) / (2.0 * step)
    assert found == pytest.approx(getattr(plane, figure), rel=1e-3, abs=1e-2)


@pytest.mark.parametrize(("name", "strain"), [("denim", 1e-6), ("jersey", 0.05)])
@pytest.mark.parametrize("axis", [0, 1], ids=["weft", "warp"])
def test_a_fabric_stretches_as_arcsims_does_when_it_is_free_to_narrow(name: str, strain: float, axis: int):
    way, across = np.diag(np.eye(2)[axis]), np.diag(np.eye(2)[1 - axis])

    def deformed(narrowed: float) -> np.ndarray:
        return np.eye(2) + strain * way - narrowed * across

    def across_tension(narrowed: float) -> float:
        return tension(STRETCHING[name], deformed(narrowed), across)

    narrowed: Any = brentq(across_tension, -0.2 * strain, 3.0 * strain, xtol=1e-15)
    pull = tension(STRETCHING[name], deformed(narrowed), way)
    # The force along the thread is (1 + e) k G with Green's strain G = e + e^2 / 2.
    stiffness = pull / ((1.0 + strain) * (strain + strain**2 / 2.0))
    # Springs, and a membrane, couple both threads of a fabric by its shear.
    fabric = FABRICS[name]
    own, other = (fabric.stretch_weft, fabric.stretch_warp)[:: 1 - 2 * axis]
    assert stiffness == pytest.approx(own - fabric.shear**2 / other, rel=DIGITS)


def moment(table: list[list[float]], axis: int, curvature: float) -> float:
    """Moment per width [N] of a grid bent along an axis, from the force of its edges' angle, as ARCSim has it."""
    spacing, row = 0.005, np.array(table[2 * (1 - axis)]) * 1e-6  # edges along the other axis are bent around
    angle = curvature * spacing
    # Per edge of length l, beside triangles of area l d in all, k l^2 / (4 l d) theta for each unit of the angle, of
    # which there is one each d: per width, l. Diagonals stay flat.
    k = np.interp(angle / spacing, 10.0 * np.arange(5), row)
    return k / (4.0 * spacing) * angle


@pytest.mark.parametrize("name", BENDING)
@pytest.mark.parametrize("axis", [0, 1], ids=["weft", "warp"])
def test_a_fabric_bends_as_arcsims_does(name: str, axis: int):
    stiffness = [moment(BENDING[name], axis, kappa) / kappa for kappa in (1e-9, 10.0, 20.0)]
    fabric = FABRICS[name]
    assert np.mean(stiffness) == pytest.approx((fabric.bend_weft, fabric.bend_warp)[axis], rel=DIGITS)


def test_arcsims_hinge_energy_of_a_cylinder_is_that_of_its_rigidity():
    """With angles measured between the flat triangles of a bent grid, in three dimensions."""
    radius, cells, spacing, width = 0.4, 40, 0.005, 0.02
    k = BENDING["denim"][0][0] * 1e-6
    angle = np.arange(cells + 1) * spacing / radius
    arc = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    ways = np.diff(arc, axis=0)
    normals = np.stack([-ways[:, 1], ways[:, 0]], axis=1) / np.linalg.norm(ways, axis=1, keepdims=True)
    bent = np.arccos(np.clip((normals[1:] * normals[:-1]).sum(axis=1), -1.0, 1.0))
    area = width * np.linalg.norm(ways, axis=1)[0]
    energy = (k * width**2 * bent**2 / (8.0 * area)).sum()
    expected = k / 4.0 / (2.0 * radius**2) * area * (cells - 1)
    # Chords for arcs: (d / R)^2 / 12 of the energy, and the rounding of small angles' cosines.
    assert energy == pytest.approx(expected, rel=1e-4)


# -- units of the other tests --


def test_kes_units():
    """Worked by hand: the firm denim of Kumari and Khurana 2016, table 5, row C."""
    assert conversions.kes_bending(0.227) == pytest.approx(22.26e-6, rel=1e-3)
    assert conversions.kes_bending_friction(0.105) == pytest.approx(0.515e-3, rel=1e-3)
    assert conversions.kes_shear(3.398) == pytest.approx(190.9, rel=1e-3)
    assert conversions.kes_weight(16.29) == pytest.approx(0.1629)


def test_fast_rows_agree_with_themselves():
    """The source prints B and G beside what they follow from: 5.56 and 5.02 uN m, 26.17 N/m."""
    worsted = FABRICS["worsted"]
    assert 1e6 * worsted.bend_warp == pytest.approx(5.56, abs=0.005)
    assert 1e6 * worsted.bend_weft == pytest.approx(5.02, abs=0.005)
    assert worsted.shear == pytest.approx(26.17, abs=0.005)
    # Three times the first load between both, over 1.2 and 1.47 % of strain.
    np.testing.assert_allclose(worsted.stretch, [3 * 4.903 / 0.0120, 3 * 4.903 / 0.0147], rtol=1e-3)
    np.testing.assert_allclose(bending_lengths(worsted), [0.0150, 0.0145], rtol=1e-12)


# -- what is there --


def test_the_default_is_what_it_was():
    assert FABRICS["cape"] == Fabric()
    assert "cape" not in MEASUREMENTS
    assert (Fabric().density, Fabric().stretch, Fabric().shear, Fabric().bend) == (0.2, 2000.0, 200.0, 1e-5)


def test_fabrics_from_silk_to_leather():
    assert {"cape", "denim", "jersey", "ponte", "tablecloth", "twill", "worsted"} <= set(FABRICS)
    assert len(MEASUREMENTS) >= 12
    weights = [measured.fabric.density for measured in MEASUREMENTS.values()]
    assert min(weights) < 0.03
    assert max(weights) > 0.6


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_each_fabric_tells_its_source_and_can_be_made_of_springs(name: str):
    measured = MEASUREMENTS[name]
    assert FABRICS[name] is measured.fabric
    assert all((measured.material, measured.source.authors, measured.source.title, measured.place, measured.figures))
    given = Fabric()
    assert "damping times" in measured.filled
    for field in fields(Fabric):
        if "damping" in field.name:
            assert getattr(measured.fabric, field.name) == getattr(given, field.name)
    # Springs couple both threads by the shear: the energy of any strain is positive.
    assert measured.fabric.stretch_warp * measured.fabric.stretch_weft > measured.fabric.shear**2
    assert measured.fabric.shear < Fabric().shear
    if measured.plane is not None:
        warp, weft = measured.plane.poisson
        assert 0.0 <= warp * weft < 1.0


def test_what_was_measured_of_the_same_cloth_orders_drape_as_bending_length_does():
    known = [(bending_lengths(m.fabric)[0], m.drape) for m in MEASUREMENTS.values() if m.drape is not None]
    assert len(known) == 4
    # Those between, both tropicals, are as good as alike: 49.8 and 50.7 %.
    assert [drape for _, drape in sorted(known)] == sorted(drape for _, drape in known)
