"""Outfits of several fabrics that tear: each part by what its own fabric bears, with its own mass."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import cape
from cape.outfits.combined import Outfit, combined
from tests.tearing.to_tear import FABRIC, IDENTITY, mesh_of, still

WIDTH, LENGTH, PULL = 0.2, 0.4, 0.0002  # m; the last in each frame
FORCE = 40.0  # N/m
# As of a strip of one fabric (`tests.tearing.test_strip`): of a frame, of clamps, and of strains at 2 % at most.
TOLERANCE = 1 / 40 + 0.01 + 1.5 * 0.02
WEAK = replace(FABRIC, stretch=(2000.0, 3000.0), density=0.15)  # N/m along warp and weft
STRONG = replace(FABRIC, stretch=(3000.0, 2000.0), density=0.25, damping_time=2e-4)


def strips(along: str, fabrics: tuple[cape.Fabric, ...] = (WEAK, STRONG)) -> tuple[Outfit, list[NDArray[np.int64]]]:
    """Two strips of 20 x 40 cm, the second one behind the first, long along warp or weft; and their clamped ends."""
    size = {"width": WIDTH, "height": LENGTH} if along == "warp" else {"width": LENGTH, "height": WIDTH}
    sheets = [mesh_of(cape.Cloth.rectangle(**size, spacing=0.05, fabric=fabric)) for fabric in fabrics]
    starts = [sheet.positions + np.array([k, 0.0, 0.0]) for k, sheet in enumerate(sheets)]
    outfit = combined(["one", "other"][: len(sheets)], sheets, starts)
    sides = ("top", "bottom") if along == "warp" else ("left", "right")
    ends = [np.concatenate([outfit.region(f"{part.name}.{side}") for part in outfit.parts]) for side in sides]
    return outfit, ends


def drawn(
    along: str, tearing: cape.Tearing, frames: int, *, solver: str = "euler", threads: int = 1, **options: int
) -> tuple[cape.Simulation, list[float]]:
    """Both drawn apart alike, slowly; and the strain at which the first edge of each parts, infinite for none."""
    outfit, (held, pulled) = strips(along)
    holds = [cape.attach(outfit, "rod", held), cape.attach(outfit, "hook", pulled)]
    scene = cape.Scene(outfit, holds, gravity=(0.0, 0.0, 0.0), tearing=tearing)
    simulation = cape.Simulation(scene, solver=cape.solver(solver, **options), threads=threads)
    simulation.start(still("rod", "hook"))
    way = np.array([0.0, 0.0, -1.0]) if along == "warp" else np.array([0.0, -1.0, 0.0])
    strains = [np.inf, np.inf]
    for frame in range(1, frames + 1):
        simulation.step({**still("rod"), "hook": (frame * PULL * way, IDENTITY)}, 1 / 30)
        split = simulation.topology.parents[outfit.vertices :]
        for k, part in enumerate(outfit.parts):
            torn = (split >= part.vertices.start) & (split < part.vertices.stop)
            if torn.any():
                strains[k] = min(strains[k], frame * PULL / LENGTH)
    return simulation, strains


@pytest.mark.parametrize("along", ["warp", "weft"])
@pytest.mark.parametrize("solver", ["euler", "tr_bdf2"])
def test_each_parts_at_the_strain_at_which_its_own_threads_bear_too_much(along: str, solver: str):
    """Force per width over the stiffness of those threads: 2 % and 1.33 %, and the other way round along the weft."""
    _, strains = drawn(along, cape.Tearing(force=FORCE), 44, solver=solver)
    stiffness = (2000.0, 3000.0) if along == "warp" else (3000.0, 2000.0)
    for strain, of in zip(strains, stiffness, strict=True):
        assert strain == pytest.approx(FORCE / of, rel=TOLERANCE)


def test_of_two_that_are_drawn_alike_only_that_parts_which_bears_too_much():
    """Halfway between both thresholds of strain."""
    frames = round(0.5 * (FORCE / 2000.0 + FORCE / 3000.0) * LENGTH / PULL)
    simulation, strains = drawn("warp", cape.Tearing(force=FORCE), frames)
    assert simulation.tears > 0
    assert np.isfinite(strains[1])
    assert np.isinf(strains[0])


def test_masses_stay_those_of_each_fabric():
    simulation, _ = drawn("warp", cape.Tearing(force=FORCE), 44)
    assert simulation.tears > 4
    outfit, parents = simulation.scene.cloth, simulation.topology.parents
    mass = simulation.assembly.outwards(simulation.assembly.mass)
    assert mass.min() > 0.0
    assert isinstance(outfit, Outfit)
    for part, fabric in zip(outfit.parts, (WEAK, STRONG), strict=True):
        own = (parents >= part.vertices.start) & (parents < part.vertices.stop)
        assert mass[own].sum() == pytest.approx(fabric.density * WIDTH * LENGTH, rel=1e-9)


@pytest.mark.parametrize("solver", ["euler", "xpbd", "backward_euler"])
def test_they_tear_with_the_same_bits_on_any_number_of_threads(solver: str):
    runs = [
        drawn(
            "warp",
            cape.Tearing(force=FORCE),
            36,
            solver=solver,
            threads=threads,
            substeps=40 if solver != "euler" else 60,
        )
        for threads in (1, 2)
    ]
    (one, _), (two, _) = runs
    assert one.tears == two.tears > 0
    np.testing.assert_array_equal(one.positions, two.positions)
    np.testing.assert_array_equal(one.topology.triangles, two.topology.triangles)
