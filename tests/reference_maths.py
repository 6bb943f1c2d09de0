"""Formulas that the tests hold the package against, and that the package itself does not need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.rotational_dynamics import Quadruple, Triple, inertia_terms, step_attitude, step_rates


def rate_products(rate_rad_s: FloatArray) -> FloatArray:
    """Return the products of rates in the order of `PRODUCTS`.

    Parameters
    ----------
    rate_rad_s : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 6)
        pp, qq, rr, qr, pr, pq [rad^2/s^2].
    """
    p, q, r = np.moveaxis(rate_rad_s, -1, 0)
    return np.stack([p * p, q * q, r * r, q * r, p * r, p * q], axis=-1)


def integrate_fixed_step(
    inertia_kg_m2: FloatArray,
    torque_n_m: Callable[[float], FloatArray],
    time_s: FloatArray,
    *,
    rate_rad_s: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Integrate eq. (8) and the attitude with one Runge-Kutta step per sample.

    Parameters
    ----------
    inertia_kg_m2 : ndarray, shape (3, 3)
    torque_n_m : callable
        Torque of shape (3,) at a time.
    time_s : ndarray, shape (n_samples,)
        Uniform.
    rate_rad_s : ndarray, shape (3,)
        At the first sample. The attitude starts level.

    Returns
    -------
    rate_rad_s : ndarray, shape (n_samples, 3)
    quaternion : ndarray, shape (n_samples, 4)
    """
    inertia = inertia_terms(inertia_kg_m2)
    step_s = float(time_s[1] - time_s[0])
    rate = _components(rate_rad_s)
    attitude: Quadruple = (1.0, 0.0, 0.0, 0.0)
    rates, attitudes = [rate], [attitude]
    end = _components(torque_n_m(float(time_s[0])))
    for time in time_s[:-1].tolist():
        start, end = end, _components(torque_n_m(time + step_s))
        middle = _components(torque_n_m(time + 0.5 * step_s))
        rate, stages = step_rates(rate, (start, middle, end), step_s, inertia, (0.0, 0.0, 0.0))
        attitude = step_attitude(attitude, stages, step_s)
        rates.append(rate)
        attitudes.append(attitude)
    return np.asarray(rates), np.asarray(attitudes)


def _components(vector: FloatArray) -> Triple:
    """Take a vector apart into floats."""
    p, q, r = vector.tolist()
    return p, q, r
