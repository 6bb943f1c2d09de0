"""Body rates from torques: the identified equations solved forward in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Model
from quadid_logs.errors import SettingsError, ShapeError
from quadid_logs.identify.terms import (
    ANGLE_SYMBOLS,
    THROTTLED_YAW,
    TRIM,
    YAW_REACTION,
    RateTerm,
    Term,
)
from quadid_logs.maths.rotations import euler_rates
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS

#: A model that is unstable, or wrong, leaves any flight: beyond, its rate stays where it is [rad/s].
_MOST_RATE_RAD_S = 1e3


def simulate_rates(
    model: Model,
    terms: Sequence[Term],
    torque: ArrayLike,
    time_s: ArrayLike,
    *,
    start_rate_rad_s: ArrayLike | None = None,
    start_attitude_rad: ArrayLike | None = None,
    throttle: ArrayLike | None = None,
) -> FloatArray:
    """Return the body rates that torques make of a model.

    Heun's method, with the torque linear between the samples. Where the lag acts on the speed of the rotors
    it acts here on the torque, which is the same to first order.

    Parameters
    ----------
    model : Model
    terms : sequence of Term
        Those of its regressors, in their order.
    torque : array_like, shape (n_samples, 3)
        L, M, N in the unit of the model's inputs.
    time_s : array_like, shape (n_samples,)
        Increasing [s].
    start_rate_rad_s, start_attitude_rad : array_like, shape (3,), optional
        At the first sample: p, q, r [rad/s]; roll, pitch, yaw [rad]. Zero if not given.
    throttle : array_like, shape (n_samples,), optional
        Above the mean of the flight that was identified; zero if not given.

    Returns
    -------
    ndarray, shape (n_samples, 3)
        p, q, r [rad/s] of the vehicle, before any filter of its gyro.

    Raises
    ------
    ShapeError
        If the arrays do not fit together.
    SettingsError
        If a regressor does not follow from rates, attitude, torque and throttle.
    """
    torque = np.asarray(torque, dtype=np.float64)
    time_s = np.asarray(time_s, dtype=np.float64)
    if time_s.ndim != 1 or time_s.size < 2 or torque.shape != (time_s.size, 3):
        raise ShapeError(
            f"Torques of shape {torque.shape} and times of shape {time_s.shape} do not belong together.",
            hint="Give torque (n, 3) and time (n,) with n of at least 2.",
        )
    if not (np.isfinite(torque).all() and np.isfinite(time_s).all() and (np.diff(time_s) > 0.0).all()):
        raise ShapeError("Torques and times must be finite, and times must increase.")
    start = [np.zeros(3) if given is None else given for given in (start_rate_rad_s, start_attitude_rad)]
    # What does not depend on the state, behind lag and delay.
    lag_s, delay_s = (0.0, 0.0) if model.actuator is None else (model.actuator.lag_s, model.actuator.delay_s)
    delayed = np.column_stack([np.interp(time_s - delay_s, time_s, column) for column in torque.T])
    above = np.zeros(time_s.size) if throttle is None else np.asarray(throttle, dtype=np.float64)
    if above.shape != time_s.shape:
        raise ShapeError(f"A throttle of shape {above.shape} does not belong to {time_s.size} times.")
    above = np.interp(time_s - delay_s, time_s, above)
    inputs = _lagged(np.column_stack([delayed, delayed[:, 2] * above]), time_s, lag_s)
    columns = {TRIM.symbol: np.ones(time_s.size), THROTTLED_YAW.symbol: inputs[:, 3]}
    columns[YAW_REACTION.symbol] = np.gradient(inputs[:, 2], time_s)
    forcing = inputs[:, :3] @ model.B.T
    for number, symbol in enumerate(model.regressors):
        if symbol in columns:
            forcing += np.outer(columns[symbol], model.A[:, number])
    slope = _slope(model, terms)
    state = np.concatenate([np.asarray(each, dtype=np.float64).reshape(3) for each in start])
    rates = np.empty((time_s.size, 3))
    rates[0] = state[:3]
    for k, step_s in enumerate(np.diff(time_s)):
        first = slope(state, forcing[k])
        second = slope(_bounded(state + step_s * first), forcing[k + 1])
        state = _bounded(state + 0.5 * step_s * (first + second))
        rates[k + 1] = state[:3]
    return rates


def _bounded(state: FloatArray) -> FloatArray:
    """Return a state (6,) whose rates are those of something that flies."""
    return np.concatenate([np.clip(state[:3], -_MOST_RATE_RAD_S, _MOST_RATE_RAD_S), state[3:]])


def _lagged(columns: FloatArray, time_s: FloatArray, lag_s: float) -> FloatArray:
    """Return columns behind a lag of first order, exact for what is linear between the samples."""
    if not lag_s > 0.0:
        return columns
    lagged = columns.copy()
    for k, step_s in enumerate(np.diff(time_s)):
        slope = (columns[k + 1] - columns[k]) / step_s
        behind = lagged[k] - columns[k] + slope * lag_s
        lagged[k + 1] = columns[k + 1] - slope * lag_s + behind * np.exp(-step_s / lag_s)
    return lagged


def _slope(model: Model, terms: Sequence[Term]) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return the function of state (6,) and forcing (n_targets,) that gives the state's derivative (6,)."""
    places = [model.targets.index(symbol) for symbol in ACCELERATION_SYMBOLS]
    angle_targets = [f"{symbol}_dot" for symbol in ANGLE_SYMBOLS]
    angles = [model.targets.index(name) for name in angle_targets if name in model.targets]
    used = [(model.A[:, number], _of_state(term)) for number, term in enumerate(terms)]
    parts = [(column, value) for column, value in used if value is not None]

    def slope(state: FloatArray, forcing: FloatArray) -> FloatArray:
        change = forcing.copy()
        for column, value in parts:
            change += column * value(state)
        turning = change[angles] if len(angles) == 3 else euler_rates(state[3:], state[:3])
        return np.concatenate([change[places], turning])

    return slope


def _of_state(term: Term) -> Callable[[FloatArray], float] | None:
    """Return the function of the state (6,) that a term is, None where it belongs to the forcing."""
    if isinstance(term, RateTerm):
        of_rate = term.of_rate
        if term.symbol in RATE_SYMBOLS:
            place = RATE_SYMBOLS.index(term.symbol)
            return lambda state: float(state[place])
        return lambda state: float(of_rate(state[np.newaxis, :3])[0])
    if term.symbol in ANGLE_SYMBOLS:
        place = 3 + ANGLE_SYMBOLS.index(term.symbol)
        return lambda state: float(state[place])
    if term.symbol in (TRIM.symbol, THROTTLED_YAW.symbol, YAW_REACTION.symbol):
        return None
    raise SettingsError(
        f"The regressor {term.symbol} cannot be computed from rates, attitude, torque and throttle.",
        hint="Simulate a structure without it.",
    )
