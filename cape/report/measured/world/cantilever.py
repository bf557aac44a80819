"""The cantilever test, ASTM D1388 option A: the length that hangs over an edge where its chord is at 41.5 degrees.

What is measured in a laboratory is that length, and its cube gives the rigidity; here the rigidity is known and the
length is compared with that of the heavy elastica. The strip is twice as long and held along its middle, where it is
level by symmetry: so there is no clamp, whose place within a cell would be a matter of taste.
"""

import math

import numpy as np

from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import fabric as fabric_named
from cape.report.measured.world import elastica
from cape.report.measured.world.forces import Forces
from cape.report.measured.world.pieces import strip_of
from cape.report.measured.world.rest import HAND, relax, started
from cape.report.measured.world.rows import Row
from cape.run.whereabouts import Diverged
from cape.scene.holding.attachments import attach
from cape.scene.scene import GRAVITY, Scene

TEST = "cantilever"
ANGLE = 41.5  # degrees
ALLOWED = 0.03  # of the length
CELLS = 16  # along the overhang
WIDTH = 0.025  # m, as in the standard
CLOSE = 0.02  # degrees, which is 1e-3 of the length
TRIES = 5
SOURCE = "heavy elastica, W g L^3 / B = {load:.4f} at 41.5 degrees, by a boundary value problem"


def measure(name: str, direction: str, variant: str) -> Row:
    """Find the overhang of a fabric along "warp" or "weft", on a grid or a kind of triangulation."""
    fabric = fabric_named(name)
    bend = fabric.bend_warp if direction == "warp" else fabric.bend_weft
    gravity = float(np.linalg.norm(GRAVITY))
    expected = elastica.length_at(ANGLE, density=fabric.density, bend=bend, gravity=gravity)
    found, result = math.nan, "finished"
    try:
        found, rested = _overhang(fabric, direction, variant, expected)
        if not rested:
            result = "does not come to rest"
    except Diverged as error:
        result = f"diverged: {error}"
    return Row(
        test=TEST, subject=name, direction=direction, variant=variant, quantity="overhang", unit="mm",
        simulated=1e3 * found, expected=1e3 * expected, allowed=ALLOWED, relative=True, result=result,
        source=SOURCE.format(load=elastica.load_at(ANGLE)),
    )  # fmt: skip


def _overhang(fabric: Fabric, direction: str, variant: str, first: float) -> tuple[float, bool]:
    """The overhang at which the chord is at `ANGLE` [m], from a first guess, and whether all strips came to rest."""
    length, rested = first, True
    for _ in range(TRIES):
        angle, still = chord_angle(fabric, direction, variant, length)
        rested = rested and still
        if abs(angle - ANGLE) < CLOSE:
            break
        # As long as it takes for a strip of the rigidity that this one has shown.
        length *= (elastica.load_at(ANGLE) / elastica.load_at(angle)) ** (1.0 / 3.0)
    return length, rested


def chord_angle(fabric: Fabric, direction: str, variant: str, length: float) -> tuple[float, bool]:
    """Angle of the chord of a strip that hangs over by a length [m], in degrees, and whether it came to rest."""
    spacing = length / CELLS
    cloth = strip_of(fabric, direction, variant, 2.0 * length, spacing, round(WIDTH / spacing))
    along = cloth.positions[:, 0]
    middle = np.flatnonzero(np.abs(along - length) < 1e-6 * length)
    simulation = started(Scene(cloth, [attach(cloth, HAND, middle)]))
    rested = relax(simulation, Forces(cloth))
    places = simulation.positions
    angles = []
    for end in (0.0, 2.0 * length):
        free = np.flatnonzero(np.abs(along - end) < 1e-6 * length)
        out, _, up = places[free].mean(axis=0) - places[middle].mean(axis=0)
        angles.append(math.degrees(math.atan2(-up, abs(out))))
    return float(np.mean(angles)), rested
