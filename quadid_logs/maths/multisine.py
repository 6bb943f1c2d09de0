"""Multisines: sums of sines of one period whose peaks are low, and which are orthogonal to one another."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray

_ROUNDS: Final = 60
_CLIPPED: Final = 0.85
#: The search for phases begins anew until a crest factor is this low, so many times at most (a sine has 1.41,
#: and the lowest of eleven starts are 1.57 to 1.60).
_LOW_CREST: Final = 1.6
_STARTS: Final = 10
#: Orders of the norms that it lowers in turn, and times to a line.
_ORDERS: Final = (2, 8, 32, 100)
_PER_LINE: Final = 8
_MOST_STEPS: Final = 150


class Multisine(NamedTuple):
    """Sines of equal amplitude: ``harmonics`` (n,) of one over the period, and ``phases`` (n,) [rad]."""

    harmonics: IntArray
    phases: FloatArray

    def wave(self, turns: FloatArray) -> FloatArray:
        """Return the sum of sines of amplitude one at times in periods; shape of `turns`."""
        angle = 2.0 * np.pi * np.multiply.outer(turns, self.harmonics) + self.phases
        return np.asarray(np.sin(angle).sum(axis=-1), dtype=np.float64)

    @property
    def peak(self) -> float:
        """Largest absolute value of the sum."""
        # Sixteen times to a cycle of the highest harmonic.
        turns = np.linspace(0.0, 1.0, 16 * int(self.harmonics.max()), endpoint=False)
        return float(np.abs(self.wave(turns)).max())

    @property
    def crest(self) -> float:
        """Peak over root mean square."""
        return self.peak / float(np.sqrt(0.5 * self.harmonics.size))


@lru_cache(maxsize=16)
def orthogonal(bands: tuple[tuple[float, float], ...], n_lines: int, seed: int = 0) -> tuple[Multisine, ...]:
    """Return multisines of odd harmonics, no harmonic in two of them.

    Even harmonics stay free, and show what is not linear; over whole periods any two are orthogonal.

    Parameters
    ----------
    bands : tuple of (float, float)
        Lowest and highest harmonic of each.
    n_lines : int
        At most, of each, evenly apart: lines with gaps that differ have higher peaks.
    seed : int

    References
    ----------
    .. [1] R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2012, ch. 4 and
    5.
    .. [2] P. Guillaume, J. Schoukens, R. Pintelon and I. Kollar, "Crest-factor minimization using nonlinear
       Chebyshev approximation methods," IEEE Trans. Instrum. Meas., vol. 40, no. 6, 1991.
    .. [3] E. A. Morelli, "Multiple input design for real-time parameter estimation in the frequency domain,"
       IFAC SYSID, 2003.
    """
    rng = np.random.default_rng(seed)
    found = []
    for number, (low, high) in enumerate(bands):
        own = 2 * number + 1 + 2 * len(bands) * np.arange(int(high) // (2 * len(bands)) + 1)
        own = own[(own >= low) & (own <= high)]
        harmonics = np.asarray(own[:: -(-own.size // n_lines)], dtype=np.int64)
        order = np.arange(harmonics.size)
        best = Multisine(harmonics, _flattened(-np.pi * order * (order + 1.0) / harmonics.size))
        for _ in range(_STARTS):
            if best.crest < _LOW_CREST:
                break
            start = rng.uniform(0.0, 2.0 * np.pi, harmonics.size)
            best = min(best, Multisine(harmonics, _flattened(start)), key=lambda one: one.crest)
        found.append(best)
    return tuple(found)


def _flattened(phases: FloatArray) -> FloatArray:
    """Lower the peak of lines that are evenly apart, by norms of higher and higher order.

    Their sum is a carrier times an envelope of as many harmonics as there are lines: no peak of the sum is
    higher than that of the envelope, which has few times to look at.
    """
    from scipy.optimize import minimize

    for order in _ORDERS:
        phases = minimize(
            _norm, phases, args=(order,), jac=True, method="L-BFGS-B", options={"maxiter": _MOST_STEPS}
        ).x
    return np.asarray(np.angle(np.exp(1j * phases)), dtype=np.float64)


def _norm(phases: FloatArray, order: int) -> tuple[float, FloatArray]:
    """Return the logarithm of a norm of the envelope's square, and its derivatives by the phases."""
    n, lines = phases.size, np.exp(1j * phases)
    envelope = np.fft.ifft(lines, _PER_LINE * n, norm="forward")
    square = np.abs(envelope) ** 2 / n
    weight = square ** (order - 1)
    power = float(np.mean(weight * square))
    by_line = np.fft.fft(weight * envelope, norm="forward")[:n]
    slope = 2.0 / (n * power) * np.imag(lines.conj() * by_line)
    return float(np.log(power) / order), np.asarray(slope, dtype=np.float64)


def low_peak_phases(harmonics: FloatArray | IntArray, rng: np.random.Generator) -> FloatArray:
    """Return phases of sines of equal amplitude whose sum has a low peak.

    Parameters
    ----------
    harmonics : ndarray, shape (n,)
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n,)
        [rad].

    References
    ----------
    E. Van der Ouderaa, J. Schoukens, J. Renneboog, "Peak factor minimization using a time-frequency domain
    swapping algorithm," IEEE Trans. Instrum. Meas., vol. 37, no. 1, 1988.
    """
    n = 8 * int(harmonics.max()) + 8
    phases = rng.uniform(0.0, 2.0 * np.pi, harmonics.size)
    index = harmonics.astype(np.int64)
    for _ in range(_ROUNDS):
        spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
        spectrum[index] = -1j * np.exp(1j * phases)
        wave = np.fft.irfft(spectrum, n)
        limit = _CLIPPED * np.abs(wave).max()
        phases = np.angle(1j * np.fft.rfft(np.clip(wave, -limit, limit))[index])
    return np.asarray(phases, dtype=np.float64)
