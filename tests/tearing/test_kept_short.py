"""A cloth that tears while a limit of strain and tethers keep it short: both act on what is left,
and let go of the rest.

The fabric is so soft that its threads would be drawn out by 20 % without either.
"""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import cape
from cape.assembly.fabrics import HELD
from cape.assembly.geodesics import geodesic_distances
from cape.assembly.self_contact import connected_pieces
from cape.cloth.meshing import as_mesh
from tests.tearing.to_tear import IDENTITY, still

LIMIT, SLACK, G = 0.03, 0.01, 9.81
FRAME, SUBSTEPS = 1 / 60, 40
SOFT = cape.Fabric(density=0.2, stretch=6.0, shear=1.0, bend=1e-5, strain_limit=LIMIT)
GRID = cape.Cloth.rectangle(width=0.3, height=0.4, spacing=0.05, fabric=SOFT)
COLUMNS = GRID.columns
SLIT, REST = 4 * COLUMNS + np.arange(5), 4 * COLUMNS + np.arange(4, COLUMNS)  # together from border to border
SLIT_DOWN = np.array([3, COLUMNS + 3, 2 * COLUMNS + 3])
CLOTHS = {"grid": GRID, "mesh": as_mesh(GRID)}
BOTH = {"strain_limit": True, "tethers": cape.Tethers(slack=SLACK)}


def hung(
    kind: str,
    *,
    threads: int = 1,
    solver: cape.Solver | None = None,
    ledger: cape.Ledger | None = None,
    **keeping,
) -> cape.Simulation:
    cloth = CLOTHS[kind]
    scene = cape.Scene(cloth, [cape.attach(cloth, "rod", "top")], tearing=cape.Tearing(strain=1e3), **keeping)
    solver = solver or cape.SymplecticEuler(substeps=SUBSTEPS, precision="double")
    simulation = cape.Simulation(scene, solver=solver, threads=threads, ledger=ledger)
    simulation.start(still("rod"))
    return simulation


def strain(simulation: cape.Simulation, among: NDArray[np.bool_] | None = None) -> float:
    """The largest strain of the sides of cells, as the triangles and the pattern tell them."""
    triangles, parents = simulation.topology.triangles, simulation.topology.parents
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    way = np.diff(GRID.pattern[parents[ends]], axis=1)[:, 0]
    threads = np.abs(way).min(axis=1) < 1e-9
    if among is not None:
        threads &= among[ends].all(axis=1)
    places = simulation.positions[ends[threads]]
    return float((np.linalg.norm(np.diff(places, axis=1)[:, 0], axis=1) / np.abs(way[threads]).sum(axis=1)).max() - 1)


def loose(simulation: cape.Simulation) -> NDArray[np.bool_]:
    """Which vertices are in pieces that nothing holds."""
    topology = simulation.topology
    pieces = connected_pieces(topology.triangles, len(topology.parents))
    return ~np.isin(pieces, pieces[GRID.regions["top"]])


def ways(simulation: cape.Simulation) -> NDArray[np.float64]:
    """How far vertices are from what is held along what is left, by another way than tethers are measured."""
    assembly = simulation.assembly
    held = np.flatnonzero(~assembly.free & (assembly.mass > 0.0))
    distances, _ = geodesic_distances(assembly.cloth, held)
    return assembly.outwards(distances)


@cache
def torn(kind: str, threads: int = 1) -> tuple[cape.Simulation, list[tuple[float, float]], list[NDArray[np.float64]]]:
    """One that is slit, then slit from where it is held, then loses all below: strains and tethers, and how that falls.

    Of each frame the largest strain of what hangs, and how much farther than tethers let it any of that is [m]; then
    the middle of what comes off, frame by frame from then on.
    """
    simulation = hung(kind, threads=threads, **BOTH)
    kept, fallen, along = [], [], ways(simulation)
    for frame in range(40):
        for cut, at in ((SLIT, 10), (SLIT_DOWN, 15), (REST, 20)):
            if frame == at:
                simulation.tear(cut)
                along = ways(simulation)
        off, mass = loose(simulation), simulation.assembly.outwards(simulation.assembly.mass)
        if off.any():
            state = np.hstack([simulation.positions, simulation.velocities])[off]
            fallen.append(mass[off] @ state / mass[off].sum())
        simulation.step(still("rod"), FRAME)
        away = np.linalg.norm(simulation.positions[:, None] - simulation.positions[GRID.regions["top"]], axis=2)
        beyond = away.min(axis=1) - (1.0 + SLACK) * along
        kept.append((strain(simulation, ~off), float(beyond[~off].max())))
    return simulation, kept, fallen


def test_without_either_it_is_drawn_out():
    simulation = hung("grid")
    for _ in range(9):  # a quarter of its swing
        simulation.step(still("rod"), FRAME)
    assert strain(simulation) > 5 * LIMIT


@pytest.mark.parametrize("kind", CLOTHS)
def test_what_still_hangs_stays_within_its_limit_and_its_tethers(kind):
    _, kept, _ = torn(kind)
    strains, beyond = np.array(kept).T
    assert strains.max() < LIMIT
    assert strains[10:20].max() > HELD * LIMIT  # which it needs once a slit lets tethers out
    # Contact and limit come after the tethers in a substep, and may undo as much as one sweep of theirs takes.
    assert beyond.max() < 1e-3


@pytest.mark.parametrize("kind", CLOTHS)
def test_what_comes_off_falls_freely(kind):
    simulation, _, fallen = torn(kind)
    assert loose(simulation).any()
    begin, time = fallen[0], FRAME * np.arange(len(fallen))
    # Symplectic Euler is ahead of g t^2 / 2 by g t h / 2.
    drop = G * (time**2 + time * FRAME / SUBSTEPS) / 2.0
    expected = begin[:3] + time[:, None] * begin[3:] - drop[:, None] * np.array([0.0, 0.0, 1.0])
    assert time[-1] > 0.3
    assert drop[-1] > 0.4
    assert np.allclose(np.array(fallen)[:, :3], expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("kind", CLOTHS)
def test_threads_of_a_team_tear_it_alike(kind):
    one, two = torn(kind)[0], torn(kind, threads=2)[0]
    assert np.array_equal(one.positions, two.positions)
    assert np.array_equal(one.topology.triangles, two.topology.triangles)


@pytest.mark.parametrize("solver", [cape.XPBD(substeps=SUBSTEPS), cape.BackwardEuler(substeps=8)])
def test_other_solvers_let_go_of_it_too(solver: cape.Solver):
    simulation = hung("grid", solver=solver, **BOTH)
    strains, fallen = [], []
    for frame in range(20):
        for cut, at in ((SLIT, 4), (REST, 8)):
            if frame == at:
                simulation.tear(cut)
        off, mass = loose(simulation), simulation.assembly.outwards(simulation.assembly.mass)
        if off.any():
            fallen.append(mass[off] @ np.stack([simulation.positions, simulation.velocities])[:, off, 2].T)
            fallen[-1] /= mass[off].sum()
        simulation.step(still("rod"), FRAME)
        strains.append(strain(simulation, ~off))
    assert solver.substeps is not None
    assert 0.99 * HELD * LIMIT < max(strains) < LIMIT
    time = FRAME * (len(fallen) - 1)
    # Both are of first order, ahead as symplectic Euler is; positions are in single precision.
    drop = G * (time**2 + time * FRAME / solver.substeps) / 2.0
    assert fallen[-1][0] == pytest.approx(fallen[0][0] + time * fallen[0][1] - drop, abs=1e-5)


def drawn_apart(kind: str, threads: int, force: float) -> cape.Simulation:
    """One that is held by two ends, which part until it does."""
    cloth = CLOTHS[kind]
    holds = [cape.attach(cloth, "rod", "top"), cape.attach(cloth, "hook", "bottom")]
    keeping = {"strain_limit": True, "tethers": cape.Tethers(slack=0.2)}
    simulation = cape.Simulation(
        cape.Scene(cloth, holds, tearing=cape.Tearing(force=force), **keeping), threads=threads
    )
    simulation.start(still("rod", "hook"))
    for frame in range(1, 20):
        simulation.step({**still("rod"), "hook": ([0.0, 0.0, -0.003 * frame], IDENTITY)}, FRAME)
    return simulation


def test_it_parts_by_itself_below_its_limit_the_same_on_all_threads():
    # 6 N/m times 2 %.
    one, two = (drawn_apart("grid", threads, 0.12) for threads in (1, 2))
    assert one.tears == two.tears >= COLUMNS - 1
    assert np.array_equal(one.positions, two.positions)
    assert strain(one) < LIMIT


def test_a_ledger_closes_where_what_is_kept_short_tears():
    ledger = cape.Ledger()
    simulation = hung("grid", ledger=ledger, **BOTH)
    for frame in range(20):
        for cut, at in ((SLIT, 4), (REST, 12)):
            if frame == at:
                simulation.tear(cut)
        simulation.step(still("rod"), FRAME)
    balance = ledger.balance
    assert balance.limit[-1] < 0.0
    assert balance.gap < 1e-3
    assert balance.moved[-1] == pytest.approx(-simulation.released, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("kind", CLOTHS)
def test_tethers_lead_around_a_slit_and_let_go_of_what_is_off(kind):
    simulation = hung(kind, **BOTH)
    before = ways(simulation)
    for cut in (SLIT, REST):
        simulation.tear(cut)
        tethers, now = simulation.assembly.tethers, ways(simulation)
        assert tethers is not None
        lengths = simulation.assembly.outwards(tethers.length)
        assert np.allclose(lengths, (1.0 + SLACK) * now, rtol=1e-14)
        off = loose(simulation)
        assert (simulation.assembly.outwards(tethers.anchor)[off] == -1).all()
        assert np.array_equal(np.isinf(now), off)
        if cut is SLIT:
            below = 5 * COLUMNS  # next to the border from which it is slit
            assert not off.any()
            assert now[below] > 1.3 * before[below]
    assert off.sum() == 5 * COLUMNS


def test_a_grid_that_gets_more_room_keeps_its_limit_and_tethers():
    simulation = hung("grid", **BOTH)
    room = simulation.assembly.cloth.vertices
    for row in range(2, GRID.rows - 1):
        simulation.tear(row * COLUMNS + np.arange(COLUMNS))
    assembly, strays = simulation.assembly, simulation._started.running.strays
    assert assembly.cloth.vertices > room
    assert assembly.tethers is not None
    assert strays is not None
    assert np.allclose(assembly.outwards(assembly.tethers.length), (1.0 + SLACK) * ways(simulation), rtol=1e-14)
    # Cells under a torn row have its side of their own, and two sides that lead down from it.
    assert strays.counts[0] == 3 * (GRID.rows - 3) * (COLUMNS - 1)


def test_threads_that_no_limit_could_keep_are_limited_again_after_a_tear():
    simulation = hung("grid", strain_limit=True)
    cloth = simulation._started
    cloth.limit.acts = False
    simulation.tear(np.concatenate([SLIT, REST[1:]]))
    strays = cloth.running.strays
    assert strays is not None
    count = int(strays.counts[0])
    assert count > 0
    assert np.isinf(strays.links.longest[:count]).all()
    cloth.limit.acts = True
    assert np.allclose(strays.links.longest[:count], (1.0 + HELD * LIMIT) * 0.05)
    # Nothing joins the row of the tear to the one below any more but what is astray.
    longest = cloth.running.longest
    assert longest is not None
    assert np.isinf(longest[1, SLIT]).all()
    assert np.isfinite(longest[1, SLIT - COLUMNS]).all()
