"""Scenes in which a cloth tears; they show that, and no solver is measured by them."""

from collections.abc import Callable

import numpy as np

from cape.air.wind import Wind
from cape.cloth.cloth import Cloth
from cape.scene.colliders import Sphere
from cape.scene.holding.attachments import attach
from cape.scene.scene import GRAVITY, Scene
from cape.scene.standard_scenes import SHEET, StandardScene, frame_times, track_of
from cape.scene.tearing import Tearing


def torn(*, spacing: float = 0.03, strain: float = 0.25, seconds: float = 2.0) -> StandardScene:
    """A sheet of 1 x 1 m that hangs between two bars, and a ball of 30 cm, too heavy to be held up, that falls on it.

    It falls from 35 cm above the sheet, through it, and on as if nothing had been there.
    """
    cloth = Cloth.rectangle(
        spacing=spacing, fabric=SHEET, origin=(-0.5, 0.5, 0.0), right=(0.0, -1.0, 0.0), down=(1.0, 0.0, 0.0)
    )
    times = frame_times(seconds)
    falling = np.array([0.0, 0.0, 0.5]) + 0.5 * times[:, None] ** 2 * np.array(GRAVITY)
    scene = Scene(
        cloth,
        [attach(cloth, "bars", "left"), attach(cloth, "bars", "right")],
        [Sphere(name="ball", bone="ball", center=np.zeros(3), radius=0.15)],
        wind=Wind(),
        tearing=Tearing(strain=strain),
    )
    return StandardScene("torn", scene, track_of(times, bars=np.zeros((len(times), 3)), ball=falling))


def caught(*, spacing: float = 0.03, force: float = 150.0, seconds: float = 3.0) -> StandardScene:
    """A cape of 0.8 x 1.2 m that walks off at 1 m/s, and whose hem is caught on a spike that stands still.

    The spike holds what is within 4 cm of the middle of the hem.
    """
    cloth = Cloth.rectangle(width=0.8, height=1.2, spacing=spacing, fabric=SHEET, origin=(0.0, 0.4, 1.4))
    times = frame_times(seconds)
    walking = np.zeros((len(times), 3))
    ramp = np.clip(times / 0.5, 0.0, 1.0)
    walking[:, 0] = np.where(times < 0.5, 0.25 * ramp**2, times - 0.25)
    near = np.flatnonzero(np.linalg.norm(cloth.positions - [0.0, 0.0, 0.2], axis=1) < 0.04)
    scene = Scene(
        cloth,
        [attach(cloth, "shoulders", "top"), attach(cloth, "spike", near)],
        wind=Wind(),
        tearing=Tearing(force=force),
    )
    return StandardScene("caught", scene, track_of(times, shoulders=walking, spike=np.zeros((len(times), 3))))


TEARING_SCENES: dict[str, Callable[[], StandardScene]] = {"torn": torn, "caught": caught}
