"""Recipes of other projects and textbooks, written here from their published formulas.

Each takes a `FlightData` and returns on-axis effectiveness with an interval.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from benchmarks.methods.entry import Estimate
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.maths.normal import NORMAL_95

#: Of the common script: above the rate loop's band, below most vibration.
_LOW_PASS_HZ: Final = 10.0
#: What first-order lags [s] the motors of multirotors have, small to large.
_LAGS_S: Final = np.concatenate([[0.0], np.arange(0.005, 0.155, 0.005)])
#: Rate and length of the segments of the output-error method: over longer ones the wind moves the rate.
_OUTPUT_HZ: Final = 50.0
_SEGMENT_S: Final = 4.0


class _Fit(NamedTuple):
    """Coefficients of one axis, their covariance, and the sum of squared residuals."""

    theta: FloatArray
    covariance: FloatArray
    squares: float


def ordinary_least_squares(data: FlightData) -> tuple[Estimate | None, ...]:
    """Linear regression of each angular acceleration, with the interval that it prints: white residuals.

    The model of moments of Galliker's data-driven-dynamics (linear in its coefficients, solved by ordinary
    least squares on measured accelerations), with the torque as logged for the rotors' part: products of
    rates, damping, trim. Its motors answer at once.
    """
    regressors, targets = _filtered(data, lag_s=0.0)
    return tuple(_estimate(_solve(regressors, targets[:, axis]), axis) for axis in range(3))


def least_squares_with_lag(data: FlightData) -> tuple[Estimate | None, ...]:
    """Do the same for every first-order lag of the torque and keep the best for each axis.

    The interval holds for that lag, with the residuals' own correlation (Morelli and Klein, J. Aircraft
    34(3), 1997: the covariance of regression with coloured residuals).
    """
    found: list[tuple[FloatArray, FloatArray]] = [_filtered(data, lag_s=float(lag)) for lag in _LAGS_S]
    estimates = []
    for axis in range(3):
        fits = [_solve(regressors, targets[:, axis]) for regressors, targets in found]
        best = int(np.argmin([fit.squares for fit in fits]))
        regressors, targets = found[best]
        estimates.append(_estimate(_coloured(fits[best], regressors, targets[:, axis]), axis))
    return tuple(estimates)


def output_error(data: FlightData) -> tuple[Estimate | None, ...]:
    """Maximum likelihood of the rate itself, simulated from the torque (Maine and Iliff, NASA RP-1168, 1986).

    The standard method of aircraft identification, which aeroid and SIDPAC offer: p' = B (torque behind a
    lag and a delay) - a p + trim; all of these and each segment's first rate by Gauss-Newton, the covariance
    by Morelli and Klein.
    """
    return tuple(_output_error(data, axis) for axis in range(3))


def _filtered(data: FlightData, *, lag_s: float) -> tuple[FloatArray, FloatArray]:
    """Return products, rates, a one and lagged torques, (n, 10), with accelerations, (n, 3), low-passed."""
    from scipy.signal import butter, lfilter, sosfiltfilt

    period_s = data.sample_period_s
    sos = butter(2, min(_LOW_PASS_HZ, 0.4 / period_s), fs=1.0 / period_s, output="sos")
    kept = -np.expm1(-period_s / lag_s) if lag_s > 0.0 else 1.0
    regressors, targets = [], []
    for segment in data.segments:
        if segment.n_samples <= 15:  # what the filter pads with
            continue
        held = _held(segment.torque) if lag_s > 0.0 else segment.torque
        lagged = lfilter([kept], [1.0, kept - 1.0], held, axis=0, zi=(1.0 - kept) * held[:1])[0]
        rates, torque = (sosfiltfilt(sos, each, axis=0) for each in (segment.body_rate_rad_s, lagged))
        p, q, r = rates.T
        regressors.append(np.column_stack([q * r, p * r, p * q, rates, np.ones(len(rates)), torque]))
        targets.append(np.gradient(rates, period_s, axis=0))
    return np.vstack(regressors), np.vstack(targets)


def _solve(regressors: FloatArray, target: FloatArray) -> _Fit:
    """Solve by least squares; the covariance is that of white residuals."""
    scale = np.maximum(np.linalg.norm(regressors, axis=0), 1e-300)
    u, singular, vt = np.linalg.svd(regressors / scale, full_matrices=False)
    inverse = np.where(singular > 1e-10 * singular[0], 1.0 / np.maximum(singular, 1e-300), 0.0)
    theta = vt.T @ (inverse * (u.T @ target)) / scale
    squares = float(np.sum((target - regressors @ theta) ** 2))
    spread = squares / max(len(target) - len(theta), 1)
    covariance = spread * ((vt.T * inverse**2) @ vt) / np.outer(scale, scale)
    return _Fit(theta, covariance, squares)


def _coloured(fit: _Fit, regressors: FloatArray, target: FloatArray) -> _Fit:
    """Return the fit with the covariance of coloured residuals: eq. 13 of Morelli and Klein."""
    residual = target - regressors @ fit.theta
    white = fit.covariance * (len(target) / max(fit.squares, 1e-300))
    return fit._replace(covariance=white @ _sandwiched(regressors, residual) @ white)


def _sandwiched(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the sum over i, j of x_i R(i - j) x_j', R the autocorrelation of the residuals."""
    size = 1 << int(2 * len(residual) - 1).bit_length()
    power = np.abs(np.fft.rfft(residual, size)) ** 2 / len(residual)
    filtered = np.fft.irfft(power[:, np.newaxis] * np.fft.rfft(jacobian, size, axis=0), size, axis=0)
    return np.asarray(jacobian.T @ filtered[: len(residual)])


def _estimate(fit: _Fit, axis: int) -> Estimate | None:
    """Return what a regression says of the torque about its axis; the torques are its last columns."""
    place = len(fit.theta) - 3 + axis
    return _with_interval(float(fit.theta[place]), float(fit.covariance[place, place]))


def _with_interval(value: float, variance: float) -> Estimate | None:
    if not np.isfinite(value):
        return None
    half = NORMAL_95 * float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else np.inf
    return Estimate(value, (value - half, value + half) if np.isfinite(half) else None)


def _output_error(data: FlightData, axis: int) -> Estimate | None:
    """Fit one axis."""
    from scipy.optimize import least_squares

    segments = list(_segments(data, axis))
    if not segments:
        return None
    period_s = segments[0][0]
    measured = np.concatenate([rate for _period, rate, _torque in segments])

    def simulated(unknown: FloatArray) -> FloatArray:
        model = unknown[:5]
        return np.concatenate(
            [
                _response(torque, period_s, model, start)
                for (_p, _r, torque), start in zip(segments, unknown[5:], strict=True)
            ]
        )

    first = [rate[0] for _period, rate, _torque in segments]
    regressors, targets = _filtered(data, lag_s=0.03)
    gain = _solve(regressors, targets[:, axis]).theta[7 + axis]  # by regression, as is the custom
    low = [-np.inf, -5.0, 1e-3, -np.inf, -0.02, *[-np.inf] * len(first)]
    high = [np.inf, 30.0, 0.3, np.inf, 0.1, *[np.inf] * len(first)]
    found = least_squares(
        lambda unknown: simulated(unknown) - measured,
        [gain, 1.0, 0.03, 0.0, 0.01, *first],
        bounds=(low, high),
        x_scale="jac",
        max_nfev=40,
    )
    residual = found.fun
    inverse = np.linalg.pinv(found.jac.T @ found.jac)
    covariance = inverse @ _sandwiched(found.jac, residual) @ inverse
    return _with_interval(float(found.x[0]), float(covariance[0, 0]))


def _segments(data: FlightData, axis: int) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Yield period [s], rate and torque about an axis of segments of a flight."""
    from scipy.signal import decimate

    factor = max(1, round(1.0 / (_OUTPUT_HZ * data.sample_period_s)))
    period_s = factor * data.sample_period_s
    length = round(_SEGMENT_S / period_s)
    for segment in data.segments:
        if segment.n_samples <= 70 * factor:
            continue  # shorter than the filter
        pair = np.column_stack([segment.body_rate_rad_s[:, axis], segment.torque[:, axis]])
        if factor > 1:
            pair = decimate(pair, factor, ftype="fir", axis=0, zero_phase=True)
        for begin in range(0, len(pair) - length + 1, length):
            rate, torque = pair[begin : begin + length].T
            yield period_s, rate, torque


def _response(torque: FloatArray, period_s: float, model: FloatArray, start: float) -> FloatArray:
    """Return the rate that a torque makes, (n,), of a model of gain, damping, lag, trim and delay."""
    from scipy.signal import lfilter

    gain, damping, lag_s, trim, delay_s = model
    time_s = period_s * np.arange(len(torque))
    kept = -np.expm1(-period_s / lag_s)
    held = _held(np.interp(time_s - delay_s, time_s, torque))
    lagged = lfilter([kept], [1.0, kept - 1.0], held, zi=[(1.0 - kept) * held[0]])[0]
    pole = np.exp(-damping * period_s)
    acting_s = period_s if abs(damping) < 1e-9 else (1.0 - pole) / damping
    push = acting_s * (gain * 0.5 * (lagged[1:] + lagged[:-1]) + trim)
    return np.concatenate([[start], lfilter([1.0], [1.0, -pole], push, zi=[pole * start])[0]])


def _held(torque: FloatArray) -> FloatArray:
    """Return the mean of a torque at both ends of each step, so that holding it is no delay of its own."""
    return np.concatenate([torque[:1], 0.5 * (torque[1:] + torque[:-1])])
