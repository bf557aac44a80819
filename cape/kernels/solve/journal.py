"""What a run notes of each substep for who keeps its accounts: where vertices are before and after contact."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import driver
from cape.kernels.self_contact.self_contact import PRESSED


class Journal(NamedTuple):
    """Room for a frame of S substeps, positions [m] and velocities [m/s]: `integrated` (S, 6, N) as each has moved the
    vertices, `ended` (S, 6, N) as impulses of contact have then left them; and `pressed` (S, N), where contact forces
    had a part in the former."""

    integrated: NDArray[np.floating]
    ended: NDArray[np.floating]
    pressed: NDArray[np.bool_]


@driver
def note_integrated(lo, hi, s, journal, substep):
    """Note vertices lo to hi as a substep has moved them, on which no contact forces act yet; nothing for None."""
    if journal is not None:
        copy_state(lo, hi, s, journal.integrated[substep])
        journal.pressed[substep, lo:hi] = False


@driver
def note_pressed(lo, hi, penalty, pressure, journal, substep):
    """Note which of the vertices lo to hi contact forces acted on within an implicit step; nothing for None."""
    if journal is not None:
        pressed = journal.pressed[substep]
        if penalty is not None:
            f = penalty.force
            for i in range(lo, hi):
                pressed[i] = pressed[i] or f[0, i] != 0.0 or f[1, i] != 0.0 or f[2, i] != 0.0
        if pressure is not None and pressure.clock[PRESSED] > 0.0:
            a = pressure.held
            for i in range(lo, hi):
                pressed[i] = pressed[i] or a[0, i] != 0.0 or a[1, i] != 0.0 or a[2, i] != 0.0


@driver
def note_end(lo, hi, s, journal, substep):
    """Note vertices lo to hi at the end of a substep; nothing for None."""
    if journal is not None:
        copy_state(lo, hi, s, journal.ended[substep])


@driver
def copy_state(lo, hi, s, out):
    """Copy the state of vertices lo to hi to `out` (6, N)."""
    for i in range(lo, hi):
        out[0, i], out[1, i], out[2, i] = s.x[i], s.y[i], s.z[i]
        out[3, i], out[4, i], out[5, i] = s.vx[i], s.vy[i], s.vz[i]
