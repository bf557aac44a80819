"""What a run gives up, step by step, where it is slower than the clock, and takes back when it can."""

from dataclasses import replace

from cape.live.changes import Changes
from cape.live.pace.falling_behind import FallingBehind
from cape.live.rig import Rig
from cape.scene.scene import Scene
from cape.scene.self_contact import SelfContact
from cape.solvers import XPBD, Solver
from cape.solvers.xpbd import SUBSTEPS

FEW = 10  # substeps a frame, from which on cloth under XPBD gets much softer than it should be
SLOWER = 0.97  # of real time, below which a run is said to be slower
IN_TIME = 20  # looks in a row that find it faster than that, until it is no longer: else the line would flicker
NEARLY = 0.5  # of a frame's time, from which on what may be needed is made ready
CALM = 120  # frames after a change, before that is


class Savings:
    """Fewer substeps than were asked for, as far as they stay stable; then XPBD, in as many as it needs, in few and in
    fewer; then time.

    What saves nothing is given back.
    """

    def __init__(self, rig: Rig, changes: Changes) -> None:
        """Give up nothing yet."""
        self._rig, self._changes = rig, changes
        self._behind = FallingBehind(0)
        self._asked: Solver | None = None
        self._tears = False
        self._contact: SelfContact | None = None
        self._scene: Scene | None = None
        self._calm = 0
        self._ways: list[tuple[str, Solver]] = []
        self._in_time = IN_TIME

    def note(self, seconds: float, period: float) -> None:
        """Take how long a frame has taken, of the time that there is for it [s]."""
        if self._changes.pending:
            return  # how long frames take tells nothing yet of what is to come
        asked = self._changes.solver
        tears = self._rig.scene.tearing is not None
        if asked is not self._asked or tears != self._tears:
            self._asked, self._tears = asked, tears
            self._ways = self._ways_from(asked, period)
            self._behind = FallingBehind(len(self._ways))
        if self._rig.scene.self_contact is not self._contact:
            self._contact = self._rig.scene.self_contact
            self._behind.forget()
        before = self._behind.level
        level = self._behind.note(seconds, period)
        if level != before:
            solver = self._ways[level - 1][1] if level else asked
            self._changes.use(solver, self._said(before, level), must=False)
        elif self._behind.mean > NEARLY * period:
            self._make_ready()

    def _said(self, before: int, level: int) -> str:
        """What is said of a change of levels."""
        now = self._ways[level - 1][0] if level else "everything as asked for again"
        if self._behind.saved_nothing:
            return f"{self._ways[before - 1][0]} saves nothing: {now}"
        return f"too slow: {now}" if level else now

    def _make_ready(self) -> None:
        """Have a cloth stand by for the solver that is taken next, which is compiled and laid out until then."""
        if self._rig.scene is not self._scene:
            self._scene, self._calm = self._rig.scene, 0
        self._calm += 1
        others = [solver for _, solver in self._ways if solver.name != self._rig.solver.name]
        if self._calm == CALM and others and not self._rig.simulation.tears:
            self._changes.make_ready(others[0])

    def told(self, rate: float) -> str:
        """What is given up, at a rate of steps against the clock's, asked again and again; empty for nothing."""
        level = self._behind.level
        given = [self._ways[level - 1][0]] if level else []
        self._in_time = 0 if rate < SLOWER else self._in_time + 1
        if self._in_time < IN_TIME and (self._behind.lowest or self._changes.pending):
            given.append("slower than real time")
        return ", ".join(given)

    def _ways_from(self, asked: Solver, period: float) -> list[tuple[str, Solver]]:
        ways: list[tuple[str, Solver]] = []
        used = self._rig.simulation.own_substeps(period) if asked.substeps is None else asked.substeps
        fewest = {"euler": self._rig.simulation.own_substeps(period), XPBD.name: FEW}.get(asked.name, 1)
        if not isinstance(asked, XPBD) and fewest < used:
            ways.append((f"{fewest} substeps", replace(asked, substeps=fewest)))
        if not self._tears or isinstance(asked, XPBD):
            if not isinstance(asked, XPBD) and used > SUBSTEPS * 60.0 * period:
                ways.append((XPBD.name, XPBD()))  # whose frames are still taken again where threads get too long
            for substeps in (2 * FEW, FEW):
                if not (isinstance(asked, XPBD) and used <= substeps):
                    ways.append((f"xpbd in {substeps}", XPBD(substeps=substeps)))
        return ways
