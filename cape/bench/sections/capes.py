"""Many capes in one call: how much more of them two cores step than one."""

from cape.bench.plan import Plan
from cape.bench.rows import Row, Told
from cape.bench.sheets import sheet
from cape.bench.timing import Probe, take_turns
from cape.run.batch import Batch
from cape.run.simulation import Simulation
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import FPS, StandardScene
from cape.solvers import SymplecticEuler
from cape.solvers.threads import available_cores

SECTION = "capes"


class Capes(Probe):
    """A batch of equal capes, stepped by whole frames through the public interface."""

    def __init__(self, swinging: StandardScene, capes: int, threads: int) -> None:
        """Start so many capes, shared by so many threads."""
        self.threads, self.capes, self.vertices = threads, capes, swinging.scene.cloth.vertices
        simulations = [
            Simulation(swinging.scene, solver=SymplecticEuler(precision="single"), threads=1) for _ in range(capes)
        ]
        self._batch = Batch(simulations, threads=threads)
        self._poses = poses_of(swinging.track, swinging.scene.bones)
        self._frame = 0
        self.requests = simulations[0].requests(self._poses[0])
        self.substeps, self.units = 0, 0.0

    def call(self) -> None:
        """Step all capes by a frame; start them first where that has not been done."""
        if not self.units:
            self._batch.start([self._poses[0]] * self.capes, settle=0.0)
        self._frame = (self._frame + 1) % len(self._poses)
        self._batch.step([self._poses[self._frame]] * self.capes, 1.0 / FPS)

    def prepare(self) -> None:
        """Count the substeps that a frame took."""
        self.substeps = self._batch.simulations[0].substeps
        self.units = float(self.capes * self.vertices * self.substeps)

    def rewind(self) -> None:
        """Let the capes swing on: what an explicit step costs does not depend on where they are."""


def measure_capes(plan: Plan, told: Told) -> list[Row]:
    """Measure all numbers of capes on one thread and on one for every core."""
    swinging = sheet(plan.cape_vertices)
    batches = [Capes(swinging, capes, threads) for capes in plan.capes for threads in sorted({1, available_cores()})]
    timings = take_turns(batches, repeats=plan.repeats, least=plan.least, told=told)
    return [
        Row(
            section=SECTION, solver="euler", layout="grid", precision="single", vertices=batch.vertices,
            threads=batch.threads, capes=batch.capes, substeps=batch.substeps,
            ns_per_vertex_substep=timing.ns, compile_s=timing.compile_s,
        )
        for batch, timing in zip(batches, timings, strict=True)
    ]  # fmt: skip


def gains(rows: list[Row]) -> dict[int, float]:
    """For each number of capes, how many times what one core steps the most threads step in the same time."""
    of_capes = [row for row in rows if row.section == SECTION]
    most = max((row.threads for row in of_capes), default=1)
    alone = {row.capes: row.ns_per_vertex_substep for row in of_capes if row.threads == 1}
    return {row.capes: alone[row.capes] / row.ns_per_vertex_substep for row in of_capes if row.threads == most}
