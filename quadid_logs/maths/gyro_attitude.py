"""Whether logged body rates integrate to the change of the logged attitude."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.maths.normal import MEDIAN_DEVIATION, NORMAL_95
from quadid_logs.maths.rotations import euler_rates

#: Points per interval at which the kinematics are evaluated: 100 Hz and more, ten times what turns.
_POINTS = 40
#: The kinematics of Euler angles are singular at 90 degrees of pitch.
_STEEPEST_RAD = np.radians(60.0)
#: Residuals beyond this many robust standard deviations count less (Huber): compass and GPS
#: corrections jump.
_OUTLIER = 3.0
#: The weights settle to well below the intervals within so many rounds.
_ROUNDS = 8
#: What is left of a lag after this many shifts, or once it is this small, changes nothing.
_SHIFTS = 4
_SMALL_LAG_S = 0.003
#: No angle is logged finer, so that a noise of zero cannot make one row infinitely heavy [rad].
_FINEST_RAD = 1e-6
#: Unknowns beside the drifts: the nine of the matrix, row by row, and the lag.
_N_UNKNOWNS = 10


class GyroFit(NamedTuple):
    """How body rates and attitude fit together.

    Attributes
    ----------
    start_s : ndarray, shape (n_intervals,)
        Of the intervals that could be used [s].
    attitude_change, integrated_change : ndarray, shape (n_intervals, 3)
        Change of roll, pitch and yaw over each interval, by the attitude, and by the body rates
        with the fitted bias and lag but without the fitted matrix [rad].
    matrix, half_width, explained : ndarray, shape (3, 3)
        Body rates that the attitude shows over those logged (the identity if they agree), half
        of the 95 % interval, and the fraction (0 to 1) of that part of the motion that it explains.
    bias_rad_s : ndarray, shape (3,)
        What is to be added to the rates, over the whole flight.
    lag_s, lag_half_width_s : float
        How long the rates come after the attitude, and half of its 95 % interval.
    """

    start_s: FloatArray
    attitude_change: FloatArray
    integrated_change: FloatArray
    matrix: FloatArray
    half_width: FloatArray
    explained: FloatArray
    bias_rad_s: FloatArray
    lag_s: float
    lag_half_width_s: float


class _Equations(NamedTuple):
    """Change of the Euler angles (n, 3), its regressors (n, 3, 10) and those of a bias (n, 3, 3).

    ``start_s``, ``duration_s`` and ``block`` (the number of its block, from 0 on) have shape (n,).
    """

    change: FloatArray
    regressors: FloatArray
    by_bias: FloatArray
    start_s: FloatArray
    duration_s: FloatArray
    block: IntArray

    def without_drift(self, values: FloatArray) -> FloatArray:
        """Return values (n, ...) less what one constant rate per block explains of them."""
        flat = values.reshape(self.block.size, -1)
        sums = np.zeros((int(self.block[-1]) + 1, flat.shape[1]))
        np.add.at(sums, self.block, flat)
        rate = sums / np.bincount(self.block, self.duration_s)[:, None]
        return (flat - self.duration_s[:, None] * rate[self.block]).reshape(values.shape)


def fit_gyro_to_attitude(
    rate_time_s: FloatArray,
    body_rate_rad_s: FloatArray,
    attitude_time_s: FloatArray,
    euler_rad: FloatArray,
    intervals: IntArray,
    block: IntArray,
) -> GyroFit | None:
    r"""Fit the matrix, bias and lag that make body rates integrate to the change of attitude.

    Over an interval from :math:`t_0` to :math:`t_1` in block :math:`k`, with the kinematics :math:`W` of
    `rotations.euler_rates` at the *logged* angles, the change of the Euler angles is

    .. math::
        \Delta e = \int_{t_0}^{t_1} W(e)\,M \omega\, dt + \tau\,[W \omega]_{t_0}^{t_1} + (t_1 - t_0)\, d_k,

    linear in the matrix :math:`M`, the lag :math:`\tau` of the rates and the drift :math:`d_k`, and
    exact for any motion but for :math:`\tau`; the rates are shifted by it and the fit repeated. The
    drift is the bias of the gyro and what the estimator corrects its attitude by (compass,
    accelerometer, position): slow, but it follows the motion, so that it must not count as scale.

    Parameters
    ----------
    rate_time_s : ndarray, shape (n_rates,)
        Strictly increasing [s].
    body_rate_rad_s : ndarray, shape (n_rates, 3)
    attitude_time_s : ndarray, shape (n_attitudes,)
        Strictly increasing [s].
    euler_rad : ndarray, shape (n_attitudes, 3)
        Roll, pitch, yaw, unwrapped.
    intervals : ndarray of int, shape (n_intervals, 2)
        First and last *attitude* sample of intervals without gaps. Those steeper than 60 degrees of
        pitch are left out.
    block : ndarray of int, shape (n_intervals,)
        Number of the block of neighbours that an interval belongs to, not decreasing. Blocks of
        *different* lengths: in even ones a periodic motion has always the same phase, and then
        neither its lag and scale nor two axes can be told apart.

    Returns
    -------
    GyroFit or None
        None if fewer than two equations per unknown are left.

    Notes
    -----
    Least squares with Huber weights (P. J. Huber, Ann. Math. Stat., vol. 35, 1964); the noise of
    each Euler angle is estimated from its own residuals. Intervals are those of the jackknife over
    blocks (CR3; J. G. MacKinnon, M. O. Nielsen and M. D. Webb, J. Econometrics, vol. 232, 2023): a few
    violent seconds may carry a fit, and residuals of neighbours go together.
    """
    shift_s = 0.0
    for _ in range(_SHIFTS):
        equations = _equations(
            rate_time_s - shift_s, body_rate_rad_s, attitude_time_s, euler_rad, intervals, block
        )
        fit = _fit(equations)
        if fit is None or abs(fit.lag_s) < _SMALL_LAG_S:
            break
        shift_s += fit.lag_s
    return None if fit is None else fit._replace(lag_s=shift_s + fit.lag_s)


def _fit(equations: _Equations) -> GyroFit | None:
    """Fit with the lag to first order, which is exact for a small one."""
    if not equations.block.size:
        return None
    n_equations = 3 * (equations.block.size - np.unique(equations.block).size)
    if n_equations < 2 * _N_UNKNOWNS:
        return None
    regressors = equations.without_drift(equations.regressors)
    weight, bias = np.ones_like(equations.change), np.zeros(3)
    for _ in range(_ROUNDS):
        # A constant bias is no constant drift of the angles while these change.
        change = equations.without_drift(equations.change - equations.by_bias @ bias)
        solution, residuals = _solve(regressors, change, weight)
        noise = np.median(np.abs(residuals), axis=0) / MEDIAN_DEVIATION + _FINEST_RAD
        size = np.abs(residuals) / noise
        weight = np.sqrt(np.minimum(1.0, _OUTLIER / np.maximum(size, _OUTLIER))) / noise
        bias, _ = _solve(equations.by_bias, equations.change - equations.regressors @ solution, weight)
    half_width, explained = _certainty(regressors, residuals, weight, solution, equations.block)
    as_logged = np.append(np.eye(3), solution[-1])
    return GyroFit(
        start_s=equations.start_s,
        attitude_change=equations.change,
        integrated_change=equations.regressors @ as_logged + equations.by_bias @ bias,
        matrix=solution[:9].reshape(3, 3),
        half_width=half_width[:9].reshape(3, 3),
        explained=explained[:9].reshape(3, 3),
        bias_rad_s=bias,
        lag_s=float(solution[-1]),
        lag_half_width_s=float(half_width[-1]),
    )


def _equations(
    rate_time_s: FloatArray,
    body_rate_rad_s: FloatArray,
    attitude_time_s: FloatArray,
    euler_rad: FloatArray,
    intervals: IntArray,
    block: IntArray,
) -> _Equations:
    """Return the equations of the intervals that are not too steep."""
    first, last = intervals.T
    inside = np.linspace(0.0, 1.0, _POINTS + 1)
    start_s, end_s = attitude_time_s[first], attitude_time_s[last]
    edges_s = start_s[:, None] + (end_s - start_s)[:, None] * inside
    turning = np.gradient(euler_rad, attitude_time_s, axis=0)
    euler = _hermite(attitude_time_s, euler_rad, turning, 0.5 * (edges_s[:, 1:] + edges_s[:, :-1]))
    level = np.abs(euler[..., 1]).max(axis=1) < _STEEPEST_RAD
    first, last, edges_s, euler = first[level], last[level], edges_s[level], euler[level]
    # The matrices from body rates to Euler rates, shape (..., 3, 3).
    columns = [euler_rates(euler, np.broadcast_to(unit, euler.shape)) for unit in np.eye(3)]
    kinematics = np.stack(columns, axis=-1)
    # The running integral of (n_samples, 3), exact for cubics on an even grid. The trapezoidal rule alone
    # loses 5 % of a motion of 1.2 Hz logged at 10 Hz.
    mean = 0.5 * (body_rate_rad_s[1:] + body_rate_rad_s[:-1])
    mean[1:-1] -= (
        body_rate_rad_s[:-3] - body_rate_rad_s[1:-2] - body_rate_rad_s[2:-1] + body_rate_rad_s[3:]
    ) / 24.0
    steps = np.diff(rate_time_s)[:, None] * mean
    turned = np.concatenate([np.zeros((1, body_rate_rad_s.shape[1])), np.cumsum(steps, axis=0)])
    turn = np.diff(_hermite(rate_time_s, turned, body_rate_rad_s, edges_s), axis=1)
    by_rate = np.einsum("npij,npk->nijk", kinematics, turn).reshape(-1, 3, 9)
    rate = np.stack(
        [np.interp(edges_s[:, [0, -1]], rate_time_s, column) for column in body_rate_rad_s.T], axis=-1
    )
    ends = np.einsum("npij,npj->npi", kinematics[:, [0, -1]], rate)
    return _Equations(
        change=euler_rad[last] - euler_rad[first],
        regressors=np.concatenate([by_rate, np.diff(ends, axis=1)[:, 0, :, None]], axis=2),
        by_bias=np.einsum("npij,np->nij", kinematics, np.diff(edges_s, axis=1)),
        start_s=attitude_time_s[first],
        duration_s=attitude_time_s[last] - attitude_time_s[first],
        block=np.unique(block[level], return_inverse=True)[1],
    )


def _hermite(time_s: FloatArray, values: FloatArray, slopes: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return values (..., 3) between samples (n, 3) with known slopes, by cubics.

    scipy.interpolate does the same, but takes longer to import than `info` may take in all.
    """
    before = np.clip(np.searchsorted(time_s, at_s) - 1, 0, time_s.size - 2)
    step = (time_s[before + 1] - time_s[before])[..., None]
    u = (at_s - time_s[before])[..., None] / step
    start, end = values[before], values[before + 1]
    rise = slopes[before] * step, slopes[before + 1] * step
    bend = u * (1.0 - u) * ((1.0 - u) * (rise[0] - (end - start)) + u * ((end - start) - rise[1]))
    return np.asarray(start + u * (end - start) + bend, dtype=np.float64)


def _solve(regressors: FloatArray, change: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted least-squares solution (n_unknowns,) and the unweighted residuals (n, 3)."""
    scaled, scale = _scaled(regressors, weight)
    solution = np.linalg.lstsq(scaled, (change * weight).ravel(), rcond=None)[0] / scale
    return solution, change - regressors @ solution


def _scaled(regressors: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted equations one below the other with columns of unit length, and the lengths."""
    stacked = (regressors * weight[:, :, None]).reshape(-1, regressors.shape[2])
    length = np.linalg.norm(stacked, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return stacked / length, length


def _certainty(
    regressors: FloatArray,
    residuals: FloatArray,
    weight: FloatArray,
    solution: FloatArray,
    block: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Return 95 % half-widths and the fraction that each unknown explains of its own part of the motion.

    That part is what the other unknowns cannot explain of a regressor; its
    noise is that of the rows in which it lies.
    """
    scaled, scale = _scaled(regressors, weight)
    noise = residuals * weight
    # The rows of the pseudo-inverse are those parts, over the square of their length.
    parts = np.linalg.pinv(scaled) / scale[:, None]
    half_width = NORMAL_95 * _jackknife_deviation(scaled * scale, parts, noise.ravel(), np.repeat(block, 3))
    by_angle = np.sum(parts.reshape(solution.size, -1, 3) ** 2, axis=1)
    unexplained = by_angle @ np.sum(noise**2, axis=0)
    whole = solution**2 + unexplained
    moved = (by_angle.sum(axis=1) > 0.0) & (whole > 0.0)
    explained = np.divide(solution**2, whole, out=np.zeros_like(solution), where=moved)
    return half_width, explained


def _jackknife_deviation(
    regressors: FloatArray, parts: FloatArray, noise: FloatArray, block: IntArray
) -> FloatArray:
    """Return how the solution scatters when one block is left out at a time; shape (n_unknowns,).

    ``parts`` is the pseudo-inverse of ``regressors`` (n_rows, n_unknowns); the rows of a block, by
    ``block`` (n_rows,), stand together.
    """
    edges = np.flatnonzero(np.diff(block, prepend=-1, append=block[-1] + 1))
    square = np.zeros(parts.shape[0])
    for first, after in pairwise(edges.tolist()):
        own = parts[:, first:after]
        leverage = regressors[first:after] @ own
        without = np.linalg.pinv(np.eye(after - first) - leverage) @ noise[first:after]
        square += (own @ without) ** 2
    return np.sqrt(square)
