"""Spectra of blocks: derivatives, filters and constants against closed forms."""

from __future__ import annotations

import numpy as np

from quadid_logs.maths.block_spectra import BlockSpectra, block_spectra

PERIOD_S = 0.005
TIME_S = np.arange(4000) * PERIOD_S


def _spectra(*columns: np.ndarray) -> BlockSpectra:
    found = block_spectra([np.column_stack(columns)], [0.0], PERIOD_S, length_s=4.0, highest_hz=20.0)
    assert found is not None
    return found


def test_the_derivative_of_a_sine_is_its_cosine_though_no_sample_is_differentiated() -> None:
    """At 3.3 Hz, between two lines."""
    omega = 2.0 * np.pi * 3.3
    found = _spectra(np.sin(omega * TIME_S), omega * np.cos(omega * TIME_S))
    size = np.abs(found.values[:, :, 1]).max()
    np.testing.assert_allclose(found.derivative(0), found.values[:, :, 1], atol=2e-3 * size)


def test_constants_are_in_no_line() -> None:
    """The first line begins beyond the window's own."""
    assert np.abs(_spectra(np.full(TIME_S.size, 7.0)).values).max() < 1e-9


def test_the_power_of_white_noise_is_that_of_its_samples() -> None:
    """Parseval: mean square of a line is the variance times period times length of a block."""
    noise = np.random.default_rng(3).standard_normal(TIME_S.size)
    found = _spectra(noise)
    expected = PERIOD_S * 4.0
    assert 0.8 < np.mean(np.abs(found.values) ** 2) / expected < 1.2


def test_a_lag_is_a_multiplier_with_the_slope_of_the_window_beside_it() -> None:
    """Its first-order term takes nine tenths of what the multiplier alone leaves."""
    lag_s, rng = 0.08, np.random.default_rng(5)
    phases = rng.uniform(0.0, 2.0 * np.pi, 40)
    omega = 2.0 * np.pi * rng.uniform(0.5, 6.0, 40)
    given = np.cos(np.outer(TIME_S, omega) + phases).sum(axis=1)
    response = 1.0 / (1.0 + 1j * omega * lag_s)
    lagged = (np.exp(1j * (np.outer(TIME_S, omega) + phases)) * response).sum(axis=1).real
    found = _spectra(given, lagged)
    s = 2j * np.pi * found.frequency_hz
    h = 1.0 / (1.0 + s * lag_s)
    plain = h * found.values[:, :, 0]
    corrected = plain + h * lag_s / (1.0 + s * lag_s) * found.by_slope[:, :, 0]
    left = [np.linalg.norm(found.values[:, :, 1] - each) for each in (plain, corrected)]
    assert left[1] < 0.15 * left[0]


def test_a_record_shorter_than_a_block_gives_none() -> None:
    """Nothing is padded."""
    assert block_spectra([np.zeros((100, 1))], [0.0], PERIOD_S, length_s=4.0, highest_hz=20.0) is None


def test_blocks_of_one_record_are_one_run_and_overlap_by_half() -> None:
    """Two records of 8 s hold three blocks each."""
    two = [np.random.default_rng(k).standard_normal((1600, 1)) for k in range(2)]
    found = block_spectra(two, [0.0, 60.0], PERIOD_S, length_s=4.0, highest_hz=20.0)
    assert found is not None
    assert found.run.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(found.start_s, [0.0, 2.0, 4.0, 60.0, 62.0, 64.0])


def test_the_last_block_of_a_short_record_ends_with_it() -> None:
    """5.5 s hold one block of 4 s, and 1.5 s more; 20 s hold nine blocks that overlap by half."""
    records = [np.random.default_rng(k).standard_normal((n, 1)) for k, n in enumerate((1100, 4000))]
    found = block_spectra(records, [0.0, 60.0], PERIOD_S, length_s=4.0, highest_hz=20.0, fewest=4)
    assert found is not None
    np.testing.assert_allclose(found.start_s, [0.0, 1.5, *60.0 + 2.0 * np.arange(9)])
    alone = block_spectra([records[0][-800:]], [0.0], PERIOD_S, length_s=4.0, highest_hz=20.0)
    assert alone is not None
    np.testing.assert_allclose(found.values[1], alone.values[0], atol=1e-12)
