"""What a run notes of each substep for who keeps its accounts: where vertices are before and after contact."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import routine, unit
from cape.kernels.self_contact.self_contact import PRESSED, Pressure
from cape.kernels.solve.soft import Pull
from cape.kernels.state import State


class Journal(NamedTuple):
    """Room for a frame of S substeps, positions [m] and velocities [m/s]: `integrated` (S, 6, N) as each has moved the
    vertices, `unlimited` (S, 6, N) as impulses of contact have then left them, None where nothing limits strain after
    that, `ended` (S, 6, N) as they are left in the end; and `pressed` (S, N), where contact forces had a part in the
    first. `goals` (S + 1, 6, n) are those of springs that hold n vertices, with their velocities, at the frame's start
    and the end of each substep; None without any."""

    integrated: NDArray[np.floating]
    unlimited: NDArray[np.floating] | None
    ended: NDArray[np.floating]
    pressed: NDArray[np.bool_]
    goals: NDArray[np.float64] | None = None


class Noting(NamedTuple):
    """A cloth, and the journal of what its steps do."""

    state: State
    journal: Journal


class NotingForces(NamedTuple):
    """A journal, and the forces of contact within a step: of colliders (3, N) [N], between layers; None for none."""

    journal: Journal
    force: NDArray[np.floating] | None
    pressure: Pressure | None


class NotingGoals(NamedTuple):
    """Springs that hold a cloth, and the journal of what its steps do."""

    pull: Pull
    journal: Journal


@unit
def note_integrated(g, team, substep, substeps, step):
    """Note vertices as a substep has moved them, on which no contact forces act yet."""
    copy_state(team.lo, team.hi, g.state, g.journal.integrated[substep])
    g.journal.pressed[substep, team.lo : team.hi] = False


@unit
def note_unlimited(g, team, substep, substeps, step):
    """Note vertices before their strain is limited."""
    copy_state(team.lo, team.hi, g.state, g.journal.unlimited[substep])


@unit
def note_pressed(g, team, substep, substeps, step):
    """Note which vertices contact forces acted on within a step."""
    _note_colliders(team.lo, team.hi, g.force, g.journal.pressed[substep])
    _note_layers(team.lo, team.hi, g.pressure, g.journal.pressed[substep])


@routine
def _note_colliders(lo, hi, f, pressed):
    if f is not None:
        for i in range(lo, hi):
            pressed[i] = pressed[i] or f[0, i] != 0.0 or f[1, i] != 0.0 or f[2, i] != 0.0


@routine
def _note_layers(lo, hi, pressure, pressed):
    if pressure is not None and pressure.clock[PRESSED] > 0.0:
        a = pressure.held
        for i in range(lo, hi):
            pressed[i] = pressed[i] or a[0, i] != 0.0 or a[1, i] != 0.0 or a[2, i] != 0.0


@unit
def note_first_goals(g, team, substep, substeps, step):
    """Note where springs hold a thread's vertices at a frame's start."""
    copy_goals(team.lo, team.hi, g.pull, g.journal.goals[0])


@unit
def note_goals(g, team, substep, substeps, step):
    """Note where springs hold a thread's vertices at the end of a substep."""
    copy_goals(team.lo, team.hi, g.pull, g.journal.goals[substep + 1])


@routine
def copy_goals(lo, hi, pull, out):
    """Copy the goals of vertices lo to hi, and their velocities, to `out` (6, n)."""
    vertices = pull.attached.vertices
    for k in range(vertices.size):
        if lo <= vertices[k] and vertices[k] < hi:
            for axis in range(3):
                out[axis, k], out[3 + axis, k] = pull.goals[axis, k], pull.speeds[axis, k]


@unit
def note_end(g, team, substep, substeps, step):
    """Note vertices at the end of a substep."""
    copy_state(team.lo, team.hi, g.state, g.journal.ended[substep])


@routine
def copy_state(lo, hi, s, out):
    """Copy the state of vertices lo to hi to `out` (6, N)."""
    for i in range(lo, hi):
        out[0, i], out[1, i], out[2, i] = s.x[i], s.y[i], s.z[i]
        out[3, i], out[4, i], out[5, i] = s.vx[i], s.vy[i], s.vz[i]
