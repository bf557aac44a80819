"""How well a take loops."""

from dataclasses import dataclass

from cape.scene.loops import Travel


@dataclass(frozen=True)
class Loop:
    """A take that leads from its last frame into its first one.

    Attributes:
        travel: how far the bones get in a round.
        rounds: of the motion that were simulated, the one that the take shows included.
        gap: largest distance of a vertex, in the frames over which the one round passes into the other, from where it
            was a round before [m], each round in its own frame.
        bound: below which the cloth is taken to repeat [m].
        blended: first and last frame over which the one round passes into the other.
        drawn: whether it was simulated on there, drawn to where it was; otherwise both rounds are mixed.
        renewed: whether the cloth is put on anew where a motion that doesn't loop jumps back.
    """

    travel: Travel
    rounds: int
    gap: float
    bound: float
    blended: tuple[int, int]
    drawn: bool
    renewed: bool = False

    @property
    def repeats(self) -> bool:
        """Whether the cloth came back to where it was a round before."""
        return self.gap <= self.bound
