"""PX4's attitude, velocity and position controllers: by parameters, and on logged rows.

mc_att_control/AttitudeControl/AttitudeControl.cpp, mc_pos_control/PositionControl/PositionControl.cpp and
MulticopterPositionControl.cpp; before 1.12 velocity gains were of thrust, which none of this is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.autopilots.loop_rows import Interval, last_before, possible, within
from quadid_logs.autopilots.px4.controller import AXIS_NAMES
from quadid_logs.autopilots.px4.reference_model import followed
from quadid_logs.autopilots.px4.signals import sample_time_s
from quadid_logs.autopilots.sources import stacked
from quadid_logs.autopilots.versions import finite
from quadid_logs.containers.ulog import TopicKey, TopicTable
from quadid_logs.data.log import FlightLog, PositionRows, Rows, Signal
from quadid_logs.data.outer_loops import (
    FEWEST_ROWS,
    AttitudeCommand,
    AttitudeRows,
    CascadeController,
    OuterControllers,
)
from quadid_logs.maths.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_euler,
    rotation_matrix,
    tilt_and_heading,
)

#: Attitude and set-point of the loop that made a rate set-point are no older than this [s]: loops take 4 ms
#: or more, and what follows in one of them takes less. A set-point of the position controller, which is
#: slower, may be older by one loop; those are asked where newer ones are too few.
_SAME_LOOP_S: Final = 2e-3
_LOOP_BEFORE_S: Final = 6e-3
#: More rows than a minute's at 400 Hz tell nothing new.
_MOST_ROWS: Final = 24_000
#: Below, a yaw weight switches the heading off (`setProportionalGain`).
_LEAST_WEIGHT: Final = 1e-4
#: MulticopterPositionControl.cpp runs on each vehicle_local_position, which the estimator publishes at 50 Hz.
_POSITION_PERIOD_S: Final = 0.02
_SETPOINT, _STATE, _TRAJECTORY = (
    "vehicle_local_position_setpoint",
    "vehicle_local_position",
    "trajectory_setpoint",
)
TOPICS: Final = frozenset({_SETPOINT, _STATE, _TRAJECTORY})
_DIRECTIONS: Final = (("north", "x", 0), ("east", "y", 1))
#: A set-point that is fed forward and older than this is not the one that was used [s].
_OLDEST_S: Final = 0.06
#: Ten times what the firmware documents of MC_REF_W_N: a model as fast as this is none.
_FASTEST_RAD_S: Final = 2000.0
_CASCADE: Final = ("MPC_XY_P", "MPC_XY_VEL_P_ACC", "MPC_XY_VEL_I_ACC", "MPC_XY_VEL_D_ACC")
_SLOPE_HZ: Final = "MPC_VELD_LP"
_DEFAULT_SLOPE_HZ: Final = 5.0


def position_rows(topics: Mapping[TopicKey, TopicTable]) -> tuple[PositionRows, ...]:
    """Return what the log holds of the horizontal position controllers.

    On the rows of vehicle_local_position_setpoint, with the states interpolated between theirs; what is fed
    forward is trajectory_setpoint's, held, and NaN where that is too old.
    """
    setpoint, state = topics.get((_SETPOINT, 0)), topics.get((_STATE, 0))
    if setpoint is None or state is None:
        return ()
    time_s, state_s = sample_time_s(setpoint), sample_time_s(state)
    if time_s is None or state_s is None or len(state_s) < 2:
        return ()
    rows = Rows(time_s, setpoint.position)
    return tuple(
        PositionRows(direction=direction, rows=rows, values=values)
        for direction, label, number in _DIRECTIONS
        if (values := _values(topics, (time_s, state_s), label, number))
    )


def _values(
    topics: Mapping[TopicKey, TopicTable], times_s: tuple[FloatArray, FloatArray], label: str, number: int
) -> dict[str, FloatArray]:
    """Return one direction's values; empty where a field is missing."""
    time_s, state_s = times_s
    setpoint, state = topics[_SETPOINT, 0], topics[_STATE, 0]
    targets = stacked(setpoint, (label, f"v{label}"))
    acceleration = _acceleration(setpoint, label, number)
    states = stacked(state, (label, f"v{label}"))
    if targets is None or states is None or targets.shape[1] != 2 or states.shape[1] != 2:
        return {}
    order = np.argsort(state_s, kind="stable")
    now = [np.interp(time_s, state_s[order], each[order]) for each in states.T]
    values = {
        "position_target": targets[:, 0],
        "velocity_target": targets[:, 1],
        "position": now[0],
        "velocity": now[1],
    }
    if acceleration is not None:
        values["acceleration_target"] = acceleration
    return values | _forwards(topics.get((_TRAJECTORY, 0)), time_s, label, number)


def _acceleration(table: TopicTable, label: str, number: int) -> FloatArray | None:
    """Return accelerations: an array since 1.9, single fields before."""
    for field in ("acceleration", f"acc_{label}"):
        found = stacked(table, (field,))
        if found is not None and found.shape[1] in (1, 3):
            return found[:, number if found.shape[1] == 3 else 0]
    return None


def _forwards(table: TopicTable | None, time_s: FloatArray, label: str, number: int) -> dict[str, FloatArray]:
    """Return velocity and acceleration that are fed forward, held; a NaN set-point feeds nothing."""
    made_s = None if table is None else sample_time_s(table)
    if table is None or made_s is None or not len(made_s):
        return {}
    arrays = stacked(table, ("velocity",))
    velocity = stacked(table, (f"v{label}",)) if arrays is None else arrays[:, number : number + 1]
    acceleration = _acceleration(table, label, number)
    if velocity is None or acceleration is None or velocity.shape[1] != 1:
        return {}
    place, row = last_before(made_s, time_s)
    old = (place < 0) | ~(time_s - made_s[row] <= _OLDEST_S)
    named = (("velocity_forward", velocity[:, 0]), ("acceleration_forward", acceleration))
    return {name: np.where(old, np.nan, np.nan_to_num(each[row], nan=0.0)) for name, each in named}


def outer_controllers(parameters: Mapping[str, float]) -> OuterControllers:
    """Return the controllers around the rate loop that the parameters make.

    Notes
    -----
    The vertical controller is left out: the estimator of the hover thrust moves its integral. Firmware with
    MC_REF_W_N follows the set-point by a critically damped model of second order, and holds the
    attitude against that one; without MC_REF_FF later builds hold it against the set-point itself, which the
    rows tell.
    """
    natural = _natural_rad_s(parameters)
    names = (
        "MC_YAW_WEIGHT",
        "MC_REF_W_N",
        "MC_REF_FF",
        *(f"MC_{each}RATE_MAX" for each in ("ROLL", "PITCH", "YAW")),
    )
    return OuterControllers(
        attitude=AttitudeCommand(
            lags_s=(1.0 / natural,) * 2 if natural else (),
            not_modelled=("MC_REF_FF",) if natural and parameters.get("MC_REF_FF", 0.0) > 0.0 else (),
            gains={name: parameters[name] for name in names if name in parameters},
        ),
        horizontal=_horizontal(parameters),
    )


def _natural_rad_s(parameters: Mapping[str, float]) -> float:
    """Return the natural frequency of the reference model; 0 for none."""
    return max(finite(parameters.get("MC_REF_W_N")) or 0.0, 0.0)


def _horizontal(parameters: Mapping[str, float]) -> CascadeController | None:
    """Return position and velocity controller; None where a gain is missing or of velocities none is set."""
    values = [finite(parameters.get(name)) for name in _CASCADE]
    if any(value is None or value < 0.0 for value in values) or not values[1]:
        return None
    position, proportional, integral, slope = (float(value or 0.0) for value in values)
    slope_hz = finite(parameters.get(_SLOPE_HZ, _DEFAULT_SLOPE_HZ))
    gains = dict(zip(_CASCADE, (position, proportional, integral, slope), strict=True))
    return CascadeController(
        position_per_s=position,
        proportional_per_s=proportional,
        integral_per_s2=integral,
        derivative=slope,
        error_hz=0.0,
        derivative_hz=_DEFAULT_SLOPE_HZ if slope_hz is None else slope_hz,
        slope_of_error=False,
        period_s=_POSITION_PERIOD_S,
        gains=gains,
    )


def attitude_rows(
    log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[Interval]
) -> AttitudeRows | None:
    """Replay the attitude controller on rate set-points; see `Autopilot.attitude_rows`.

    None where their attitude and its set-point were logged too seldom.

    Notes
    -----
    `AttitudeControl::update`: twice the vector part of the error's quaternion times MC_*_P, the error being
    that of the thrust's direction followed by MC_YAW_WEIGHT times that of the heading; the yaw gain is
    divided by the weight. The rate about the vertical that the set-point asks for is added, and MC_*RATE_MAX
    limit the sum.
    """
    gains = [finite(parameters.get(f"MC_{name}_P")) for name, _ in AXIS_NAMES.values()]
    signals = [
        next(iter(log.candidates(name)), None)
        for name in ("attitude", "attitude_setpoint", "body_rate_setpoint")
    ]
    attitude, wanted, rate = signals
    if attitude is None or wanted is None or rate is None or None in gains:
        return None
    if min(each.n_samples for each in (attitude, wanted, rate)) < FEWEST_ROWS:
        return None
    usable = within(rate.time_s, intervals) & possible(rate.values) & (rate.values != 0.0).any(axis=1)
    now, fresh = _latest(attitude, rate.time_s, _SAME_LOOP_S)
    for oldest_s in (_SAME_LOOP_S, _LOOP_BEFORE_S):
        asked, current = _latest(wanted, rate.time_s, oldest_s)
        chosen = np.flatnonzero(usable & fresh & current)[:_MOST_ROWS]
        if chosen.size >= FEWEST_ROWS:
            break
    else:
        return None
    body = quaternion_from_euler(attitude.values[now[chosen]])
    rows = AttitudeRows(
        time_s=rate.time_s[chosen],
        from_error=np.zeros((chosen.size, 3)),
        forward=rotation_matrix(body)[:, 2, :] * _yaw_rate(log, rate.time_s[chosen])[:, np.newaxis],
        logged=rate.values[chosen],
    )
    targets: dict[tuple[float, ...], FloatArray] = {(): quaternion_from_euler(wanted.values[asked[chosen]])}
    natural = min(_natural_rad_s(parameters), _FASTEST_RAD_S)
    if natural:
        # The attitude that the reference model had at each row of the attitude.
        _, latest = last_before(wanted.time_s, attitude.time_s)
        target = quaternion_from_euler(np.nan_to_num(wanted.values[np.maximum(latest, 0)]))
        modelled = followed(target, _yaw_rate(log, attitude.time_s), attitude.time_s, natural)
        targets[(1.0 / natural,) * 2] = modelled[now[chosen]]
    some = [float(gain or 0.0) for gain in gains]
    made = {
        lags_s: _from_error(multiply_quaternions(conjugate(body), target), some, parameters)
        for lags_s, target in targets.items()
    }
    lags_s = min(
        made, key=lambda one: float(np.median(np.abs(made[one] + rows.forward - rows.logged)[:, :2]))
    )
    if len(made) == 1:
        return replace(rows, from_error=made[lags_s])
    # Of yaw the model leaves a sixth, and nobody knows why.
    return replace(rows, from_error=made[lags_s], lags_s=lags_s, not_judged=("yaw",) if lags_s else ())


def _latest(signal: Signal, time_s: FloatArray, oldest_s: float) -> tuple[IntArray, BoolArray]:
    """Return the row before each time, and whether it is new enough and holds numbers."""
    place, row = last_before(signal.time_s, time_s)
    age_s = time_s - signal.time_s[row]
    fresh = (place >= 0) & (age_s <= oldest_s) & possible(signal.values)[row]
    return row, np.asarray(fresh, dtype=np.bool_)


def _from_error(error: FloatArray, gains: Sequence[float], parameters: Mapping[str, float]) -> FloatArray:
    """Return the rates that are made of attitude errors, unit quaternions of shape (n, 4)."""
    weight = finite(parameters.get("MC_YAW_WEIGHT"))
    weight = 1.0 if weight is None else min(max(weight, 0.0), 1.0)
    tilt, heading = tilt_and_heading(error)
    turned = np.zeros_like(error)
    turned[:, 0], turned[:, 3] = np.cos(0.5 * weight * heading), np.sin(0.5 * weight * heading)
    whole = multiply_quaternions(tilt, turned)
    vector = 2.0 * whole[:, 1:] * np.where(whole[:, :1] < 0.0, -1.0, 1.0)
    roll, pitch, yaw = gains
    return np.asarray(vector * np.array([roll, pitch, yaw / weight if weight > _LEAST_WEIGHT else yaw]))


def _yaw_rate(log: FlightLog, time_s: FloatArray) -> FloatArray:
    """Return the rate about the vertical that the set-point commanded [rad/s]."""
    terms = next((each for each in log.controller_terms if "rate_forward" in each.values), None)
    if terms is None or not terms.rows.n_samples:
        return np.zeros(time_s.shape)
    place, row = last_before(terms.rows.time_s, time_s)
    rates = np.nan_to_num(terms.values["rate_forward"], nan=0.0, posinf=0.0, neginf=0.0)
    return np.where(place >= 0, rates[row], 0.0)
