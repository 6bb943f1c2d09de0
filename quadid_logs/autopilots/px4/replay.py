"""PX4's rate controller step by step, on the rows that the log holds of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.loop_rows import Interval, longest_run, matched, possible, stood_still, within
from quadid_logs.autopilots.px4.controller import AXIS_NAMES, parameter_period_s, rate_parameters
from quadid_logs.autopilots.px4.filters import cutoff_hz, derivative_filter, has_second_order_derivative
from quadid_logs.data.controller import AxisRows, FlownControllers, ReplayedTerms, ReplayInput, Term
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.maths.recurrence import anti_windup_sum, linear_filter, low_pass
from quadid_logs.vocabulary import AXES

#: The set-points that the logger missed, and the limits of the integrator that it holds at 5 Hz, leave this.
_TOLERANCE: Final = 0.05
#: A set-point older than so many typical periods is not the one that the controller had.
_HELD: Final = 1.5
_DEFAULT_LIMIT: Final = 0.3
#: rate_control.cpp: the integrator slows down with the error, to nothing at 400 deg/s.
_INTEGRATOR_END: Final = np.radians(400.0)
#: AlphaFilter's step, clamped as the controller clamps it [s].
_STEPS_S: Final = (0.125e-3, 20e-3)


def replay_inputs(
    log: FlightLog, controllers: FlownControllers, intervals: Sequence[Interval]
) -> dict[str, ReplayInput]:
    """Return by axis the rows and the law to replay them with; see `Autopilot.replay_inputs`.

    Nothing where set-point, rate or output were not logged.
    """
    names = ("body_rate_setpoint", "body_rate", "torque_command")
    found = [next(iter(log.candidates(name)), None) for name in names]
    setpoint, rate, output = found
    if setpoint is None or rate is None or output is None or setpoint.n_samples < 2:
        return {}
    given = np.column_stack([matched(output.time_s, column, rate.time_s) for column in output.values.T])
    usable = within(rate.time_s, intervals) & possible(given, rate.values)
    run = longest_run(rate.time_s, usable & (given != 0.0).any(axis=1))
    if run is None:
        return {}
    parameters = log.parameters_at(int(rate.position[run.start]))
    return {
        axis: ReplayInput(
            rows=_rows(log, axis, run, (setpoint, rate), given[:, AXES.index(axis)]),
            law=partial(terms, axis=axis),
            parameters=parameters,
            gains={term: f"MC_{AXIS_NAMES[axis][0]}RATE_{term}" for term in ("P", "I", "D", "FF")},
            cutoffs=("MC_YAW_TQ_CUTOFF",) if axis == "yaw" else ("IMU_DGYRO_CUTOFF",),
            tolerance=_TOLERANCE,
            loop_period_s=controllers.axes[axis].period_s,
            shortest_period_s=parameter_period_s(parameters),
            filters=("IMU_GYRO_CUTOFF", "IMU_GYRO_NF", "IMU_DGYRO_CUTOFF", "MC_YAW_TQ_CUTOFF"),
        )
        for axis in controllers.axes
    }


def terms(rows: AxisRows, parameters: Mapping[str, float], *, axis: str) -> ReplayedTerms:
    """Replay RateControl::update.

    Returns
    -------
    ReplayedTerms
        Of the yaw axis the terms before its low-pass. The logger keeps the allocator's limits at 5 Hz only:
        they are taken from the steps of the output.

    Notes
    -----
    The integral is summed up from the settled row on. The output less the other terms tells where it begins:
    the median over a second, for in some loops the set-point came before the controller.
    """
    name, limit_name = AXIS_NAMES[axis]
    pid = rate_parameters(parameters, name)
    step = np.clip(rows.step_s, *_STEPS_S)
    error = rows.target - rows.rate
    proportional = pid["K"] * pid["P"] * error
    # What D acts on [rad/s^2]: as logged, else the filtered slope of the rate.
    if rows.derivative is not None:
        acceleration = rows.derivative
    else:
        slope = np.diff(rows.rate, prepend=rows.rate[0]) / rows.step_s
        used = derivative_filter(parameters, float(np.median(rows.step_s)))
        if has_second_order_derivative(parameters):
            acceleration = linear_filter(used.numerator, used.denominator, slope)
        else:
            acceleration = low_pass(slope, cutoff_hz(parameters), rows.step_s, first=0.0)
    derivative = -pid["K"] * pid["D"] * acceleration
    forward = pid["FF"] * rows.target
    slower = np.clip(1.0 - (error / _INTEGRATOR_END) ** 2, 0.0, None)
    increments = np.roll(pid["K"] * pid["I"] * slower * error * step, 1)
    torque_hz = parameters.get("MC_YAW_TQ_CUTOFF", 0.0) if axis == "yaw" else 0.0
    before = unfiltered(rows.output, torque_hz, step)
    rest = before - proportional - derivative - forward
    bound = parameters.get(f"MC_{limit_name}_INT_LIM", _DEFAULT_LIMIT)
    limited = _inferred_limits(rest, increments, rows.known) if rows.limited is None else rows.limited
    # The integral from its own increments, begun where it fits what is left of the logged sum.
    steps = np.where(limited, 0.0, increments)
    begin = rows.settled()
    if begin >= rows.n_rows:
        integral = rest
    else:
        free = np.cumsum(steps[begin:]) - steps[begin]
        second = rows.known[begin : 2 * begin]
        offset = (rest[begin:] - free)[: second.size][second]
        first = float(np.median(offset)) if offset.size else float(rest[begin])
        never = np.zeros(rows.n_rows - begin, np.bool_)
        integral = np.concatenate([rest[:begin], anti_windup_sum(steps[begin:], never, bound, first=first)])
    total = proportional + integral + derivative + forward
    values: dict[Term, FloatArray] = {"P": proportional, "I": integral, "D": derivative, "FF": forward}
    values["output"] = low_pass(total, torque_hz, step, first=float(rows.output[0]))
    return ReplayedTerms(values, limited)


def unfiltered(output: FloatArray, cutoff_hz: float, step_s: FloatArray) -> FloatArray:
    """Return what went into a first-order low-pass."""
    if not cutoff_hz > 0.0:
        return output
    alpha = step_s / (step_s + 1.0 / (2.0 * np.pi * cutoff_hz))
    before = np.concatenate([output[:1], output[:-1]])
    return np.asarray(before + (output - before) / alpha)


def _inferred_limits(integral: FloatArray, increments: FloatArray, known: BoolArray) -> BoolArray:
    """Mark steps at which the integral stood still; where set-points are unknown, between two such steps."""
    told = known & np.concatenate([[False], known[:-1]])
    stopped, rows = stood_still(integral, increments) & told, np.arange(known.size)
    before = np.maximum.accumulate(np.where(told, rows, 0))
    after = np.minimum.accumulate(np.where(told, rows, known.size - 1)[::-1])[::-1]
    return np.asarray(stopped[before] & stopped[after], dtype=np.bool_)


def _rows(
    log: FlightLog, axis: str, run: slice, signals: tuple[Signal, Signal], output: FloatArray
) -> AxisRows:
    """Return the rows of one axis: a loop uses the set-point that was published before its gyro sample."""
    setpoint, rate = signals
    number = AXES.index(axis)
    now = slice(run.start + 1, run.stop)
    time_s = rate.time_s[now]
    target, known = _held(setpoint, number, time_s)
    logged = [one for one in log.controller_terms if one.axis == axis and "derivative" in one.values]
    derivative = matched(logged[0].rows.time_s, logged[0].values["derivative"], time_s) if logged else None
    return AxisRows(
        start_s=float(time_s[0]),
        positions=rate.position[now],
        step_s=np.diff(rate.time_s[run]),
        target=target,
        rate=rate.values[now, number],
        output=output[now],
        added=np.zeros(time_s.size),
        known=known,
        derivative=derivative if derivative is not None and np.isfinite(derivative).all() else None,
        setpoints_per_row=float(np.mean(within(setpoint.time_s, [(time_s[0], time_s[-1])])))
        * setpoint.n_samples
        / time_s.size,
    )


def _held(setpoint: Signal, number: int, time_s: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the last set-point before each time, interpolated where one is missing; and where not."""
    order = np.argsort(setpoint.time_s, kind="stable")
    published, values = setpoint.time_s[order], setpoint.values[order, number]
    sane = possible(values[:, np.newaxis])
    published, values = published[sane], values[sane]
    if published.size < 2:
        return np.zeros(time_s.size), np.zeros(time_s.size, np.bool_)
    period_s = float(np.median(np.diff(published)))
    last = np.searchsorted(published, time_s) - 1
    age = time_s - published[np.maximum(last, 0)]
    known = (last >= 0) & (age <= _HELD * period_s)
    between = np.interp(time_s - period_s, published, values)
    return np.where(known, values[np.maximum(last, 0)], between), np.asarray(known, np.bool_)
