"""Spectra and coherence of finite, gappy records."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray


class Spectra(NamedTuple):
    """Averaged one-sided densities over ``frequency_hz`` (n_frequencies,).

    ``input_psd`` and ``output_psd`` [unit^2/Hz]; ``cross`` = conj(input) * output;
    ``n_averages`` counts the half-overlapping stretches.
    """

    frequency_hz: FloatArray
    input_psd: FloatArray
    output_psd: FloatArray
    cross: np.ndarray[tuple[int], np.dtype[np.complex128]]
    n_averages: int

    @property
    def coherence(self) -> FloatArray:
        """Share of the output's power that a linear system explains; shape (n_frequencies,)."""
        product = self.input_psd * self.output_psd
        explained = np.zeros_like(product)
        np.divide(np.abs(self.cross) ** 2, product, out=explained, where=product > 0.0)
        return explained


def averaged_spectra(
    pairs: Iterable[tuple[FloatArray, FloatArray]], *, period_s: float, n_stretch: int
) -> Spectra:
    """Average periodograms of Hann-windowed, half-overlapping stretches (Welch's method).

    Parameters
    ----------
    pairs : iterable of (input, output)
        One pair of arrays of shape (n_samples,) per gap-free segment; no
        stretch reaches across two segments.
    period_s : float
        Sample period [s].
    n_stretch : int
        Samples per stretch.

    Returns
    -------
    Spectra
        All zero, with ``n_averages`` 0, if no segment is long enough.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio Electroacoust., vol. 15, pp. 70-73, 1967.
    """
    window = np.hanning(n_stretch + 1)[:-1]
    n_bins = n_stretch // 2 + 1
    input_psd, output_psd = np.zeros(n_bins), np.zeros(n_bins)
    cross = np.zeros(n_bins, dtype=np.complex128)
    n_averages = 0
    for first, second in pairs:
        if first.shape[0] < n_stretch:
            continue
        both = np.stack([first, second])
        stretches = np.lib.stride_tricks.sliding_window_view(both, n_stretch, axis=1)[:, :: n_stretch // 2]
        centred = stretches - stretches.mean(axis=2, keepdims=True)
        x, y = np.fft.rfft(centred * window, axis=2)
        input_psd += np.sum(np.abs(x) ** 2, axis=0)
        output_psd += np.sum(np.abs(y) ** 2, axis=0)
        cross += np.sum(np.conj(x) * y, axis=0)
        n_averages += x.shape[0]
    norm = 2.0 * period_s / (np.sum(window**2) * max(n_averages, 1))
    frequency = np.asarray(np.fft.rfftfreq(n_stretch, period_s), dtype=np.float64)
    return Spectra(frequency, input_psd * norm, output_psd * norm, cross * norm, n_averages)
