"""ArduPilot's input shaper, attitude, velocity and position controllers: by parameters, and on logged rows.

libraries/AC_AttitudeControl/AC_AttitudeControl.cpp, AC_PosControl.cpp, libraries/AC_PID/AC_PID_2D.cpp and
libraries/AP_Math/control.cpp; the parameters were renamed in 4.7, some with another unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.controller import AXIS_NAMES, loop_period_s
from quadid_logs.autopilots.ardupilot.signals import DEGREE
from quadid_logs.autopilots.loop_rows import Interval, in_step, last_before, longest_run, possible, within
from quadid_logs.autopilots.versions import finite
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import FlightLog, PositionRows, Rows
from quadid_logs.data.outer_loops import (
    AttitudeCommand,
    AttitudeRows,
    CascadeController,
    OuterControllers,
    ShaperRows,
)
from quadid_logs.maths.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_euler,
    rotation_vector,
    tilt_and_heading,
)
from quadid_logs.vocabulary import GRAVITY_M_S2

#: A minute at 400 Hz: more rows say nothing new of a law, and cost time.
_MOST_ROWS: Final = 24_000
#: AC_AttitudeControl.h: half of the acceleration limit, between these, shapes the angle controller [deg/s^2].
_ACCELERATIONS: Final = ((40.0, 720.0), (40.0, 720.0), (10.0, 120.0))
#: AC_ATTITUDE_THRUST_ERROR_ANGLE_RAD: with a larger error the heading is faded out [rad].
_LARGEST_ERROR: Final = math.radians(30.0)
#: Until 4.6 in hundredths of a degree, since then in degrees.
_ACCELERATION_LIMITS: Final = (("ATC_ACCEL_{0}_MAX", 0.01), ("ATC_ACC_{0}_MAX", 1.0))
#: Rate set-points and angles are of one loop where their stamps are no further apart [s].
_SAME_LOOP_S: Final = 1e-3
#: The shaper is replayed so many times a second: ten times as often as its shortest time constant asks.
_SHAPER_HZ: Final = 100.0
#: AC_AttitudeControl.cpp: the shortest that ATC_INPUT_TC can be [s].
_SHORTEST_TC_S: Final = 0.01
#: Position controllers' messages by direction: since 4.1, with the letter that ends their labels.
_DIRECTIONS: Final = (("PSCN", "N", "north"), ("PSCE", "E", "east"), ("PSCD", "D", "down"))
_LABELS: Final = {
    "position_target": "TP",
    "position": "P",
    "velocity_forward": "DV",
    "velocity_target": "TV",
    "velocity": "V",
    "acceleration_forward": "DA",
    "acceleration_target": "TA",
}
#: One message for both until 4.0, without what is fed forward.
_OLD_MESSAGE: Final = "PSC"
_OLD_DIRECTIONS: Final = (("X", "north"), ("Y", "east"))
_OLD_LABELS: Final = {
    "position_target": "TP",
    "position": "P",
    "velocity_target": "TV",
    "velocity": "V",
    "acceleration_target": "TA",
}
POSITION_MESSAGES: Final = frozenset({_OLD_MESSAGE, *(message for message, _, _ in _DIRECTIONS)})
POSITION_LABELS: Final = frozenset(
    {label + end for _, end, _ in _DIRECTIONS for label in _LABELS.values()}
    | {label + end for end, _ in _OLD_DIRECTIONS for label in _OLD_LABELS.values()}
)
#: AC_P_2D's square-root controller is linear up to a / p, a being of the mode: WPNAV_ACCEL and LOIT_ACC_MAX
#: allow no less [m/s^2].
_LEAST_ACCELERATION: Final = 0.5
#: How the names of position and velocity gains begin: since 4.7, and before.
_HORIZONTAL: Final = (("PSC_NE_POS", "PSC_POSXY"), ("PSC_NE_VEL", "PSC_VELXY"))
_VERTICAL: Final = (("PSC_D_POS", "PSC_POSZ"), ("PSC_D_VEL", "PSC_VELZ"))
_OF_VELOCITY: Final = ("P", "I", "D", "FLTE", "FLTD")


def position_rows(
    tables: Mapping[str, MessageTable], rows_of: Mapping[str, Rows]
) -> tuple[PositionRows, ...]:
    """Return what the log holds of the position controllers.

    Parameters
    ----------
    tables : mapping of str to MessageTable
        PSCN, PSCE and PSCD, or PSC, as far as the log has them.
    rows_of : mapping of str to Rows
        Of the same messages.

    Returns
    -------
    tuple of PositionRows
        In metres and seconds, whatever unit the log states; old firmware logged centimetres.
    """
    found = []
    for message, end, direction in _DIRECTIONS:
        if message in tables:
            labels = {name: label + end for name, label in _LABELS.items()}
            found.append(_of_direction(tables[message], rows_of[message], labels, direction))
    if not found and _OLD_MESSAGE in tables:
        for end, direction in _OLD_DIRECTIONS:
            labels = {name: label + end for name, label in _OLD_LABELS.items()}
            found.append(_of_direction(tables[_OLD_MESSAGE], rows_of[_OLD_MESSAGE], labels, direction))
    return tuple(found)


def _of_direction(table: MessageTable, rows: Rows, labels: Mapping[str, str], direction: str) -> PositionRows:
    values = {}
    for name, label in labels.items():
        if table.has_numbers(label):
            unit = table.units.get(label)
            values[name] = table.columns[label].astype(np.float64) * (1.0 if unit is None else unit.factor)
    return PositionRows(direction=direction, rows=rows, values=values)


def outer_controllers(parameters: Mapping[str, float]) -> OuterControllers:
    """Return the controllers around the rate loop that the parameters make.

    Notes
    -----
    With ATC_RATE_FF_ENAB the shaper gives a target that lags the wanted angle by ATC_INPUT_TC for small
    changes, and the target's rate goes to the rate controller; without it the wanted angle is the target.
    """
    forward = parameters.get("ATC_RATE_FF_ENAB", 1.0) > 0.0
    constant_s = finite(parameters.get("ATC_INPUT_TC"))
    lags_s = () if constant_s is None or not forward else (max(constant_s, _SHORTEST_TC_S),)
    names = ("ATC_INPUT_TC", "ATC_RATE_FF_ENAB", *(f"ATC_RATE_{each}_MAX" for each in "RPY"))
    limits = (name.format(each) for name, _ in _ACCELERATION_LIMITS for each in "RPY")
    gains = {name: parameters[name] for name in (*names, *limits) if name in parameters}
    return OuterControllers(
        attitude=AttitudeCommand(lags_s=lags_s, forward=forward, gains=gains),
        horizontal=_cascade(parameters, *_HORIZONTAL),
        vertical=_cascade(parameters, *_VERTICAL),
    )


def _cascade(
    parameters: Mapping[str, float], position: tuple[str, str], velocity: tuple[str, str]
) -> CascadeController | None:
    """Return position and velocity controller; None where a gain is missing or of velocities none is set."""
    names = {"position": [f"{each}_P" for each in position]}
    names |= {short: [f"{each}_{short}" for each in velocity] for short in _OF_VELOCITY}
    known = {
        short: [one for one in each if finite(parameters.get(one)) is not None]
        for short, each in names.items()
    }
    values = {short: parameters[each[0]] for short, each in known.items() if each}
    gains = {each[0]: parameters[each[0]] for each in known.values() if each}
    if len(values) < len(names) or not values["P"] > 0.0 or min(values.values()) < 0.0:
        return None
    return CascadeController(
        position_per_s=values["position"],
        proportional_per_s=values["P"],
        integral_per_s2=values["I"],
        derivative=values["D"],
        error_hz=values["FLTE"],
        derivative_hz=values["FLTD"],
        slope_of_error=True,
        period_s=loop_period_s({**parameters, "FSTRATE_ENABLE": 0.0}),
        gains=gains,
        linear_m_s=_LEAST_ACCELERATION / values["position"] if values["position"] > 0.0 else math.inf,
    )


def acceleration_limit(parameters: Mapping[str, float], axis: int) -> float:
    """Return the limit of one axis' target [rad/s^2], 0 for none."""
    for name, scale in _ACCELERATION_LIMITS:
        value = finite(parameters.get(name.format("RPY"[axis])))
        if value is not None:
            return max(value, 0.0) * scale * DEGREE
    return 0.0


def square_root(error: FloatArray, gain: float, limit: float, step_s: FloatArray) -> FloatArray:
    """Return the rate that takes an error away with limited deceleration.

    Parameters
    ----------
    error : ndarray, shape (n,)
        [rad]
    gain : float
        For small errors [1/s].
    limit : float
        Of the deceleration [rad/s^2]; 0 for none.
    step_s : ndarray, shape (n,)
        Of the loop [s]: no more than the error is taken away in one.

    Returns
    -------
    ndarray, shape (n,)

    Notes
    -----
    AP_Math/control.cpp, `sqrt_controller`.
    """
    size = np.abs(error)
    wanted = gain * size
    if limit > 0.0 and gain > 0.0:
        linear = limit / gain**2
        wanted = np.where(size > linear, np.sqrt(2.0 * limit * np.maximum(size - 0.5 * linear, 0.0)), wanted)
    return np.asarray(np.sign(error) * np.minimum(wanted, size / step_s), dtype=np.float64)


def attitude_rows(
    log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[Interval]
) -> AttitudeRows | None:
    """Replay the attitude controller on the rows of its target; see `Autopilot.attitude_rows`.

    None where target and attitude were not logged together at the loop's rate.

    Notes
    -----
    `attitude_controller_run_quat`: the error is split into one of the thrust's direction and one of the
    heading; each goes through the square-root controller with half of the acceleration limit, and the
    target's own rate, turned into body axes, is added. That rate is what takes one logged target to the next.
    """
    gains = [finite(parameters.get(f"ATC_ANG_{name}_P")) for name in AXIS_NAMES.values()]
    target = next(iter(log.candidates("attitude_setpoint")), None)
    attitude = target and in_step(log, "attitude", target)
    setpoint = next(iter(log.candidates("body_rate_setpoint")), None)
    if target is None or attitude is None or setpoint is None or None in gains or setpoint.n_samples < 2:
        return None
    sane = possible(target.values, attitude.values)
    run = longest_run(target.time_s, within(target.time_s, intervals) & sane)
    if run is None:
        return None
    run = slice(run.start, min(run.stop, run.start + _MOST_ROWS))
    time_s = target.time_s[run]
    step_s = np.diff(time_s)
    # Slower rows do not tell the target's own rate.
    if float(np.median(step_s)) > 1.5 * loop_period_s({**parameters, "FSTRATE_ENABLE": 0.0}):
        return None
    # Set-points of rows that were logged in the same loop.
    place, row = last_before(setpoint.time_s, time_s[:-1] + _SAME_LOOP_S)
    logged = setpoint.values[row]
    same = (place >= 0) & (np.abs(setpoint.time_s[row] - time_s[:-1]) <= _SAME_LOOP_S) & possible(logged)
    logged = np.where(same[:, np.newaxis], logged, 0.0)
    wanted = quaternion_from_euler(target.values[run])
    error = multiply_quaternions(conjugate(quaternion_from_euler(attitude.values[run]))[:-1], wanted[:-1])
    forward = _forward(wanted, error, step_s, parameters)
    tilt, heading = tilt_and_heading(error)
    angles = np.column_stack([rotation_vector(tilt)[:, :2], heading])
    corrected = np.column_stack(
        [
            square_root(angles[:, axis], float(gain or 0.0), _shaping(parameters, axis), step_s)
            for axis, gain in enumerate(gains)
        ]
    )
    # Where the thrust's direction is far off the heading is faded out, and where nothing is wanted nothing
    # runs.
    clear = same & (np.linalg.norm(angles[:, :2], axis=1) < _LARGEST_ERROR) & (logged != 0.0).any(axis=1)
    return AttitudeRows(
        time_s=time_s[:-1][clear], from_error=corrected[clear], forward=forward[clear], logged=logged[clear]
    )


def _shaping(parameters: Mapping[str, float], axis: int) -> float:
    """Return the deceleration by which one axis' angle controller takes large errors away [rad/s^2]."""
    limit = acceleration_limit(parameters, axis)
    low, high = (DEGREE * each for each in _ACCELERATIONS[axis])
    return float(np.clip(0.5 * limit, low, high)) if limit > 0.0 else 0.0


def _forward(
    wanted: FloatArray, error: FloatArray, step_s: FloatArray, parameters: Mapping[str, float]
) -> FloatArray:
    """Return the target's own rate in body axes [rad/s], zeros where it is not fed forward."""
    turned = np.zeros_like(error)
    if not parameters.get("ATC_RATE_FF_ENAB", 1.0) > 0.0:
        return turned[:, 1:]
    turned[:, 1:] = (
        rotation_vector(multiply_quaternions(conjugate(wanted[:-1]), wanted[1:])) / step_s[:, np.newaxis]
    )
    return multiply_quaternions(multiply_quaternions(error, turned), conjugate(error))[:, 1:]


def shaper_rows(
    log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[Interval]
) -> ShaperRows | None:
    """Replay the input shaper where position control wants angles; see `Autopilot.shaper_rows`.

    None without accelerations that were wanted, or without a shaper.

    Notes
    -----
    `accel_to_lean_angles` makes angles of accelerations, `input_shaping_angle` a target of these: the
    square-root controller with one over ATC_INPUT_TC and the acceleration limit gives a rate, which changes
    by no more than that limit, and the target is its integral. Angles of stick modes are not logged.
    """
    constant_s = finite(parameters.get("ATC_INPUT_TC"))
    north, east = (
        next((each for each in log.position_control if each.direction == one), None)
        for one in ("north", "east")
    )
    target = next(iter(log.candidates("attitude_setpoint")), None)
    if constant_s is None or not parameters.get("ATC_RATE_FF_ENAB", 1.0) > 0.0:
        return None
    if north is None or east is None or target is None or target.n_samples < 2:
        return None
    if "acceleration_target" not in north.values or "acceleration_target" not in east.values:
        return None
    n_rows = min(north.rows.n_samples, east.rows.n_samples)
    wanted = np.column_stack([each.values["acceleration_target"][:n_rows] for each in (north, east)])
    time_s = north.rows.time_s[:n_rows]
    run = longest_run(time_s, within(time_s, intervals) & possible(wanted))
    if run is None:
        return None
    sane = possible(target.values) & np.isfinite(target.time_s)
    order = np.argsort(target.time_s[sane], kind="stable")
    known_s, known = target.time_s[sane][order], target.values[sane][order]
    if known_s.size < 2:
        return None
    fine_s = np.arange(time_s[run][0], time_s[run][-1], 1.0 / _SHAPER_HZ)[:_MOST_ROWS]
    target_at = np.column_stack([np.interp(fine_s, known_s, np.unwrap(each)) for each in known.T])
    north_m_s2, east_m_s2 = (np.interp(fine_s, time_s[run], each) for each in wanted[run].T)
    angles = lean_angles(north_m_s2, east_m_s2, target_at[:, 2])
    shaped = np.column_stack(
        [
            shape_angle(angles[:, axis], constant_s, acceleration_limit(parameters, axis), target_at[0, axis])
            for axis in range(2)
        ]
    )
    return ShaperRows(wanted=angles, shaped=shaped, logged=target_at[:, :2])


def lean_angles(north_m_s2: FloatArray, east_m_s2: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Return roll and pitch that give horizontal accelerations, shape (n, 2) [rad]."""
    ahead = north_m_s2 * np.cos(heading_rad) + east_m_s2 * np.sin(heading_rad)
    right = east_m_s2 * np.cos(heading_rad) - north_m_s2 * np.sin(heading_rad)
    pitch = np.arctan2(-ahead, GRAVITY_M_S2)
    return np.column_stack([np.arctan2(right * np.cos(pitch), GRAVITY_M_S2), pitch])


def shape_angle(wanted: FloatArray, constant_s: float, limit: float, first: float) -> FloatArray:
    """Return the target that the input shaper makes of one wanted angle.

    Parameters
    ----------
    wanted : ndarray, shape (n,)
        [rad], `_SHAPER_HZ` of them a second.
    constant_s : float
        ATC_INPUT_TC [s].
    limit : float
        Of the angular acceleration [rad/s^2]; 0 for none.
    first : float
        The target at the first row [rad].

    Returns
    -------
    ndarray, shape (n,)
    """
    step_s, gain = 1.0 / _SHAPER_HZ, 1.0 / max(constant_s, _SHORTEST_TC_S)
    linear, most = (limit / gain**2, limit * step_s) if limit > 0.0 else (math.inf, math.inf)
    angle, rate, found = first, 0.0, []
    for one in wanted.tolist():
        found.append(angle)
        error = one - angle
        size = abs(error)
        asked = gain * size if size <= linear else math.sqrt(2.0 * limit * (size - 0.5 * linear))
        asked = math.copysign(min(asked, size / step_s), error)
        rate = min(max(asked, rate - most), rate + most)
        angle += rate * step_s
    return np.array(found)
