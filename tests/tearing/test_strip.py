"""A strip that is drawn apart, against what it may bear: force per width times width."""

import pytest

import cape
from tests.tearing.to_tear import FABRIC, IDENTITY, mesh_of, still

WIDTH, LENGTH, PULL = 0.2, 0.4, 0.0002  # m; the last in each frame
FORCE, STRAIN = 40.0, 0.02  # N/m, which FABRIC bears at a strain of 2 %, within a share of shear / stretch


def force_at_parting(cloth: cape.Cloth, tearing: cape.Tearing) -> tuple[float, float]:
    """Force [N] and strain with which a strip held by its ends is drawn when its first edge parts."""
    holds = [cape.attach(cloth, "rod", "top"), cape.attach(cloth, "hook", "bottom")]
    simulation = cape.Simulation(cape.Scene(cloth, holds, gravity=(0.0, 0.0, 0.0), tearing=tearing))
    simulation.start(still("rod", "hook"))
    before, reached = 0.0, 0.0
    for frame in range(1, 90):
        drawn = frame * PULL
        before, energy = reached, simulation.energy.elastic
        simulation.step({**still("rod"), "hook": ([0.0, 0.0, -drawn], IDENTITY)}, 1 / 30)
        # The work that draws it on by a frame is what its energy gains, as slow as it is.
        reached = (simulation.energy.elastic - energy) / PULL if not simulation.tears else before
        if simulation.tears:
            # A force that grows evenly has its mean half a frame before.
            return reached * (drawn - PULL) / (drawn - 1.5 * PULL), drawn / LENGTH
    raise AssertionError("it never parts")


CLOTHS = {
    "grid": lambda h: cape.Cloth.rectangle(width=WIDTH, height=LENGTH, spacing=h, fabric=FABRIC),
    "mesh": lambda h: mesh_of(CLOTHS["grid"](h), mirrored=True),
    "uneven mesh": lambda h: mesh_of(CLOTHS["grid"](h), jitter=0.15 * h),
}
# A frame draws it by 1 / 40 of what it bears. Clamps keep its ends from becoming narrower, which takes shear / stretch
# = 1 % of the load on; the strains of Saint Venant and Kirchhoff, which some meshes have, make 1.5 times 2 % of it.
TOLERANCE = 1 / 40 + 0.01 + 1.5 * STRAIN


@pytest.mark.parametrize("spacing", [0.05, 0.025])
@pytest.mark.parametrize("kind", CLOTHS)
def test_a_strip_parts_at_its_force_per_width_times_its_width(kind, spacing):
    force, strain = force_at_parting(CLOTHS[kind](spacing), cape.Tearing(force=FORCE))
    assert force == pytest.approx(FORCE * WIDTH, rel=TOLERANCE)
    assert strain == pytest.approx(STRAIN, rel=TOLERANCE)


def test_a_strip_parts_at_its_strain():
    _, strain = force_at_parting(CLOTHS["grid"](0.05), cape.Tearing(strain=STRAIN))
    assert strain == pytest.approx(STRAIN, rel=TOLERANCE)
