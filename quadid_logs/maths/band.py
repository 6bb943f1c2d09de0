"""Linear filters as frequency responses, applied to whole segments without phase error.

One smoothing filter goes over target and regressors alike, so a derivative
never lags what it is compared with. The smoothing kernel is a Gaussian; its
derivative applied to the measured rate is, by partial integration, the weak
form of the equation of motion with Gaussian test functions: no sample is ever
differenced.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import FloatArray

ComplexArray = NDArray[np.complex128]


def angular_frequency(n_samples: int, period_s: float) -> ComplexArray:
    """Return j*omega [rad/s] of the bins of a real FFT; shape (n_samples // 2 + 1,)."""
    return np.asarray(2j * np.pi * np.fft.rfftfreq(n_samples, period_s), dtype=np.complex128)


def gaussian_response(s: ComplexArray, cutoff_hz: float) -> FloatArray:
    """Zero-phase Gaussian low-pass, -3 dB at `cutoff_hz`; `s` is j*omega."""
    return np.asarray(2.0 ** (-0.5 * (s.imag / (2.0 * np.pi * cutoff_hz)) ** 2), dtype=np.float64)


def gaussian_reach_s(cutoff_hz: float) -> float:
    """Return the time [s] beyond which the Gaussian kernel is below 1e-6 of its peak.

    The kernel of a response with standard deviation sigma_f [Hz] has the
    standard deviation 1 / (2 pi sigma_f) in time.
    """
    sigma_hz = cutoff_hz / np.sqrt(np.log(2.0))
    return float(np.sqrt(2.0 * np.log(1e6)) / (2.0 * np.pi * sigma_hz))


def lag_response(s: ComplexArray, lag_s: float) -> ComplexArray:
    """First-order lag 1 / (1 + s T)."""
    return 1.0 / (1.0 + s * lag_s)


def delay_response(s: ComplexArray, delay_s: float) -> ComplexArray:
    """Pure delay exp(-s tau), of any fraction of a sample."""
    return np.asarray(np.exp(-s * delay_s), dtype=np.complex128)


def butterworth_response(s: ComplexArray, cutoff_hz: float) -> ComplexArray:
    """Second-order Butterworth low-pass, as autopilots filter their gyros.

    ArduPilot INS_GYRO_FILTER and PX4 IMU_GYRO_CUTOFF (LowPassFilter2p).
    """
    x = s / (2.0 * np.pi * cutoff_hz)
    return np.asarray(1.0 / (1.0 + np.sqrt(2.0) * x + x * x), dtype=np.complex128)


def notch_response(s: ComplexArray, frequency_hz: float, inverse_q: float, depth: float) -> ComplexArray:
    """Notch of second order that leaves a share of `depth` at its centre.

    ArduPilot NotchFilter.cpp, PX4 NotchFilter.hpp, both before they are made digital.
    """
    x = s / (2.0 * np.pi * frequency_hz)
    straight = 1.0 + x * x
    return np.asarray((straight + depth * inverse_q * x) / (straight + inverse_q * x), dtype=np.complex128)


def gyro_response(
    s: ComplexArray, low_pass_hz: float, notches: Sequence[tuple[float, float, float]]
) -> ComplexArray:
    """Return what is known of a gyro's filters: low-pass (NaN for none) and notches; 1 without any."""
    response = butterworth_response(s, low_pass_hz) if np.isfinite(low_pass_hz) else np.ones_like(s)
    for notch in notches:
        response = response * notch_response(s, *notch)
    return response


def filtered(
    spectrum: ComplexArray, response: NDArray[np.inexact], *, n_samples: int, n_out: int
) -> FloatArray:
    """Apply a response and go back to time, on a coarser grid where the band allows.

    Parameters
    ----------
    spectrum : ndarray, shape (n_samples // 2 + 1, n_columns)
        Real FFT of the signals.
    response : ndarray, shape (n_samples // 2 + 1,)
    n_samples : int
        Length of the signals.
    n_out : int
        Length of the result, at most `n_samples`; the response must have
        died out at the new Nyquist frequency.

    Returns
    -------
    ndarray, shape (n_out, n_columns)
    """
    n_bins = n_out // 2 + 1
    shaped = spectrum[:n_bins] * response[:n_bins, np.newaxis]
    return np.asarray(np.fft.irfft(shaped, n_out, axis=0) * (n_out / n_samples), dtype=np.float64)


def without_slow(columns: FloatArray, period_s: float, cutoff_hz: float) -> FloatArray:
    """Remove mean, drift and all cosines slower than the cut-off from columns of one gap-free stretch.

    A projection, not a filter with a memory: a linear relation between
    columns holds afterwards as before, up to the first and the last row.

    Parameters
    ----------
    columns : ndarray, shape (n_rows, n_columns)
    period_s : float
        Between the rows [s].
    cutoff_hz : float
        Component k of a cosine transform (DCT-II) over T seconds has the frequency k / (2 T).

    Returns
    -------
    ndarray, shape (n_rows, n_columns)

    Examples
    --------
    >>> t = np.arange(0.0, 10.0, 0.01)
    >>> float(np.abs(without_slow((2.0 + 0.0 * t)[:, np.newaxis], 0.01, 0.3)).max().round(9))
    0.0
    """
    from scipy.fft import dct, idct

    slow = int(2.0 * len(columns) * period_s * cutoff_hz) + 1
    spectrum = dct(columns, axis=0, norm="ortho")
    spectrum[:slow] = 0.0
    return np.asarray(idct(spectrum, axis=0, norm="ortho"), dtype=np.float64)
