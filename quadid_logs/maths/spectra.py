"""Spectra and coherence of finite, gappy records."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray

#: Segments of averaged spectra [s]. The main lobe of a Hann window is four bins wide (F. Harris, Proceedings
#: of the IEEE 66, 1978), so lines half a hertz apart are resolved, as those of common manoeuvres are; a
#: segment holds two periods of the slowest crossover, and half a minute has fourteen, half overlapping.
WINDOW_S: Final = 4.0


class Spectra(NamedTuple):
    """Averaged one-sided densities over ``frequency_hz`` (n_frequencies,).

    ``input_psd`` and ``output_psd`` [unit^2/Hz]; ``cross`` = conj(input) * output;
    ``n_averages`` counts the half-overlapping segments.
    """

    frequency_hz: FloatArray
    input_psd: FloatArray
    output_psd: FloatArray
    cross: np.ndarray[tuple[int], np.dtype[np.complex128]]
    n_averages: int

    @property
    def coherence(self) -> FloatArray:
        """Magnitude-squared coherence |S_xy|^2 / (S_xx S_yy), 0 without power; shape (n_frequencies,)."""
        product = self.input_psd * self.output_psd
        explained = np.zeros_like(product)
        np.divide(np.abs(self.cross) ** 2, product, out=explained, where=product > 0.0)
        return explained


def averaged_spectra(
    pairs: Iterable[tuple[FloatArray, FloatArray]], *, period_s: float, n_per_segment: int
) -> Spectra:
    """Average periodograms of Hann-windowed, half-overlapping segments (Welch's method).

    Parameters
    ----------
    pairs : iterable of (input, output)
        One pair of arrays of shape (n_samples,) per gap-free record; no
        segment reaches across two records.
    period_s : float
        Sample period [s].
    n_per_segment : int
        Samples per segment.

    Returns
    -------
    Spectra
        One-sided densities, each segment's mean removed; all zero, with
        ``n_averages`` 0, if no record is long enough.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio Electroacoust., vol. 15, pp. 70-73, 1967.
    """
    window = np.hanning(n_per_segment + 1)[:-1]
    n_bins = n_per_segment // 2 + 1
    input_psd, output_psd = np.zeros(n_bins), np.zeros(n_bins)
    cross = np.zeros(n_bins, dtype=np.complex128)
    n_averages = 0
    for first, second in pairs:
        if first.shape[0] < n_per_segment:
            continue
        both = np.stack([first, second])
        view = np.lib.stride_tricks.sliding_window_view(both, n_per_segment, axis=1)
        segments = view[:, :: n_per_segment // 2]
        centred = segments - segments.mean(axis=2, keepdims=True)
        x, y = np.fft.rfft(centred * window, axis=2)
        input_psd += np.sum(np.abs(x) ** 2, axis=0)
        output_psd += np.sum(np.abs(y) ** 2, axis=0)
        cross += np.sum(np.conj(x) * y, axis=0)
        n_averages += x.shape[0]
    norm = 2.0 * period_s / (np.sum(window**2) * max(n_averages, 1))
    frequency = np.asarray(np.fft.rfftfreq(n_per_segment, period_s), dtype=np.float64)
    return Spectra(frequency, input_psd * norm, output_psd * norm, cross * norm, n_averages)
