"""Mean wind with Dryden turbulence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quadid_logs.arrays import FloatArray

_FEET_PER_M = 3.28084


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """Mean speed [m/s], where it blows to (0 north, pi/2 east) [rad], and the height above ground [m]."""

    speed_m_s: float = 0.0
    heading_rad: float = 0.6
    height_m: float = 6.0


def dryden_wind(wind: Wind, n_samples: int, step_s: float, rng: np.random.Generator) -> FloatArray:
    """Return the wind's velocity.

    The low-altitude Dryden model of MIL-F-8785C: intensities and lengths from
    the height and from the wind at 20 ft, shaping filters driven by white
    noise. A hovering vehicle meets the frozen field at the mean wind's speed.

    Parameters
    ----------
    step_s : float
        Between samples [s].

    Returns
    -------
    ndarray, shape (n_samples, 3)
        In NED [m/s]; zero without mean wind.

    References
    ----------
    MIL-F-8785C, 1980, sec. 3.7.2 to 3.7.3; shaping filters as in MIL-HDBK-1797.
    """
    from scipy.signal import cont2discrete, lfilter

    if wind.speed_m_s <= 0.0:
        return np.zeros((n_samples, 3))
    height_ft = max(wind.height_m * _FEET_PER_M, 10.0)
    shape = 0.177 + 0.000823 * height_ft
    length_m = np.array([1.0 / shape**1.2, 1.0 / shape**1.2, 1.0]) * height_ft / _FEET_PER_M
    sigma = 0.1 * wind.speed_m_s * np.array([1.0 / shape**0.4, 1.0 / shape**0.4, 1.0])
    delay = length_m / max(wind.speed_m_s, 1.0)
    gusts = np.empty((n_samples, 3))
    for axis in range(3):
        gain, pole = sigma[axis] * np.sqrt(delay[axis] / np.pi), [delay[axis], 1.0]
        if axis == 0:
            numerator, denominator = [np.sqrt(2.0) * gain], np.array(pole)
        else:
            numerator, denominator = [gain * np.sqrt(3.0) * delay[axis], gain], np.polymul(pole, pole)
        b, a, _ = cont2discrete((numerator, denominator), step_s, method="bilinear")
        noise = rng.standard_normal(n_samples) * np.sqrt(np.pi / step_s)
        gusts[:, axis] = lfilter(np.ravel(b), a, noise)
    cosine, sine = np.cos(wind.heading_rad), np.sin(wind.heading_rad)
    along, across = wind.speed_m_s + gusts[:, 0], gusts[:, 1]
    return np.column_stack([along * cosine - across * sine, along * sine + across * cosine, gusts[:, 2]])
