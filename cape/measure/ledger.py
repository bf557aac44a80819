"""Where the energy of a run comes from and where it goes, kept substep by substep.

Vertex i of mass m goes from x0, v0 to x1, v1 within a substep h. With u = (v0 + v1) / 2 its kinetic energy changes by
exactly m (v1 - v0) . u. Forces of three kinds are known:

    f  springs and gravity, which have an energy:   work  f . (x1 - x0),  f = (f0 + 4 fm + f1) / 6
    d  damping of the springs:                      work  h d . u,        d = (d0 + d1) / 2
    s  springs by which bones hold the cloth:       part of f, and what their dampers do of d
    a  air, which may move and give energy:         work  h a . u,        a = (a0 + a1) / 2

of which fm is that with all vertices half on their way (Simpson's rule).

What is left of a vertex's kinetic energy was done by something else:

    w = m (v1 - v0) . u - f . (x1 - x0) - h (d + a) . u

Where a bone holds the vertex, or a curve that it slides along, that is the work of its *attachment*, m (v1 - v0) / h -
f - d - a being the force that holds it. Where springs hold it softly the bone works on them instead: -(s + ds) . (g1 -
g0) along the way of what they are held at, with s as f and ds as d, less what their dampers dissipate.

*Contact* by impulses, as a step notes it itself, takes a vertex from v' and x' to v1 and x1: it stops the vertex, rubs
on it, and moves it out of a shape, or back to where its tether reaches or it is confined to, by p = x1 - x' - h (v1 -
v') besides. Its work is m (v1 - v') . u - f . p, none on a vertex at rest, whatever presses it. A *limit* of strain,
which is noted before contact, does such work likewise. Its impulses between vertices add up to nothing, so that what
holds the cloth gave P = sum m (v' - v) to the free; P times the mean way of all that is held, over h, was therefore
done by the attachments, and not by the limit. That is exact where all that is held moves alike. Where an implicit step
finds contact forces along with all others the whole of w is contact's.

All that is left of the w of free vertices is *numerical*: what the method itself adds or loses. It vanishes with the
step. With linear forces it is h/2 (f0 . v0 - f1 . v1) for symplectic Euler, where m (v1 - v0) = h f0 and
x1 - x0 = h v1; summed over a run that stays bounded: energy is carried to and fro, not lost (Hairer, Lubich and Wanner
2006, "Geometric numerical integration", section IX.3). For backward Euler, where m (v1 - v0) = h f1, it is
h/2 (f1 . v0 - f0 . v1), on a spring of stiffness k the same as -m/2 (v1 - v0)^2 - k/2 (x1 - x0)^2. At vertices that are
held, or pressed in an implicit step, the method's own part can't be told from the force that acts there and is counted
to it; that, too, vanishes with the step.

In XPBD springs are stretched by more than the impulses account for that its sweeps have found, so that f is too large
on what is held. But impulses between vertices add up to nothing: what springs gave to all that is held is minus what
they gave to the free, P = h sum (m g + a) - sum m (v' - v0). The difference to h sum (f - m g + d) over what is held is
taken to be spread evenly there, and its work is numerical. That is exact where all that is held moves alike. Springs
that hold the cloth add to P what they give.

Summed over all vertices, and with minus the damping's work as what is dissipated,

    change of kinetic + elastic + potential
        = attachments + contacts + limit + air - damping + numerical + moved + residual

The work of f is taken from the solvers' own forces, elastic and potential energy from their definition
(`measure.energy`). So the *residual* closes the books: it is what Simpson's rule misses of an energy's difference along
the line from x0 to x1, of fifth order in x1 - x0 and none for gravity and linear springs, and it would be large if
forces were not the gradients of the energies. *moved* is what jumps of the bones and `Simulation.disturb` do between
frames, to which none of this applies.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly, force_scratch
from cape.forces.base import Acting
from cape.forces.registry import forces_of
from cape.kernels.linking import Frame, Linker
from cape.kernels.solve.journal import Journal
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.kernels.team import Team
from cape.measure.energy import Energy, energy_of, kinetic_energy_of
from motions.border import checked
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

ATTACHMENTS, CONTACTS, AIR, DAMPING, NUMERICAL, MOVED, LIMIT = range(7)

TOGETHER = 16_384  # vertices times steps that are looked at in one go: so much fits the processor's cache


@checked
@dataclass(frozen=True, eq=False)
class Balance:
    """Energies at F times, and what was done from the first of them on, each of shape (F,) and in joules.

    Attributes:
        times: since the start [s].
        kinetic: energy of motion.
        elastic: energy of stretched and bent springs, and of those that hold the cloth softly.
        potential: energy of height, 0 at the origin of the world.
        attachments: work done on the cloth by the bones that hold it, also by springs.
        contacts: work done on it by colliders, by its own layers on each other, by tethers and confinements.
        air: work done on it by the air: drag, lift and viscosity, of either sign.
        damping: what the springs' damping has dissipated, also of those that hold the cloth softly.
        numerical: what the method of integration has added; below zero what it has dissipated.
        moved: what was changed between frames: by jumps of the bones, `Simulation.disturb`, or threads that parted.
        limit: work done on it by the limit of its strain; below zero what that has taken away.
    """

    times: FloatArray
    kinetic: FloatArray
    elastic: FloatArray
    potential: FloatArray
    attachments: FloatArray
    contacts: FloatArray
    air: FloatArray
    damping: FloatArray
    numerical: FloatArray
    moved: FloatArray
    limit: FloatArray

    @property
    def total(self) -> FloatArray:
        """Kinetic, elastic and potential energy [J], shape (F,)."""
        return self.kinetic + self.elastic + self.potential

    @property
    def residual(self) -> FloatArray:
        """The change of the total that no term accounts for [J], shape (F,)."""
        done = self.attachments + self.contacts + self.air - self.damping + self.numerical + self.moved + self.limit
        return self.total - self.total[0] - done

    @property
    def exchanged(self) -> float:
        """The largest change of an energy, or amount of work or dissipation, at any time [J]."""
        changes = (abs(getattr(self, f.name) - getattr(self, f.name)[0]).max() for f in fields(self)[1:])
        return float(max(changes))

    @property
    def gap(self) -> float:
        """By how much the balance fails to close: the largest residual as a share of what was exchanged."""
        largest = float(abs(self.residual).max())
        return largest / self.exchanged if largest > 0.0 else 0.0


@checked
class Ledger:
    """Keeps the energy accounts of a simulation that is given it; see the module for what is counted where.

    A run with a ledger has the same bits as one without, and takes a few times as long.
    """

    def __init__(self) -> None:
        """Nothing is in it before the simulation starts."""
        self._times: list[float] = []
        self._energies: list[Energy] = []
        self._sums: list[FloatArray] = []
        self._forces: _Forces | None = None
        self._sweeps = False

    @property
    def balance(self) -> Balance:
        """All that was entered since the simulation's start.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        if not self._times:
            raise ValueRangeError("the ledger is empty: give it to a simulation, and start that")
        energies, sums = np.array(self._energies).T, np.stack(self._sums).T
        return Balance(np.array(self._times), *energies, *sums)

    def requests(self, assembly: Assembly, state: State) -> list[Request]:
        """The code that keeping the accounts of a cloth needs, to be compiled together with other code."""
        return [*_Forces(assembly).requests, kinetic_energy_of(assembly, state).request]

    def begin(self, assembly: Assembly, state: State, origin: FloatArray, *, sweeps: bool) -> None:
        """Forget all, and begin with a cloth as it is.

        Args:
            assembly: of the cloth.
            state: where its vertices are.
            origin: that positions refer to, in the world [m], shape (3,).
            sweeps: whether its springs act by impulses of sweeps over them (`Solver.sweeps`).
        """
        self._times, self._sums, self._sweeps = [0.0], [np.zeros(7)], sweeps
        self._energies = [energy_of(assembly, state, origin)]

    def enter(self, assembly: Assembly, before: State, origin: FloatArray, journal: Journal, duration: float) -> None:
        """Enter a frame of `duration` [s].

        Args:
            assembly: of the cloth.
            before: where its vertices were.
            origin: that positions refer to, in the world [m], shape (3,).
            journal: what the frame's substeps did.
            duration: of the frame [s].
        """
        sums = self._sums[-1].copy()
        if journal.goals is not None:
            _aim(assembly, journal.goals[0])
        sums[MOVED] += energy_of(assembly, before, origin).total - self._energies[-1].total
        sums += self._work_of(assembly, np.stack(before).astype(float), journal, duration / len(journal.ended))
        if journal.goals is not None:
            _aim(assembly, journal.goals[-1])
        self._times.append(self._times[-1] + duration)
        self._sums.append(sums)
        self._energies.append(energy_of(assembly, State(*journal.ended[-1]), origin))

    def _work_of(self, assembly: Assembly, begin: FloatArray, journal: Journal, h: float) -> FloatArray:
        """What the terms gain in a frame that starts at the state `begin` (6, N) with steps of `h` [s], shape (7,)."""
        if self._forces is None or self._forces.assembly.springs is not assembly.springs:
            self._forces = _Forces(assembly)
        sums, count = np.zeros(7), max(1, TOGETHER // begin.shape[1])
        for first in range(0, len(journal.ended), count):
            some = slice(first, first + count)
            integrated, ended = (states[some].astype(float) for states in (journal.integrated, journal.ended))
            goals = None if journal.goals is None else journal.goals[first : first + len(ended) + 1]
            unlimited = None if journal.unlimited is None else journal.unlimited[some].astype(float)
            pressed = journal.pressed[some]
            shares = (first + np.arange(len(ended) + 1)) / len(journal.ended)
            sums += self._work_of_steps(assembly, begin, integrated, unlimited, ended, pressed, goals, shares, h)
            begin = ended[-1]
        return sums

    def _work_of_steps(
        self,
        assembly: Assembly,
        begin: FloatArray,
        integrated: FloatArray,
        unlimited: FloatArray | None,
        ended: FloatArray,
        pressed: NDArray[np.bool_],
        goals: FloatArray | None,
        shares: FloatArray,
        h: float,
    ) -> FloatArray:
        """The same for S of the steps, as a journal has them, of which the first starts at the state `begin`.

        `goals` (S + 1, 6, n) are those of springs that hold the cloth, None without any; `shares` (S + 1,) is how much
        of the frame has passed at each state.
        """
        assert self._forces is not None
        mass, held = assembly.mass, ~assembly.free
        states = np.concatenate([begin[None], ended])
        begun = states[:-1]
        forces = self._forces.at(states, goals, shares)
        damping, air = 0.5 * (forces[1:, :-1] + forces[1:, 1:])
        halfway = None if goals is None else 0.5 * (goals[:-1] + goals[1:])
        between = self._forces.conservative(0.5 * (begun + ended), halfway)
        conservative = (forces[0, :-1] + 4.0 * between + forces[0, 1:]) / 6.0
        moved, gained = ended[:, :3] - begun[:, :3], ended[:, 3:] - begun[:, 3:]
        mean = 0.5 * (begun[:, 3:] + ended[:, 3:])
        damped, blown = h * _dots(damping, mean), h * _dots(air, mean)
        left = mass * _dots(gained, mean) - _dots(conservative, moved) - damped - blown

        def work_between(earlier: FloatArray, later: FloatArray) -> FloatArray:
            """What impulses do that take vertices from one state to another within a step."""
            kicked = later[:, 3:] - earlier[:, 3:]
            pushed = later[:, :3] - earlier[:, :3] - h * kicked
            return np.where(held, 0.0, mass * _dots(kicked, mean) - _dots(conservative, pushed))

        # A bone gives what it does on goals, of which dampers keep what they don't pass on to the cloth.
        springs, dampers, way = _soft_hold(assembly, goals, 0.5 * (begun + ended))
        given_to_springs, dissipated = np.sum((springs + dampers) * way), np.sum(dampers * way) - damped.sum()
        attachments, kept = left[:, held].sum(), np.zeros_like(left)
        touched = work_between(integrated, ended if unlimited is None else unlimited)
        limit = 0.0
        if unlimited is not None:
            kept = work_between(unlimited, ended)
            limit = kept.sum()
            if held.any():
                given = (mass * (ended[:, 3:] - unlimited[:, 3:]))[:, :, ~held].sum(axis=2)
                pulled = (given * moved[:, :, held].mean(axis=2)).sum() / h
                attachments, limit = attachments + pulled, limit - pulled
        touched = np.where(pressed & ~held, left - kept, touched)
        if assembly.rails is not None:
            sliding = assembly.rails.attached.vertices
            attachments += (left - kept)[:, sliding].sum()
            touched[:, sliding] = 0.0
        touched = touched.sum()
        if self._sweeps and held.any():
            weight = self._forces.weight
            given = integrated[:, 3:] - begun[:, 3:]
            impulse = (h * (weight + air) - mass * given)[:, :, ~held].sum(axis=2)
            impulse += h * (springs + dampers).sum(axis=2)
            stretched = h * (conservative - weight + damping)[:, :, held].sum(axis=2)
            attachments -= ((impulse - stretched) * moved[:, :, held].mean(axis=2)).sum() / h
        sums = np.zeros(7)
        sums[ATTACHMENTS], sums[CONTACTS] = attachments + given_to_springs, touched
        sums[LIMIT], sums[NUMERICAL] = limit, left.sum() - attachments - touched - limit
        sums[AIR], sums[DAMPING] = blown.sum(), dissipated
        return sums


def _dots(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products of the columns of (S, 3, N) arrays, shape (S, N)."""
    return np.einsum("sci,sci->si", a, b)


class _Forces:
    """The forces on an assembled cloth, by the account that they belong to."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        self.weight = np.outer(assembly.scene.gravity, assembly.mass)
        count = assembly.cloth.vertices
        self._room = np.zeros((6, count))
        self._state = State(*self._room)
        self._forces = np.zeros((3, count))
        self._linker = Linker()
        self._programs = {account: self._program(account) for account in ("elastic", "hold", "air")}

    @property
    def requests(self) -> list[Request]:
        """The code that is not linked yet."""
        return self._linker.requests

    def _program(self, account: str) -> Frame | None:
        """What computes the forces of an account at `_state`; None where there are none."""
        acting = Acting(self.assembly, self._state, self._forces, force_scratch(self.assembly, np.float64)[0])
        uses = []
        for force in forces_of(self.assembly.scene):
            if force.account == account:
                uses += force.uses(acting, force.arrays(self.assembly, np.float64))
        return self._linker.frame([], uses, Team.alone(len(self._state.x))) if uses else None

    def at(self, states: FloatArray, goals: FloatArray | None, shares: FloatArray) -> FloatArray:
        """Springs and weight, damping, and air [N] at states (S, 6, N); shape (3, S, 3, N).

        `goals` (S, 6, n) are those of springs that hold the cloth, None without any; `shares` (S,) is how much of the
        frame has passed.
        """
        conservative = self.conservative(states, goals)
        springs = self._compute("elastic", states) + self._compute("hold", states, goals)
        damping = springs - (conservative - self.weight)
        return np.stack([conservative, damping, self._air(states, shares)])

    def _air(self, states: FloatArray, shares: FloatArray) -> FloatArray:
        """Forces of the air [N] at states (S, 6, N) after shares of the frame (S,); shape (S, 3, N)."""
        stream = self.assembly.stream
        if stream is None:
            return self._compute("air", states)
        found = []
        for state, share in zip(states, shares, strict=True):
            stream.now[:] = stream.begin + share * (stream.end - stream.begin)
            found.append(self._compute("air", state[None]))
        return np.concatenate(found)

    def conservative(self, states: FloatArray, goals: FloatArray | None) -> FloatArray:
        """Springs and weight [N] at states (S, 6, N), whatever their velocities; shape (S, 3, N)."""
        still = _at_rest(states)
        held = self._compute("hold", still, None if goals is None else _at_rest(goals))
        return self._compute("elastic", still) + held + self.weight

    def _compute(self, account: str, states: FloatArray, goals: FloatArray | None = None) -> FloatArray:
        """Forces of an account at states (S, 6, N); shape (S, 3, N)."""
        found = np.zeros((len(states), 3, states.shape[2]))
        program = self._programs[account]
        if program is not None:
            self._linker.link()
            for step, (state, forces) in enumerate(zip(states, found, strict=True)):
                if goals is not None:
                    _aim(self.assembly, goals[step])
                self._forces[:] = 0.0
                self._room[:] = state
                program.run(1, 1.0)
                forces[:] = self._forces
        return found


def _soft_hold(
    assembly: Assembly, goals: FloatArray | None, between: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What springs that hold a cloth do in S steps in the middle of which it is at states (S, 6, N).

    Forces of the springs on the cloth [N], those of their dampers [N], and the way of what they are held at [m], each
    of shape (S, 3, n), from `goals` (S + 1, 6, n); n is 0 without any.
    """
    pull = assembly.pull
    if goals is None or pull is None:
        nothing = np.zeros((len(between), 3, 0))
        return nothing, nothing, nothing
    off = 0.5 * (goals[:-1] + goals[1:]) - between[:, :, pull.attached.vertices]
    return pull.stiffness * off[:, :3], pull.damping * off[:, 3:], goals[1:, :3] - goals[:-1, :3]


def _at_rest(states: FloatArray) -> FloatArray:
    """States (S, 6, N) without their velocities."""
    return np.concatenate([states[:, :3], np.zeros_like(states[:, 3:])], axis=1)


def _aim(assembly: Assembly, goals: FloatArray) -> None:
    """Have springs hold an assembled cloth at goals with their velocities (6, n)."""
    pull = assembly.pull
    assert pull is not None
    pull.goals[:], pull.speeds[:] = goals[:3], goals[3:]
