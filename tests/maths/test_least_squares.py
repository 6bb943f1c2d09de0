"""Least squares and its intervals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadid_logs.errors import ShapeError
from quadid_logs.maths.least_squares import (
    Equation,
    clustered_covariance,
    first_order_change,
    solve_least_squares,
)


@given(seed=st.integers(0, 10_000), decades=st.integers(0, 8))
def test_the_solution_agrees_with_lapack_whatever_the_units(seed: int, decades: int) -> None:
    """numpy.linalg.lstsq is the reference."""
    rng = np.random.default_rng(seed)
    Z = rng.standard_normal((40, 5)) * np.logspace(0, decades, 5)
    Y = rng.standard_normal((40, 2))
    expected = np.linalg.lstsq(Z, Y, rcond=None)[0].T
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(solve_least_squares(Z, Y).coefficients / scale, expected / scale, atol=1e-8)


def test_a_repeated_column_is_reported_as_rank_deficient() -> None:
    """q and M moving together must not look like an identified pair."""
    column = np.linspace(-1.0, 1.0, 20)[:, np.newaxis]
    solution = solve_least_squares(np.hstack([column, 3.0 * column]), column)
    assert solution.rank == 1
    assert np.isinf(solution.condition_number)


def test_too_few_samples_are_refused() -> None:
    """The message names both numbers."""
    with pytest.raises(ShapeError, match="2 samples cannot determine 3 coefficients"):
        solve_least_squares(np.ones((2, 3)), np.ones((2, 1)))


def _slopes(n_runs: int, memory: float) -> tuple[np.ndarray, np.ndarray]:
    """Estimate a slope of zero in noise with memory; return estimates and clustered standard errors."""
    rng = np.random.default_rng(5)
    n, length = 4000, 200
    estimates, errors = [], []
    for _ in range(n_runs):
        noise = rng.standard_normal((2, n))
        for k in range(1, n):
            noise[:, k] += memory * noise[:, k - 1]
        x = noise[0][:, np.newaxis]
        fit = solve_least_squares(x, noise[1][:, np.newaxis])
        equation = Equation(x, fit.residuals[:, 0], np.array([0]))
        covariance = clustered_covariance([equation], np.arange(n) // length, 1)
        estimates.append(fit.coefficients[0, 0])
        errors.append(np.sqrt(covariance[0, 0]))
    return np.array(estimates), np.array(errors)


@pytest.mark.thorough
def test_clustered_errors_match_the_true_spread_of_estimates_in_coloured_noise() -> None:
    """With residual autocorrelation 0.95 the true spread over 150 runs is met within its own noise."""
    estimates, errors = _slopes(150, 0.95)
    # The spread of 150 runs is known to 6 %, the clusters (20) lose a few per cent more.
    assert np.mean(errors) == pytest.approx(np.std(estimates), rel=0.2)


@pytest.mark.thorough
def test_the_white_noise_formula_would_be_far_too_small_in_that_noise() -> None:
    """Otherwise the test above would prove nothing."""
    estimates, _ = _slopes(60, 0.95)
    white = 1.0 / np.sqrt(4000.0)
    assert np.std(estimates) > 3.0 * white


def test_parameters_shared_by_two_targets_get_tighter_than_from_one() -> None:
    """Two targets that see the same parameter halve its variance."""
    rng = np.random.default_rng(2)
    x = rng.standard_normal((2000, 1))
    clusters = np.arange(2000) // 20
    one = [Equation(x, rng.standard_normal(2000), np.array([0]))]
    two = [*one, Equation(x, rng.standard_normal(2000), np.array([0]))]
    ratio = clustered_covariance(two, clusters, 1) / clustered_covariance(one, clusters, 1)
    assert ratio[0, 0] == pytest.approx(0.5, rel=0.3)  # 100 clusters know a variance to 14 %


def test_the_first_order_change_is_that_of_a_fit_to_the_changed_targets() -> None:
    """Least squares is linear in its targets, with a shared parameter and a prior too."""
    rng = np.random.default_rng(8)
    jacobians = rng.standard_normal((2, 50, 3))
    places = [np.array([0, 1, 3]), np.array([2, 1, 3])]
    prior = np.array([0.0, 2.0, 0.0, 5.0])
    errors = rng.standard_normal((2, 50, 2))
    whole = np.zeros((2, 50, 4))
    for each, jacobian, place in zip(whole, jacobians, places, strict=True):
        each[:, place] = jacobian
    stacked = np.concatenate([*whole, np.diag(np.sqrt(prior))])
    expected, *_ = np.linalg.lstsq(stacked, np.concatenate([*errors, np.zeros((4, 2))]), rcond=None)
    equations = [Equation(j, np.zeros(50), place) for j, place in zip(jacobians, places, strict=True)]
    found = first_order_change(equations, list(errors), 4, prior)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def _shared_problem() -> tuple[list[Equation], np.ndarray, np.ndarray, np.ndarray]:
    """Two targets with one common parameter, 12 clusters, columns of unlike size, one prior.

    Returns equations, clusters, the prior's precision, and the rows of both
    equations by all parameters, shape (2, 60, 4).
    """
    rng = np.random.default_rng(11)
    places = [np.array([0, 1, 3]), np.array([2, 3])]
    whole = np.zeros((2, 60, 4))
    for rows, place in zip(whole, places, strict=True):
        rows[:, place] = rng.standard_normal((60, place.size)) * np.array([1.0, 50.0, 0.02, 3.0])[place]
    prior = np.array([0.0, 900.0, 0.0, 40.0])
    noise = np.repeat(rng.standard_normal((2, 12)), 5, axis=1) + 0.3 * rng.standard_normal((2, 60))
    clusters = np.arange(60) // 5
    theta = _fit(whole, noise, prior, np.ones(60, dtype=bool))
    equations = [
        Equation(rows[:, place], target - rows @ theta, place)
        for rows, place, target in zip(whole, places, noise, strict=True)
    ]
    return equations, clusters, prior, np.concatenate([whole, noise[..., np.newaxis]], axis=2)


def _fit(whole: np.ndarray, targets: np.ndarray, prior: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Solve some samples of both equations together with the prior."""
    stacked = np.concatenate([*whole[:, kept], np.diag(np.sqrt(prior))])
    return np.linalg.lstsq(stacked, np.concatenate([*targets[:, kept], np.zeros(4)]), rcond=None)[0]


def test_the_clustered_covariance_is_the_jackknife_of_leaving_each_cluster_out() -> None:
    """CR3: (G - 1) / G times the sum of squared changes, by refitting G times; the prior adds its own."""
    equations, clusters, prior, table = _shared_problem()
    whole, targets = table[..., :4], table[..., 4]
    theta = _fit(whole, targets, prior, np.ones(60, dtype=bool))
    changes = np.array([_fit(whole, targets, prior, clusters != number) - theta for number in range(12)])
    information = np.einsum("eni,enj->ij", whole, whole) + np.diag(prior)
    inverse = np.linalg.inv(information)
    expected = 11.0 / 12.0 * changes.T @ changes + inverse @ np.diag(prior) @ inverse
    found = clustered_covariance(equations, clusters, 4, prior)
    deviation = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(
        found / np.outer(deviation, deviation), expected / np.outer(deviation, deviation), atol=1e-6
    )


def test_a_parameter_that_no_row_holds_takes_its_variance_from_the_prior() -> None:
    """One over its precision, in whatever unit."""
    x = np.random.default_rng(3).standard_normal((40, 1))
    equation = Equation(x, np.ones(40), np.array([0]))
    covariance = clustered_covariance([equation], np.arange(40) // 4, 2, np.array([0.0, 25.0]))
    assert covariance[1, 1] == pytest.approx(1.0 / 25.0)
