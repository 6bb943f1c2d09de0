"""Segments of a log hold its rows: no interpolation takes power from the upper half of a spectrum."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.align.series import CleanSeries
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import Rows
from quadid_logs.health.records import records
from quadid_logs.health.spectra import Periodograms, periodograms

RATE_HZ = 500.0
N = 30_000


def at(time_s: FloatArray, values: FloatArray, period_s: float = 1.0 / RATE_HZ) -> CleanSeries:
    """Return a series whose typical period is given: that of a whole log, not of these rows."""
    return CleanSeries(
        name="body_rate",
        rows=Rows(time_s, np.arange(time_s.size)),
        time_s=time_s,
        stored=values,
        period_s=period_s,
        source="made",
    )


def spectrum(series: CleanSeries, most: int = 120_000) -> Periodograms:
    """Return the spectrum of all of a series."""
    found = periodograms(*records([series], ((series.time_s[0], series.time_s[-1]),), most))
    assert found is not None
    return found


def white(seed: int) -> FloatArray:
    """Return white noise of three axes with a density of 2 / RATE_HZ."""
    return np.random.default_rng(seed).standard_normal((N, 3))


def upper_half(found: Periodograms) -> float:
    """Return the mean density of the upper half of a spectrum, over that of white noise."""
    upper = found.frequency_hz > 0.25 * RATE_HZ
    return float(found.mean[upper].mean()) / (2.0 / RATE_HZ)


@pytest.mark.parametrize("period_s", [0.002, 0.002006, 0.0019988])
def test_a_clock_that_is_a_little_off_costs_no_power(period_s: float) -> None:
    """Interpolated linearly at every place between two rows, a third of the power would be lost."""
    time_s = 3.0 + period_s * np.arange(N)
    assert upper_half(spectrum(at(time_s, white(0)))) == pytest.approx(1.0, abs=0.03)


def test_a_clock_whose_rate_changes_costs_no_power() -> None:
    """A loop takes longer while something else is at work: 22 rows late after half a minute."""
    time_s = 3.0 + np.cumsum(np.where(np.arange(N) < N // 2, 0.002, 0.002006))
    assert upper_half(spectrum(at(time_s, white(4)))) == pytest.approx(1.0, abs=0.03)


def test_parts_of_a_long_flight_begin_at_rows() -> None:
    """They are spread over the flight without a look at its rows."""
    time_s = 3.0 + np.arange(N) / RATE_HZ
    assert upper_half(spectrum(at(time_s, white(1)), 20_000)) == pytest.approx(1.0, abs=0.04)


def test_lost_rows_move_no_line_and_cost_little() -> None:
    """Every fiftieth row is lost: a line at 180 Hz stays there, and noise keeps its level."""
    kept = np.arange(N) % 50 != 49
    time_s = np.arange(N) / RATE_HZ
    line = np.sin(2.0 * np.pi * 180.0 * time_s)[:, np.newaxis] * np.ones(3)
    found = spectrum(at(time_s[kept], line[kept], 1.02 / RATE_HZ))
    assert found.frequency_hz[found.mean[:, 0].argmax()] == pytest.approx(180.0 / 1.0, rel=0.025)
    assert upper_half(spectrum(at(time_s[kept], white(2)[kept]))) == pytest.approx(1.0, abs=0.05)


def test_true_jitter_makes_no_noise_of_slow_motion() -> None:
    """Rows at uneven times, taken for even ones, would turn 5 Hz into noise at all frequencies."""
    rng = np.random.default_rng(3)
    even_s = np.arange(N) / RATE_HZ
    time_s = even_s + 0.08 / RATE_HZ * rng.standard_normal(N).clip(-2.0, 2.0)
    motion = np.sin(2.0 * np.pi * 5.0 * time_s)[:, np.newaxis] * np.ones(3)
    shown, taken_for_even = spectrum(at(time_s, motion)), spectrum(at(even_s, motion))
    fast = shown.frequency_hz > 50.0
    assert shown.mean[fast].sum() < 0.02 * taken_for_even.mean[fast].sum()
