"""An effectiveness that comes and goes in flight: at which frequency, and how likely that is.

Batteries sag, climbs and the ground change what a command is worth, about all axes alike: the effectiveness
is B (1 + a cos(w t) + b sin(w t)). To first order, what an equation leaves is that much of what it explains:
the product of both, each over its noise, holds a and b. One Fourier transform of those products gives the
normal equations at every frequency (Lomb, Astrophysics and Space Science 39, 1976, with the mean fitted
beside them), and with a prior of a and b the evidence follows in closed form.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.band import ComplexArray

#: One standard deviation of a and b. A cell goes from 4.2 to 3.5 V, its thrust by 30 %: by half of that
#: about the mean.
VARIES: Final = 0.15
#: What changes faster changes within a manoeuvre: a nonlinearity of the torque, which has columns of its own.
_FASTEST_HZ = 2.0
#: Of the double of that, a period has five bins [s].
_BIN_S = 0.05
#: Steps in frequency, over what a flight of this length tells apart.
_FINER = 4


class Variation(NamedTuple):
    """The likeliest variation: cos(2 pi ``frequency_hz`` t - ``phase_rad``), t in s.

    ``weight``: the mean evidence of all frequencies, over that of this one.
    """

    frequency_hz: float
    phase_rad: float
    weight: float


def likeliest_variation(
    time_s: FloatArray, error: FloatArray, explained: FloatArray, period_s: float
) -> Variation | None:
    """Return the frequency at which an effectiveness is likeliest to come and go.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Of the samples, from zero, in order; gaps are allowed.
    error, explained : ndarray, shape (n, n_axes)
        What the equations leave and what they explain, both over the square root of the noise's density.
    period_s : float
        Between two samples.

    Returns
    -------
    Variation or None
        None where the flight is too short for any, or nothing is explained.
    """
    if not time_s.size or not explained.any():
        return None
    at_bin = np.rint(time_s / _BIN_S).astype(int)
    n_bins = int(at_bin[-1]) + 1
    size = 1 << (_FINER * n_bins - 1).bit_length()
    step_hz = 1.0 / (size * _BIN_S)
    # From half a period in the flight, as of a battery that is emptied.
    lines = np.arange(max(size // (2 * n_bins), 1), int(_FASTEST_HZ / step_hz) + 1)

    def transformed(products: FloatArray) -> ComplexArray:
        """Return sums with cos + j sin at every line; white noise has a variance of one over the period."""
        bins = np.stack([np.bincount(at_bin, each, n_bins) for each in products.T])
        return np.asarray(np.fft.rfft(period_s * bins, size, axis=1).conj())

    if not lines.size:
        return None
    # The logarithm of the marginal likelihood against none, and [a, b], at every line; axes have [a, b] in
    # common, and a mean of their own.
    of_error = transformed(error * explained)
    of_square = transformed(explained**2)
    told = of_square[:, 0].real > 0.0
    of_error, of_square = of_error[told], of_square[told]
    whole, once, twice = of_square[:, :1].real, of_square[:, lines], of_square[:, 2 * lines]
    mean = np.stack([once.real, once.imag], axis=-1)
    # cos^2 = (1 + cos 2wt) / 2, sin^2 = (1 - cos 2wt) / 2, cos sin = sin 2wt / 2.
    normal = 0.5 * np.stack(
        [np.stack([whole + twice.real, twice.imag], -1), np.stack([twice.imag, whole - twice.real], -1)], -1
    )
    normal -= mean[..., :, np.newaxis] * mean[..., np.newaxis, :] / whole[..., np.newaxis, np.newaxis]
    cross = np.stack([of_error[:, lines].real, of_error[:, lines].imag], axis=-1)
    cross -= mean * (of_error[:, :1].real / whole)[..., np.newaxis]
    precision = normal.sum(axis=0) + np.eye(2) / VARIES**2
    right = cross.sum(axis=0)
    along = np.linalg.solve(precision, right[..., np.newaxis])[..., 0]
    determinant = np.linalg.slogdet(VARIES**2 * precision)[1]
    evidence = 0.5 * (np.sum(along * right, axis=1) - determinant)
    best = int(evidence.argmax())
    weight = float(np.exp(evidence - evidence[best]).mean())
    return Variation(float(lines[best] * step_hz), float(np.arctan2(along[best, 1], along[best, 0])), weight)
