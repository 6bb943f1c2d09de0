"""Inner products with the shaped torque, without going back to time for every lag that is tried."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.identify.design import Design
from quadid_logs.maths.band import ComplexArray, delay_response, lag_response
from quadid_logs.vocabulary import TORQUE_SYMBOLS

#: Loop, filter and radio-free output delay of known autopilots stay below 30 ms; twice that.
MAX_DELAY_S: Final = 0.06
#: Published motor lags reach 80 ms; three times that.
MAX_LAG_S: Final = 0.25
#: Lags among which the few are chosen whose responses make up any: close where a lag is short.
_LAGS_S: Final = MAX_LAG_S * np.linspace(0.0, 1.0, 30) ** 3
#: So many delays, too, and one more for each radian that the longest turns the fastest motion.
_FEWEST_DELAYS = 12
#: Of the band; responses of lag and delay are smooth in frequency, and steepest where it is low.
_N_FREQUENCIES = 200
#: What is left out of a response, relative: losses are compared to a millionth at most.
_LEFT = 1e-11
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
        Of lag and delay [s], up to the largest, to products of shape (n_directions, n_symbols).

    Notes
    -----
    By Parseval's theorem the product of two series is that of their spectra,
    and lag and delay only multiply the torque's. What takes out the slow is a
    projection, so it may as well be applied to the directions, once. Over a band, the responses
    of all lags and delays are combinations of those of a few, and so are the products.
    """
    directions = design.high_pass(directions, design.high_pass_hz)
    columns = [design.torque.symbols.index(symbol) for symbol in symbols]
    kernels: list[tuple[ComplexArray, ComplexArray]] = []
    first = 0
    for grid, spectrum in zip(design.torque.grids, design.torque.spectra, strict=True):
        padded = np.zeros((grid.n_out, directions.shape[1]))
        padded[grid.rows] = directions[first : first + grid.n_rows]
        first += grid.n_rows
        s = grid.s
        # Of a real series each bin but the first, and the last of an even length, stands for two.
        twice = np.full(s.size, 2.0)
        twice[0] = 1.0
        if grid.n_out % 2 == 0:
            twice[-1] = 1.0
        shape = grid.smoothing * twice / grid.n_padded * design.torque.gyro_response(s)
        torque = shape[:, np.newaxis] * spectrum[:, columns]
        conjugate = np.conj(np.fft.rfft(padded, axis=0))
        kernels.append((s, conjugate[:, :, np.newaxis] * torque[:, np.newaxis, :]))
    highest_rad_s = max(float(s.imag[-1]) for s, _ in kernels)
    few = _few_responses(highest_rad_s)
    ready = np.sum(
        [np.tensordot(few.at(s).T, kernel, axes=1).real for s, kernel in kernels], axis=0, dtype=np.float64
    )

    def products(lag_s: float, delay_s: float) -> FloatArray:
        combined = _combined(highest_rad_s, lag_s, delay_s)
        return np.asarray(np.tensordot(combined, ready, axes=1), dtype=np.float64)

    return products


class _FewResponses(NamedTuple):
    """Lags and delays [s], (n, 2), whose responses at ``s``, real above imaginary parts, are ``q @ r``."""

    timing: FloatArray
    s: ComplexArray
    q: FloatArray
    r: FloatArray

    def at(self, s: ComplexArray) -> ComplexArray:
        """Return the responses at s (n_bins,); shape (n_bins, n)."""
        return _responses(s, self.timing)


@lru_cache(maxsize=8)
def _few_responses(highest_rad_s: float) -> _FewResponses:
    """Choose the responses by QR with pivoting: each is the one that those before it say least about."""
    from scipy.linalg import qr

    s = np.asarray(1j * highest_rad_s * np.linspace(0.0, 1.0, _N_FREQUENCIES) ** 2, dtype=np.complex128)
    n_delays = _FEWEST_DELAYS + int(np.ceil(highest_rad_s * MAX_DELAY_S))
    delays_s = np.linspace(0.0, MAX_DELAY_S, n_delays)
    timing = np.array([(lag_s, delay_s) for lag_s in _LAGS_S for delay_s in delays_s])
    q, r, order = qr(_parts(_responses(s, timing)), mode="economic", pivoting=True)
    n = np.count_nonzero(np.abs(np.diagonal(r)) > _LEFT * abs(r[0, 0]))
    return _FewResponses(timing[order[:n]], s, np.asarray(q[:, :n], float), np.asarray(r[:n, :n], float))


@lru_cache(maxsize=512)
def _combined(highest_rad_s: float, lag_s: float, delay_s: float) -> FloatArray:
    """Return the coefficients (n,) with which the few responses make that of a lag and a delay.

    Every fit of a flight begins with the same grid of them.
    """
    from scipy.linalg import solve_triangular

    few = _few_responses(highest_rad_s)
    wanted = _parts(_responses(few.s, np.array([(lag_s, delay_s)])))[:, 0]
    found = np.asarray(solve_triangular(few.r, few.q.T @ wanted, check_finite=False), dtype=np.float64)
    found.setflags(write=False)
    return found


def _responses(s: ComplexArray, timing: FloatArray) -> ComplexArray:
    """Return the responses (n_bins, n) of lags and delays (n, 2)."""
    each = [lag_response(s, lag_s) * delay_response(s, delay_s) for lag_s, delay_s in timing]
    return np.asarray(np.column_stack(each), dtype=np.complex128)


def _parts(responses: ComplexArray) -> FloatArray:
    """Return real parts above imaginary ones; shape (2 n_bins, n)."""
    return np.concatenate([responses.real, responses.imag])
