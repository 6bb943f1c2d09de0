"""Spectra over time, and the lines in them with the chance of a false one."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.health import Line
from quadid_logs.health.records import Record
from quadid_logs.maths.median import median
from quadid_logs.maths.spectra import WINDOW_S

#: Fewer windows than these have no mean of which anything is known.
_FEWEST_WINDOWS: Final = 6
#: Half-overlapping Hann windows count as this many independent ones each: 1 / (1 + 2 (1/6)^2), for the
#: correlation of two neighbours is 1/6 (P. D. Welch, 1967).
_INDEPENDENT: Final = 0.947
#: The floor around a frequency is the median within this fraction of it, and at least so many bins.
_AROUND, _AROUND_BINS = 0.25, 8
#: The main lobe of a Hann window.
_LOBE: Final = 2
#: A peak no sharper than a resonance of this damping ratio is no line: a loop with 10 degrees of phase margin
#: has about that (damping ratio = margin / 100; K. Ogata, Modern Control Engineering, 7-7).
_DAMPING: Final = 0.1
#: The chance that a spectrum without lines shows one.
FALSE_ALARM: Final = 0.01
_MOST_LINES: Final = 6
#: Bins on either side of a peak that tell where its line stands, how far it may stand from the peak, in which
#: steps, and half of its width at half its height.
_FITTED, _FARTHEST, _SHIFT = 16, 8.0, 0.1
_WIDTHS: Final = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)
#: Sines that a resonance is made of, and rounds of its size.
_PARTS, _ROUNDS = 101, 4
#: Beyond, the edge of what the log's rate shows is no line.
_HIGHEST: Final = 0.95


class Periodograms(NamedTuple):
    """One-sided densities of windows.

    Attributes
    ----------
    time_s : ndarray, shape (n_windows,)
        The windows' middles.
    frequency_hz : ndarray, shape (n_frequencies,)
    density : ndarray, shape (n_windows, n_frequencies, n_columns)
    """

    time_s: FloatArray
    frequency_hz: FloatArray
    density: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Welch's estimate, shape (n_frequencies, n_columns)."""
        return np.asarray(self.density.mean(axis=0), dtype=np.float64)


#: Tried in turn.
_WINDOWS_S: Final = (WINDOW_S, 0.5 * WINDOW_S)


def periodograms(
    found: Sequence[Record], period_s: float, windows_s: Sequence[float] = _WINDOWS_S
) -> Periodograms | None:
    """Return the densities of Hann windows that overlap by half.

    Parameters
    ----------
    windows_s : sequence of float
        Lengths of windows; the first one of which there are enough is taken.

    Returns
    -------
    Periodograms or None
        None where there are too few windows for a mean.
    """
    for window_s in windows_s:
        n = round(window_s / period_s) if period_s > 0.0 else 0
        n_windows = sum(max(0, (one.time_s.size - n) // max(n // 2, 1) + 1) for one in found if n >= 8)
        if n_windows >= _FEWEST_WINDOWS:
            break
    else:
        return None
    window = np.hanning(n + 1)[:-1]
    times, parts = [], []
    for one in found:
        if one.time_s.size < n:
            continue
        view = np.lib.stride_tricks.sliding_window_view(one.values, n, axis=0)[:: n // 2]
        centred = view - view.mean(axis=2, keepdims=True)
        power = np.abs(np.fft.rfft(centred * window, axis=2)) ** 2
        parts.append(np.moveaxis(power, 1, 2) * (2.0 * period_s / np.sum(window**2)))
        times.append(one.time_s[0] + period_s * (n // 2 * np.arange(view.shape[0]) + 0.5 * n))
    return Periodograms(
        np.concatenate(times),
        np.asarray(np.fft.rfftfreq(n, period_s), np.float64),
        np.asarray(np.concatenate(parts), np.float64),
    )


def find_lines(
    spectra: Periodograms, column: int, searched: BoolArray, n_searches: int = 1
) -> tuple[Line, ...]:
    """Find the lines of a spectrum.

    Each bin's mean over the windows is held against the highest that a spectrum without lines, but with a
    resonance of 0.1 damping there, would have: a gamma variable around the floor times what such a resonance
    stands above it. The number of windows that count is lowered by how much more than noise they vary.

    Parameters
    ----------
    searched : ndarray of bool, shape (n_frequencies,)
        Where lines may be.
    n_searches : int
        How many spectra are searched in all, for the p-value.

    Returns
    -------
    tuple of Line
        The highest above the floor first, at most six.
    """
    from scipy.special import gammaincc, gammaincinv

    density, frequency_hz = spectra.density[:, :, column], spectra.frequency_hz
    mean = density.mean(axis=0)
    step_hz = float(frequency_hz[1])
    allowed = (
        searched & (frequency_hz >= (_LOBE + 1) * step_hz) & (frequency_hz <= _HIGHEST * frequency_hz[-1])
    )
    if not (mean[1:] > 0.0).all() or not allowed.any():
        return ()
    floor, variation = _around(mean), _around(density.var(axis=0, ddof=1) / mean**2)
    counted = _INDEPENDENT * len(density) / np.maximum(variation, 1.0)
    floor = floor * counted / gammaincinv(counted, 0.5)
    half: FloatArray = np.maximum(_AROUND * frequency_hz / step_hz, _AROUND_BINS)
    offset_hz = 0.5 * (_LOBE + 1 + half) * step_hz
    blunt: FloatArray = 1.0 + (offset_hz / (_DAMPING * np.maximum(frequency_hz, step_hz))) ** 2
    ratio: FloatArray = mean / floor
    n_places = np.count_nonzero(allowed) * n_searches
    chance = np.asarray(gammaincc(counted, ratio / blunt * counted) * n_places, dtype=np.float64)
    left = allowed & (chance < FALSE_ALARM)
    found: list[Line] = []
    while left.any() and len(found) < _MOST_LINES:
        peak = int(np.argmax(np.where(left, ratio, 0.0)))
        near = slice(max(1, peak - _LOBE), peak + _LOBE + 1)
        stands = density[:, near].max(axis=1) > blunt[peak] * floor[peak]
        found.append(
            Line(
                frequency_hz=float(_centre(mean, floor, peak) * step_hz),
                height_db=float(10.0 * np.log10(ratio[peak])),
                p_value=float(min(chance[peak], 1.0)),
                share=float(stands.mean()),
                rms=float(np.sqrt(max(np.sum(mean[near] - floor[near]) * step_hz, 0.0))),
            )
        )
        width = int(half[peak])
        left[max(0, peak - width) : peak + width + 1] = False
    return tuple(found)


def _centre(mean: FloatArray, floor: FloatArray, peak: int) -> float:
    """Return where between the bins a line stands, by Whittle's likelihood.

    A part that rings makes a line as wide as its damping times its frequency, whose highest bin is a matter
    of chance: it lies up to that far off. So lines of several widths, each a resonance seen through the
    window, are held against all bins around the peak, behind the floor (P. Whittle, 1953).
    """
    first, after = max(1, peak - _FITTED), min(mean.size, peak + _FITTED + 1)
    bins = np.arange(first, after)
    shift, seen = _shapes()
    # Shapes at every distance from a bin that was looked at: (n_shifts, n_bins) of each width.
    apart = np.abs(bins[np.newaxis, :] - peak - shift[:, np.newaxis])
    shape = seen[:, np.rint(apart / _SHIFT).astype(np.intp)]
    measured, behind = mean[first:after], floor[first:after]
    # The size that fits best, weighted by what is expected: a few rounds settle it.
    size = np.maximum(measured - behind, 0.0).max() / shape.max(axis=2, keepdims=True)
    for _ in range(_ROUNDS):
        weight = shape / (behind + size * shape) ** 2
        size = np.maximum(
            (weight * (measured - behind)).sum(axis=2, keepdims=True)
            / (weight * shape).sum(axis=2, keepdims=True),
            0.0,
        )
    expected = behind + size * shape
    misfit = (np.log(expected) + measured / expected).sum(axis=2)
    return peak + float(shift[np.unravel_index(int(np.argmin(misfit)), misfit.shape)[1]])


@lru_cache(maxsize=1)
def _shapes() -> tuple[FloatArray, FloatArray]:
    """Return shifts (n_shifts,) and, of each width, how high a line is by its distance (n_widths, n_places).

    A resonance's spectrum is Cauchy's around its frequency, and a Hann window smears each part of it.
    """
    n_shifts = round(_FARTHEST / _SHIFT)
    shift = np.asarray(_SHIFT * np.arange(-n_shifts, n_shifts + 1), dtype=np.float64)
    away = _SHIFT * np.arange(round((_FITTED + _FARTHEST) / _SHIFT) + 1)
    quantiles = np.tan(np.pi * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5))
    parts = away[np.newaxis, :, np.newaxis] - np.array(_WIDTHS)[:, np.newaxis, np.newaxis] * quantiles
    # What a Hann window shows of a sine so many bins away, over what it shows of one on the bin.
    beside = 0.5 * (np.sinc(parts - 1.0) + np.sinc(parts + 1.0))
    seen = (np.sinc(parts) + beside) ** 2
    return shift, np.asarray(seen.mean(axis=2), dtype=np.float64)


def _around(values: FloatArray) -> FloatArray:
    """Return the median around each bin, without its own lobe where that counts; shape of `values`."""
    n = values.size
    narrow = min(int(_AROUND_BINS / _AROUND), n - 1)
    centres = [*range(1, narrow + 1)]
    while centres[-1] < n - 1:
        centres.append(max(centres[-1] + 1, int(1.04 * centres[-1])))
    # What is not known at some bin is known nowhere near it.
    middle = np.median if np.isnan(values).any() else median
    medians = []
    for centre in centres:
        half = max(int(_AROUND * centre), _AROUND_BINS)
        below, above = values[max(1, centre - half) : max(1, centre - _LOBE)], values[centre + _LOBE + 1 :]
        near = np.concatenate([below, above[: half - _LOBE]])
        medians.append(middle(near) if near.size and n > 4 else np.nan)
    known = np.maximum(np.asarray(medians), np.finfo(np.float64).tiny)
    inside = np.arange(n)
    return np.asarray(
        np.exp(np.interp(np.log(np.maximum(inside, 1)), np.log(centres), np.log(known))), dtype=np.float64
    )
