"""Gusts and eddies against what their sources say of them: means, spectra, and that no air appears or vanishes."""

import numpy as np
import pytest
from scipy.integrate import quad

from cape import Wind
from cape.air.gusts import FASTEST, GUST_TIME, SLOWEST, Gusts
from cape.air.turbulence import LARGEST, SMALLEST, Eddies


def test_gusts_have_the_spectrum_of_the_wind():
    # A periodogram over a time T tells waves apart that differ by 1/T; those of a band are all of its variance but for
    # what leaks over its two edges, a wave each at most.
    span, rate = 4000.0, 8.0
    times = np.arange(0.0, span, 1.0 / rate)
    gusts = Gusts(3)
    samples = np.array([gusts.at(time) for time in times])
    power = 2.0 * np.abs(np.fft.rfft(samples) / len(samples)) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1.0 / rate)
    assert np.mean(samples) == pytest.approx(0.0, abs=2.0 / (2.0 * np.pi * SLOWEST * span))

    def variance(low: float, high: float) -> float:
        return quad(lambda n: 4.0 * GUST_TIME / (1.0 + 70.8 * (n * GUST_TIME) ** 2) ** (5.0 / 6.0), low, high)[0]

    whole = variance(SLOWEST, FASTEST)
    for low, high in ((SLOWEST, 0.05), (0.05, 0.2), (0.2, 0.8), (0.8, FASTEST)):
        found = power[(frequency >= low) & (frequency < high)].sum()
        ratio = (FASTEST / SLOWEST) ** (1.0 / 80.0)
        edges = variance(low / ratio, low * ratio) + variance(high / ratio, high * ratio)
        assert found == pytest.approx(variance(low, high) / whole, abs=edges / whole)


def test_eddies_are_as_fast_as_they_are_asked_to_be():
    # Waves are 4 m long at most, so points 50 m apart know nothing of each other: the mean square of 3,000 of them is
    # sure to 1/sqrt(3000) times that of a squared normal number, sqrt(2); three times that is asked for.
    rng = np.random.default_rng(0)
    squares = []
    for seed in range(10):
        places = rng.uniform(-5e3, 5e3, (3000, 3))
        squares.append(np.mean(Eddies(seed).at(2.0, places, speed=0.7) ** 2))
    # The three components share the square evenly in the mean over waves' directions alone.
    assert np.mean(squares) == pytest.approx(0.7**2, rel=3.0 * np.sqrt(2.0 / 3000 / 10))


def test_air_in_eddies_neither_appears_nor_vanishes():
    eddies, h = Eddies(7), 1e-4
    places = np.random.default_rng(1).uniform(-10.0, 10.0, (200, 3))
    slopes = np.stack(
        [
            (eddies.at(1.0, places + h * step, speed=1.0) - eddies.at(1.0, places - h * step, speed=1.0)) / (2.0 * h)
            for step in np.eye(3)
        ],
        axis=2,
    )
    # Central differences are off by h^2/6 times third derivatives, (2 pi / 0.2)^3 of some m/s at most.
    allowed = h**2 / 6.0 * (2.0 * np.pi / SMALLEST) ** 3 * 20.0
    assert np.abs(np.trace(slopes, axis1=1, axis2=2)).max() < allowed
    assert np.abs(slopes).max() > 100.0 * allowed


@pytest.mark.parametrize("distance", [0.1, 0.5, 1.5])
def test_eddies_are_alike_over_as_far_as_their_spectrum_says(distance: float):
    # Of waves in all directions the mean product over a distance r is the mean of sin(k r) / (k r), weighed by the
    # energies k^-5/3 (Batchelor, The Theory of Homogeneous Turbulence, 1953, section 3.4). Waves of one seed have 48
    # directions, of which some 30 matter: 60 seeds leave a deviation of sqrt(1/2 / 30 / 60), and three are allowed.
    low, high = 2.0 * np.pi / LARGEST, 2.0 * np.pi / SMALLEST
    energy = quad(lambda k: k ** (-5 / 3), low, high)[0]
    expected = quad(lambda k: k ** (-5 / 3) * np.sin(k * distance) / (k * distance), low, high)[0] / energy
    places = np.random.default_rng(2).uniform(-1e3, 1e3, (400, 3))
    further = places + np.array([distance, 0.0, 0.0])
    found = []
    for seed in range(60):
        here, there = (Eddies(seed).at(0.0, where, speed=1.0) for where in (places, further))
        found.append(np.mean(here * there))
    assert np.mean(found) == pytest.approx(expected, abs=3.0 * np.sqrt(0.5 / 30 / 60))


def test_a_seed_tells_the_wind_and_the_mean_wind_carries_it():
    places = np.random.default_rng(0).normal(size=(20, 3))
    wind = Wind(velocity=(3.0, 0.0, 0.0), gusts=0.3, turbulence=0.5, seed=4)
    again = Wind(velocity=(3.0, 0.0, 0.0), gusts=0.3, turbulence=0.5, seed=4)
    other = Wind(velocity=(3.0, 0.0, 0.0), gusts=0.3, turbulence=0.5, seed=5)
    np.testing.assert_array_equal(wind.at(1.7, places), again.at(1.7, places))
    assert np.abs(wind.at(1.7, places) - other.at(1.7, places)).max() > 0.1
    # Eddies, that change at a rate of their own, are where the wind has carried them a moment later.
    eddies = Wind(velocity=(3.0, 0.0, 0.0), turbulence=0.5)
    carried = eddies.at(0.01, places + 0.01 * np.array([3.0, 0.0, 0.0]))
    assert (
        np.abs(carried - eddies.at(0.0, places)).max()
        < 0.2 * np.abs(eddies.at(0.01, places) - eddies.at(0.0, places)).max()
    )
