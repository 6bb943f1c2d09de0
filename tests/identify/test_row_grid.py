"""Rows of a chunk: smoothed by fast transforms, whatever the chunk's length."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from quadid_logs.data.log import NO_GYRO_FILTER
from quadid_logs.identify.torque import RowGrid, RowTorque

#: A prime: without padding, its transform takes ten times as long as that of a length close by.
N, PERIOD_S, SMOOTHING_HZ = 4001, 0.005, 5.0
GRID = RowGrid.of(N, PERIOD_S, SMOOTHING_HZ, rows_hz=50.0)


def test_transforms_are_made_at_a_length_without_large_prime_factors() -> None:
    """All FFTs of a chunk have this length: a large factor makes them dear."""
    left = GRID.n_padded
    for prime in (2, 3, 5):
        while left % prime == 0:
            left //= prime
    assert left == 1


def test_rows_of_a_chunk_of_prime_length_are_its_smoothed_signal() -> None:
    """Padding is seen in no row, not at the end either: times and values are those of the signal."""
    signal = np.sin(2.0 * np.pi * PERIOD_S * np.arange(N))[:, np.newaxis] + 1.0
    found = GRID.lay(GRID.spectrum_of(signal))[:, 0]
    rows_s = PERIOD_S * GRID.n_padded / GRID.n_out * np.arange(GRID.rows.start, GRID.rows.stop)
    expected = 1.0 + np.sin(2.0 * np.pi * rows_s) * 2.0 ** (-0.5 / SMOOTHING_HZ**2)
    assert found == pytest.approx(expected, abs=2e-6)


def test_the_last_row_is_as_near_to_the_end_as_the_filter_allows() -> None:
    """Padding costs no row: the flight's end is used up to the kernel's reach, but for one row."""
    row_s = PERIOD_S * GRID.n_padded / GRID.n_out
    unused_s = N * PERIOD_S - GRID.rows.stop * row_s
    first_s = GRID.rows.start * row_s
    assert first_s - row_s <= unused_s <= first_s + row_s


def test_each_chunk_has_the_response_of_its_own_length() -> None:
    """Chunks of one length share theirs."""
    rng = np.random.default_rng(0)
    lengths = [800, 1200, 800]
    grids = [RowGrid.of(n, PERIOD_S, SMOOTHING_HZ, rows_hz=50.0) for n in lengths]
    torques = [rng.standard_normal((n, 3)) for n in lengths]
    whole = RowTorque(
        symbols=("L", "M", "N"),
        spectra=tuple(grid.spectrum_of(torque) for grid, torque in zip(grids, torques, strict=True)),
        throttle=(None, None, None),
        grids=tuple(grids),
        gyro_filter=NO_GYRO_FILTER,
        row_period_s=0.02,
    )
    alone = [whole.chosen([number]).behind(0.05, 0.01) for number in range(3)]
    np.testing.assert_array_equal(whole.behind(0.05, 0.01), np.concatenate(alone))


def test_a_spectrum_keeps_no_more_than_its_rows_hold() -> None:
    """At 400 Hz rows of 50 Hz hold an eighth; a view of the whole kept all of it for every fit."""
    grid = RowGrid.of(48_000, 0.0025, 5.0, rows_hz=50.0)
    columns = np.zeros((48_000, 3))
    tracemalloc.start()
    try:
        spectrum = grid.spectrum_of(columns)
        assert tracemalloc.get_traced_memory()[0] < columns.nbytes / 4
    finally:
        tracemalloc.stop()
    assert spectrum.shape == (grid.s.size, 3)
