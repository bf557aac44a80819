"""The drape test of Cusick (BS 5058): a disc of cloth lies on a smaller one, and its shadow from above is measured.

The drape coefficient is the share of the free ring that is left in the shadow: 1 for a board, 0 for cloth that hangs
straight down. The cloth is flat where the discs hold it, and what is free is let down from there, set out with a little
noise: its weight comes on by and by (`WEIGHTS`); by the first it falls, and at each it comes to rest.

How it is let down matters, since a cloth can rest in more or in fewer folds: of one that is dropped the hem buckles
finely while it falls, and stays in up to twice the folds that laboratories count. That the number of folds, and with it
the coefficient, depends on the state from which a cloth sets out they find too (Jeong and Phillips 1998, "A study of
fabric-drape behaviour with image analysis, part I", abstract).

Fibres rub on each other as cloth bends: its moment per width is B k + H on the way to a curvature k, where 2 H is the
width of the loop that KES measures. That is not simulated, but what it is worth at most can be told
(`with_friction`): at the root mean square k of its own curvature a cloth that bends ever more is as stiff as B + H / k,
were H there from the first bend on. What is measured should lie between that and a drape without friction.
"""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS, MEASUREMENTS
from cape.cloth.fabrics import fabric as fabric_named
from cape.cloth.measurement import bending_lengths
from cape.forces.elastic import Elastic
from cape.report.measured.world import triangulations
from cape.report.measured.world.forces import Forces
from cape.report.measured.world.rest import HAND, fall, relax, started
from cape.report.measured.world.rows import Row, mean, scatter
from cape.run.simulation import Simulation
from cape.run.whereabouts import Diverged
from cape.scene.holding.attachments import attach
from cape.scene.scene import GRAVITY, Scene
from cape.solvers.threads import available_cores

FloatArray = NDArray[np.float64]

TEST = "drape"
DISC, PEDESTAL = 0.15, 0.09  # m, radii of cloth and support
SPACING, FINER = 0.0075, 0.0055  # m, of all drapes, and of some to tell what the spacing is worth
NOISE = 1e-4  # m, standard deviation of the heights from which a cloth sets out
WEIGHTS = (0.125, 0.25, 0.5, 1.0)  # shares of its weight that a cloth is let down by
FALLS = 100  # steps at most in which a cloth falls by the first of them, 0.5 s
DIRECTIONS = 720  # in which the shadow's radius is measured
DEEP = 0.05  # of the free ring's width, by which a fold stands out at least
ALLOWED = 5.0  # points
AGREE, AGREE_FOLDS = 2.0, 1.0  # points, folds: between triangulations
STARTS = 10
SINGLE = "random"  # the triangulation of tests on one alone
RUBBING, RUBBED = "with friction", 0.01  # and the spacing of such drapes [m]
ROUNDS = 4  # of draping, in each as stiff as friction makes a cloth of the curvature that it had in the one before
APART = "apart"  # how far triangulations lie from each other
NOT_MEASURED = "no measured drape of this fabric is known: its source gives none"
GEOMETRY = "; the disc sizes are not in the transcription, and are taken as Cusick's"


@dataclass(frozen=True)
class Draped:
    """A draped cloth.

    Attributes:
        coefficient: share of the free ring in the shadow [%].
        folds: how many.
        rested: whether it came to rest.
        curvature: root mean square over the free ring [1/m].
    """

    coefficient: float
    folds: int
    rested: bool
    curvature: float


def measure(name: str, kind: str, starts: int, *, spacing: float = SPACING) -> list[Row]:
    """Drape a fabric on a triangulation from several starts: its coefficient [%] and folds, the means."""
    fabric = fabric_named(name)
    variant = kind if spacing == SPACING else f"{kind}, {1e3 * spacing:g} mm"
    result, found = "finished", []
    try:
        found = [drape(fabric, kind, 0, spacing=spacing)]  # compiles what all need
        with ThreadPoolExecutor(available_cores()) as pool:
            found += pool.map(lambda seed: drape(fabric, kind, seed, spacing=spacing), range(1, starts))
        if not all(draped.rested for draped in found):
            result = f"{sum(not draped.rested for draped in found)} of {starts} do not come to rest"
    except Diverged as error:
        result = f"diverged: {error}"
    return _rows(name, variant, found, result=result, allowed=ALLOWED)


def with_friction(name: str) -> list[Row]:
    """Drape a fabric whose friction in bending was measured as stiffly as that makes it; what comes out is not judged.

    Raises:
        UnknownNameError: there is no such fabric.
    """
    fabric, friction = fabric_named(name), MEASUREMENTS[name].bend_friction or 0.0
    *_, last = rubbing(fabric, friction)  # stiffer each time, and ever less so
    return _rows(name, RUBBING, [last], result="finished" if last.rested else "does not come to rest", allowed=math.nan)


def rubbing(fabric: Fabric, friction: float, *, spacing: float = RUBBED) -> Iterator[Draped]:
    """Drape a fabric without friction, then as stiff as friction [N] makes one of the curvature that it had last."""
    draped = drape(fabric, SINGLE, 0, spacing=spacing)
    yield draped
    for _ in range(ROUNDS - 1):
        more = friction / draped.curvature
        stiff = replace(fabric, bend=(fabric.bend_warp + more, fabric.bend_weft + more))
        draped = drape(stiff, SINGLE, 0, spacing=spacing)
        yield draped


def _rows(name: str, variant: str, found: list[Draped], *, result: str, allowed: float) -> list[Row]:
    """The figures of drapes of a fabric, next to what was measured."""
    measurement = MEASUREMENTS.get(name)
    expected = math.nan if measurement is None or measurement.drape is None else 100.0 * measurement.drape
    folds = math.nan if measurement is None or measurement.folds is None else float(measurement.folds)
    source = NOT_MEASURED if measurement is None or math.isnan(expected) else str(measurement.source) + GEOMETRY
    return [
        Row(
            test=TEST, subject=name, variant=variant, quantity=quantity, unit=unit, simulated=mean(values),
            scatter=scatter(values), starts=len(found), expected=wanted, allowed=most, result=result, source=source,
        )
        for quantity, unit, values, wanted, most in (
            ("drape coefficient", "%", [draped.coefficient for draped in found], expected, allowed),
            ("folds", "", [float(draped.folds) for draped in found], folds, math.nan),
        )
    ]  # fmt: skip


def agreement(rows: list[Row]) -> list[Row]:
    """How far the means of a fabric's drapes on all triangulations lie apart."""
    result = []
    for name in dict.fromkeys(row.subject for row in rows):
        for quantity, allowed in (("drape coefficient", AGREE), ("folds", AGREE_FOLDS)):
            mine = [
                row
                for row in rows
                if row.subject == name and row.quantity == quantity and row.variant in triangulations.DISC_KINDS
            ]
            if len(mine) < len(triangulations.DISC_KINDS):
                continue
            values = [row.simulated for row in mine]
            broken = [row.result for row in mine if row.result != "finished"]
            result.append(
                Row(
                    test=TEST, subject=name, variant=APART, quantity=quantity, unit=mine[0].unit,
                    simulated=max(values) - min(values), starts=sum(row.starts for row in mine), expected=0.0,
                    allowed=allowed, result=broken[0] if broken else "finished",
                    source="a fabric's drape does not depend on its triangulation",
                )
            )  # fmt: skip
    return result


def softest_and_stiffest() -> tuple[str, str]:
    """The fabrics of the shortest and the longest bending length, by the geometric mean of warp and weft."""
    order = sorted(FABRICS, key=lambda name: math.prod(bending_lengths(FABRICS[name])))
    return order[0], order[-1]


def drape(fabric: Fabric, kind: str, seed: int, *, spacing: float = SPACING) -> Draped:
    """Let down a ring of cloth, on a kind of triangulation, from one start, which the seed chooses."""
    piece = triangulations.ring(kind, PEDESTAL, DISC, spacing)
    held = triangulations.held_by_ring(piece, PEDESTAL, spacing)
    heights = np.random.default_rng(seed).normal(0.0, NOISE, len(piece.points))
    heights[held] = 0.0
    places = np.column_stack([piece.points, heights])
    cloth = Cloth.from_mesh(places, piece.triangles, pattern=piece.points, fabric=fabric)
    forces, rested, curved = Forces(cloth), True, 0.0
    for weight in WEIGHTS:
        cloth = replace(cloth, positions=places)
        scene = Scene(cloth, [attach(cloth, HAND, held)], gravity=(0.0, 0.0, weight * GRAVITY[2]))
        simulation = started(scene)
        if weight == WEIGHTS[0]:
            fall(simulation, FALLS)
        rested = rested and relax(simulation, forces)
        places, curved = simulation.positions, curvature(simulation)
    radii = shadow(places, piece.triangles)
    return Draped(100.0 * coefficient(radii), folds(radii), rested, curved)


def curvature(simulation: Simulation) -> float:
    """Root mean square curvature of a draped ring [1/m], told by the energy of its bending: B k^2 / 2 per area."""
    fabric = simulation.scene.cloth.fabric
    assembly = simulation.assembly
    held = Elastic.energy_of_bending(assembly, assembly.inwards(simulation.positions))
    area = math.pi * (DISC**2 - PEDESTAL**2)
    return math.sqrt(2.0 * held / (math.sqrt(fabric.bend_warp * fabric.bend_weft) * area))


def coefficient(radii: FloatArray) -> float:
    """Drape coefficient, as a share, of a shadow with these radii in evenly spaced directions [m]."""
    return float((np.mean(radii**2) - PEDESTAL**2) / (DISC**2 - PEDESTAL**2))


def shadow(places: FloatArray, triangles: NDArray[np.integer]) -> FloatArray:
    """Radii of the shadow that triangles cast straight down [m], in `DIRECTIONS` around the world's Z, from X on.

    It is where each ray last leaves an edge: a bay under an overhanging fold counts as shadow.

    Args:
        places: of the vertices [m], shape (V, 3).
        triangles: their vertices, shape (T, 3).
    """
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    first, second = (places[column, :2] for column in np.unique(ends, axis=0).T)
    angle = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    ray, beside = np.column_stack([np.cos(angle), np.sin(angle)]), np.column_stack([-np.sin(angle), np.cos(angle)])
    off_first, off_second = beside @ first.T, beside @ second.T
    crossed = (off_first * off_second <= 0.0) & (off_first != off_second)
    share = off_first / np.where(crossed, off_first - off_second, 1.0)
    reached = ray @ first.T * (1.0 - share) + ray @ second.T * share
    return np.where(crossed, reached, 0.0).max(axis=1)


def folds(radii: FloatArray) -> int:
    """Number of folds: how often around the radius rises by `DEEP` of the free ring's width and falls again."""
    from scipy.signal import find_peaks

    # Begun at its lowest, no fold is cut in two by the ends.
    around = np.roll(radii, -int(np.argmin(radii)))
    peaks, _ = find_peaks(np.append(around, around[0]), prominence=DEEP * (DISC - PEDESTAL))
    return len(peaks)
