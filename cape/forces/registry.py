"""The forces there are, in the order in which they are computed: a line for each."""

from cape.forces.air import Air
from cape.forces.base import Force
from cape.forces.elastic import Elastic
from cape.forces.hold import Hold
from cape.forces.strays import Strays, StraysInAir
from cape.forces.viscous_air import ViscousAir
from cape.scene.scene import Scene

FORCES: tuple[type[Force], ...] = (
    Elastic,
    Air,
    ViscousAir,
    Hold,
    Strays,
    StraysInAir,
)


def forces_of(scene: Scene) -> list[type[Force]]:
    """The forces that a scene has."""
    return [force for force in FORCES if force.acts(scene)]
