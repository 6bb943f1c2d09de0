"""Several estimates of one value, or of several."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.random_effect import random_effect


def draws(n: int, between: float, *, seed: int, size: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Return estimates of 1 with errors of 0.02 to 0.08, and half of their 95 % intervals; (size, n) each."""
    rng = np.random.default_rng(seed)
    sigma = rng.uniform(0.02, 0.08, (size, n))
    value = 1.0 + between * rng.standard_normal((size, n)) + sigma * rng.standard_normal((size, n))
    return value, 1.959964 * sigma


def fixed(value: np.ndarray, half: np.ndarray) -> tuple[float, float]:
    """Return the mean that knows of no difference, and half of its interval."""
    weight = half**-2.0
    return float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)


@pytest.mark.parametrize("n", [2, 3, 5, 20])
def test_estimates_of_one_value_are_rarely_told_apart(n: int) -> None:
    """At 5 % one in twenty, within three standard deviations of 2000 draws."""
    value, half = draws(n, 0.0, seed=n)
    told = np.mean([random_effect(*each).p_value < 0.05 for each in zip(value, half, strict=True)])
    assert 0.035 < told < 0.065


@pytest.mark.parametrize("between", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("n", [3, 5, 12])
def test_the_interval_of_the_mean_covers_what_flights_differ_about(n: int, between: float) -> None:
    """The mean's own interval and what is added cover the true mean in 93 % of draws and more."""
    value, half = draws(n, between, seed=10 * n)
    covered = []
    for one, width in zip(value, half, strict=True):
        mean, own = fixed(one, width)
        covered.append(abs(mean - 1.0) < np.hypot(own, random_effect(one, width).half_width))
    assert np.mean(covered) > 0.93


def test_the_spread_between_is_found() -> None:
    """Of twelve estimates, within a third of it in the mean."""
    value, half = draws(12, 0.15, seed=3)
    found = np.mean([random_effect(*each).sd for each in zip(value, half, strict=True)])
    assert 0.13 < found < 0.17


def test_two_estimates_are_compared_but_nothing_is_added() -> None:
    """Their spread says next to nothing of that of others."""
    found = random_effect(np.array([1.0, 1.5]), np.array([0.05, 0.05]))
    assert found.p_value < 1e-9
    assert found.half_width == 0.0


def test_what_is_not_known_is_left_out() -> None:
    """A flight without motion about an axis tells nothing of it."""
    known = random_effect(np.array([1.0, 1.1, 0.9]), np.full(3, 0.05))
    value, half = np.array([1.0, np.nan, 1.1, 0.9, 2.0]), np.array([0.05, 0.05, 0.05, 0.05, np.nan])
    assert random_effect(value, half) == known
    assert random_effect(np.array([np.nan]), np.array([np.nan])).n == 0
