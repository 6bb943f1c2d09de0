"""Motor thrust from a PX4 log: actuator_motors, the set-point through the allocation, the outputs.

Sources: src/modules/control_allocator (ControlAllocationPseudoInverse.cpp,
ActuatorEffectivenessRotors.cpp) and src/lib/mixer_module/functions/FunctionMotors.hpp.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries, any_motor, on_all_axes
from quadid_logs.actuation.slow import at_rows, first, flown
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.ardupilot.mixer import torque_of_thrust
from quadid_logs.data.log import FlightLog, Signal

#: Single precision of the allocation is 1e-7; a thousandth of full command is a limit at work.
_LIMITED = 1e-3
#: actuator_motors carries the time of the set-point that it was made from.
_SAME_SAMPLE_S = 1e-4
#: Channels that rest at an end of their range for most of a flight are not the motors'.
_OFTEN = 0.5
#: src/lib/mixer_module/output_functions.yaml: Motor 1 is 101.
_FIRST_MOTOR_FUNCTION = 101
_N_OUTPUTS = 16


def rebuild(log: FlightLog, airframe: Airframe) -> tuple[MotorSeries, ...]:
    """Rebuild motor thrusts from every source that the log holds.

    Parameters
    ----------
    log : FlightLog
    airframe : Airframe

    Returns
    -------
    tuple of MotorSeries
        What was achieved first, then the set-point as if nothing were limited, then the outputs.
    """
    found = (_from_motors(log, airframe), _from_setpoint(log, airframe), _from_outputs(log, airframe))
    return tuple(series for series in found if series is not None)


def _thrust_model(log: FlightLog) -> float:
    """Return THR_MDL_FAC, 0 where it is not logged."""
    factor = log.parameters.get("THR_MDL_FAC", 0.0)
    return factor if 0.0 <= factor <= 1.0 else 0.0


def output_of_thrust(thrust: FloatArray, factor: float) -> FloatArray:
    """Return the output x that solves f x^2 + (1 - f) x = thrust (FunctionMotors.hpp); same shape."""
    thrust = np.clip(thrust, 0.0, 1.0)
    if factor <= 0.0:
        return thrust
    rest = 1.0 - factor
    return np.asarray((-rest + np.sqrt(rest**2 + 4.0 * factor * thrust)) / (2.0 * factor), dtype=np.float64)


def _from_motors(log: FlightLog, airframe: Airframe) -> MotorSeries | None:
    """Take actuator_motors: allocated thrust, before THR_MDL_FAC; NaN is a stopped motor."""
    signal = first(log, "motor_thrust")
    if signal is None or signal.values.shape[1] < airframe.n_rotors:
        return None
    # A stopped motor gives no thrust, but a row of NaN only says nothing.
    known = np.isfinite(signal.values[:, : airframe.n_rotors]).any(axis=1)
    thrust = np.nan_to_num(signal.values[:, : airframe.n_rotors])
    thrust[~known] = np.nan
    command = torque_of_thrust(thrust, airframe.factors, np.ones(len(thrust)))
    return MotorSeries(
        time_s=signal.time_s,
        position=signal.position,
        thrust=thrust,
        actuator=output_of_thrust(thrust, _thrust_model(log)),
        command=command,
        saturated=_limited(log, signal, thrust, command),
        flown=flown(log, signal.position, np.nan_to_num(thrust).mean(axis=1)) & known,
        source=f"{signal.source} through CA_ROTOR*",
        reason="the thrust that the allocation gave each motor: saturation is in it",
        achieved=True,
    )


def _limited(log: FlightLog, signal: Signal, thrust: FloatArray, command: FloatArray) -> BoolArray:
    """Mark the axes that got less than the sample's set-point; without one, rows with a motor at a stop."""
    at_stop = any_motor((thrust <= 0.0) | (thrust >= 1.0))
    limited = on_all_axes(at_stop)
    setpoint = first(log, "torque_command")
    if setpoint is None or not setpoint.n_samples:
        return limited
    order = np.argsort(setpoint.time_s, kind="stable")
    after = np.clip(np.searchsorted(setpoint.time_s[order], signal.time_s), 1, max(len(order) - 1, 1))
    row = order[np.minimum(after, len(order) - 1)]
    before = order[after - 1]
    closer = np.abs(setpoint.time_s[before] - signal.time_s) < np.abs(setpoint.time_s[row] - signal.time_s)
    row = np.where(closer, before, row)
    same = np.abs(setpoint.time_s[row] - signal.time_s) < _SAME_SAMPLE_S
    limited[same] = np.abs(command - setpoint.values[row])[same] > _LIMITED
    return limited


def _from_setpoint(log: FlightLog, airframe: Airframe) -> MotorSeries | None:
    """Take the torque set-point as the allocation would meet it without limits."""
    signal = first(log, "torque_command")
    throttle = first(log, "throttle")
    if signal is None or throttle is None or signal.achieved:
        return None
    collective = at_rows(throttle, signal.position, missing=math.nan)
    thrust = np.column_stack([signal.values, collective]) @ airframe.factors.T
    unallocated = first(log, "unallocated_torque")
    limited = on_all_axes(any_motor((thrust < 0.0) | (thrust > 1.0)))
    if unallocated is not None:
        for axis in range(3):
            column = Signal(
                name="lift_max",
                rows=unallocated.rows,
                values=np.abs(unallocated.values[:, axis : axis + 1]),
                source=unallocated.source,
            )
            limited[:, axis] |= at_rows(column, signal.position, missing=0.0) > _LIMITED
    return MotorSeries(
        time_s=signal.time_s,
        position=signal.position,
        thrust=thrust,
        actuator=output_of_thrust(thrust, _thrust_model(log)),
        command=signal.values,
        saturated=limited,
        flown=flown(log, signal.position, collective),
        source=signal.source,
        reason=f"{signal.reason}; saturation is not in it",
        achieved=False,
    )


def _from_outputs(log: FlightLog, airframe: Airframe) -> MotorSeries | None:
    """Take actuator_outputs back through pulse range and thrust model."""
    for signal in log.candidates("output_pwm"):
        ranges = _pulse_ranges(log.parameters, airframe, signal.values.shape[1])
        if ranges is None:
            continue
        channel, low, high = ranges
        actuator = np.clip((signal.values[:, channel] - low) / (high - low), 0.0, 1.0)
        if not actuator.any():
            continue
        factor = _thrust_model(log)
        thrust = factor * actuator**2 + (1.0 - factor) * actuator
        at_stop = any_motor((actuator <= 0.0) | (actuator >= 1.0))
        up = flown(log, signal.position, thrust.mean(axis=1))
        if not up.any() or np.mean(at_stop[up]) > _OFTEN:
            continue
        return MotorSeries(
            time_s=signal.time_s,
            position=signal.position,
            thrust=thrust,
            actuator=actuator,
            command=torque_of_thrust(thrust, airframe.factors, np.ones(len(thrust))),
            saturated=on_all_axes(at_stop),
            flown=up,
            source=f"{signal.source} back through THR_MDL_FAC",
            reason="what the outputs sent: saturation is in it",
            achieved=True,
        )
    return None


def _pulse_ranges(
    parameters: Mapping[str, float], airframe: Airframe, n_channels: int
) -> tuple[list[int], FloatArray, FloatArray] | None:
    """Return channel index, lowest and highest pulse width of each motor; None where one is not known."""
    for prefix in ("PWM_MAIN", "PWM_AUX"):
        function = {
            round(parameters[f"{prefix}_FUNC{n}"]): n
            for n in range(_N_OUTPUTS, 0, -1)
            if math.isfinite(parameters.get(f"{prefix}_FUNC{n}", math.nan))
        }
        motors = range(_FIRST_MOTOR_FUNCTION, _FIRST_MOTOR_FUNCTION + airframe.n_rotors)
        if all(motor in function for motor in motors):
            channels = [function[motor] for motor in motors]
        elif not function and airframe.channels:
            channels = list(airframe.channels)
        else:
            continue
        limits = [tuple(_limits(parameters, prefix, channel)) for channel in channels]
        if max(channels) <= n_channels and all(high > low > 0.0 for low, high in limits):
            low, high = np.array(limits).T
            return [channel - 1 for channel in channels], low, high
    return None


def _limits(parameters: Mapping[str, float], prefix: str, channel: int) -> Iterator[float]:
    """Yield lowest and highest pulse width of a channel: its own, the port's, or the old common one."""
    for end in ("MIN", "MAX"):
        values = (
            parameters.get(name, math.nan)
            for name in (f"{prefix}_{end}{channel}", f"{prefix}_{end}", f"PWM_{end}")
        )
        yield next((value for value in values if value > 0.0), math.nan)
