"""H_k at every k: exact where it can be, honest where it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadid_logs.errors import ShapeError
from quadid_logs.maths.sliding_windows import solve_windows, stack_windows


def _windows(seed: int, width: int, unknowns: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((7, width, unknowns)), rng.standard_normal((3, unknowns))


@pytest.mark.parametrize(("width", "unknowns"), [(6, 6), (9, 9), (20, 9)])
def test_exact_data_give_the_exact_coefficients_in_every_window(width: int, unknowns: int) -> None:
    """Square windows (the paper's) and wider ones recover what generated the data."""
    H, theta = _windows(1, width, unknowns)
    solution = solve_windows(H, H @ theta.T)
    np.testing.assert_allclose(solution.coefficients, np.broadcast_to(theta, (7, *theta.shape)), rtol=1e-8)


@given(scale=st.lists(st.floats(1e-6, 1e6), min_size=6, max_size=6), seed=st.integers(0, 1000))
def test_the_condition_number_does_not_depend_on_the_units(scale: list[float], seed: int) -> None:
    """Measuring a column in other units changes neither condition number nor rank."""
    H, theta = _windows(seed, 6, 6)
    plain = solve_windows(H, H @ theta.T)
    scaled = solve_windows(H * np.array(scale), H @ theta.T)
    np.testing.assert_allclose(scaled.condition_number, plain.condition_number, rtol=1e-6)
    np.testing.assert_array_equal(scaled.rank, plain.rank)


def test_a_zero_column_is_rank_deficient_and_gets_a_zero_coefficient() -> None:
    """One axis excited from rest leaves columns of zeros: the paper's own experiment."""
    H, theta = _windows(2, 6, 6)
    H[:, :, 2] = 0.0
    solution = solve_windows(H, H @ theta.T)
    assert np.all(solution.rank == 5)
    assert np.all(np.isinf(solution.condition_number))
    # Zero but for rounding: the minimum-norm solution puts nothing where nothing was seen.
    assert np.abs(solution.coefficients[:, :, 2]).max() < 1e-12


def test_the_solution_agrees_with_the_pseudo_inverse_that_the_paper_uses() -> None:
    """Minimum-norm solutions in scaled and unscaled columns agree at full rank."""
    H, theta = _windows(3, 6, 6)
    targets = H @ theta.T + 0.1
    expected = np.linalg.pinv(H) @ targets
    np.testing.assert_allclose(np.swapaxes(solve_windows(H, targets).coefficients, 1, 2), expected, rtol=1e-7)


def test_windows_take_consecutive_samples_at_the_asked_stride_and_step() -> None:
    """Width 3, stride 2, every second sample: k, k+2, k+4."""
    series = np.arange(10.0)[:, np.newaxis]
    windows = stack_windows(series, width=3, stride=2, step=2)[:, :, 0]
    np.testing.assert_array_equal(windows, [[0, 2, 4], [2, 4, 6], [4, 6, 8]])


def test_a_series_shorter_than_a_window_has_no_windows() -> None:
    """No error: there is just nothing to solve."""
    assert stack_windows(np.zeros((5, 2)), width=6, stride=1).shape == (0, 6, 2)


def test_a_window_with_fewer_samples_than_unknowns_is_refused() -> None:
    """The error says how wide the window must be."""
    with pytest.raises(ShapeError, match="at least 9"):
        solve_windows(np.zeros((1, 6, 9)), np.zeros((1, 6, 1)))


def test_a_stride_of_zero_is_refused() -> None:
    """It would never get anywhere."""
    with pytest.raises(ShapeError, match="at least 1"):
        stack_windows(np.zeros((5, 2)), width=2, stride=0)


@given(n=st.integers(0, 30), width=st.integers(1, 5), stride=st.integers(1, 4), step=st.integers(1, 4))
def test_every_window_that_fits_is_there(n: int, width: int, stride: int, step: int) -> None:
    """Sample i of window k is sample k * stride + i * step, as long as the series reaches."""
    windows = stack_windows(np.arange(float(n))[:, np.newaxis], width=width, stride=stride, step=step)
    expected = [
        [start + i * step for i in range(width)]
        for start in range(0, n, stride)
        if start + (width - 1) * step < n
    ]
    np.testing.assert_array_equal(windows[:, :, 0], np.reshape(expected, (-1, width)))


def test_the_condition_number_is_the_ratio_of_the_singular_values_of_unit_columns() -> None:
    """Two columns at an angle of 60 degrees: sqrt((1 + cos) / (1 - cos)), whatever their lengths."""
    H = np.array([[[2.0, 2.5], [0.0, 2.5 * np.sqrt(3.0)]]])
    assert solve_windows(H, np.ones((1, 2, 1))).condition_number[0] == pytest.approx(np.sqrt(3.0))


def test_residual_and_columns_are_given_by_their_root_mean_square() -> None:
    """A constant of 3 against a target that alternates: nothing is explained."""
    H = np.full((1, 4, 1), 3.0)
    solution = solve_windows(H, np.array([1.0, -1.0, 1.0, -1.0]).reshape(1, 4, 1))
    assert solution.coefficients.item() == pytest.approx(0.0, abs=1e-12)
    assert solution.residual_rms.item() == pytest.approx(1.0)
    assert solution.column_rms.item() == pytest.approx(3.0)


def test_a_square_window_of_which_a_column_is_another_s_double_is_solved_at_least_norm() -> None:
    """Elimination would give numbers without meaning there; its neighbours are solved as ever."""
    rng = np.random.default_rng(6)
    H, theta = rng.standard_normal((3, 4, 4)), np.arange(1.0, 5.0)
    H[1, :, 3] = 2.0 * H[1, :, 2]
    solution = solve_windows(H, (H @ theta)[..., np.newaxis])
    assert solution.rank.tolist() == [4, 3, 4]
    np.testing.assert_allclose(solution.coefficients[[0, 2], 0], [theta, theta], rtol=1e-9)
    np.testing.assert_allclose(H[1] @ solution.coefficients[1, 0], H[1] @ theta, rtol=1e-9)
    assert np.abs(solution.coefficients[1, 0]).max() < 12.0
