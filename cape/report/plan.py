"""How much a report measures, and how long that may take."""

from dataclasses import dataclass, replace
from typing import Any

from cape.report.cases import CASES
from cape.scene.standard_scenes import STANDARD_SCENES
from cape.solvers import SOLVERS
from motions.errors import UnknownNameError

ACCURACIES_MM = (10.0, 3.0, 1.0, 0.3)
WORLD = ("cantilever", "drape", "tension", "shear", "pendulum")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What `run` measures.

    Attributes:
        scenes: names of the standard scenes.
        solvers: names of the solvers.
        every: second, third... of the settings of a solver.
        repeats: times that a run is taken; the quickest counts.
        seconds: of each scene's motion at most [s].
        tolerances_mm: that are asked of `Auto` in smooth scenes, where errors of whole runs mean something [mm].
        scene_s: CPU time for all runs of a scene [s]; slower settings are left out, and named.
        cases: names of the stress cases.
        case_repeats: how often each is run, from jittered starts.
        spacings: of the vertices of one cape [m], from wide to narrow; none to leave out what they are worth.
        balances: names of the standard scenes whose energy is accounted for.
        world: names of the textile tests.
    """

    scenes: tuple[str, ...] = tuple(STANDARD_SCENES)
    solvers: tuple[str, ...] = tuple(SOLVERS)
    every: int
    repeats: int
    seconds: float
    tolerances_mm: tuple[float, ...] = ACCURACIES_MM
    scene_s: float
    cases: tuple[str, ...] = tuple(CASES)
    case_repeats: int
    spacings: tuple[float, ...] = ()
    balances: tuple[str, ...] = ()
    world: tuple[str, ...] = ()

    def only(self, section: str) -> "Plan":
        """The plan for one of the `SECTIONS` of a report alone.

        Raises:
            UnknownNameError: there is no such section.
        """
        if section not in SECTIONS:
            raise UnknownNameError("section of a report", section, tuple(SECTIONS))
        nothing: dict[str, Any] = {field: () for name, field in SECTIONS.items() if name != section}
        return replace(self, **nothing)


# By its name, the field that a section is measured for; nothing there leaves it out.
SECTIONS = {"scenes": "scenes", "stress": "cases", "spacings": "spacings", "energy": "balances", "world": "world"}


FULL = Plan(
    every=1, repeats=5, seconds=10.0, scene_s=50.0, case_repeats=10,
    spacings=(0.06, 0.03, 0.015, 0.0075), balances=("swing", "sphere", "walk"), world=WORLD,
)  # fmt: skip
# These cases compile nothing that the scenes do not, and take little time.
FREE = ("crumpled", "flattened", "twisted", "teleported", "half a turn", "light", "shaken", "jerky")
QUICK = Plan(
    scenes=("swing", "walk"), every=2, repeats=3, seconds=1.5, scene_s=10.0, cases=(*FREE, "torn"), case_repeats=2,
    world=("pendulum",),
)  # fmt: skip
