"""Energy accounts of a run: each term against a closed form, and that all of them close."""

import dataclasses

import numpy as np
import pytest

from cape import (
    TRBDF2,
    XPBD,
    BackwardEuler,
    Balance,
    Cloth,
    Fabric,
    Ledger,
    Plane,
    Pose,
    Scene,
    SelfContact,
    Simulation,
    Solver,
    Sphere,
    SymplecticEuler,
    Wind,
    attach,
    simulate,
)
from cape.assembly.fabrics import HELD
from cape.assembly.springs import springs_of
from cape.kernels.solve.strain_limit import SLACK
from cape.scene.standard_scenes import frame_times, track_of
from motions.errors import ValueRangeError
from tests.support.scenes import grid_cloth, mesh_cloth, turn_about

G = 9.81  # m/s2
FRAME = 1 / 60  # s
SOFT = Fabric(density=0.2, stretch=50.0, shear=10.0, bend=1e-4, damping_time=0.0, bend_damping_time=0.0)
STILL = Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
FLOATING = (0.0, 0.0, 0.0)
EULER, SWEEPS = SymplecticEuler(precision="double"), XPBD(precision="double")
BACKWARD, TRAPEZOID = BackwardEuler(tolerance=1e-11), TRBDF2(tolerance=1e-11)
EVERY = (EULER, SWEEPS, BACKWARD, TRAPEZOID)

every_solver = pytest.mark.parametrize("solver", EVERY, ids=lambda s: s.name)


def at(solver: Solver, substeps: int) -> Solver:
    return dataclasses.replace(solver, substeps=substeps)


def run(scene: Scene, solver: Solver, poses: list[Pose] | int, *, dt: float = FRAME, settle: float = 0.0) -> Balance:
    """The accounts of a scene along poses of its bones, or for so many frames without any."""
    nowhere = [Pose(np.zeros((0, 3)), np.zeros((0, 4)))]
    given = nowhere * (poses + 1) if isinstance(poses, int) else poses
    ledger = Ledger()
    simulation = Simulation(scene, solver=solver, ledger=ledger, cuts=None)
    simulation.start(given[0], settle=settle)
    for pose in given[1:]:
        simulation.step(pose, dt)
    return ledger.balance


def sheet(fabric: Fabric = SOFT, *, height: float = 0.0) -> Cloth:
    """A sheet of 0.3 x 0.2 m that lies flat."""
    return grid_cloth(np.linspace(0, 0.3, 7), np.linspace(0, 0.2, 5), fabric, down=(0, -1, 0), origin=(0, 0, height))


def order(errors: list[float]) -> float:
    return float(np.log2(errors[0] / errors[1]))


# -- each term by itself --


@every_solver
def test_in_free_fall_height_becomes_motion(solver: Solver):
    substeps, frames = 10, 12
    balance = run(Scene(sheet()), at(solver, substeps), frames)
    mass, time, h = 0.2 * 0.06, frames * FRAME, FRAME / substeps
    assert balance.times[-1] == pytest.approx(time)
    # Velocities are exact in all methods, but for the 1e-11 m that an implicit stage may leave in each of 120 steps;
    # heights are in TR-BDF2. The others move by h v1 where they should by h (v0 + v1)/2.
    assert balance.kinetic[-1] == pytest.approx(0.5 * mass * (G * time) ** 2, rel=1e-6)
    late = 0.0 if isinstance(solver, TRBDF2) else -0.5 * h * mass * G**2 * time
    # The weight's work on 1e-11 m in 240 stages.
    np.testing.assert_allclose(balance.numerical[-1], late, rtol=1e-6, atol=240 * 1e-11 * mass * G)
    assert balance.potential[0] - balance.potential[-1] == pytest.approx(balance.kinetic[-1] - late, rel=1e-6)
    for term in (balance.attachments, balance.contacts, balance.air, balance.damping, balance.moved):
        np.testing.assert_allclose(term, 0.0, atol=1e-15)
    # Some 100 steps, each rounding energies of 1e-2 J and forces of springs at the last digit of a position.
    assert np.abs(balance.residual).max() < 1e-13


@every_solver
@pytest.mark.few("euler", "tr_bdf2")
def test_what_holds_a_sheet_lifts_its_weight(solver: Solver):
    fabric = dataclasses.replace(SOFT, stretch=500.0, shear=100.0, damping_time=2e-3)
    cloth = grid_cloth(np.linspace(0, 0.3, 7), np.linspace(0, 0.2, 5), fabric)
    scene = Scene(cloth, [attach(cloth, "hand", range(7))])
    lift, seconds = 0.3, 2.0
    share = np.linspace(0, 1, round(seconds / FRAME) + 1)
    share = share * share * (3 - 2 * share)
    poses = [Pose(np.array([[0.0, 0.0, lift * s]]), STILL.rotations_wxyz) for s in share]
    balance = run(scene, at(solver, 20), poses, settle=1.0)
    # The way begins and ends with 6 lift / seconds^2 = 0.45 m/s2. To a cloth at rest that is an additional weight of
    # 5 %, which stretches springs by as much more: (5 %)^2 of an energy that is itself below 1 % of the work.
    assert balance.attachments[-1] == pytest.approx(0.2 * 0.06 * G * lift, rel=2e-3)
    assert abs(balance.numerical[-1]) < 2e-3 * balance.attachments[-1]
    assert balance.gap < 1e-9


def spring(ratio: float, solver: Solver, steps: int) -> tuple[float, float]:
    """What damping dissipates in one period of a Kelvin-Voigt spring, and what it must, as shares of all energy."""
    width, height, density, stretch = 0.1, 0.2, 0.3, 120.0
    # As in test_free_motion: the lower left vertex carries a third of a cell's mass and hangs on half a cell's thread.
    # The lower right one carries a sixth.
    omega = np.sqrt(stretch * width / 2 / height / (density * width * height / 3))
    fabric = Fabric(density=density, stretch=stretch, shear=0, bend=0, damping_time=2 * ratio / omega)
    cloth = grid_cloth([0, width], [0, height], fabric)
    # So little that the tilt of the sideways threads, of second order, is lost.
    pulled = dataclasses.replace(cloth, positions=cloth.positions * [1, 1, 1 + 1e-5])
    scene = Scene(pulled, [attach(pulled, "hand", [0, 1])], gravity=FLOATING)
    period = 2 * np.pi / omega
    balance = run(scene, at(solver, steps), [STILL, STILL], dt=period)
    left = 0.0
    for faster in (1.0, np.sqrt(2.0)):
        zeta = faster * ratio
        slower, decay = np.sqrt(1 - zeta**2), np.exp(-2 * np.pi * faster * zeta)
        phase = 2 * np.pi * faster * slower
        place = decay * (np.cos(phase) + zeta / slower * np.sin(phase))
        speed = -decay / slower * np.sin(phase)
        left += 0.5 * (place**2 + speed**2)
    return balance.damping[-1] / balance.elastic[0], 1 - left


@every_solver
def test_damping_takes_what_kelvin_and_voigt_say(solver: Solver):
    (coarse, exact), (fine, _) = (spring(0.05, solver, steps) for steps in (400, 800))
    power = 2 if isinstance(solver, TRBDF2) else 1
    assert order([abs(coarse - exact), abs(fine - exact)]) == pytest.approx(power, abs=0.2)
    # Extrapolated to no step at all; backward Euler's own damping, 0.01 of critical, is a fifth of the spring's.
    assert fine + (fine - coarse) / (2**power - 1) == pytest.approx(exact, rel=0.01)


@every_solver
def test_a_plane_takes_the_energy_of_what_drops_on_it(solver: Solver):
    drop = 0.1
    scene = Scene(sheet(height=drop + 0.005), colliders=[Plane(thickness=0.005)])
    balance = run(scene, at(solver, 40), 20)
    weight = 0.2 * 0.06 * G
    assert balance.contacts[-1] == pytest.approx(-weight * drop, rel=0.02)
    assert balance.contacts[5] == 0.0
    assert balance.kinetic.max() == pytest.approx(weight * drop, rel=0.3)
    assert balance.kinetic[-1] < 1e-3 * weight * drop


@every_solver
def test_friction_takes_its_force_times_the_way(solver: Solver):
    friction, slope = 0.3, 0.5
    cloth = sheet(height=0.005)
    gravity = (G * np.sin(slope), 0.0, -G * np.cos(slope))
    scene = Scene(cloth, colliders=[Plane(thickness=0.005, friction=friction)], gravity=gravity)
    frames = 30
    balance = run(scene, at(solver, 40), frames)
    mass, time = 0.2 * 0.06, frames * FRAME
    acceleration = G * (np.sin(slope) - friction * np.cos(slope))
    way = 0.5 * acceleration * time**2
    # First order: h / time of it, 1/1200, and what the implicit ones need to build up pressure.
    assert balance.contacts[-1] == pytest.approx(-friction * mass * G * np.cos(slope) * way, rel=5e-3)
    assert balance.kinetic[-1] == pytest.approx(0.5 * mass * (acceleration * time) ** 2, rel=5e-3)


@pytest.mark.parametrize("solver", [EULER, SWEEPS], ids=lambda s: s.name)
def test_the_air_takes_what_a_falling_sheet_loses_and_gives_what_it_blows(solver: Solver):
    falling = run(Scene(sheet(), wind=Wind()), at(solver, 40), 60)
    # With d the density, d v' = d g - viscous v - rho/2 Cd v^2: at the terminal velocity all of the weight's work.
    quadratic, viscous = 0.5 * Wind().density * Wind().drag, Wind().viscous
    terminal = (np.sqrt(viscous**2 + 4 * quadratic * 0.2 * G) - viscous) / (2 * quadratic)
    lost = 0.2 * 0.06 * G * terminal * 10 * FRAME
    assert falling.air[-11] - falling.air[-1] == pytest.approx(lost, rel=0.01)
    blown = run(Scene(sheet(), gravity=FLOATING, wind=Wind(velocity=(0, 0, 5.0))), at(solver, 40), 10)
    assert blown.air[-1] == pytest.approx(blown.kinetic[-1], rel=0.02)
    assert blown.air[-1] > 0.1 * 0.5 * 0.2 * 0.06 * 5.0**2


@pytest.mark.parametrize("solver", [EULER, SWEEPS], ids=lambda s: s.name)
def test_a_limit_takes_what_stops_at_the_end_of_its_thread(solver: Solver):
    # Limp threads: nothing but their limit stops the free half of a sheet, all at once.
    limp = dataclasses.replace(SOFT, stretch=1e-6, shear=0.0, bend=0.0, strain_limit=0.05)
    cloth = grid_cloth([0.0, 0.1, 0.2], [0.0, 0.2], limp)
    drop = HELD * 0.05 * 0.2
    balance = run(Scene(cloth, [attach(cloth, "hand", range(3))], strain_limit=True), at(solver, 200), [STILL] * 8)
    weight = 0.2 * 0.04 / 2 * G
    assert balance.limit[2] == 0.0
    # Half of a step's way more or less, 1/2 of 200 in 2.7 frames.
    assert balance.limit[-1] == pytest.approx(-weight * drop, rel=5e-3)
    # It then falls by the slack again and again.
    slack = weight * SLACK * (1.0 + HELD * 0.05) * 0.2
    assert np.diff(balance.limit).max() <= slack
    assert balance.kinetic[-1] <= slack
    np.testing.assert_allclose(balance.contacts, 0.0, atol=1e-15)
    assert balance.gap < 1e-6


# -- the method's own part --


def stretched(solver: Solver, substeps: int, frames: int = 30) -> Balance:
    """A free cloth, stretched by 5 % and let go."""
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.3, 4), SOFT)
    return run(
        Scene(dataclasses.replace(cloth, positions=cloth.positions * 1.05), gravity=FLOATING),
        at(solver, substeps),
        frames,
    )


def test_symplectic_euler_carries_energy_to_and_fro():
    coarse, fine = (stretched(EULER, n) for n in (60, 120))
    # At a frame's end h/2 (f0 . v0 - f1 . v1), and f0 . v0 is none at the start: no trend, of first order.
    assert order([float(np.abs(b.numerical).max()) for b in (coarse, fine)]) == pytest.approx(1.0, abs=0.2)
    middle = len(coarse.numerical) // 2
    start = coarse.elastic[0]
    assert abs(coarse.numerical[middle:].mean() - coarse.numerical[:middle].mean()) < 0.02 * start
    assert coarse.gap < 1e-9


def test_backward_euler_and_xpbd_lose_energy_in_every_frame():
    for solver in (BACKWARD, SWEEPS):
        coarse, fine = (stretched(solver, n, frames=12) for n in (60, 240))
        for balance in (coarse, fine):
            assert np.diff(balance.numerical).max() < 0.0
            # Nothing else happens to it.
            np.testing.assert_allclose(balance.numerical, balance.total - balance.total[0], atol=1e-9)
        assert fine.numerical[3] > coarse.numerical[3]


def test_what_tr_bdf2_loses_is_of_third_order():
    lost = [stretched(TRAPEZOID, n, frames=12).numerical[-1] for n in (80, 160)]
    assert max(lost) < 0.0
    assert order([abs(energy) for energy in lost]) == pytest.approx(3.0, abs=0.2)


# -- all at once --


def busy(kind: str = "grid") -> tuple[Scene, list[Pose]]:
    """A cloth that is swung and turned through the air and against a ball."""
    fabric = Fabric(density=0.2, stretch=200.0, shear=40.0, bend=1e-4, damping_time=1e-4)
    if kind == "limited":
        fabric = dataclasses.replace(fabric, strain_limit=0.02)
    make = grid_cloth if kind in ("grid", "layers", "limited") else mesh_cloth
    cloth = make(np.linspace(0, 0.3, 9), np.linspace(0, 0.4, 11), fabric)
    if kind == "membrane":
        # With its threads at an angle to the edges.
        turned = cloth.pattern @ np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
        cloth = Cloth.from_mesh(cloth.positions, cloth.triangles, pattern=turned, fabric=fabric)
    assert (springs_of(cloth).membrane is not None) == (kind == "membrane")
    scene = Scene(
        cloth,
        [attach(cloth, "hand", range(9))],
        [Sphere(center=np.array([0.15, 0.12, -0.3]), radius=0.1)],
        wind=Wind(velocity=(0.0, 1.0, 0.0)),
        self_contact=SelfContact() if kind == "layers" else None,
        strain_limit=kind == "limited",
    )
    angles = 2 * np.pi * frame_times(0.5)
    poses = [
        Pose(np.array([[0.1 * np.sin(a), 0.1 * (1 - np.cos(a)), 0.0]]), turn_about((0, 0, 1), 0.5 * np.sin(a))[None])
        for a in angles
    ]
    return scene, poses


@pytest.mark.parametrize(
    ("solver", "kind"),
    [
        *((s, "grid") for s in EVERY),
        (EULER, "limited"),
        (SWEEPS, "limited"),
        (TRAPEZOID, "limited"),
        (EULER, "mesh"),
        (SWEEPS, "mesh"),
        (EULER, "layers"),
    ]
    + [(s, "membrane") for s in EVERY],
    ids=lambda value: getattr(value, "name", value),
)
def test_the_balance_closes(solver: Solver, kind: str):
    scene, poses = busy(kind)
    balance = run(scene, at(solver, 40), poses)
    assert balance.exchanged > 0.01
    for term in (balance.attachments, balance.contacts, balance.air, balance.damping):
        assert np.abs(term).max() > 1e-3 * balance.exchanged
    assert (np.diff(balance.damping) > 0.0).all()
    assert (np.abs(balance.limit).max() > 1e-3 * balance.exchanged) == (kind == "limited")
    # Forces are the gradients of energies: what is left is of fifth order in the way of a step.
    assert balance.gap < 1e-6


@pytest.mark.parametrize("solver", [SWEEPS, TRAPEZOID], ids=lambda s: s.name)
def test_steps_are_accounted_for_alike_one_by_one_and_together(solver: Solver, monkeypatch: pytest.MonkeyPatch):
    scene, poses = busy()
    balances = []
    for together in (100 * scene.cloth.vertices, 7 * scene.cloth.vertices, 1):
        monkeypatch.setattr("cape.measure.ledger.TOGETHER", together)
        balances.append(run(scene, at(solver, 40), poses[:12]))
    first, *others = balances
    assert np.abs(first.attachments).max() > 1e-4
    for other in others:
        for field in dataclasses.fields(Balance):
            np.testing.assert_allclose(getattr(other, field.name), getattr(first, field.name), rtol=1e-12, atol=1e-15)


@every_solver
def test_a_ledger_changes_no_bit_of_a_run(solver: Solver):
    scene, poses = busy()
    kept, free = (Simulation(scene, solver=solver, ledger=x) for x in (Ledger(), None))
    for pose in poses[:12]:
        kept.step(pose, FRAME)
        free.step(pose, FRAME)
    np.testing.assert_array_equal(kept.positions, free.positions)
    np.testing.assert_array_equal(kept.velocities, free.velocities)


def test_the_accounts_are_the_same_on_any_number_of_threads():
    scene, poses = busy()
    ledgers = [Ledger(), Ledger()]
    for threads, ledger in enumerate(ledgers, 1):
        simulation = Simulation(scene, solver=EULER, threads=threads, ledger=ledger)
        for pose in poses[:12]:
            simulation.step(pose, FRAME)
    one, two = (ledger.balance for ledger in ledgers)
    for field in dataclasses.fields(Balance):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))


def test_what_jumps_and_disturbances_change_is_apart():
    cloth = grid_cloth(np.linspace(0, 0.3, 7), np.linspace(0, 0.2, 5), SOFT)
    scene, ledger = Scene(cloth, [attach(cloth, "hand", range(7))]), Ledger()
    simulation = Simulation(scene, solver=TRAPEZOID, ledger=ledger)
    simulation.start(STILL)
    up = Pose(np.array([[0.0, 0.0, 5.0]]), STILL.rotations_wxyz)
    simulation.step(up, FRAME)
    assert simulation.jumps == 1
    weight = 0.2 * 0.06 * G
    assert ledger.balance.moved[-1] == pytest.approx(5.0 * weight, rel=1e-6)
    simulation.disturb(np.tile([0.0, 0.0, 0.1], (35, 1)))
    simulation.step(up, FRAME)
    assert ledger.balance.moved[-1] > 5.05 * weight
    assert ledger.balance.gap < 1e-6


def test_a_ledger_begins_anew_with_each_start():
    scene, poses = busy()
    ledger = Ledger()
    with pytest.raises(ValueRangeError, match="give it to a simulation"):
        _ = ledger.balance
    simulation = Simulation(scene, ledger=ledger)
    simulation.start(poses[0])
    begun = simulation.snapshot()
    simulation.step(poses[1], FRAME)
    assert len(ledger.balance.times) == 2
    assert ledger.balance.total[-1] == pytest.approx(simulation.energy.total, rel=1e-12)
    simulation.start_from(begun)
    assert ledger.balance.times.tolist() == [0.0]
    assert ledger.balance.gap == 0.0


def test_a_take_can_be_accounted_for():
    cloth = Cloth.rectangle(width=0.3, height=0.4, spacing=0.05, fabric=SOFT)
    times, ledger = frame_times(0.1), Ledger()
    track = track_of(times, hand=np.outer(times, [1.0, 0.0, 0.0]))
    take = simulate(Scene(cloth, [attach(cloth, "hand", "top")]), track, ledger=ledger)
    np.testing.assert_allclose(ledger.balance.times, times, atol=1e-12)
    np.testing.assert_allclose(ledger.balance.kinetic, take.kinetic_energy, rtol=1e-12)
