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
