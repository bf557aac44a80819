"""Limbs that close on a hanging sheet, overlap, and part again."""

from dataclasses import replace

import numpy as np
import pytest

import cape
from cape import Box, Capsule, Cloth, Collider, Pose, Scene, Simulation, TaperedCapsule, attach
from cape.kernels.contact.contact import EXIT
from cape.report.cases import CASES
from cape.run.hanging import Hanging
from cape.scene.standard_scenes import StandardScene

RADIUS, HEIGHT = 0.06, 1.2  # m, of both limbs
MOST_STRAIN = 0.1


class Pinched:
    """The stress case of that name, frame by frame."""

    def __init__(self, solver: str, *, limit: bool = False) -> None:
        """Hang the sheet between the limbs."""
        self.given: StandardScene = CASES["pinched"].build()
        scene = replace(self.given.scene, strain_limit=limit)
        self.simulation = Simulation(scene, solver=cape.solver(solver), threads=1)
        self._track = self.given.track
        self._chosen = [self._track.index(bone) for bone in self.simulation.bones]
        self.frame = 0
        self.simulation.start(self.pose(0))

    def pose(self, frame: int) -> Pose:
        return Pose(self._track.positions[frame, self._chosen], self._track.rotations_wxyz[frame, self._chosen])

    def go(self, seconds: float):
        """Go on until that time, and yield each frame's strain and speed."""
        meter = self.simulation.meter()
        for frame in range(self.frame + 1, round(seconds * 60.0) + 1):
            self.simulation.step(self.pose(frame), 1.0 / 60.0)
            self.frame = frame
            speed = np.linalg.norm(self.simulation.velocities, axis=1).max()
            yield self.simulation.read(meter).stretch, speed

    @property
    def depths(self) -> np.ndarray:
        """How deep each vertex is in each limb [m], shape (V, 2)."""
        track, where = self._track, self.simulation.positions
        limbs = [track.positions[self.frame, track.index(bone), 0] for bone in ("left", "right")]
        return np.stack([RADIUS - np.hypot(where[:, 0] - x, where[:, 2] - HEIGHT) for x in limbs], axis=1)


@pytest.mark.parametrize("limit", [False, True], ids=["", "threads held short"])
@pytest.mark.parametrize("name", ["euler", "xpbd"])
def test_what_limbs_close_upon_is_held_midway_between_them(name: str, limit: bool):
    pinched = Pinched(name, limit=limit)
    strains, speeds = zip(*pinched.go(1.9), strict=True)
    assert max(strains) < MOST_STRAIN
    assert max(speeds) < 2.0 * EXIT
    depths = pinched.depths
    inside = depths.max(axis=1) > 0.001
    # Two threads across, of 16 vertices: the limbs' axes are 4 cm apart, and nothing else is in their way.
    assert inside.sum() == 32
    height = pinched.simulation.positions[inside, 2] - HEIGHT
    np.testing.assert_allclose(depths[inside, 0], depths[inside, 1], atol=1e-4)
    np.testing.assert_allclose(depths[inside, 0], RADIUS - np.hypot(0.02, height), atol=1e-4)


@pytest.mark.parametrize(
    ("name", "limit"), [*((name, False) for name in cape.SOLVERS), ("euler", True), ("xpbd", True)]
)
@pytest.mark.few("euler-True", "xpbd-True", "tr_bdf2-False")
def test_it_comes_out_when_they_part(name: str, limit: bool):
    pinched = Pinched(name, limit=limit)
    for _ in pinched.go(2.5):
        pass
    assert pinched.depths.max() < 0.0
    assert max(strain for strain, _ in pinched.go(3.0 - 1 / 60)) < MOST_STRAIN


def test_a_frame_that_is_taken_back_forgets_what_it_has_pinched(monkeypatch: pytest.MonkeyPatch):
    pinched = Pinched("xpbd")
    for _ in pinched.go(0.75):
        pass
    simulation, closed = pinched.simulation, pinched.pose(60)
    shapes = simulation.assembly.contacts.colliders
    assert shapes is not None
    assert not shapes.pinched.any()

    def stop(_: Hanging):
        assert shapes.pinched.any()
        raise KeyboardInterrupt

    monkeypatch.setattr(Hanging, "look", stop)
    with pytest.raises(KeyboardInterrupt):
        simulation.step(closed, 0.3)
    monkeypatch.undo()
    assert not shapes.pinched.any()
    simulation.step(closed, 0.3)
    assert shapes.pinched.any()
    simulation.start_from(simulation.snapshot())
    assert not shapes.pinched.any()


@pytest.mark.parametrize(("name", "tapered"), [("euler", False), ("xpbd", False), ("euler", True)])
def test_a_sheet_that_hangs_through_two_limbs_that_overlap_for_ever_hangs_still(name: str, tapered: bool):
    sheet = Cloth.rectangle(width=0.6, height=0.6, spacing=0.04, origin=(0.0, 0.3, 1.5))
    half = np.array([0.0, 0.4, 0.0])
    middles = [np.array([x, 0.0, HEIGHT]) for x in (-0.03, 0.03)]
    limbs: list[Collider] = [Capsule(f"limb {k}", None, x - half, x + half, RADIUS) for k, x in enumerate(middles)]
    if tapered:
        start, end = middles[0] - half, middles[0] + half
        limbs[0] = TaperedCapsule(name="thigh", start=start, end=end, start_radius=RADIUS, end_radius=RADIUS)
    simulation = Simulation(Scene(sheet, [attach(sheet, "rod", "top")], limbs), solver=cape.solver(name), threads=1)
    simulation.start({"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])})
    meter = simulation.meter()
    for _ in range(60):
        simulation.step({"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
        assert simulation.read(meter).stretch < MOST_STRAIN
    assert np.linalg.norm(simulation.velocities, axis=1).max() < 0.5
    depth = RADIUS - np.hypot(0.03, simulation.positions[:, 2] - HEIGHT)
    assert simulation.read(meter).penetration == pytest.approx(depth.max(), abs=2e-4)


@pytest.mark.parametrize("solver", ["euler", "xpbd"])
def test_a_limb_does_not_go_through_a_cell_whose_corner_others_pinch(solver: str):
    """It comes down in the middle between rows of vertices, which pass it on either side."""
    radius, half, still = 0.02, np.array([0.15, 0.0, 0.0]), [1.0, 0.0, 0.0, 0.0]
    sheet = Cloth.rectangle(
        width=0.4, height=0.4, spacing=0.1, origin=(-0.2, -0.2, 0.0), right=(1.0, 0.0, 0.0), down=(0.0, 1.0, 0.0)
    )
    knobs = [
        Box(name=name, center=np.array([0.0, 0.0, z]), half_sizes=np.array([0.03, 0.03, 0.02]))
        for name, z in (("below", -0.015), ("above", 0.015))
    ]
    held = [attach(sheet, "frame", edge) for edge in ("top", "bottom")]
    scene = Scene(sheet, held, [Capsule("limb", "limb", -half, half, radius), *knobs], thickness=0.002)
    simulation = Simulation(scene, solver=cape.solver(solver), threads=1)

    def bones(height: float) -> dict[str, tuple[np.ndarray, list[float]]]:
        return {"frame": (np.zeros(3), still), "limb": (np.array([0.0, 0.05, height]), still)}

    simulation.start(bones(0.03), settle=0.0)
    colliders = simulation.assembly.contacts.colliders
    assert colliders is not None
    share = np.arange(9) / 8.0
    weights = np.array([(a, b, 1.0 - a - b) for a in share for b in share if a + b <= 1.0])
    deepest, pinched = -np.inf, False
    for height in np.linspace(0.03, -0.02, 31)[1:]:
        simulation.step(bones(height), 1.0 / 60.0)
        pinched |= bool(colliders.pinched.any())
        corners = simulation.positions[sheet.triangles]
        points = np.einsum("wk,tkd->twd", weights, corners).reshape(-1, 3) - [0.0, 0.05, height]
        off = np.linalg.norm(points - np.clip(points, -half, half), axis=1)
        deepest = max(deepest, radius - off.min())
    assert pinched
    assert deepest < 0.0
