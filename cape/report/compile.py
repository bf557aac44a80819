"""Compiles what a report needs on all cores, before anything is timed on one of them."""

import multiprocessing
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed

from cape.report.measured.stability import compile_case
from cape.report.measured.trajectory import EXACT, Setting, Stage
from cape.report.plan import FREE, Plan
from cape.scene.standard_scenes import standard_scene
from cape.solvers.threads import available_cores


def compile_all(plan: Plan, told: Callable[[int], Callable[[], None]] = lambda steps: lambda: None) -> None:
    """Fill the cache of compiled kernels, in as many processes as there are cores; nothing on a single one."""
    workers = min(available_cores(), len(plan.solvers) + 1)
    if workers < 2:
        return
    settings = [EXACT, *(Setting(solver) for solver in plan.solvers)]
    # The last ones first: those with contact stand behind the others, and take longest.
    scenes = [(scene, setting) for scene in reversed(plan.scenes) for setting in settings]
    cases = [(case, solver) for case in plan.cases if case not in FREE for solver in plan.solvers]
    done = told(len(scenes) + len(cases))
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_leave_interrupts)
    try:
        begun = [pool.submit(_compile, *task) for task in scenes]
        begun += [pool.submit(compile_case, *task) for task in cases]
        for compiled in as_completed(begun):
            compiled.result()
            done()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.kill()
        raise
    pool.shutdown()


def _leave_interrupts() -> None:
    """Leave Ctrl-C to the process that waits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _compile(scene: str, setting: Setting) -> None:
    """Compile what a scene needs with a solver; runs in a process of its own."""
    Stage(standard_scene(scene), seconds=0.1).run(setting)
