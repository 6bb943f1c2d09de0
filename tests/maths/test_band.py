"""Filters as frequency responses: no phase error, right time constants."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.fft

from quadid_logs.maths.band import (
    angular_frequency,
    butterworth_response,
    delay_response,
    filtered,
    gaussian_reach_s,
    gaussian_response,
    gyro_response,
    high_pass,
    lag_response,
    notch_response,
    shorter_fast_length,
)

N, PERIOD_S = 2000, 0.005


def _apply(signal: np.ndarray, response: np.ndarray, n_out: int = N) -> np.ndarray:
    spectrum = np.fft.rfft(signal[:, np.newaxis], axis=0)
    return filtered(spectrum, response, n_samples=N, n_out=n_out)[:, 0]


def test_smoothing_and_differentiating_a_sine_gives_its_derivative_without_delay() -> None:
    """The derivative of a smoothed 1 Hz sine is a cosine of known size, in phase."""
    t = np.arange(N) * PERIOD_S
    s = angular_frequency(N, PERIOD_S)
    slope = _apply(np.sin(2 * np.pi * t), s * gaussian_response(s, 5.0))
    expected = 2 * np.pi * np.cos(2 * np.pi * t) * 2.0 ** (-0.5 / 25.0)
    np.testing.assert_allclose(slope, expected, atol=1e-9)


def test_the_gaussian_is_three_decibels_down_at_its_cutoff() -> None:
    """-3 dB is a factor of sqrt(1/2)."""
    s = np.array([2j * np.pi * 4.0])
    assert gaussian_response(s, 4.0)[0] == pytest.approx(np.sqrt(0.5))


def test_the_kernel_has_died_out_at_its_reach() -> None:
    """Beyond the reach an impulse leaves less than 1e-6 of its peak."""
    s = angular_frequency(N, PERIOD_S)
    impulse = np.zeros(N)
    impulse[N // 2] = 1.0
    kernel = np.abs(_apply(impulse, gaussian_response(s, 5.0)))
    reach = int(np.ceil(gaussian_reach_s(5.0) / PERIOD_S))
    assert kernel[: N // 2 - reach].max() < 1.01e-6 * kernel.max()


def test_lag_and_delay_move_a_step_as_their_closed_forms_say() -> None:
    """1 - exp(-(t - tau) / T) after a smooth step; the period wraps far away."""
    t = np.arange(N) * PERIOD_S
    step = (t > 2.0).astype(float) - (t > 7.0).astype(float)
    s = angular_frequency(N, PERIOD_S)
    response = _apply(step, lag_response(s, 0.2) * delay_response(s, 0.05))
    inside = (t > 2.3) & (t < 6.5)
    # The step lies half a sample before the first sample that shows it.
    expected = 1.0 - np.exp(-(t - 2.0 - 0.5 * PERIOD_S - 0.05) / 0.2)
    np.testing.assert_allclose(response[inside], expected[inside], atol=2e-3)


def test_the_gyro_filter_delays_slow_motion_by_its_known_group_delay() -> None:
    """sqrt(2) / (2 pi f_c), the group delay of a second-order Butterworth filter at zero."""
    s = np.array([2j * np.pi * 0.01])
    delay = -np.angle(butterworth_response(s, 20.0)[0]) / (2 * np.pi * 0.01)
    assert delay == pytest.approx(np.sqrt(2.0) / (2 * np.pi * 20.0), rel=1e-6)


def test_a_coarser_grid_shows_the_same_signal() -> None:
    """Every tenth sample of the smoothed signal, without filtering at full rate first."""
    rng = np.random.default_rng(1)
    signal = rng.standard_normal(N)
    smoothing = gaussian_response(angular_frequency(N, PERIOD_S), 1.5)
    np.testing.assert_allclose(_apply(signal, smoothing, N // 10), _apply(signal, smoothing)[::10], atol=1e-7)


def test_a_notch_leaves_its_depth_at_the_centre_and_all_at_rest() -> None:
    """Whatever its width."""
    s = 2j * np.pi * np.array([0.0, 80.0])
    np.testing.assert_allclose(notch_response(s, 80.0, 0.5, 0.01), [1.0, 0.01], atol=1e-12)


def test_far_below_its_centre_a_notch_is_a_delay() -> None:
    """Of (1 - depth) / (Q omega): 1 ms for 80 Hz and half its width."""
    frequency_hz, inverse_q, depth = 80.0, 0.5, 0.01
    s = 2j * np.pi * np.array([1.0])
    delay_s = -np.angle(notch_response(s, frequency_hz, inverse_q, depth))[0] / (2.0 * np.pi)
    assert delay_s == pytest.approx((1.0 - depth) * inverse_q / (2.0 * np.pi * frequency_hz), rel=1e-3)


def test_the_reach_is_where_the_kernel_has_fallen_to_a_millionth() -> None:
    """Neither nearer nor much farther: rows within it of a gap are lost."""
    sigma_hz = 5.0 / np.sqrt(np.log(2.0))
    kernel = np.exp(-0.5 * (2.0 * np.pi * sigma_hz * gaussian_reach_s(5.0)) ** 2)
    assert kernel == pytest.approx(1e-6, rel=1e-9)


def test_the_gyro_low_pass_is_a_second_order_butterworth() -> None:
    """3 dB down at its cut-off, and 40 dB per decade above."""
    s = 2j * np.pi * np.array([20.0, 2000.0, 20_000.0])
    gain = np.abs(butterworth_response(s, 20.0))
    assert gain[0] == pytest.approx(np.sqrt(0.5))
    assert gain[1] / gain[2] == pytest.approx(100.0, rel=1e-3)


def test_a_notch_is_as_wide_as_its_inverse_quality() -> None:
    """Half of the power passes at two frequencies that lie f_0 / Q apart."""
    half = 0.5 * 0.3
    edges_hz = 80.0 * (np.sqrt(1.0 + half**2) + np.array([-half, half]))
    assert np.diff(edges_hz)[0] == pytest.approx(0.3 * 80.0)
    power = np.abs(notch_response(2j * np.pi * edges_hz, 80.0, 0.3, 0.0)) ** 2
    np.testing.assert_allclose(power, 0.5, rtol=1e-9)


def test_a_gyro_s_filters_act_one_after_the_other() -> None:
    """Low-pass and all notches; nothing known is no filter."""
    s = 2j * np.pi * np.array([3.0, 30.0, 90.0])
    first, second = (60.0, 0.5, 0.1), (120.0, 0.4, 0.05)
    expected = butterworth_response(s, 40.0) * notch_response(s, *first) * notch_response(s, *second)
    np.testing.assert_allclose(gyro_response(s, 40.0, [first, second]), expected, rtol=1e-12)
    np.testing.assert_array_equal(gyro_response(s, np.nan, []), np.ones(3))


@pytest.mark.parametrize("n_rows", [1, 7, 240, 1300, 4000, 13_000])
def test_a_short_record_is_high_passed_as_a_long_one(n_rows: int) -> None:
    """A few cosines are taken out one by one, many by two transforms: the same projection."""
    columns = np.random.default_rng(n_rows).standard_normal((n_rows, 3)) + 5.0
    spectrum = scipy.fft.dct(columns, axis=0, norm="ortho")
    spectrum[: int(2.0 * n_rows * PERIOD_S * 0.5) + 1] = 0.0
    expected = scipy.fft.idct(spectrum, axis=0, norm="ortho")
    np.testing.assert_allclose(high_pass(columns, PERIOD_S, 0.5), expected, atol=1e-12)


def test_the_high_pass_takes_out_the_cosines_below_its_cutoff_and_no_others() -> None:
    """Cosine k over T seconds has the frequency k / (2 T): up to six and the mean go."""
    k = np.arange(12)
    cosines = np.cos(np.pi * (np.arange(N)[:, np.newaxis] + 0.5) * k / N)
    passed = high_pass(cosines, PERIOD_S, 0.32)
    np.testing.assert_allclose(passed, np.where(k <= 6, 0.0, cosines), atol=1e-9)


@pytest.mark.parametrize(("n_samples", "expected"), [(54_185, 54_000), (1024, 1024), (13, 12), (0, 0)])
def test_a_fast_length_has_small_prime_factors_and_is_the_next_one_below(
    n_samples: int, expected: int
) -> None:
    """Cosine transforms of 54 185 = 5 x 10 837 samples take twelve times as long as those of 54 000."""
    assert shorter_fast_length(n_samples) == expected
