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
        Blocks of one run follow each other by half their length.
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
    records: list[FloatArray], start_s: list[float], period_s: float, *, length_s: float, highest_hz: float
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

    Returns
    -------
    BlockSpectra or None
        None where no record is as long as a block.
    """
    n_samples = 2 * round(0.5 * length_s / period_s)
    phase = 2.0 * np.pi * np.arange(n_samples) / n_samples
    # Hann's window, whose mean square is 3/8, and its exact slope.
    window = (0.5 - 0.5 * np.cos(phase)) / np.sqrt(0.375)
    slope = 0.5 * np.sin(phase) * 2.0 * np.pi / (n_samples * period_s) / np.sqrt(0.375)
    lines = np.arange(2, min(int(highest_hz * n_samples * period_s), n_samples // 2 - 1) + 1)
    values, by_slope, starts, runs = [], [], [], []
    for number, record in enumerate(records):
        for first in range(0, len(record) - n_samples + 1, n_samples // 2):
            part = record[first : first + n_samples]
            part = part - part.mean(axis=0)
            values.append(np.fft.rfft(part * window[:, np.newaxis], axis=0)[lines])
            by_slope.append(np.fft.rfft(part * slope[:, np.newaxis], axis=0)[lines])
            starts.append(start_s[number] + first * period_s)
            runs.append(number)
    if not values:
        return None
    return BlockSpectra(
        frequency_hz=lines / (n_samples * period_s),
        values=np.array(values) * period_s,
        by_slope=np.array(by_slope) * period_s,
        start_s=np.array(starts),
        run=np.array(runs),
        period_s=period_s,
    )
