"""AC_PID step by step, on the rows that ArduPilot logged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.controller import AXIS_NAMES, loop_period_s, pid_parameters
from quadid_logs.autopilots.loop_rows import (
    Interval,
    in_step,
    longest_run,
    matched,
    possible,
    stood_still,
    within,
)
from quadid_logs.data.controller import AxisRows, FlownControllers, ReplayedTerms, ReplayInput, Term
from quadid_logs.data.log import FlightLog, Signal, whole_number
from quadid_logs.maths.recurrence import anti_windup_sum, low_pass
from quadid_logs.vocabulary import AXES

#: Stamps, set-points and rates of each loop are logged as the controller had them; what differs is rounding.
_TOLERANCE: Final = 0.01
_SCALE: Final = "gain_scale"
#: AC_AttitudeControl_Multi.cpp boosts P and D to twice what they are, or a few times over in one loop.
_LARGEST_SCALE: Final = 10.0
#: SID_AXIS that adds to the mixer's input: 10 roll, 11 pitch, 12 yaw (mode_systemid.cpp).
_FIRST_MIXER_AXIS: Final = 10


def replay_inputs(
    log: FlightLog, controllers: FlownControllers, intervals: Sequence[Interval]
) -> dict[str, ReplayInput]:
    """Return by axis the rows and the law to replay them with; see `Autopilot.replay_inputs`.

    Nothing where set-point, rate and output were not logged together.
    """
    setpoint = next(iter(log.candidates("body_rate_setpoint")), None)
    rate = setpoint and in_step(log, "body_rate", setpoint)
    output = setpoint and in_step(log, "torque_command", setpoint)
    if setpoint is None or rate is None or output is None:
        return {}
    sane = possible(setpoint.values, rate.values, output.values)
    flying = within(setpoint.time_s, intervals) & sane & (output.values != 0.0).any(axis=1)
    run = longest_run(setpoint.time_s, flying)
    if run is None:
        return {}
    parameters = log.parameters_at(int(setpoint.position[run.start]))
    return {
        axis: ReplayInput(
            rows=_rows(log, axis, run, (setpoint, rate, output), parameters),
            law=partial(terms, name=AXIS_NAMES[axis]),
            parameters=parameters,
            gains={term: f"ATC_RAT_{AXIS_NAMES[axis]}_{term}" for term in ("P", "I", "D", "FF")},
            cutoffs=tuple(f"ATC_RAT_{AXIS_NAMES[axis]}_{short}" for short in ("FLTT", "FLTE", "FLTD")),
            tolerance=_TOLERANCE,
            loop_period_s=loop_period_s(parameters),
            slew_limits=(f"ATC_RAT_{AXIS_NAMES[axis]}_SMAX",),
            filters=("INS_GYRO_FILTER", "INS_HNTC", "INS_NOTCH"),
        )
        for axis in controllers.axes
    }


def terms(rows: AxisRows, parameters: Mapping[str, float], *, name: str) -> ReplayedTerms:
    """Replay AC_PID::update_all.

    Parameters
    ----------
    name : str
        RLL, PIT or YAW.

    Returns
    -------
    ReplayedTerms
        Where the log holds no limit flags, they are taken from the steps of the output.

    Notes
    -----
    The integral is summed up from the settled row on, where the log, or the output less the other terms,
    tells its value.
    """
    pid = pid_parameters(parameters, name)
    step = rows.step_s
    target = low_pass(rows.target, pid["FLTT"], step, first=float(rows.target[0]))
    error = low_pass(target - rows.rate, pid["FLTE"], step, first=float(target[0] - rows.rate[0]))
    slope = np.diff(error, prepend=error[0]) / step
    proportional = pid["P"] * error
    derivative = pid["D"] * low_pass(slope, pid["FLTD"], step, first=0.0)
    # The factor on P and D: the logged slew limiter's and scales, then that of PDMX.
    total = proportional + derivative
    highest = pid["PDMX"]
    factor = np.ones_like(total)
    for logged in (rows.scale, rows.gain_scale):
        factor = factor if logged is None else factor * logged
    if highest > 0.0:
        size = np.abs(factor * total)
        factor = factor * np.where(size > highest, highest / np.maximum(size, highest), 1.0)
    proportional, derivative = factor * proportional, factor * derivative
    forward = pid["FF"] * target + pid["D_FF"] * np.diff(target, prepend=target[0]) / step
    rest = rows.output - rows.added - proportional - derivative - forward
    increments = pid["I"] * error * step
    limited = stood_still(rest, increments) if rows.limited is None else rows.limited
    begin = rows.settled()
    told = rows.logged.get("I", rest)[begin:]
    integral = rest.copy()
    integral[begin:] = anti_windup_sum(
        increments[begin:], limited[begin:], pid["IMAX"], first=float(told[0]), told=told
    )
    values: dict[Term, FloatArray] = {"P": proportional, "I": integral, "D": derivative, "FF": forward}
    values["output"] = proportional + integral + derivative + forward + rows.added
    return ReplayedTerms(values, limited)


def _rows(
    log: FlightLog,
    axis: str,
    run: slice,
    signals: tuple[Signal, Signal, Signal],
    parameters: Mapping[str, float],
) -> AxisRows:
    """Return the rows of one axis: RATE holds the target for the next loop, all else of its own."""
    setpoint, rate, output = signals
    number = AXES.index(axis)
    now, before = slice(run.start + 1, run.stop), slice(run.start, run.stop - 1)
    time_s = setpoint.time_s
    terms_of_axis = [one for one in log.controller_terms if one.axis == axis]
    logged = next((one for one in terms_of_axis if _SCALE not in one.values), None)
    scaled = next((one for one in terms_of_axis if _SCALE in one.values), None)
    found = {}
    if logged is not None:
        found = {name: matched(logged.rows.time_s, each, time_s[now]) for name, each in logged.values.items()}
        # None of a term that a loop lacks.
        found = {name: values for name, values in found.items() if np.isfinite(values).all()}
    limited, scale = found.pop("limited", None), found.pop("scale", None)
    gain_scale = None
    if scaled is not None:
        gain_scale = matched(scaled.rows.time_s, scaled.values[_SCALE], time_s[now])
        # 1 where none was written, or nonsense.
        gain_scale = np.where((gain_scale > 0.0) & (gain_scale < _LARGEST_SCALE), gain_scale, 1.0)
    # What System ID mode added to the mixer's input: SIDD.Targ of the loop before.
    before_s = time_s[before]
    chirp = next(iter(log.candidates("sysid_chirp")), None)
    if chirp is None or whole_number(parameters.get("SID_AXIS")) != _FIRST_MIXER_AXIS + number:
        mixer_chirp = np.zeros(before_s.size)
    else:
        mixer_chirp = np.nan_to_num(
            matched(chirp.time_s, chirp.values[:, 0], before_s), posinf=0.0, neginf=0.0
        )
    return AxisRows(
        start_s=float(time_s[now.start]),
        positions=setpoint.position[now],
        step_s=np.diff(time_s[run]),
        target=setpoint.values[before, number],
        rate=rate.values[now, number],
        output=output.values[now, number],
        added=mixer_chirp,
        known=np.ones(run.stop - run.start - 1, np.bool_),
        logged={term: found[term] for term in ("P", "I", "D", "FF") if term in found},
        limited=None if limited is None else limited > 0.5,
        scale=scale,
        gain_scale=gain_scale,
    )
