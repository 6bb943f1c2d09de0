"""Spectra and coherence against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.discretise import zero_order_hold
from quadid_logs.maths.spectra import averaged_spectra


def test_white_noise_has_the_density_that_its_variance_says() -> None:
    """One-sided: 2 sigma^2 T, on average over the band."""
    rng = np.random.default_rng(3)
    noise = 0.3 * rng.standard_normal(100_000)
    spectra = averaged_spectra([(noise, noise)], period_s=0.01, n_per_segment=400)
    assert np.mean(spectra.input_psd[1:-1]) == pytest.approx(2 * 0.3**2 * 0.01, rel=0.02)


def test_a_linear_system_has_coherence_one_and_independent_noise_near_zero() -> None:
    """The two ends of the scale."""
    rng = np.random.default_rng(4)
    x, other = rng.standard_normal((2, 100_000))
    y = np.convolve(x, [0.5, 0.3, 0.2], mode="same")
    assert averaged_spectra([(x, y)], period_s=0.01, n_per_segment=400).coherence[1:].min() > 0.99
    assert averaged_spectra([(x, other)], period_s=0.01, n_per_segment=400).coherence.mean() < 0.02


def test_records_too_short_for_one_segment_give_no_average() -> None:
    """Zero spectra and a count of zero, no division by zero."""
    spectra = averaged_spectra([(np.zeros(10), np.zeros(10))], period_s=0.01, n_per_segment=400)
    assert spectra.n_averages == 0
    assert not spectra.coherence.any()


def test_a_discretised_lag_steps_as_its_closed_form() -> None:
    """x_dot = (u - x) / T: A_d = exp(-h / T), B_d = 1 - A_d."""
    A_d, B_d = zero_order_hold(np.array([[-5.0]]), np.array([[5.0]]), 0.1)
    assert A_d[0, 0] == pytest.approx(np.exp(-0.5))
    assert B_d[0, 0] == pytest.approx(1.0 - np.exp(-0.5))


def test_an_output_that_comes_late_has_a_falling_phase() -> None:
    """-omega times the delay: the cross spectrum is conj(input) times output."""
    rng = np.random.default_rng(5)
    noise = rng.standard_normal(100_000)
    spectra = averaged_spectra([(noise[3:], noise[:-3])], period_s=0.01, n_per_segment=400)
    low = slice(1, 40)
    expected = -2.0 * np.pi * spectra.frequency_hz[low] * 0.03
    np.testing.assert_allclose(np.angle(spectra.cross[low]), expected, atol=0.05)


def test_a_constant_offset_has_no_power() -> None:
    """Through the window it would leak into the lowest frequencies."""
    x = np.random.default_rng(6).standard_normal(4000)
    plain = averaged_spectra([(x, x)], period_s=0.01, n_per_segment=400)
    offset = averaged_spectra([(x + 50.0, x)], period_s=0.01, n_per_segment=400)
    np.testing.assert_allclose(offset.input_psd, plain.input_psd, rtol=1e-6, atol=1e-12)


def test_segments_overlap_by_half_and_stay_within_a_record() -> None:
    """2000 samples hold nine segments of 400, 799 hold two."""
    records = [(np.ones(n), np.ones(n)) for n in (2000, 799, 399)]
    assert averaged_spectra(records, period_s=0.01, n_per_segment=400).n_averages == 9 + 2


def test_an_output_with_as_much_noise_as_signal_has_coherence_one_half() -> None:
    """It is a fraction of power, not of amplitude."""
    x, noise = np.random.default_rng(7).standard_normal((2, 200_000))
    spectra = averaged_spectra([(x, x + noise)], period_s=0.01, n_per_segment=400)
    assert spectra.coherence[1:].mean() == pytest.approx(0.5, abs=0.01)
