"""Small scenes on which stated errors are judged: five that are smooth, five with contact, each varied by a seed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS
from cape.scene.colliders import Box, Sphere
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from cape.scene.standard_scenes import StandardScene, draped, frame_times, plain, track_of, worn

WOVEN = ("worsted", "tablecloth", "twill", "broadcloth", "faille", "cape")


def _varied(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, *name.encode()])


def _hung(name: str, seed: int, *, stretch: float, sideways: float, bob: float, seconds: float) -> StandardScene:
    """A sheet whose top edge is moved forth and back, sideways and up and down, from rest."""
    rng = _varied(seed, name)
    # As stiff in bending as a sheet must be that swings without buckling.
    fabric = Fabric(
        density=rng.uniform(0.15, 0.3), stretch=stretch * rng.uniform(1000.0, 3000.0),
        shear=stretch * rng.uniform(80.0, 200.0), bend=rng.uniform(1.5e-4, 3e-4),
    )  # fmt: skip
    spacing = rng.uniform(0.06, 0.08)
    size = {"width": rng.uniform(0.5, 0.8), "height": rng.uniform(0.8, 1.2)}
    cloth = Cloth.rectangle(**size, spacing=spacing, fabric=fabric, origin=(0.0, 0.4, 1.5))
    times = frame_times(seconds)
    ramp = np.clip(times / 0.5, 0.0, 1.0)
    ramp = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    turns = 2.0 * np.pi * times / rng.uniform(1.9, 2.6)
    sizes = np.array([rng.uniform(0.08, 0.15), sideways * rng.uniform(0.01, 0.03), bob * rng.uniform(0.01, 0.03)])
    waves = np.stack([np.sin(turns), np.sin(0.7 * turns), np.sin(1.6 * turns)], axis=1)
    rod = sizes * ramp[:, None] * waves
    return StandardScene(name, Scene(cloth, [attach(cloth, "rod", "top")]), track_of(times, rod=rod), smooth=True)


def gentle(name: str, seed: int, seconds: float, *, stretch: float, spacing: float = 0.05) -> StandardScene:
    """A sheet that is stiff in bending, moved forth and back slowly: smooth also for ten seconds."""
    rng = _varied(seed, name)
    fabric = Fabric(density=rng.uniform(0.15, 0.3), stretch=stretch, shear=max(100.0, 0.1 * stretch), bend=1e-3)
    size = {"width": rng.uniform(0.5, 0.7), "height": rng.uniform(0.8, 1.1)}
    cloth = Cloth.rectangle(**size, spacing=spacing, fabric=fabric, origin=(0.0, 0.4, 1.5))
    times = frame_times(seconds)
    ramp = np.clip(times / 0.5, 0.0, 1.0)
    rod = np.zeros((len(times), 3))
    turns = 2.0 * np.pi * times / rng.uniform(2.8, 3.6)
    rod[:, 0] = rng.uniform(0.07, 0.11) * ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2) * np.sin(turns)
    return StandardScene(name, Scene(cloth, [attach(cloth, "rod", "top")]), track_of(times, rod=rod), smooth=True)


def _pushed(seed: int, seconds: float) -> StandardScene:
    """A hanging sheet into which a ball swings."""
    rng = _varied(seed, "pushed")
    fabric = FABRICS[rng.choice(WOVEN)]
    cloth = Cloth.rectangle(
        width=0.7, height=1.0, spacing=rng.uniform(0.05, 0.07), fabric=fabric, origin=(0, 0.35, 1.5)
    )
    times = frame_times(seconds)
    ball = np.zeros((len(times), 3))
    ball[:, 0] = 0.3 * np.cos(2.0 * np.pi * times / rng.uniform(1.2, 2.0)) - 0.02
    ball[:, 1] = 0.1 * np.sin(3.0 * times)
    ball[:, 2] = rng.uniform(0.8, 1.2)
    scene = Scene(cloth, [attach(cloth, "rod", "top")], [Sphere(bone="hand", radius=rng.uniform(0.08, 0.15))])
    return StandardScene("pushed", scene, track_of(times, rod=np.zeros((len(times), 3)), hand=ball))


def _draped(name: str, seed: int, seconds: float) -> StandardScene:
    rng = _varied(seed, name)
    size = rng.uniform(0.25, 0.32)
    center = np.zeros(3)
    shape = Sphere(center=center, radius=size) if name == "sphere" else Box(center=center, half_sizes=np.full(3, size))
    return draped(name, shape, spacing=rng.uniform(0.05, 0.07), seconds=seconds)


def _plain(seed: int, seconds: float) -> StandardScene:
    rng = _varied(seed, "plain")
    return plain(spacing=rng.uniform(0.05, 0.07), fabric=FABRICS[rng.choice(WOVEN)], seconds=seconds)


def _worn(seed: int, seconds: float) -> StandardScene:
    """Two seconds of a clip: the walk by the first seed, others by others."""
    rng = _varied(seed, "worn")
    given = worn(("walk", "run", "spin", "kick")[seed % 4], vertices=int(rng.uniform(250, 400)))
    start = int(0.25 * given.track.frames)
    frames = slice(start, start + round(60 * seconds) + 1)
    track = given.track
    part = replace(
        track, times=track.times[frames], positions=track.positions[frames], rotations_wxyz=track.rotations_wxyz[frames]
    )
    return StandardScene("worn", given.scene, part)


SMOOTH: dict[str, Callable[[int, float], StandardScene]] = {
    "swung": lambda seed, s: _hung("swung", seed, stretch=1.0, sideways=0.0, bob=0.0, seconds=s),
    "sideways": lambda seed, s: _hung("sideways", seed, stretch=1.0, sideways=1.0, bob=0.0, seconds=s),
    "bobbed": lambda seed, s: _hung("bobbed", seed, stretch=1.0, sideways=0.0, bob=1.0, seconds=s),
    "stiffer": lambda seed, s: _hung("stiffer", seed, stretch=10.0, sideways=0.0, bob=0.0, seconds=s),
    "stiffest": lambda seed, s: _hung("stiffest", seed, stretch=30.0, sideways=0.0, bob=0.0, seconds=s),
}
TOUCHED: dict[str, Callable[[int, float], StandardScene]] = {
    "pushed": _pushed,
    "sphere": lambda seed, s: _draped("sphere", seed, s),
    "cube": lambda seed, s: _draped("cube", seed, s),
    "plain": _plain,
    "worn": _worn,
}
