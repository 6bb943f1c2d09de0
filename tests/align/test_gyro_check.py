"""What the comparison of gyro and attitude costs on clocks that no flight has."""

from __future__ import annotations

import tracemalloc

import numpy as np

from quadid_logs.align.gyro import check_gyro
from quadid_logs.align.series import CleanSeries

from .flights import motion, signal


def series(name: str, time_s: np.ndarray) -> CleanSeries:
    """Return smooth values at the given times as they are."""
    logged = signal(name, time_s, 0.1 * motion(time_s))
    return CleanSeries(
        name=name,
        rows=logged.rows,
        time_s=logged.time_s,
        values=logged.values,
        period_s=float(np.median(np.diff(time_s))),
        source=name,
    )


def test_a_damaged_clock_costs_no_memory() -> None:
    """A flight of 300 000 years has a second for each sample, not a sample for each second."""
    time_s = np.linspace(0.0, 1e13, 200)
    tracemalloc.start()
    try:
        assert check_gyro(series("body_rate", time_s), series("attitude", time_s), [(0.0, 1e13)]) is None
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
