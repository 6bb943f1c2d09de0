"""Least squares without negative coefficients, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from quadid_logs.maths.nonnegative import nonnegative_least_squares


@pytest.mark.parametrize("n_columns", [1, 2, 5, 12])
def test_coefficients_without_sign_are_scipys(n_columns: int) -> None:
    """Of columns that resemble each other, too, where several have to go again."""
    rng = np.random.default_rng(n_columns)
    for _ in range(40):
        alike = rng.standard_normal((30, 1)) + 0.3 * rng.standard_normal((30, n_columns))
        target = rng.standard_normal(30) + alike @ rng.standard_normal(n_columns)
        found = nonnegative_least_squares(alike, target)
        assert found == pytest.approx(nnls(alike, target)[0], rel=1e-9, abs=1e-12)


def test_a_target_that_all_columns_oppose_gets_none() -> None:
    assert nonnegative_least_squares(np.ones((4, 2)), -np.ones(4)).tolist() == [0.0, 0.0]


def test_of_two_equal_columns_one_is_enough() -> None:
    assert nonnegative_least_squares(np.ones((4, 2)), np.ones(4)) == pytest.approx([1.0, 0.0])


def test_columns_of_zeros_are_left_out() -> None:
    assert nonnegative_least_squares(np.zeros((4, 2)), np.ones(4)).tolist() == [0.0, 0.0]
