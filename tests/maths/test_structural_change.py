"""A change is found at its time, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.structural_change import largest_change


def series(change_at: int | None, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals of a fit to 4000 samples in 80 clusters, the coefficient 2.0, later 2.5."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(4000)
    slope = np.full(4000, 2.0)
    if change_at is not None:
        slope[change_at:] = 2.5
    y = slope * x + np.convolve(rng.standard_normal(4020), np.ones(21) / 21**0.5, "valid")
    return x, y - x * (x @ y) / (x @ x), np.repeat(np.arange(80), 50)


def test_a_change_is_found_at_its_time_with_both_values() -> None:
    """To two clusters, and the difference to a fifth of it."""
    found = largest_change(*series(2500, seed=1))
    assert found is not None
    assert abs(found.first_cluster - 50) <= 2
    assert abs(found.after - found.before - 0.5) < 0.1
    assert found.statistic > 16.0


def test_without_a_change_the_statistic_keeps_its_distribution() -> None:
    """Above 8.7 in about 5 % of series (Andrews 2003): among 300 between 2 and 10 %."""
    above = [
        found is not None and found.statistic > 8.7
        for found in (largest_change(*series(None, seed=seed)) for seed in range(300))
    ]
    assert 0.02 < np.mean(above) < 0.10


def test_a_regressor_that_never_moves_tells_nothing() -> None:
    """No information, no answer."""
    assert largest_change(np.zeros(100), np.ones(100), np.repeat(np.arange(10), 10)) is None


def by_definition(x: np.ndarray, e: np.ndarray, clusters: np.ndarray) -> tuple[int, float, float, float]:
    """Try every time with 15 % of the information on either side: Wald's statistic of the two slopes."""
    groups = [clusters == number for number in range(clusters.max() + 1)]
    information = np.array([x[rows] @ x[rows] for rows in groups])
    score = np.array([x[rows] @ e[rows] for rows in groups])
    best = (0, 0.0, 0.0, -1.0)
    for first in range(1, len(groups)):
        sides = [slice(0, first), slice(first, None)]
        held = [information[side].sum() / information.sum() for side in sides]
        if min(held) <= 0.15:
            continue
        slopes = [score[side].sum() / information[side].sum() for side in sides]
        variance = sum(
            np.sum((score[side] - slope * information[side]) ** 2) / information[side].sum() ** 2
            for side, slope in zip(sides, slopes, strict=True)
        )
        statistic = (slopes[1] - slopes[0]) ** 2 / variance
        if statistic > best[3]:
            best = (first, slopes[0], slopes[1], statistic)
    return best


@pytest.mark.parametrize(("change_at", "seed"), [(2500, 1), (300, 4), (3900, 6), (None, 2)])
def test_the_largest_change_is_the_largest_of_all_times(change_at: int | None, seed: int) -> None:
    """Also where the change lies too near the start or the end to be judged."""
    problem = series(change_at, seed=seed)
    found = largest_change(*problem)
    assert found is not None
    expected = by_definition(*problem)
    assert found.first_cluster == expected[0]
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-9)
