"""Resampling: exact for what the grid can hold, nothing folded down from above."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.resampling import fill_gaps, resample, resample_held, typical_period


def test_a_straight_line_stays_a_straight_line_on_jittered_times() -> None:
    """Linear interpolation is exact for it."""
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0.0, 1.0, 400))
    grid = np.arange(0.1, 0.9, 0.004)
    np.testing.assert_allclose(resample(time, (3.0 * time)[:, np.newaxis], grid)[:, 0], 3.0 * grid, atol=1e-9)


def test_a_tone_above_the_new_nyquist_frequency_does_not_alias() -> None:
    """45 Hz sampled at 50 Hz would look like 5 Hz; less than 1 % of it may remain."""
    time = np.arange(0.0, 10.0, 0.0025)
    grid = np.arange(1.0, 9.0, 0.02)
    remains = resample(time, np.sin(2 * np.pi * 45.0 * time)[:, np.newaxis], grid)
    assert np.abs(remains).max() < 0.01


def test_a_slow_tone_passes_the_anti_alias_filter_unchanged() -> None:
    """3 Hz at 50 Hz: size and phase within a thousandth."""
    time = np.arange(0.0, 10.0, 0.0025)
    grid = np.arange(1.0, 9.0, 0.02)
    passed = resample(time, np.sin(2 * np.pi * 3.0 * time)[:, np.newaxis], grid)[:, 0]
    np.testing.assert_allclose(passed, np.sin(2 * np.pi * 3.0 * grid), atol=1e-3)


def test_bunched_stamps_do_not_hide_the_true_rate() -> None:
    """Pairs of stamps 1 us apart every 10 ms are 200 rows per second."""
    time = np.repeat(np.arange(0.0, 1.0, 0.01), 2) + np.tile([0.0, 1e-6], 100)
    # Half of the steps are 1 us, so their median alone would promise a megahertz.
    assert 1.0 / typical_period(time) == pytest.approx(200.0, rel=0.01)


def test_bunches_and_a_pause_together_show_the_rate_between_the_pauses() -> None:
    """Triples every 10 ms, and two minutes without a row."""
    triples = np.repeat(np.arange(0.0, 2.0, 0.01), 3) + np.tile([0.0, 1e-6, 2e-6], 200)
    time = np.concatenate([triples, triples + 122.0])
    assert 1.0 / typical_period(time) == pytest.approx(300.0, rel=0.01)


def test_a_pause_does_not_lower_the_typical_rate() -> None:
    """Ten seconds without a sample are a gap, not a slower sensor."""
    time = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(11.0, 12.0, 0.01)])
    assert 1.0 / typical_period(time) == pytest.approx(100.0)


def test_a_single_sample_has_no_rate() -> None:
    """NaN, not a division by zero."""
    assert np.isnan(typical_period(np.array([1.0])))


def test_held_values_at_grid_points_are_the_samples_themselves() -> None:
    """Evenly spaced on the grid: nothing is averaged away."""
    time = np.arange(0.0, 1.0, 0.0025)
    values = np.sin(9.0 * time)[:, np.newaxis]
    np.testing.assert_allclose(resample_held(time, values, time), values, atol=1e-9)


def test_a_microsecond_of_jitter_does_not_move_held_values_by_a_sample() -> None:
    """Whether a stamp falls just before or just after a grid point changes nothing."""
    rng = np.random.default_rng(0)
    grid = np.arange(0.0, 1.0, 0.0025)
    values = np.sin(9.0 * grid)[:, np.newaxis]
    jittered = grid + rng.uniform(-1e-6, 1e-6, grid.size)
    np.testing.assert_allclose(resample_held(jittered, values, grid), values, atol=1e-4)


def test_held_values_keep_their_area_whatever_the_spacing() -> None:
    """The impulse of a torque is what turns the vehicle."""
    time = np.array([0.0, 0.013, 0.014, 0.05, 0.08])
    values = np.array([1.0, -2.0, 4.0, 0.5, 3.0])[:, np.newaxis]
    grid = np.arange(0.0, 0.1, 0.01)
    impulse = resample_held(time, values, grid).sum() * 0.01
    assert impulse == pytest.approx(0.013 - 2 * 0.001 + 4 * 0.036 + 0.5 * 0.03 + 3 * 0.02)


def test_gaps_are_filled_on_a_straight_line_and_samples_stay() -> None:
    time_s = np.array([0.0, 0.01, 0.02, 0.06, 0.07])
    filled_s, values = fill_gaps(time_s, 100.0 * time_s[:, np.newaxis], 0.01, 0.03)
    np.testing.assert_allclose(filled_s, 0.01 * np.arange(8), atol=1e-12)
    np.testing.assert_allclose(values[:, 0], np.arange(8), atol=1e-9)


def test_samples_without_gaps_are_handed_back() -> None:
    time_s, values = np.array([0.0, 0.01, 0.03]), np.zeros((3, 2))
    assert fill_gaps(time_s, values, 0.01, 0.03)[1] is values
