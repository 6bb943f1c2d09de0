"""Which flight the gyro is held against the attitude on, and what that costs on clocks that no flight has."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

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
        stored=logged.values,
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


STAMPS = np.arange(0.0, 120.0, 0.02)


def turning() -> tuple[CleanSeries, CleanSeries]:
    """Return body rates and attitude of a vehicle that sways and turns through all headings, wrapped."""
    t = STAMPS
    phi, theta, psi = 0.4 * np.sin(1.1 * t), 0.3 * np.sin(1.7 * t + 1.0), 1.5 * t + 0.6 * np.sin(0.9 * t)
    phi_dot, theta_dot = 0.44 * np.cos(1.1 * t), 0.51 * np.cos(1.7 * t + 1.0)
    psi_dot = 1.5 + 0.54 * np.cos(0.9 * t)
    rate = np.column_stack(
        [
            phi_dot - psi_dot * np.sin(theta),
            theta_dot * np.cos(phi) + psi_dot * np.sin(phi) * np.cos(theta),
            -theta_dot * np.sin(phi) + psi_dot * np.cos(phi) * np.cos(theta),
        ]
    )
    wrapped = (psi + np.pi) % (2.0 * np.pi) - np.pi
    angles = np.column_stack([phi, theta, wrapped])
    return (
        replace(series("body_rate", t), stored=rate),
        replace(series("attitude", t), stored=angles),
    )


def test_a_turn_through_all_headings_is_no_contradiction() -> None:
    """The attitude jumps by 360 degrees two dozen times, the rates never."""
    found = check_gyro(*turning(), [(0.0, 120.0)])
    assert found is not None
    np.testing.assert_allclose(found.matrix, np.eye(3), atol=1e-3)
    assert found.lag_s == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("paused", [0, 1])
def test_nothing_is_compared_across_a_pause_of_either_signal(paused: int) -> None:
    """Two seconds of rates, or of the attitude, are missing."""
    both = list(turning())
    kept = (STAMPS < 60.3) | (STAMPS > 62.3)
    both[paused] = both[paused].take(kept)
    found = check_gyro(*both, [(0.0, 120.0)])
    assert found is not None
    assert not ((found.start_s > 60.3 - 0.9 * found.length_s) & (found.start_s < 62.2)).any()
    np.testing.assert_allclose(found.matrix, np.eye(3), atol=1e-3)
