"""Springs by which bones, or hands, hold vertices softly."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.forces.base import Acting, Force
from cape.kernels.program import Use
from cape.kernels.solve.soft import Pull, Pulled, pull_vertices
from cape.scene.scene import Scene


class Hold(Force):
    """A spring and a damper between a vertex and where bones carry it; see `cape.attach`."""

    name: ClassVar[str] = "hold"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "hold"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Where an attachment has a stiffness."""
        return any(attachment.soft for attachment in scene.attachments)

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> Pull:
        """The springs, with their goals as the bones move them."""
        assert assembly.pull is not None
        return assembly.pull

    @staticmethod
    def uses(acting: Acting, arrays: Pull) -> list[Use]:
        """One unit for any cloth."""
        return [Use(pull_vertices, Pulled(acting.state, arrays, acting.forces))]

    @staticmethod
    def energy(assembly: Assembly, positions: NDArray[np.float64]) -> float:
        """Energy of the springs, with their goals where they are now [J]."""
        pull = assembly.pull
        if pull is None:
            return 0.0
        away = positions[pull.attached.vertices].T - pull.goals
        return 0.5 * float(pull.stiffness @ np.sum(away**2, axis=0))


class Hands(Force):
    """A spring and a damper between a vertex and the hand that holds it; see `cape.run.by_hand`."""

    name: ClassVar[str] = "hands"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "hold"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Nowhere: no scene tells of hands, which come and go as it runs."""
        return False

    @classmethod
    def is_in(cls, assembly: Assembly) -> bool:
        """Tell whether hands may take hold."""
        return assembly.hands is not None

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> Pull:
        """The springs, with their goals as the hands move them."""
        assert assembly.hands is not None
        return assembly.hands

    @staticmethod
    def uses(acting: Acting, arrays: Pull) -> list[Use]:
        """That of any soft hold."""
        return Hold.uses(acting, arrays)
