"""Drape: shadows of known outlines, and cloth that falls from a disc."""

import math
from itertools import islice

import numpy as np
import pytest

from cape import FABRICS, Cloth, Fabric, Scene, attach
from cape.cloth.fabrics import MEASUREMENTS
from cape.report.measured.world import drape, rest, triangulations
from cape.report.measured.world.drape import DISC, PEDESTAL
from cape.report.measured.world.forces import Forces
from cape.report.measured.world.rows import Row

CORNERS = 400
TURNS = 2.0 * math.pi * np.arange(CORNERS) / CORNERS


def skirt(radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A surface from the pedestal's edge to an outline of these radii, in evenly spaced directions, 5 cm lower."""
    angle = 2.0 * math.pi * np.arange(len(radii)) / len(radii)
    ways = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(radii))])
    top, hem = PEDESTAL * ways, radii[:, None] * ways - [0.0, 0.0, 0.05]
    here, ahead = np.arange(len(radii)), np.roll(np.arange(len(radii)), -1)
    below, below_ahead = here + len(radii), ahead + len(radii)
    triangles = np.concatenate([np.stack([here, below, ahead], 1), np.stack([ahead, below, below_ahead], 1)])
    return np.concatenate([top, hem]), triangles


@pytest.mark.parametrize("waves", [2, 5, 7])
def test_a_waved_outline_has_the_area_and_the_folds_of_its_waves(waves: int):
    middle, height = 0.12, 0.01
    radii = drape.shadow(*skirt(middle + height * np.cos(waves * TURNS)))
    # The mean of (m + h cos)^2 is m^2 + h^2 / 2; chords of 400 corners are 3e-5 of the radius inside.
    expected = (middle**2 + height**2 / 2.0 - PEDESTAL**2) / (DISC**2 - PEDESTAL**2)
    assert drape.coefficient(radii) == pytest.approx(expected, rel=5e-4)
    assert drape.folds(radii) == waves


def test_a_board_keeps_all_of_its_shadow_and_a_tube_none():
    board, tube = (drape.shadow(*skirt(np.full(CORNERS, radius))) for radius in (DISC, PEDESTAL))
    assert drape.coefficient(board) == pytest.approx(1.0, abs=5e-4)
    assert drape.coefficient(tube) == pytest.approx(0.0, abs=5e-4)
    assert drape.folds(board) == drape.folds(tube) == 0


def test_ripples_are_no_folds():
    height = drape.DEEP * (DISC - PEDESTAL) / 2.0
    assert drape.folds(drape.shadow(*skirt(0.12 + 0.9 * height * np.cos(9 * TURNS)))) == 0
    assert drape.folds(drape.shadow(*skirt(0.12 + 1.1 * height * np.cos(9 * TURNS)))) == 9


def test_a_hem_that_is_drawn_in_leaves_the_shadow_of_what_is_above_it():
    places, triangles = skirt(np.full(CORNERS, DISC))
    below = places[CORNERS:] * [0.7, 0.7, 1.0] - [0.0, 0.0, 0.05]
    both = np.concatenate([places, below])
    more = triangles + CORNERS  # from that hem to the one below
    assert drape.coefficient(drape.shadow(both, np.concatenate([triangles, more]))) == pytest.approx(1.0, abs=5e-4)


def test_cloth_as_stiff_as_a_board_lies_flat():
    fabric = Fabric(density=0.2, stretch=2000.0, shear=30.0, bend=0.02)
    found = drape.drape(fabric, "equilateral", 3)
    assert found.rested
    # A strip as long as the ring is wide sags by W g l^4 / 8 B = 0.16 mm; what that takes of 6 cm is far below 1e-3,
    # and the outline's polygon lacks 1 - sin(x) / x = 4e-4 of its disc, x = 2 pi / 126 being a corner's angle.
    assert found.coefficient == pytest.approx(100.0, abs=0.2)


def test_the_curvature_of_a_board_is_told_by_how_far_it_sags():
    bend, spacing = 0.02, 0.01
    fabric = Fabric(density=0.2, stretch=2e4, shear=1e4, bend=bend)
    piece = triangulations.ring("equilateral", PEDESTAL, DISC, spacing)
    places = np.column_stack([piece.points, np.zeros(len(piece.points))])
    cloth = Cloth.from_mesh(places, piece.triangles, pattern=piece.points, fabric=fabric)
    held = triangulations.held_by_ring(piece, PEDESTAL, spacing)
    simulation = rest.started(Scene(cloth, [attach(cloth, rest.HAND, held)]))
    assert rest.relax(simulation, Forces(cloth), within=1e-9)
    # What bends in proportion to its load holds half of the work that the load could do: by Clapeyron,
    # B k^2 A / 2 = W / 2. Stretched it is by the square of the sag, 0.16 mm, which is nothing.
    work = -9.81 * float(cloth.masses() @ simulation.positions[:, 2])
    expected = math.sqrt(work / (bend * math.pi * (DISC**2 - PEDESTAL**2)))
    assert drape.curvature(simulation) == pytest.approx(expected, rel=2e-3)


def test_friction_in_bending_stiffens_a_drape_and_without_it_a_start_is_always_the_same():
    fabric = Fabric(density=0.2, stretch=2000.0, shear=30.0, bend=0.02)
    first, again = islice(drape.rubbing(fabric, 0.0, spacing=0.02), 2)
    assert again == first
    _, second = islice(drape.rubbing(fabric, fabric.bend_warp * first.curvature, spacing=0.02), 2)
    # Twice as stiff, a board bends half as much.
    assert second.curvature == pytest.approx(0.5 * first.curvature, rel=0.01)


@pytest.mark.extra
def test_a_cloth_that_is_let_down_falls_in_as_many_folds_as_its_source_counts():
    measured = MEASUREMENTS["polyester-tropical"].folds
    assert measured == 5
    # Dropped, it stays in eight; one more or less is what starts and triangles make.
    found = drape.drape(FABRICS["polyester-tropical"], "random", 0, spacing=0.01)
    assert found.rested
    assert abs(found.folds - measured) <= drape.AGREE_FOLDS


def test_triangulations_agree_or_not():
    def rows(values: dict[str, float]) -> list[Row]:
        return [
            Row(
                test=drape.TEST, subject="felt", variant=kind, quantity=quantity, unit="", simulated=value, source="",
                starts=10,
            )
            for kind, value in values.items()
            for quantity in ("drape coefficient", "folds")
        ]  # fmt: skip

    values: dict[str, float] = dict(zip(triangulations.DISC_KINDS, (50.0, 50.5, 51.0, 51.5, 51.9), strict=True))
    coefficient, folds = drape.agreement(rows(values))
    assert coefficient.simulated == pytest.approx(1.9)
    assert coefficient.starts == 50
    assert coefficient.verdict == "passes"
    assert folds.verdict == "degrades"  # by more than one
    assert drape.agreement(rows({"random": 50.0})) == []
