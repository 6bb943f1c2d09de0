"""A flight as spectra of short overlapping blocks: everything an estimate in the frequency domain needs.

A block is a smooth window of some seconds. The equation of motion holds under any window (the weak form): the
derivative of a signal goes onto the window, FT[w dx/dt] = j omega FT[w x] - FT[dw/dt x], so that no sample is
differentiated. A filter that acts on a signal is a multiplier, to second order in its memory over the window:
FT[w (h * u)] = H FT[w u] + j H' FT[dw/dt u] with H' the derivative of H by angular frequency.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.maths.band import ComplexArray


class BlockSpectra(NamedTuple):
    """Spectra of the columns of a record, and of the same under the slope of the window.

    Attributes
    ----------
    frequency_hz : ndarray, shape (n_lines,)
        From the second line of a block: the window keeps constants below it.
    values, by_slope : ndarray of complex, shape (n_blocks, n_lines, n_columns)
        FT[w x] and FT[dw/dt x]; a window has a mean square of one.
    start_s : ndarray, shape (n_blocks,)
    run : ndarray of int, shape (n_blocks,)
        Blocks of one run follow each other by half their length, or less where a record is short.
    period_s : float
        Between samples.
    """

    frequency_hz: FloatArray
    values: ComplexArray
    by_slope: ComplexArray
    start_s: FloatArray
    run: IntArray
    period_s: float

    def derivative(self, column: int) -> ComplexArray:
        """Return FT[w dx/dt] of a column, shape (n_blocks, n_lines)."""
        s = 2j * np.pi * self.frequency_hz
        return s * self.values[:, :, column] - self.by_slope[:, :, column]


def block_spectra(
    records: list[FloatArray],
    start_s: list[float],
    period_s: float,
    *,
    length_s: float,
    highest_hz: float,
    fewest: int = 0,
) -> BlockSpectra | None:
    """Return the spectra of all blocks of some records.

    Parameters
    ----------
    records : list of ndarray, each of shape (n_samples, n_columns)
        On one uniform period, each without gaps.
    start_s : list of float
        Time of the first sample of each.
    period_s : float
    length_s : float
        Of a block; blocks overlap by half.
    highest_hz : float
        Lines above are left out.
    fewest : int
        In a record of fewer blocks than this they overlap by more than half, so that its end is not lost.

    Returns
    -------
    BlockSpectra or None
        None where no record is as long as a block.
    """
    from scipy.fft import rfft

    n_samples = 2 * round(0.5 * length_s / period_s)
    lines = np.arange(2, min(int(highest_hz * n_samples * period_s), n_samples // 2 - 1) + 1)
    values, by_slope, starts, runs = [], [], [], []
    for number, record in enumerate(records):
        if len(record) < n_samples:
            continue
        # A constant is beside the lines that are kept, its rounding is not.
        columns = np.ascontiguousarray((record - record.mean(axis=0)).T)
        windows = np.lib.stride_tricks.sliding_window_view(columns, n_samples, axis=1)
        places = np.arange(0, windows.shape[1], n_samples // 2)
        blocks = windows[:, :: n_samples // 2]
        if places.size < fewest:
            latest = windows.shape[1] - 1
            places = np.rint(np.linspace(0, latest, 1 - (-latest // (n_samples // 2)))).astype(int)
            blocks = windows[:, places]
        spectra = np.moveaxis(rfft(blocks, axis=2)[:, :, 1 : lines.size + 3], 0, 2)
        below, at, above = (spectra[:, first : first + lines.size] for first in range(3))
        # Hann's window, whose mean square is 3/8, is 1/2 - cos / 2, and its slope is a sine.
        values.append((0.5 * at - 0.25 * (below + above)) / np.sqrt(0.375))
        by_slope.append(-0.5j * np.pi / (n_samples * period_s) / np.sqrt(0.375) * (below - above))
        starts.append(start_s[number] + places * period_s)
        runs.append(np.full(len(spectra), number))
    if not values:
        return None
    return BlockSpectra(
        frequency_hz=lines / (n_samples * period_s),
        values=np.asarray(np.concatenate(values) * period_s, dtype=np.complex128),
        by_slope=np.asarray(np.concatenate(by_slope) * period_s, dtype=np.complex128),
        start_s=np.concatenate(starts),
        run=np.concatenate(runs),
        period_s=period_s,
    )
