"""A torque on the rows of a design: shaped by an actuator as a spectrum, one FFT per chunk of the flight.

A trial of another lag costs three inverse FFTs and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import Segment
from quadid_logs.data.log import GyroFilter
from quadid_logs.identify.terms import TORQUE_TERMS
from quadid_logs.maths.band import (
    ComplexArray,
    angular_frequency,
    delay_response,
    filtered,
    gaussian_reach_s,
    gaussian_response,
    gyro_response,
    high_pass,
    lag_response,
)
from quadid_logs.vocabulary import TORQUE_SYMBOLS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowGrid:
    """How a gap-free chunk goes from its samples to its smoothed rows.

    Attributes
    ----------
    n_padded, n_out : int
        Length at the full rate, with zeros up to one whose FFT is fast, and of the coarser grid that
        holds all of the smoothed band; both last equally long.
    s : ndarray, shape (n_bins,)
        j omega [rad/s] of the bins of the real FFT that the coarser grid holds.
    smoothing : ndarray, shape (n_bins,)
        Response of the Gaussian.
    rows : slice
        Of the coarser grid, those beyond the reach of all filters.
    """

    n_padded: int
    n_out: int
    s: ComplexArray
    smoothing: FloatArray
    rows: slice

    @classmethod
    def of(
        cls,
        n_samples: int,
        period_s: float,
        smoothing_hz: float,
        *,
        rows_hz: float = np.inf,
        settle_s: float = 0.0,
    ) -> RowGrid:
        """Return the grid of a chunk, with `rows_hz` or more, but no more rows than samples.

        `settle_s` more are dropped at its start. Beyond the chunk all counts as zero: no row reaches there.
        """
        from scipy.fft import next_fast_len

        # A length with a large prime factor costs ten times as much, and up to hundreds of FFTs are made.
        n_padded = int(next_fast_len(n_samples, real=True))
        n_out = n_padded
        if rows_hz < 1.0 / period_s:
            n_out = min(n_padded, int(next_fast_len(int(np.ceil(n_padded * period_s * rows_hz)), real=True)))
        row_period_s = period_s * n_padded / n_out
        reach = int(np.ceil(gaussian_reach_s(smoothing_hz) / row_period_s))
        s = angular_frequency(n_padded, period_s)[: n_out // 2 + 1].copy()
        n_rows = n_samples * n_out // n_padded
        return cls(
            n_padded=n_padded,
            n_out=n_out,
            s=s,
            smoothing=gaussian_response(s, smoothing_hz),
            rows=slice(reach + int(np.ceil(settle_s / row_period_s)), n_rows - reach),
        )

    def spectrum_of(self, columns: FloatArray) -> ComplexArray:
        """Return the real FFT of columns (n_samples, n_columns) as far as the rows hold it.

        Shape (n_bins, n_columns).
        """
        # The same numbers as by numpy, which goes through one column after the other, twice as slowly.
        from scipy.fft import rfft

        # A copy: a view would keep the whole spectrum, eight times as large at 400 Hz.
        return np.array(rfft(columns, self.n_padded, axis=0)[: self.s.size], dtype=np.complex128)

    @property
    def n_rows(self) -> int:
        """Number of rows, 0 where the chunk is shorter than the filters' memory."""
        return max(0, int(self.rows.stop) - int(self.rows.start))

    def lay(self, spectrum: ComplexArray, response: ComplexArray | None = None) -> FloatArray:
        """Return columns on the rows, smoothed and shaped by a response (n_bins,); (n_rows, n_columns)."""
        shape = self.smoothing if response is None else response * self.smoothing
        return filtered(spectrum, shape, n_samples=self.n_padded, n_out=self.n_out)[self.rows]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowTorque:
    """A torque with all that is needed to lay it on rows behind any lag and delay.

    Attributes
    ----------
    symbols : tuple of str
        Of the columns: L, M, N, and those of `TorqueTerm` that the flight has.
    spectra : tuple of ndarray, shape (n_bins, n_columns)
        One per chunk, as far as its rows hold them.
    throttle : tuple of ndarray, shape (n_samples,), or None
        Its deviation from the mean of the flight, one per chunk; None where it is not known throughout.
    grids : tuple of RowGrid
    gyro_filter : GyroFilter
        Known filters of the logged rates; the torque passes them too.
    row_period_s, high_pass_hz : float
    """

    symbols: tuple[str, ...]
    spectra: tuple[ComplexArray, ...]
    throttle: tuple[FloatArray | None, ...]
    grids: tuple[RowGrid, ...]
    gyro_filter: GyroFilter
    row_period_s: float
    high_pass_hz: float = 0.0

    @classmethod
    def of(
        cls,
        chunks: Sequence[Segment],
        grids: Sequence[RowGrid],
        *,
        mean_throttle: float | None,
        gyro_filter: GyroFilter,
        row_period_s: float,
    ) -> RowTorque:
        """Return the torque as logged in the chunks of a flight."""
        throttle = tuple(
            None if mean_throttle is None or chunk.throttle is None else chunk.throttle - mean_throttle
            for chunk in chunks
        )
        empty = cls(
            symbols=(),
            spectra=(),
            throttle=throttle,
            grids=tuple(grids),
            gyro_filter=gyro_filter,
            row_period_s=row_period_s,
        )
        return empty.replaced([chunk.torque for chunk in chunks])

    def replaced(self, torques: Sequence[FloatArray]) -> RowTorque:
        """Return other torques, one array (n_samples, 3) per chunk, for the same rows."""
        found = [
            {term.symbol: term.of_torque(torque, throttle) for term in TORQUE_TERMS}
            for torque, throttle in zip(torques, self.throttle, strict=True)
        ]
        columns = [{name: column for name, column in each.items() if column is not None} for each in found]
        symbols = tuple(name for name in found[0] if all(name in chunk for chunk in columns))
        spectra = [
            grid.spectrum_of(np.column_stack([chunk[symbol] for symbol in symbols]))
            for grid, chunk in zip(self.grids, columns, strict=True)
        ]
        for term in TORQUE_TERMS:
            if term.differentiated and term.symbol in symbols:
                for spectrum, grid in zip(spectra, self.grids, strict=True):
                    spectrum[:, symbols.index(term.symbol)] *= grid.s
        return replace(self, symbols=symbols, spectra=tuple(spectra))

    def chosen(self, numbers: Sequence[int]) -> RowTorque:
        """Return the torque of some of the chunks."""
        return replace(
            self,
            spectra=tuple(self.spectra[number] for number in numbers),
            throttle=tuple(self.throttle[number] for number in numbers),
            grids=tuple(self.grids[number] for number in numbers),
        )

    def behind(self, lag_s: float, delay_s: float, symbols: Sequence[str] = TORQUE_SYMBOLS) -> FloatArray:
        """Return columns behind lag, delay and gyro filter, smoothed; shape (n_rows, n_symbols)."""
        return self.shaped(lambda s: lag_response(s, lag_s) * delay_response(s, delay_s), symbols)

    def by_lag(self, lag_s: float, delay_s: float, symbols: Sequence[str] = TORQUE_SYMBOLS) -> FloatArray:
        """Return the derivative of `behind` by the lag [unit/s]; shape (n_rows, n_symbols)."""
        return self.shaped(lambda s: -s * lag_response(s, lag_s) ** 2 * delay_response(s, delay_s), symbols)

    def by_delay(self, lag_s: float, delay_s: float, symbols: Sequence[str] = TORQUE_SYMBOLS) -> FloatArray:
        """Return the derivative of `behind` by the delay [unit/s]; shape (n_rows, n_symbols)."""
        return self.shaped(lambda s: -s * lag_response(s, lag_s) * delay_response(s, delay_s), symbols)

    def as_logged(self) -> FloatArray:
        """Return the torque smoothed but without actuator, as the paper takes it; shape (n_rows, 3)."""
        return self._laid([None] * len(self.grids), TORQUE_SYMBOLS)

    def gyro_response(self, s: ComplexArray) -> ComplexArray:
        """Return what the gyro's known filters make of the torque; 1 where none is known."""
        return gyro_response(s, *self.gyro_filter)

    def shaped(
        self, response: Callable[[ComplexArray], ComplexArray], symbols: Sequence[str] = TORQUE_SYMBOLS
    ) -> FloatArray:
        """Return columns behind a response of j omega and the gyro filter, smoothed; (n_rows, n_symbols)."""
        sizes = {(grid.n_padded, grid.n_out): grid.s for grid in self.grids}
        shapes = {size: response(s) * self.gyro_response(s) for size, s in sizes.items()}
        return self._laid([shapes[grid.n_padded, grid.n_out] for grid in self.grids], symbols)

    def _laid(self, responses: Sequence[ComplexArray | None], symbols: Sequence[str]) -> FloatArray:
        columns = [self.symbols.index(symbol) for symbol in symbols]
        parts = [
            grid.lay(spectrum[:, columns], response)
            for grid, spectrum, response in zip(self.grids, self.spectra, responses, strict=True)
        ]
        if self.high_pass_hz:
            parts = [high_pass(part, self.row_period_s, self.high_pass_hz) for part in parts]
        return np.concatenate(parts)
