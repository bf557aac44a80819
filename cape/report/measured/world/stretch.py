"""Tension and shear: the force that a deformed piece is held with, against the plane stiffness of its fabric.

A strip is pulled between two grips that hold its width, and its strain is read in its middle third, far from them, as
an extensometer does; a square is sheared with its border held. The forces there are the cloth's own on what is held.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.cloth.conversions import PlaneStiffness
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import fabric as fabric_named
from cape.report.measured.world.forces import Forces
from cape.report.measured.world.pieces import strip_of
from cape.report.measured.world.rest import HAND, relax, started
from cape.report.measured.world.rows import Row
from cape.run.whereabouts import Diverged
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene

FloatArray = NDArray[np.float64]

TENSION, SHEAR = "tension", "shear"
STRAIN = 2e-3  # of the strip, and shear angle of the square [rad]: what is of second order is a few thousandths
LENGTH, WIDTH = 0.5, 0.05  # m, of the strip: as in strip tests of woven cloth, but longer
# m. Springs along a border carry another share than those inside: with four cells across instead of eight, the bias of
# a one-way mesh comes out 3 to 4 % softer.
SPACING = 0.00625
SIDE = 0.1  # m, of the square
ALLOWED = 0.05  # of a stiffness
ALLOWED_NARROWING = 0.02  # as a ratio of strains
CLOSED_FORM = "orthotropic sheet of the fabric's stiffness, by algebra"


def tension(name: str, direction: str, variant: str) -> list[Row]:
    """Pull a fabric along "warp", "weft" or "bias": its stiffness [N/m], and how much it narrows over how much."""
    fabric = fabric_named(name)
    expected = _expected(fabric, direction)
    found, result = (math.nan, math.nan), "finished"
    try:
        stiffness, narrowing, rested = _pull(fabric, direction, variant, expected)
        found = stiffness, narrowing
        result = result if rested else "does not come to rest"
    except Diverged as error:
        result = f"diverged: {error}"
    return [
        Row(
            test=TENSION, subject=name, direction=direction, variant=variant, quantity=quantity, unit=unit,
            simulated=value, expected=wanted, allowed=allowed, relative=relative, result=result, source=CLOSED_FORM,
        )
        for quantity, unit, value, wanted, allowed, relative in (
            ("stiffness", "N/m", found[0], expected[0], ALLOWED, True),
            ("narrowing", "", found[1], expected[1], ALLOWED_NARROWING, False),
        )
    ]  # fmt: skip


def shear(name: str, variant: str) -> Row:
    """Shear a fabric, and give the shear force per width and angle [N/m]."""
    fabric = fabric_named(name)
    found, result = math.nan, "finished"
    try:
        found, rested = _shear(fabric, variant)
        result = result if rested else "does not come to rest"
    except Diverged as error:
        result = f"diverged: {error}"
    return Row(
        test=SHEAR, subject=name, variant=variant, quantity="stiffness", unit="N/m", simulated=found,
        expected=fabric.shear, allowed=ALLOWED, relative=True, result=result, source=CLOSED_FORM,
    )  # fmt: skip


def plane_of(fabric: Fabric) -> PlaneStiffness:
    """Stiffness in the plane of a fabric made of springs, which couple both threads by its shear (Cauchy)."""
    return PlaneStiffness(fabric.stretch_weft, fabric.shear, fabric.stretch_warp, fabric.shear)


def _expected(fabric: Fabric, direction: str) -> tuple[float, float]:
    """Tension per width and strain of a strip free to narrow [N/m], and strain across over strain along.

    From compliances turned by the angle t to the weft (by algebra here, from the work of a stress along that direction
    and of one across): s11' = s11 c^4 + (2 s12 + s66) s^2 c^2 + s22 s^4, s12' = s12 (s^4 + c^4) +
    (s11 + s22 - s66) s^2 c^2 with c = cos t, s = sin t.
    """
    plane = plane_of(fabric)
    (s11, s12), (_, s22) = np.linalg.inv([[plane.c11, plane.c12], [plane.c12, plane.c22]])
    s66 = 1.0 / plane.shear
    cos2 = {"weft": 1.0, "bias": 0.5, "warp": 0.0}[direction]
    sin2 = 1.0 - cos2
    along = s11 * cos2**2 + (2.0 * s12 + s66) * sin2 * cos2 + s22 * sin2**2
    across = s12 * (sin2**2 + cos2**2) + (s11 + s22 - s66) * sin2 * cos2
    return 1.0 / along, -across / along


def _pull(fabric: Fabric, direction: str, variant: str, expected: tuple[float, float]) -> tuple[float, float, bool]:
    """Stiffness [N/m], strain across over strain along, and whether the strip came to rest."""
    flat = strip_of(fabric, direction, variant, LENGTH, SPACING, round(WIDTH / SPACING))
    x, y = flat.positions[:, :2].T
    grips = np.flatnonzero((x < 1e-6) | (x > LENGTH - 1e-6))
    # It sets out about as it will be, but in the grips as wide as it was.
    narrowed = np.where(np.isin(np.arange(len(x)), grips), 0.0, expected[1] * STRAIN)
    places = np.column_stack([(1.0 + STRAIN) * x, y - narrowed * (y - WIDTH / 2.0), 0.0 * x])
    places, forces, rested = _at_rest(flat, places, grips)
    force = forces[x > LENGTH - 1e-6, 0].sum()
    middle = np.abs(x - LENGTH / 2.0) < LENGTH / 6.0
    start = np.column_stack([x, y, np.ones_like(x)])[middle]
    gradient = np.linalg.lstsq(start, places[middle, :2], rcond=None)[0]
    along, across = gradient[0, 0] - 1.0, gradient[1, 1] - 1.0
    return -float(force) / WIDTH / along, -across / along, rested


def _shear(fabric: Fabric, variant: str) -> tuple[float, bool]:
    flat = strip_of(fabric, "weft", variant, SIDE, SPACING, round(SIDE / SPACING))
    x, y = flat.positions[:, :2].T
    border = np.flatnonzero(np.minimum(np.minimum(x, SIDE - x), np.minimum(y, SIDE - y)) < 1e-6)
    places = np.column_stack([x + STRAIN * y, y, 0.0 * x])
    places, forces, rested = _at_rest(flat, places, border)
    force = forces[y > SIDE - 1e-6, 0].sum()
    return -float(force) / SIDE / STRAIN, rested


def _at_rest(flat: Cloth, start: FloatArray, held: NDArray[np.int64]) -> tuple[FloatArray, FloatArray, bool]:
    """Where vertices (V, 3) come to rest without weight [m] while some stay where they start, the cloth's forces on all
    of them there [N], and whether they do."""
    cloth = replace(flat, positions=start)
    simulation, forces = started(Scene(cloth, [attach(cloth, HAND, held)], gravity=(0.0, 0.0, 0.0))), Forces(cloth)
    rested = relax(simulation, forces, within=1e-8)
    return simulation.positions, forces(simulation.positions), rested
