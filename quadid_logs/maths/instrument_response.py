"""Responses from spectral lines by an instrument: what both the fitted band and the loop are judged by."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.band import ComplexArray

#: Windows overlap by half and their taper leaks into neighbours: so many of their lines are independent.
INDEPENDENT = 0.5
_TINY = float(np.finfo(float).tiny)


class GainByInstrument(NamedTuple):
    """Complex gain of effect over cause, and its relative standard error."""

    gain: complex
    error: float


def tapered_spectra(windows: FloatArray) -> ComplexArray:
    """Return the spectra of windows without mean and trend, tapered (Hann).

    Parameters
    ----------
    windows : ndarray, shape (n_windows, n_samples, n_columns)
        Half overlapping, as `gain_by_instrument` takes them to be.

    Returns
    -------
    ndarray of complex, shape (n_windows, n_lines, n_columns)
    """
    line = np.linspace(-1.0, 1.0, windows.shape[1])[:, np.newaxis]
    level = windows - windows.mean(axis=1, keepdims=True)
    slope = (line * level).sum(axis=1, keepdims=True) / np.sum(line**2)
    taper = np.hanning(windows.shape[1])[:, np.newaxis]
    return np.asarray(np.fft.rfft((level - slope * line) * taper, axis=1), dtype=np.complex128)


def gain_by_instrument(
    driven_by: ComplexArray, cause: ComplexArray, effect: ComplexArray
) -> GainByInstrument:
    """Return effect over cause in one band of lines, both as far as an instrument drives them.

    Parameters
    ----------
    driven_by, cause, effect : ndarray of complex, shape (n_windows, n_lines)
        Of the same lines; the instrument must drive the cause.

    Returns
    -------
    GainByInstrument

    Notes
    -----
    J. S. Bendat and A. G. Piersol, *Random Data*, section 9: the variance of a response is that of what it
    leaves over that of its input, per independent line.
    """
    power = np.vdot(driven_by, cause)
    gain = np.vdot(driven_by, effect) / power
    left = np.linalg.norm(effect - gain * cause) * np.linalg.norm(driven_by)
    left = left / np.sqrt(INDEPENDENT * cause.size)
    return GainByInstrument(complex(gain), float(left / max(float(abs(gain * power)), _TINY)))
