"""The forces there are, in the order in which they are computed: a line for each."""

from cape.assembly.assemble import Assembly
from cape.forces.air import Air
from cape.forces.base import Force
from cape.forces.elastic import Elastic
from cape.forces.hold import Hands, Hold
from cape.forces.strays import Strays, StraysInAir
from cape.forces.viscous_air import ViscousAir
from cape.scene.scene import Scene

FORCES: tuple[type[Force], ...] = (
    Elastic,
    Air,
    ViscousAir,
    Hold,
    Hands,
    Strays,
    StraysInAir,
)


def forces_of(scene: Scene) -> list[type[Force]]:
    """The forces that a scene has."""
    return [force for force in FORCES if force.acts(scene)]


def forces_in(assembly: Assembly) -> list[type[Force]]:
    """The forces that an assembled cloth has: those of its scene, and of hands."""
    return [force for force in FORCES if force.is_in(assembly)]
