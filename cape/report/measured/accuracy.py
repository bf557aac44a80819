"""How far a run is from a reference of the same spatial model, and how sure the reference is.

The model is a system of ordinary differential equations, M x'' = f(x, x', t): an error is the distance of vertices from
where its exact solution takes them, for which a run stands whose step is so short that halving it changes next to
nothing. Contact and buckling make single trajectories diverge, however short the step. What then stays comparable is
how far a run gets from the reference within a short while if it sets out from the reference's own state, the mean
shape, and what can be read off any shape.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.report.measured.trajectory import Setting, Stage, Trajectory
from cape.run.step_error import distance, limit_of

FloatArray = NDArray[np.float64]

LAST = 1.0  # s at the end, over which a mean shape is taken
SURE = 0.1  # of the smallest error quoted, that the reference may change by when its step is halved


@dataclass(frozen=True)
class Error:
    """Distances between the vertices of two runs, over all frames that both have but the first, which they share.

    Attributes:
        rms_mm: root mean square [mm].
        max_mm: largest [mm].
        shape_mm: root mean square of the distances between mean positions over the last `LAST` [mm].
    """

    rms_mm: float
    max_mm: float
    shape_mm: float


def error_of(run: Trajectory, reference: Trajectory) -> Error:
    """How far a run is from a reference; not a number where it broke off in its first frame."""
    frames = min(len(run.times), len(reference.times))
    if frames < 2:
        return Error(np.nan, np.nan, np.nan)
    ours, theirs = run.positions[1:frames], reference.positions[1:frames]
    squared = np.sum((ours - theirs) ** 2, axis=2)
    window = reference.times[1:frames] > reference.times[frames - 1] - LAST
    shift = ours[window].mean(axis=0) - theirs[window].mean(axis=0)
    return Error(
        rms_mm=1e3 * float(np.sqrt(squared.mean())),
        max_mm=1e3 * float(np.sqrt(squared.max())),
        shape_mm=1e3 * float(np.sqrt(np.sum(shift**2, axis=1).mean())),
    )


@dataclass(frozen=True, eq=False)
class Reference:
    """What stands for the exact solution.

    Attributes:
        trajectory: the run with the shortest step.
        uncertainty: how far it is from one with twice the step.
        window_mm: the same after a tenth of a second (`window_error`) [mm].
        settled: whether that is as little as was asked for.
    """

    trajectory: Trajectory
    uncertainty: Error
    window_mm: float
    settled: bool


def window_error(stage: Stage, setting: Setting, reference: Trajectory) -> float:
    """Root mean square error [mm] at the ends of the stage's windows; not a number where there are none."""
    if not reference.snapshots:
        return np.nan
    return apart_mm(stage.run_windows(setting, reference), window_ends(stage, reference))


def window_ends(stage: Stage, reference: Trajectory) -> FloatArray:
    """Where the reference is at the ends of the stage's W windows [m], shape (W, V, 3)."""
    return reference.positions[[start + stage.window for start in reference.snapshots]]


def apart_mm(first: FloatArray, second: FloatArray) -> float:
    """Root mean square distance between vertices [mm], of positions [m], shape (W, V, 3)."""
    return 1e3 * distance(first, second)


def own_limit(ends: Mapping[int, FloatArray]) -> FloatArray | None:
    """Where ever shorter steps of one solver would end the windows [m], shape (W, V, 3), from the ends by substeps.

    It takes the three finest settings; None where there are fewer, or their steps don't shrink evenly.
    """
    counts = sorted(ends)[-3:]
    if len(counts) < 3 or counts[1] ** 2 != counts[0] * counts[2]:
        return None
    windows = zip(*(ends[count] for count in counts), strict=True)
    return np.stack([limit_of(levels, counts[2] / counts[1]).positions for levels in windows])


def converge(
    stage: Stage,
    solver: str,
    *,
    substeps: int,
    aim_mm: float,
    options: tuple[tuple[str, object], ...] = (),
    most: int = 7,
    enough: Callable[[], bool] = lambda: False,
) -> Reference:
    """Halve the step until that changes a run by less than `SURE` of an error.

    Args:
        stage: where the runs set out from.
        solver: that takes them.
        substeps: of the first run.
        aim_mm: smallest error that is to be told from none, as a root mean square [mm].
        options: other fields of the solver.
        most: times that the step is halved.
        enough: asked before each halving but the first; True ends them.
    """
    coarse = stage.run(Setting(solver, substeps, options))
    fine, uncertainty = coarse, Error(np.nan, np.nan, np.nan)
    for halving in range(most):
        if halving > 0 and enough():
            break
        coarse = fine
        fine = stage.run(Setting(solver, 2 * (coarse.setting.substeps or substeps), options))
        uncertainty = error_of(coarse, fine)
        if uncertainty.rms_mm <= SURE * aim_mm:
            break
    settled = uncertainty.rms_mm <= SURE * aim_mm
    window_mm = np.nan if stage.standard.smooth else window_error(stage, coarse.setting, fine)
    return Reference(fine, uncertainty, window_mm, settled)
