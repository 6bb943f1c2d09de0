"""Matrix, bias and lag between body rates and attitude, from a motion that is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.gyro_attitude import GyroFit, _jackknife_deviation, fit_gyro_to_attitude
from quadid_logs.maths.rotations import body_rates

MATRIX = np.array([[1.04, 0.02, -0.01], [-0.03, 0.97, 0.015], [0.01, -0.02, 1.02]])
BIAS = np.array([0.02, -0.015, 0.03])
#: Seconds apart; an attitude at 50 Hz, intervals of 0.3 s, four in a block.
ATTITUDE_S = np.arange(0.0, 60.02, 0.02)
INTERVALS = np.column_stack([np.arange(0, 3000, 15), np.arange(15, 3001, 15)])
BLOCK = np.arange(200) // 4
AMPLITUDE = np.array([[0.35, 0.2], [0.3, 0.25], [0.5, 0.3]])
OMEGA = np.array([[1.9, 4.3], [2.7, 5.1], [1.3, 3.7]])


def angles(time_s: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw: two sines each, shape (n, 3)."""
    return np.sum(AMPLITUDE * np.sin(OMEGA * time_s[:, None, None]), axis=2)


def turn_rates(time_s: np.ndarray) -> np.ndarray:
    """Body rates of that motion, shape (n, 3)."""
    slopes = np.sum(AMPLITUDE * OMEGA * np.cos(OMEGA * time_s[:, None, None]), axis=2)
    return body_rates(angles(time_s), slopes)


def fitted(
    *, lag_s: float = 0.0, noise: np.ndarray | float = 0.0, intervals: np.ndarray = INTERVALS
) -> GyroFit:
    """Fit rates that show inv(MATRIX) (true - BIAS), `lag_s` late, to the attitude with noise."""
    time_s = np.arange(-0.5, 60.5, 0.005)
    shown = (turn_rates(time_s) - BIAS) @ np.linalg.inv(MATRIX).T
    fit = fit_gyro_to_attitude(
        time_s + lag_s, shown, ATTITUDE_S, angles(ATTITUDE_S) + noise, intervals, BLOCK[: len(intervals)]
    )
    assert fit is not None
    return fit


def test_matrix_and_bias_of_the_gyro_are_found() -> None:
    """Without noise, to the accuracy of the integration."""
    fit = fitted()
    np.testing.assert_allclose(fit.matrix, MATRIX, atol=2e-4)
    np.testing.assert_allclose(fit.bias_rad_s, BIAS, atol=2e-4)
    assert fit.lag_s == pytest.approx(0.0, abs=2e-4)


@pytest.mark.parametrize("lag_s", [0.035, -0.02])
def test_the_lag_is_positive_where_the_rates_come_late(lag_s: float) -> None:
    """And matrix and bias are those without it."""
    fit = fitted(lag_s=lag_s)
    assert fit.lag_s == pytest.approx(lag_s, abs=5e-4)
    np.testing.assert_allclose(fit.matrix, MATRIX, atol=1e-3)


def test_rates_at_ten_hertz_are_integrated_as_smooth_ones() -> None:
    """The trapezoidal rule alone loses 2 % of the faster sines of this motion."""
    time_s = np.arange(-1.0, 61.0, 0.1)
    fit = fit_gyro_to_attitude(time_s, turn_rates(time_s), ATTITUDE_S, angles(ATTITUDE_S), INTERVALS, BLOCK)
    assert fit is not None
    np.testing.assert_allclose(fit.matrix, np.eye(3), atol=3e-3)


def test_one_jump_of_the_compass_changes_nothing() -> None:
    """Yaw is set by half a radian in the middle: one interval out of two hundred."""
    jump = np.where(ATTITUDE_S[:, np.newaxis] > 30.5, np.array([0.0, 0.0, 0.5]), 0.0)
    rng = np.random.default_rng(1)
    fit = fitted(noise=jump + 0.002 * rng.standard_normal((ATTITUDE_S.size, 3)))
    np.testing.assert_allclose(fit.matrix, MATRIX, atol=0.01)


@pytest.mark.thorough
def test_the_half_widths_are_those_of_95_percent() -> None:
    """1.96 times the spread over 60 noises, of nine elements and the lag: known to 9 % each, 3 % together."""
    rng = np.random.default_rng(2)
    # No end in common: the formula takes the errors of two blocks as independent.
    apart = INTERVALS[:168] + 10 * BLOCK[:168, np.newaxis]
    noise = 0.003 * rng.standard_normal((60, ATTITUDE_S.size, 3))
    fits = [fitted(noise=each, intervals=apart) for each in noise]
    found = np.array([[*fit.matrix.ravel(), fit.lag_s] for fit in fits])
    half_width = np.array([[*fit.half_width.ravel(), fit.lag_half_width_s] for fit in fits])
    ratio = np.mean(half_width, axis=0) / np.std(found, axis=0)
    assert np.exp(np.mean(np.log(ratio))) == pytest.approx(1.96, rel=0.12)


def test_an_axis_that_does_not_turn_is_not_explained() -> None:
    """Of a motion of pitch and yaw alone, roll's own element is unknown, the others are not."""
    time_s = np.arange(-0.5, 60.5, 0.005)
    still = np.array([0.0, 1.0, 1.0])
    slopes = still * np.sum(AMPLITUDE * OMEGA * np.cos(OMEGA * time_s[:, None, None]), axis=2)
    rates = body_rates(still * angles(time_s), slopes)
    rng = np.random.default_rng(3)
    noisy = still * angles(ATTITUDE_S) + 0.003 * rng.standard_normal((ATTITUDE_S.size, 3))
    rates[:, 0] = 0.001 * rng.standard_normal(time_s.size)
    fit = fit_gyro_to_attitude(time_s, rates, ATTITUDE_S, noisy, INTERVALS, BLOCK)
    assert fit is not None
    assert fit.explained[0, 0] < 0.5
    assert fit.explained[1, 1] > 0.99


def test_too_few_intervals_give_no_fit() -> None:
    """Two equations per unknown are the least, and a block's drift takes the equations of one interval."""
    time_s = np.arange(-0.5, 60.5, 0.005)
    args = (time_s, turn_rates(time_s), ATTITUDE_S, angles(ATTITUDE_S))
    assert fit_gyro_to_attitude(*args, INTERVALS[:8], BLOCK[:8]) is None
    assert fit_gyro_to_attitude(*args, INTERVALS[:12], BLOCK[:12]) is not None


def test_a_drift_of_its_own_in_each_block_changes_no_element() -> None:
    """As the compass corrects yaw, which no kinematics depend on: by more than a bias, and never alike."""
    at = np.append(INTERVALS[::4, 0], ATTITUDE_S.size - 1)
    yaw = np.interp(ATTITUDE_S, ATTITUDE_S[at], np.random.default_rng(5).normal(0.0, 0.05, at.size).cumsum())
    fit = fitted(noise=yaw[:, np.newaxis] * np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(fit.matrix, MATRIX, atol=1e-3)


def test_the_interval_is_the_scatter_of_the_fits_without_one_block() -> None:
    """Each fit is made anew, without the formula."""
    rng = np.random.default_rng(4)
    block = np.repeat(np.arange(12), 5)
    regressors = rng.normal(size=(block.size, 3))
    values = regressors @ (1.0, -2.0, 0.5) + rng.normal(size=block.size) * np.where(block == 3, 8.0, 1.0)
    solution = np.linalg.lstsq(regressors, values, rcond=None)[0]
    without = [
        np.linalg.lstsq(regressors[block != left_out], values[block != left_out], rcond=None)[0]
        for left_out in range(12)
    ]
    expected = np.sqrt(np.sum((np.array(without) - solution) ** 2, axis=0))
    found = _jackknife_deviation(
        regressors, np.linalg.pinv(regressors), values - regressors @ solution, block
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9)
