"""Looks of fabrics: how threads cross, what textures are made of a relief, and what is sewn where, in metres."""

import numpy as np
import pytest

from cape.cloth.cloth import Cloth, GridCloth
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS
from cape.cloth.looks import weaves
from cape.cloth.looks.look import Look
from cape.cloth.looks.maps import REPEATS, maps_of, softened
from cape.cloth.looks.registry import LOOKS, look_of
from cape.cloth.looks.sewn import MAGNIFIED, TEXEL, TEXELS, texture_of
from cape.cloth.looks.weaves import Relief
from cape.cloth.tailoring import HEM

TEXELS_A_THREAD = 16


def test_every_fabric_has_a_look_of_its_own():
    assert set(LOOKS) == set(FABRICS)
    assert len({(look.color, look.weft, look.lining) for look in LOOKS.values()}) == len(LOOKS)
    for name, fabric in FABRICS.items():
        assert look_of(fabric) is LOOKS[name]
    assert look_of(Fabric(density=0.123)) is LOOKS["cape"]


@pytest.mark.parametrize(
    ("weave", "threads", "warp"),
    [
        (weaves.PLAIN, 2, 1 / 2),
        (weaves.twill(3, 1), 4, 3 / 4),
        (weaves.twill(2, 2), 4, 1 / 2),
        (weaves.satin(5, 2), 5, 4 / 5),
    ],
    ids=["plain", "3/1 twill", "2/2 twill", "satin"],
)
def test_threads_cross_as_the_weave_says(weave: weaves.Weave, threads: int, warp: float):
    relief = weave(2, 2 * threads * TEXELS_A_THREAD)
    middles = np.arange(2 * threads) * TEXELS_A_THREAD + TEXELS_A_THREAD // 2
    crossings = relief.weft[np.ix_(middles, middles)]
    assert crossings.mean() == pytest.approx(1.0 - warp)
    # Each thread crosses as many under as over, wherever it lies, and one repeat is like the next.
    np.testing.assert_allclose(crossings.mean(axis=0), 1.0 - warp)
    np.testing.assert_allclose(crossings.mean(axis=1), 1.0 - warp)
    np.testing.assert_array_equal(crossings[:threads, :threads], crossings[threads:, threads:])
    assert 0.0 <= relief.height.min() < 0.5
    assert 0.9 < relief.height.max() <= 1.0


def test_a_twill_goes_one_thread_further_on_in_each_row():
    threads = 4
    relief = weaves.twill(2, 2)(1, threads * TEXELS_A_THREAD)
    middles = np.arange(threads) * TEXELS_A_THREAD + TEXELS_A_THREAD // 2
    crossings = relief.weft[np.ix_(middles, middles)]
    for row in range(threads - 1):
        np.testing.assert_array_equal(crossings[row + 1], np.roll(crossings[row], -1))


@pytest.mark.parametrize("name", sorted(LOOKS))
def test_a_piece_of_fabric_can_be_laid_beside_itself(name: str):
    baked = maps_of(LOOKS[name], texels=128).baked.astype(float)
    for axis in (0, 1):
        steps = np.abs(np.diff(baked, axis=axis, append=baked.take([0], axis))).mean(axis=(1 - axis, 2))
        assert steps[-1] <= steps[:-1].max()


def waves(depth: float, *, repeat: float = 0.01) -> Look:
    """A fabric that is a wave across, so deep from its lowest to its highest in repeats, which are so wide [m]."""

    def weave(repeats: int, texels: int) -> Relief:
        height = 0.5 + 0.5 * np.sin(2.0 * np.pi * repeats * (np.arange(texels) + 0.5) / texels)
        height = np.tile(height.astype(np.float32), (texels, 1))
        return Relief(height, np.zeros_like(height), np.zeros(height.shape, np.int64), depth)

    return Look(color=(120, 60, 200), weave=weave, repeat=repeat, slub=0.0, rough=0.5)


def test_normals_are_those_of_the_relief():
    texels, depth = 1024, 0.2
    maps = maps_of(waves(depth), texels=texels)
    assert maps.size == pytest.approx(REPEATS * 0.01)
    phase = 2.0 * np.pi * REPEATS * (np.arange(texels) + 0.5) / texels
    # The height is depth / 2 sin(2 pi x) repeats, so that its slope is pi depth cos(2 pi x); the central difference of
    # 128 texels a repeat is too small by sin(h) / h, h = 2 pi / 128: 0.04 %.
    slope = np.pi * depth * np.cos(phase)
    expected = np.stack([-slope, np.zeros(texels), np.ones(texels)], axis=1) / np.hypot(slope, 1.0)[:, None]
    normal = maps.normal[5].astype(float) / 127.5 - 1.0
    np.testing.assert_allclose(normal, expected, atol=0.5 / 127.5 + 4e-4)
    np.testing.assert_array_equal(maps.albedo, np.broadcast_to(np.array([120, 60, 200], np.uint8), maps.albedo.shape))
    # Higher is smoother; light comes from the left, so that what rises to the right is brighter than what falls.
    assert maps.roughness[0, phase.searchsorted(np.pi / 2)] < maps.roughness[0, phase.searchsorted(3 * np.pi / 2)]
    lit = maps.baked[0, :, 2].astype(int)
    assert lit[phase.searchsorted(2.0 * np.pi)] > lit[phase.searchsorted(np.pi)]


def test_a_texture_is_blurred_as_by_a_gaussian():
    n, width, waves_ = 64, 2.0, 3
    wave = np.sin(2.0 * np.pi * waves_ * np.arange(n) / n)
    texture = np.rint(127.5 + 100.0 * np.tile(wave, (n, 1))).astype(np.uint8)[..., None]
    # The transform of a Gaussian: each wave of f periods a texel is weaker by exp(-2 (pi f s)^2).
    kept = np.exp(-2.0 * (np.pi * waves_ / n * width) ** 2)
    np.testing.assert_allclose(softened(texture, width)[0, :, 0], 127.5 + 100.0 * kept * wave, atol=0.6)


def flared() -> GridCloth:
    """A cape whose hem is three times as wide as its collar."""
    return Cloth.cape(length=1.0, flare=3.0, spacing=0.05)


def test_a_hem_is_as_wide_all_around_as_it_is_sewn():
    look = Look(color=(20, 20, 20), trim=(220, 220, 220), slub=0.0, relief=0.0)
    cloth = flared()
    texture = texture_of(cloth, look)
    height, width = texture.shape[:2]
    assert height * width <= 1.01 * TEXELS
    assert height == round(1.0 / TEXEL)
    pattern = cloth.pattern.reshape(cloth.rows, cloth.columns, 2)
    widths = np.linalg.norm(np.diff(pattern, axis=1), axis=2).sum(axis=1)
    for share in (0.3, 0.6, 0.9):  # of the way down
        trimmed = texture[round(share * height), :, 0] > 110
        row = np.interp(share, np.linspace(0.0, 1.0, cloth.rows), widths)
        ends = [np.argmin(trimmed), np.argmin(trimmed[::-1])]
        np.testing.assert_allclose(np.array(ends) * row / width, HEM, atol=1.5 * row / width)
    trimmed = texture[:, width // 2, 0] > 110
    ends = [np.argmin(trimmed), np.argmin(trimmed[::-1])]
    np.testing.assert_allclose(np.array(ends) / height, HEM, atol=1.5 / height)


def test_a_weave_is_as_fine_at_the_hem_as_at_the_collar():
    look = waves(0.3, repeat=0.004)
    cloth = flared()
    texture = texture_of(cloth, look)[..., 0].astype(float)
    height, width = texture.shape
    columns = cloth.pattern.reshape(cloth.rows, cloth.columns, 2)[..., 0]
    for share in (0.2, 0.5, 0.8):
        row = [np.interp(share, np.linspace(0.0, 1.0, cloth.rows), column) for column in columns.T]
        middle = slice(width // 4, 3 * width // 4)
        places = np.interp((np.arange(width) + 0.5) / width, np.linspace(0.0, 1.0, cloth.columns), row)[middle]
        line = texture[round(share * height), middle]
        rates = np.linspace(10.0, 60.0, 1001)  # periods a metre
        power = np.abs(np.exp(2j * np.pi * rates[:, None] * places) @ (line - line.mean()))
        assert rates[power.argmax()] == pytest.approx(1.0 / (MAGNIFIED * look.repeat), rel=0.03)


def test_a_seam_runs_down_its_column():
    plain = Cloth.rectangle(width=0.8, height=0.6, spacing=0.1)
    sewn = GridCloth(
        rows=plain.rows, columns=plain.columns, pattern=plain.pattern, positions=plain.positions, seams=(6,)
    )
    look = Look(color=(200, 200, 200), slub=0.0, relief=0.0)
    without, with_seam = (texture_of(cloth, look)[..., 0].astype(float) for cloth in (plain, sewn))
    height, width = without.shape
    darker = (without - with_seam)[height // 2 - 20 : height // 2 + 20].mean(axis=0)
    assert darker.argmax() == pytest.approx(0.75 * width, abs=1.0)
    np.testing.assert_array_equal(darker[: width // 2], 0.0)


def test_a_mesh_is_drawn_in_its_own_measures():
    skirt = Cloth.skirt(waist=1.0, length=0.5)
    assert texture_of(skirt, LOOKS["denim"]).shape[2] == 3
