"""What a caller gives wrongly ends in one kind of error, whatever it is."""

import math

import numpy as np
import pytest

import cape
from motions.errors import UserError

# What is given here is wrong on purpose, also as far as its types go.
# pyright: reportArgumentType=false

SHEET = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.25)
OTHER = cape.Cloth.rectangle(width=2.0, height=1.0, spacing=0.25)
SCENE = cape.Scene(SHEET, [cape.attach(SHEET, "rod", "top")])
STIFF = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.25, fabric=cape.Fabric(stretch=1e12))
AT_REST = {"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}


def step(pose, dt: float = 1 / 60) -> None:
    simulation = cape.Simulation(SCENE)
    simulation.start(AT_REST)
    simulation.step(pose, dt)


WRONG = {
    "attachments of another cloth": lambda: cape.Scene(SHEET, [cape.attach(OTHER, "rod", "top")]),
    "vertices beyond the cloth": lambda: cape.Scene(SHEET, [cape.Attachment("rod", np.array([10_000]))]),
    "damping for weeks": lambda: cape.Fabric(damping_time=1e6),
    "damping of bending for weeks": lambda: cape.Fabric(bend_damping_time=1e6),
    "threads beyond any number": lambda: cape.Fabric(stretch=1e300),
    "hardly any mass": lambda: cape.Fabric(density=1e-300),
    "more steps than anyone waits for": lambda: cape.Simulation(
        cape.Scene(STIFF, [cape.attach(STIFF, "rod", "top")])
    ).start(AT_REST),
    "a mesh of atoms": lambda: cape.Cloth.from_mesh(1e-30 * np.eye(3), [[0, 1, 2]]),
    "a mesh of galaxies": lambda: cape.Cloth.from_mesh(1e308 * np.eye(3), [[0, 1, 2]]),
    "an origin that is none": lambda: cape.Cloth.rectangle(spacing=0.25, origin=(math.nan, 0.0, 0.0)),
    "an origin in the plane": lambda: cape.Cloth.rectangle(spacing=0.25, origin=(0.0, 0.0)),
    "half a substep": lambda: cape.SymplecticEuler(substeps=2.5),
    "many substeps": lambda: cape.XPBD(substeps="many"),
    "a billion substeps": lambda: cape.SymplecticEuler(substeps=10**9),
    "true substeps": lambda: cape.TRBDF2(substeps=True),
    "no substeps": lambda: cape.BackwardEuler(substeps=0),
    "threads in text": lambda: cape.Simulation(SCENE, threads="2"),
    "half a thread": lambda: cape.Simulation(SCENE, threads=1.5),
    "a teleport to nowhere": lambda: step({"rod": (np.array([1e308, 0.0, 0.0]), [1.0, 0.0, 0.0, 0.0])}),
    "a ragged pose": lambda: step({"rod": ([0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}),
    "no pose": lambda: step({"rod": None}),
    "a pose of words": lambda: step({"rod": ("here", "there")}),
    "a pose without a rotation": lambda: step({"rod": (np.zeros(3),)}),
    "no time": lambda: step(AT_REST, 0.0),
    "no number of time": lambda: step(AT_REST, math.nan),
    "friction below zero": lambda: cape.Scene(SHEET, SCENE.attachments, friction=-1.0),
    "a collider's friction": lambda: cape.Capsule("c", "rod", [0, 0, 0], [0, 0, 1], 0.1, friction=math.nan),
}


@pytest.mark.parametrize("what", WRONG)
def test_it_is_a_user_error_that_says_what_was_wrong(what):
    with pytest.raises(UserError) as caught:
        WRONG[what]()
    assert 0 < len(str(caught.value)) < 500


def test_a_cloth_that_explodes_is_among_them():
    assert issubclass(cape.Diverged, UserError)


def test_a_cloth_that_was_moved_keeps_its_attachments():
    moved = SHEET.moved([1.0, 0.0, 0.0])
    assert cape.Scene(moved, SCENE.attachments).cloth is moved
