"""Units of textile testing in SI units: Kawabata's apparatus (KES), FAST, the cantilever, and ARCSim's tables.

KES: Kawabata 1980, The Standardization and Analysis of Hand Evaluation. FAST: De Boos and Tester 1994, SiroFAST, CSIRO
report WT92.02. A gram-force is 9.80665e-3 N.
"""

from collections.abc import Sequence
from math import radians, sqrt
from typing import NamedTuple

GRAM_FORCE = 9.80665e-3  # N
GRAVITY = 9.81  # m/s2, as FAST's own formulas have it
FAST_LOADS = {"E5": 4.903, "E20": 19.61}  # N/m, of those that stretch is taken between
CM = 1e-2  # m


def kes_bending(bending: float) -> float:
    """Bending moment per width and curvature [N m] from KES's B [gf cm2/cm]."""
    return bending * GRAM_FORCE * CM


def kes_bending_friction(hysteresis: float) -> float:
    """Moment per width [N] that friction holds against bending, from KES's 2HB [gf cm/cm], the width of the loop."""
    return hysteresis * GRAM_FORCE / 2.0


def kes_shear(stiffness: float) -> float:
    """Tension per width and shear angle [N/m] from KES's G [gf/(cm degree)]."""
    return stiffness * GRAM_FORCE / CM / radians(1.0)


def kes_weight(weight: float) -> float:
    """Mass per area [kg/m2] from KES's W [mg/cm2]."""
    return weight * 1e-6 / CM**2


def fast_stretch(e5: float, e20: float) -> float:
    """Tension per width and strain [N/m] between FAST's first two loads, from its extensions E5 and E20 [%]."""
    return (FAST_LOADS["E20"] - FAST_LOADS["E5"]) / ((e20 - e5) / 100.0)


def fast_shear(bias_extension: float) -> float:
    """Tension per width and shear angle [N/m] from FAST's EB5 [%], at 45 degrees to the threads: 123 / EB5.

    Threads that don't stretch turn by the shear angle of twice the strain, so that G = load / (4 strain).
    """
    return 123.0 / bias_extension


def cantilever_bending(density: float, bending_length: float) -> float:
    """Bending moment per width and curvature [N m] from mass per area [kg/m2] and bending length [m]: W g c^3.

    FAST's B, and that of ASTM D1388 with c half of the length that hangs over to 41.5 degrees.
    """
    return density * GRAVITY * bending_length**3


def bending_length(density: float, bend: float) -> float:
    """The length [m] at which a cloth of that mass per area [kg/m2] bends under its own weight: (B / (W g))^(1/3)."""
    return (bend / (density * GRAVITY)) ** (1.0 / 3.0)


class PlaneStiffness(NamedTuple):
    """Tension per width and strain of a cloth in its plane, first axis weft, second warp.

    Attributes:
        c11: along the weft, strained along it alone [N/m].
        c12: across to either, which narrows a cloth that is pulled [N/m].
        c22: along the warp [N/m].
        shear: tension per width and shear angle [N/m].
    """

    c11: float
    c12: float
    c22: float
    shear: float

    @property
    def stretch_warp(self) -> float:
        """Tension per width and strain along the warp of a cloth that is free to narrow [N/m]."""
        return self.c22 - self.c12**2 / self.c11

    @property
    def stretch_weft(self) -> float:
        """The same along the weft [N/m]."""
        return self.c11 - self.c12**2 / self.c22

    @property
    def poisson(self) -> tuple[float, float]:
        """How much a cloth narrows over how much it is pulled, along the warp and along the weft."""
        return self.c12 / self.c11, self.c12 / self.c22


def held_stretch(warp: float, weft: float, shear: float) -> tuple[float, float]:
    """Tension per width and strain of a cloth held as wide as it was, along warp and weft [N/m].

    Args:
        warp: that along the warp where the cloth is free to narrow [N/m].
        weft: the same along the weft.
        shear: tension per width and shear angle [N/m], by which both threads of a `Fabric` are coupled.

    From C_warp - shear^2 / C_weft = warp and C_weft - shear^2 / C_warp = weft, so that C_warp / C_weft = warp / weft.
    """
    held = (warp + sqrt(warp**2 + 4.0 * shear**2 * warp / weft)) / 2.0
    return held, held * weft / warp


ROWS_STRAINED_BY = 1.0 / 6.0  # larger principal stretch, less 1, at which ARCSim's rows but the first were measured
CURVATURES = (0.0, 10.0, 20.0)  # 1/m, of the first columns of its bending tables


def arcsim_stretching(
    at_rest: Sequence[float], strained: Sequence[float] | None = None, *, strain: float = 0.0
) -> PlaneStiffness:
    """Stiffness in the plane from rows (C11, C12, C22, C33) of ARCSim's "stretching" tables.

    ARCSim's forces are those of the energy per area k11 G00^2 / 2 + k12 G00 G11 + k22 G11^2 / 2 + k33 G01^2, G Green's
    strain and k twice its table's values, where they are negative 0: so C11, C12 and C22 are twice the table's, and the
    shear stiffness, G01 being half of the shear angle, k33 / 2, the table's own. (Its function for the energy has half
    of the last term, which its forces have not.)

    Args:
        at_rest: the first row, of no strain.
        strained: the second row for a cloth strained along its first axis, the last for one along its second; None
            where the strain is 0.
        strain: larger principal stretch, less 1, between both rows, 0 to 1/6. Shear stays that of the first.
    """
    share = strain / ROWS_STRAINED_BY
    rows = zip(at_rest, at_rest if strained is None else strained, strict=True)
    c11, c12, c22, _ = (2.0 * max((1.0 - share) * rest + share * pulled, 0.0) for rest, pulled in rows)
    return PlaneStiffness(c11, c12, c22, max(at_rest[3], 0.0))


def arcsim_bending(row: Sequence[float]) -> float:
    """Bending moment per width and curvature [N m], mean of curvatures of 0 to 20 per m, from ARCSim's tables.

    A row is of edges along one direction, which is the axis that the cloth bends around, with columns for `CURVATURES`,
    as in its files [N m]. The energy of an edge of length l between triangles of area a in all, bent by theta, is
    k l^2 theta^2 / (8 a); on a grid of spacing d, where a = l d and theta = kappa d, k kappa^2 / 8 per area: B = k / 4.
    """
    columns = row[: len(CURVATURES)]
    return sum(columns) / len(columns) / 4.0
