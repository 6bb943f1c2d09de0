"""Flights of which everything is known: a rate loop with a known lag, a known line, known motors."""

from __future__ import annotations

import numpy as np

from quadid_logs.align.series import CleanSeries
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import NO_GYRO_FILTER, GyroFilter, Rows

FLOWN_S = 60.0
#: Known to end vibration, so that nothing can be folded down.
LOW_PASS = GyroFilter(40.0)


def series(
    name: str,
    time_s: FloatArray,
    values: FloatArray,
    *,
    gyro_filter: GyroFilter = NO_GYRO_FILTER,
    raw: bool = False,
) -> CleanSeries:
    """Return a clean series on an even grid."""
    return CleanSeries(
        name=name,
        rows=Rows(time_s, np.arange(time_s.size)),
        time_s=time_s,
        stored=np.asarray(values, dtype=np.float64),
        period_s=float(time_s[1] - time_s[0]),
        source=f"made {name}",
        gyro_filter=gyro_filter,
        raw=raw,
    )


def grid(rate_hz: float, flown_s: float = FLOWN_S) -> FloatArray:
    """Return the times of a flight that begins at 10 s."""
    return 10.0 + np.arange(int(flown_s * rate_hz)) / rate_hz


def coloured(
    seed: int, n_samples: int, rate_hz: float, corner_hz: float = 3.0, columns: int = 3
) -> FloatArray:
    """Return noise that falls off above a corner, as gusts and sticks do; rms about 0.3."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((n_samples, columns))
    frequency_hz = np.fft.rfftfreq(n_samples, 1.0 / rate_hz)
    gain = 1.0 / (1.0 + (frequency_hz / corner_hz) ** 2)
    shaped = np.fft.irfft(np.fft.rfft(white, axis=0) * gain[:, np.newaxis], n_samples, axis=0)
    return 0.3 * shaped / shaped.std(axis=0)


def delayed(values: FloatArray, rate_hz: float, lag_s: float, time_constant_s: float = 0.0) -> FloatArray:
    """Return a series behind a pure delay and a lag of first order, exactly, in the frequency domain."""
    frequency = 2j * np.pi * np.fft.rfftfreq(len(values), 1.0 / rate_hz)
    response = np.exp(-frequency * lag_s) / (1.0 + frequency * time_constant_s)
    return np.fft.irfft(np.fft.rfft(values, axis=0) * response[:, np.newaxis], len(values), axis=0)


def resonance(seed: int, n_samples: int, rate_hz: float, at_hz: float, damping: float) -> FloatArray:
    """Return three columns of noise through a resonance, as gusts through a loop."""
    rng = np.random.default_rng(seed)
    s = 2j * np.pi * np.fft.rfftfreq(n_samples, 1.0 / rate_hz)
    w = 2.0 * np.pi * at_hz
    response = w**2 / (s**2 + 2.0 * damping * w * s + w**2)
    white = np.fft.rfft(rng.standard_normal((n_samples, 3)), axis=0)
    return np.fft.irfft(white * response[:, np.newaxis], n_samples, axis=0)
