"""The shape of the thrust curve: thrust is (1 - e) y + e y^2 of the throttle y that the battery leaves.

e is 0 where thrust is in proportion to throttle, 1 where it is to its square.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray, row_blocks
from quadid_logs.maths.moving_mean import moving_mean

#: A rotor that hardly turns has no thrust that could be wrong.
_LEAST_THROTTLE: Final = 1e-3
#: A manoeuvre lasts so long: all of its thrust counts alike [s].
_MANOEUVRE_S: Final = 5.0
#: The slope of this polynomial is that of a thrust curve, from idle to full throttle, to a thousandth.
_DEGREE: Final = 5


def relative_by_expo(throttle: FloatArray, expo: float) -> FloatArray:
    """Return the derivative of thrust by the expo over thrust, (y - 1) / (1 - e + e y); same shape.

    Parameters
    ----------
    throttle : ndarray
        0 to 1, as the battery leaves it [1].
    expo : float

    Returns
    -------
    ndarray
        Finite also for a rotor at rest.
    """
    y = np.clip(throttle, _LEAST_THROTTLE, None)
    return np.asarray((y - 1.0) / (1.0 - expo + expo * y), dtype=np.float64)


def mean_while_moved(level: FloatArray, torque: FloatArray, period_s: float) -> float:
    """Return the mean of a level over the manoeuvres, not over what is flown between them.

    Parameters
    ----------
    level : ndarray, shape (n,)
    torque : ndarray, shape (n, n_axes)
        How hard the vehicle is moved: the mean over five seconds of its squares, each axis over its
        variance, is the weight.
    period_s : float
        Between the rows [s].

    Returns
    -------
    float
    """
    spread = np.var(torque, axis=0)
    square = np.sum((torque - torque.mean(axis=0)) ** 2 / np.where(spread > 0.0, spread, np.inf), axis=1)
    weight = moving_mean(square, round(_MANOEUVRE_S / period_s), beyond="mirrored")
    return float(np.average(level, weights=weight if weight.any() else None))


def slope_at(x: FloatArray, y: FloatArray, where: float) -> float:
    """Return the derivative of a smooth function at a point, from its values at many others.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Points, and the function there.
    where : float
        Within the range of `x`.

    Returns
    -------
    float
        NaN where the points do not vary, or are too few.
    """
    return float(slopes_at(x, y, np.array([where]))[0])


def slopes_at(x: FloatArray, y: FloatArray, where: FloatArray) -> FloatArray:
    """Return the derivative of a smooth function at some points, from its values at many others.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Points, and the function there.
    where : ndarray, shape (m,)
        Within the range of `x`.

    Returns
    -------
    ndarray, shape (m,)
        NaN where the points do not vary, or are too few.
    """
    from numpy.polynomial import polynomial

    spread = float(np.std(x)) if x.size > _DEGREE else 0.0
    if not spread > 0.0:
        return np.full(where.shape, np.nan)
    # About the points and in units of the spread, so that the powers are of one size.
    middle = float(np.mean(where))
    triangle = np.zeros((0, _DEGREE + 2))
    # The triangle of all rows from those of blocks: the powers of all points are six times as large as they.
    for rows in row_blocks(x.size):
        powers = polynomial.polyvander((x[rows] - middle) / spread, _DEGREE)
        below = np.column_stack([powers, y[rows]])
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, below]), mode="r"), dtype=np.float64)
    length = np.linalg.norm(triangle[:, :-1], axis=0)
    scaled = triangle[:, :-1] / length, triangle[:, -1]
    fitted = np.linalg.lstsq(*scaled, rcond=x.size * np.finfo(np.float64).eps)[0] / length
    slope = polynomial.polyder(fitted)
    return np.asarray(polynomial.polyval((where - middle) / spread, slope), dtype=np.float64) / spread
