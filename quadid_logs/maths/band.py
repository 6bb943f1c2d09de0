"""Linear filters as frequency responses, applied to whole segments without phase error.

One smoothing filter goes over target and regressors alike, so a derivative
never lags what it is compared with. The smoothing kernel is a Gaussian; its
derivative applied to the measured rate is, by partial integration, the weak
form of the equation of motion with Gaussian test functions: no sample is ever
differenced.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import FloatArray

ComplexArray = NDArray[np.complex128]
#: So many cosines are taken out one by one, which takes a third to a whole of the time of two transforms.
_FEW_COSINES: Final = 100
#: The largest table of cosines that is kept, 5 MB: with more rows a record is transformed.
_MOST_KEPT: Final = 600_000


def angular_frequency(n_samples: int, period_s: float) -> ComplexArray:
    """Return the Laplace variable on the imaginary axis at the bins of a real FFT.

    Parameters
    ----------
    n_samples : int
    period_s : float
        Between samples [s].

    Returns
    -------
    ndarray of complex, shape (n_samples // 2 + 1,)
        j*omega [rad/s].
    """
    return np.asarray(2j * np.pi * np.fft.rfftfreq(n_samples, period_s), dtype=np.complex128)


def gaussian_response(s: ComplexArray, cutoff_hz: float) -> FloatArray:
    """Zero-phase Gaussian low-pass, -3 dB at the cut-off.

    Parameters
    ----------
    s : ndarray of complex, shape (n_bins,)
        j*omega [rad/s].
    cutoff_hz : float

    Returns
    -------
    ndarray, shape (n_bins,)
    """
    return np.asarray(2.0 ** (-0.5 * (s.imag / (2.0 * np.pi * cutoff_hz)) ** 2), dtype=np.float64)


def gaussian_reach_s(cutoff_hz: float) -> float:
    """Return the time [s] beyond which the Gaussian kernel is below 1e-6 of its peak.

    Parameters
    ----------
    cutoff_hz : float
        As of `gaussian_response`.

    Returns
    -------
    float

    Notes
    -----
    The kernel of a response with standard deviation sigma_f [Hz] has the
    standard deviation 1 / (2 pi sigma_f) in time (the Fourier transform of a Gaussian).
    """
    sigma_hz = cutoff_hz / np.sqrt(np.log(2.0))
    return float(np.sqrt(2.0 * np.log(1e6)) / (2.0 * np.pi * sigma_hz))


def lag_response(s: ComplexArray, lag_s: float) -> ComplexArray:
    """First-order lag 1 / (1 + s T).

    Parameters
    ----------
    s : ndarray of complex, shape (n_bins,)
        j*omega [rad/s].
    lag_s : float
        Time constant T [s].

    Returns
    -------
    ndarray of complex, shape (n_bins,)
    """
    return 1.0 / (1.0 + s * lag_s)


def delay_response(s: ComplexArray, delay_s: float) -> ComplexArray:
    """Pure delay exp(-s tau), of any fraction of a sample.

    Parameters
    ----------
    s : ndarray of complex, shape (n_bins,)
        j*omega [rad/s].
    delay_s : float
        tau [s].

    Returns
    -------
    ndarray of complex, shape (n_bins,)
    """
    return np.asarray(np.exp(-s * delay_s), dtype=np.complex128)


def butterworth_response(s: ComplexArray, cutoff_hz: float) -> ComplexArray:
    """Second-order Butterworth low-pass 1 / (1 + sqrt(2) x + x^2) with x = s / omega_c.

    Parameters
    ----------
    s : ndarray of complex, shape (n_bins,)
        j*omega [rad/s].
    cutoff_hz : float

    Returns
    -------
    ndarray of complex, shape (n_bins,)

    References
    ----------
    S. Butterworth, "On the theory of filter amplifiers," Wireless Engineer, vol. 7, 1930.
    """
    x = s / (2.0 * np.pi * cutoff_hz)
    return np.asarray(1.0 / (1.0 + np.sqrt(2.0) * x + x * x), dtype=np.complex128)


def notch_response(s: ComplexArray, frequency_hz: float, inverse_q: float, depth: float) -> ComplexArray:
    """Analogue notch of second order, (1 + depth x / Q + x^2) / (1 + x / Q + x^2) with x = s / omega_0.

    Parameters
    ----------
    s : ndarray of complex, shape (n_bins,)
        j*omega [rad/s].
    frequency_hz : float
        Of its centre.
    inverse_q : float
        1 / Q: the width at -3 dB over the centre frequency (of a notch of depth 0).
    depth : float
        Gain that is left at the centre.

    Returns
    -------
    ndarray of complex, shape (n_bins,)
    """
    x = s / (2.0 * np.pi * frequency_hz)
    undamped = 1.0 + x * x
    return np.asarray((undamped + depth * inverse_q * x) / (undamped + inverse_q * x), dtype=np.complex128)


def gyro_response(
    s: ComplexArray,
    low_pass_hz: float,
    notches: Sequence[tuple[float, float, float]],
    tracked: Sequence[Sequence[Sequence[tuple[float, float, float]]]] = (),
) -> ComplexArray:
    """Return the product of a gyro's known filters, 1 without any.

    Parameters
    ----------
    s : ndarray of complex, shape (n_bins,)
        j*omega [rad/s].
    low_pass_hz : float
        Cut-off of the second-order Butterworth low-pass, NaN for none.
    notches : sequence of (frequency_hz, inverse_q, depth)
        As of `notch_response`.
    tracked : sequence of sequences of notches
        Groups of notches that moved: those of each instant. The mean response over the instants counts,
        which is right for notches that move slowly against their own memory.

    Returns
    -------
    ndarray of complex, shape (n_bins,)
    """
    response = butterworth_response(s, low_pass_hz) if np.isfinite(low_pass_hz) else np.ones_like(s)
    response = response * _in_series(s, notches)
    for instants in tracked:
        response = response * np.mean([_in_series(s, each) for each in instants], axis=0)
    return response


def _in_series(s: ComplexArray, notches: Sequence[tuple[float, float, float]]) -> ComplexArray:
    response = np.ones_like(s)
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
        At the times of the signals from the first sample on, spaced n_samples / n_out as far.
    """
    n_bins = n_out // 2 + 1
    shaped = spectrum[:n_bins] * response[:n_bins, np.newaxis]
    return np.asarray(np.fft.irfft(shaped, n_out, axis=0) * (n_out / n_samples), dtype=np.float64)


def shorter_fast_length(n_samples: int) -> int:
    """Return the largest number up to `n_samples` without prime factors above 11: its transforms are fast.

    Parameters
    ----------
    n_samples : int

    Returns
    -------
    int
        Of thousands of samples, less than a fiftieth are lost.
    """
    from scipy.fft import next_fast_len

    return next((n for n in range(n_samples, 0, -1) if next_fast_len(n) == n), 0)


def high_pass(columns: FloatArray, period_s: float, cutoff_hz: float) -> FloatArray:
    """Remove mean, drift and all cosines below the cut-off from columns of one gap-free record.

    A projection, not a recursive filter: a linear relation between columns
    holds afterwards as before, up to the first and the last row.

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
    >>> float(np.abs(high_pass((2.0 + 0.0 * t)[:, np.newaxis], 0.01, 0.3)).max().round(9))
    0.0
    """
    n_removed = min(int(2.0 * len(columns) * period_s * cutoff_hz) + 1, len(columns))
    if n_removed <= _FEW_COSINES and n_removed * len(columns) <= _MOST_KEPT:
        low = _lowest_cosines(len(columns), n_removed)
        # First the mean: of a large one, sums of products would leave more than rounding does elsewhere.
        rest = columns - columns.mean(axis=0)
        return np.asarray(rest - low @ (low.T @ rest))
    from scipy.fft import dct, idct

    spectrum = dct(columns, axis=0, norm="ortho")
    spectrum[:n_removed] = 0.0
    return np.asarray(idct(spectrum, axis=0, norm="ortho"), dtype=np.float64)


@lru_cache(maxsize=32)
def _lowest_cosines(n_rows: int, n_cosines: int) -> FloatArray:
    """Return the first columns of the orthonormal DCT-II, shape (n_rows, n_cosines), not to be written to."""
    phase = np.pi / n_rows * np.outer(np.arange(n_rows) + 0.5, np.arange(n_cosines))
    cosines = np.sqrt(2.0 / n_rows) * np.cos(phase)
    cosines[:, 0] /= np.sqrt(2.0)
    cosines.flags.writeable = False
    return np.asarray(cosines)
