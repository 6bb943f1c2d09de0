"""Inner products with the shaped torque, without going back to time for every lag that is tried."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.identify.design import Design
from quadid_logs.maths.band import ComplexArray, delay_response, lag_response
from quadid_logs.vocabulary import TORQUE_SYMBOLS

#: Maps a lag and a delay [s] to products of shape (n_directions, n_symbols).
TorqueProducts = Callable[[float, float], FloatArray]


def torque_products(
    design: Design, directions: FloatArray, symbols: Sequence[str] = TORQUE_SYMBOLS
) -> TorqueProducts:
    """Return a function of lag and delay, ``directions.T @ design.torque.behind(lag_s, delay_s)``.

    Parameters
    ----------
    design : Design
    directions : ndarray, shape (n_rows, n_directions)
    symbols : sequence of str
        Columns of the torque.

    Returns
    -------
    callable
        Of lag and delay [s], to products of shape (n_directions, n_symbols).

    Notes
    -----
    By Parseval's theorem the product of two series is that of their spectra,
    and lag and delay only multiply the torque's. What takes out the slow is a
    projection, so it may as well be applied to the directions, once.
    """
    directions = design.high_pass(directions, design.high_pass_hz)
    columns = [design.torque.symbols.index(symbol) for symbol in symbols]
    kernels: list[tuple[ComplexArray, ComplexArray]] = []
    first = 0
    for grid, spectrum in zip(design.torque.grids, design.torque.spectra, strict=True):
        padded = np.zeros((grid.n_out, directions.shape[1]))
        padded[grid.rows] = directions[first : first + grid.n_rows]
        first += grid.n_rows
        n_bins = grid.n_bins
        # Of a real series each bin but the first, and the last of an even length, stands for two.
        twice = np.full(n_bins, 2.0)
        twice[0] = 1.0
        if grid.n_out % 2 == 0:
            twice[-1] = 1.0
        s = grid.s[:n_bins]
        shape = grid.smoothing[:n_bins] * twice / grid.n_samples * design.torque.gyro_response(s)
        torque = shape[:, np.newaxis] * spectrum[:n_bins, columns]
        conjugate = np.conj(np.fft.rfft(padded, axis=0))
        kernels.append((s, conjugate[:, :, np.newaxis] * torque[:, np.newaxis, :]))

    def products(lag_s: float, delay_s: float) -> FloatArray:
        parts = [
            np.tensordot(lag_response(s, lag_s) * delay_response(s, delay_s), kernel, axes=(0, 0)).real
            for s, kernel in kernels
        ]
        return np.asarray(np.sum(parts, axis=0), dtype=np.float64)

    return products
