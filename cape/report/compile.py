"""Compiles what a report needs on all cores at once, before anything is timed."""

from collections.abc import Iterator

from cape.kernels import store
from cape.measure.ledger import Ledger
from cape.report.cases import CASES
from cape.report.measured import resolution
from cape.report.measured.stability import simulation_of
from cape.report.measured.trajectory import EXACT, Setting
from cape.report.plan import Plan
from cape.run.simulation import Simulation
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene, curtain, standard_scene
from cape.solvers import SOLVERS


def compile_all(plan: Plan) -> None:
    """Compile all that a plan's runs need and that this machine lacks."""
    wanted = [
        request
        for standard, simulation in _simulations(plan)
        for request in simulation.requests(poses_of(standard.track.first(1), simulation.bones)[0])
    ]
    store.prepare(wanted)


def _simulations(plan: Plan) -> Iterator[tuple[StandardScene, Simulation]]:
    """A simulation of each kind that a plan asks for."""
    settings = [EXACT, *(Setting(solver) for solver in plan.solvers)]
    for name in plan.scenes:
        standard = standard_scene(name)
        for setting in settings:
            yield standard, setting.simulation(standard.scene, threads=1)
    for name in plan.balances:
        standard = standard_scene(name)
        for setting in settings[1:]:
            yield standard, setting.simulation(standard.scene, threads=1, ledger=Ledger())
    for name in plan.cases:
        standard = CASES[name].build()
        for solver in plan.solvers:
            yield standard, simulation_of(CASES[name], standard, SOLVERS[solver]())
        yield standard, EXACT.simulation(standard.scene, threads=1)
    for spacing in plan.spacings[:1]:
        standard = curtain(spacing=spacing)
        for solver in {resolution.REFERENCE, *resolution.MEASURED} & {resolution.REFERENCE, *plan.solvers}:
            yield standard, Setting(solver).simulation(standard.scene, threads=1)
