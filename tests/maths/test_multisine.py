"""Multisines: low peaks, odd harmonics, no two alike."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.multisine import _norm, orthogonal
from tests.marks import thorough

BANDS = ((5.0, 200.0), (5.0, 200.0), (3.0, 100.0))


@pytest.mark.parametrize("n_lines", [16, thorough(24)])
def test_peaks_are_below_1_6_times_the_rms(n_lines: int) -> None:
    """A sine has 1.41; random phases have 2.5 to 3."""
    time = np.linspace(0.0, 1.0, 20_000, endpoint=False)
    for one in orthogonal(BANDS, n_lines):
        wave = one.wave(time)
        assert np.abs(wave).max() / np.sqrt(np.mean(wave**2)) < 1.6


@pytest.mark.parametrize("order", [2, 32])
def test_the_slope_of_a_norm_is_that_by_differences(order: int) -> None:
    """Or the search for low peaks walks in another direction than down."""
    phases = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, 7)
    slope, step = _norm(phases, order)[1], 1e-6 * np.eye(7)
    by_differences = [(_norm(phases + one, order)[0] - _norm(phases - one, order)[0]) / 2e-6 for one in step]
    np.testing.assert_allclose(slope, by_differences, atol=1e-6)


def test_over_a_period_no_two_go_together() -> None:
    """Each axis has harmonics of its own."""
    time = np.linspace(0.0, 1.0, 4000, endpoint=False)
    waves = np.array([one.wave(time) for one in orthogonal(BANDS, 12)])
    products = waves @ waves.T
    assert np.abs(products - np.diag(np.diag(products))).max() < 1e-9 * products.max()


def test_harmonics_are_odd_and_in_their_bands() -> None:
    """What is not linear answers at even ones, too."""
    for one, (low, high) in zip(orthogonal(BANDS, 12), BANDS, strict=True):
        assert np.all(one.harmonics % 2 == 1)
        assert low <= one.harmonics.min() < 2.0 * low
        assert high >= one.harmonics.max() > 0.8 * high
