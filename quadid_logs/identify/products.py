"""Inner products with the shaped torque, without going back to time for every lag that is tried."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.identify.design import Design
from quadid_logs.maths.band import ComplexArray, delay_response, lag_response

#: Maps a lag and a delay [s] to products of shape (n_directions, 3).
TorqueProducts = Callable[[float, float], FloatArray]


def torque_products(design: Design, directions: FloatArray) -> TorqueProducts:
    """Return the function of lag and delay that equals ``directions.T @ design.torque(lag_s, delay_s)``.

    Parameters
    ----------
    design : Design
    directions : ndarray, shape (n_rows, n_directions)

    Returns
    -------
    callable

    Notes
    -----
    By Parseval's theorem the product of two series is that of their spectra,
    and lag and delay only multiply the torque's. What takes out the slow is a
    projection, so it may as well be applied to the directions, once.
    """
    swift = design.swift(directions, design.high_pass_hz)
    kernels: list[tuple[ComplexArray, ComplexArray]] = []
    first = 0
    for part in design.spectra:
        count = part.rows.stop - part.rows.start
        padded = np.zeros((part.n_out, directions.shape[1]))
        padded[part.rows] = swift[first : first + count]
        first += count
        n_bins = part.n_out // 2 + 1
        # Of a real series each bin but the first, and the last of an even length, stands for two.
        twice = np.full(n_bins, 2.0)
        twice[0] = 1.0
        if part.n_out % 2 == 0:
            twice[-1] = 1.0
        s = part.s[:n_bins]
        shape = part.smoothing[:n_bins] * twice / part.n_samples * design.gyro_response(s)
        torque = shape[:, np.newaxis] * part.torque[:n_bins, :3]
        spectrum = np.conj(np.fft.rfft(padded, axis=0))
        kernels.append((s, spectrum[:, :, np.newaxis] * torque[:, np.newaxis, :]))

    def products(lag_s: float, delay_s: float) -> FloatArray:
        parts = [
            np.tensordot(lag_response(s, lag_s) * delay_response(s, delay_s), kernel, axes=(0, 0)).real
            for s, kernel in kernels
        ]
        return np.asarray(np.sum(parts, axis=0), dtype=np.float64)

    return products
