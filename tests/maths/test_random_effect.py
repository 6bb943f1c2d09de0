"""Several estimates of one value, or of several."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadid_logs.maths.random_effect import random_effect, random_effect_mean
from tests.marks import thorough


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


@pytest.mark.parametrize("between", [0.0, thorough(0.05), 0.2])
@pytest.mark.parametrize("n", [3, thorough(5), 12])
def test_the_interval_of_the_mean_covers_what_two_vehicles_about(n: int, between: float) -> None:
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


@pytest.mark.parametrize(("sd", "n"), [(0.0, 3), (0.02, 5), (0.1, 3), (0.1, 8)])
def test_the_mean_of_a_random_effect_lies_in_its_interval(sd: float, n: int) -> None:
    """In 95 % of cases, with and without a spread between; of 400 draws 91 % are three deviations less."""
    random = np.random.default_rng(11)
    held = {"mean": 0, "sd": 0, "next": 0}
    for _ in range(400):
        half = random.uniform(0.02, 0.1, n + 1)
        value = 1.0 + sd * random.standard_normal(n + 1) + half / 1.96 * random.standard_normal(n + 1)
        found = random_effect_mean(value[:n], half[:n])
        held["mean"] += abs(found.value - 1.0) < found.half_width
        held["sd"] += found.sd_ci95[0] <= sd <= found.sd_ci95[1]
        held["next"] += abs(value[n] - found.value) < np.hypot(found.next_half_width, half[n])
    assert min(held.values()) >= 0.91 * 400


def test_the_interval_of_the_mean_is_never_narrower_than_the_estimates_make_it() -> None:
    """Four that are equal by chance know the mean to a half of what each of them knows."""
    found = random_effect_mean(np.ones(4), np.full(4, 0.1))
    assert found.half_width == pytest.approx(0.05, rel=1e-6)
    assert found.sd == 0.0


@given(
    value=st.lists(st.floats(-1e9, 1e9), min_size=0, max_size=6),
    width=st.lists(
        st.floats(1e-12, 1e9) | st.sampled_from([0.0, float("nan"), float("inf")]), min_size=6, max_size=6
    ),
)
def test_the_mean_of_any_estimates_has_ordered_finite_ends(value: list[float], width: list[float]) -> None:
    """Whatever the estimates are, the standard deviation's interval is ordered and nothing is NaN."""
    found = random_effect_mean(np.array(value), np.array(width[: len(value)]))
    assert 0.0 <= found.sd_ci95[0] <= found.sd_ci95[1]
    assert found.half_width >= 0.0
