"""Motor thrust from a PX4 log: actuator_motors, the set-point through the allocation, the outputs.

Sources: src/modules/control_allocator (ControlAllocationPseudoInverse.cpp,
ActuatorEffectivenessRotors.cpp) and src/lib/mixer_module/functions/FunctionMotors.hpp.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries, Rebuilt, any_motor, on_all_axes
from quadid_logs.align.series import CleanLog, CleanSeries
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.log import FlightLog
from quadid_logs.data.off_nominal import AS_COMMANDED, ThrustLaw
from quadid_logs.data.torque import AssumedExpo
from quadid_logs.maths.thrust_curve import relative_by_expo

#: Single precision of the allocation is 1e-7; a thousandth of full command is a limit at work.
_LIMITED = 1e-3
#: actuator_motors carries the time of the set-point that it was made from.
_SAME_SAMPLE_S = 1e-4
#: Channels that rest at an end of their range for most of a flight are not the motors'.
_OFTEN = 0.5
#: src/lib/mixer_module/output_functions.yaml: Motor 1 is 101.
_FIRST_MOTOR_FUNCTION = 101
_N_OUTPUTS = 16
#: MC_BAT_SCALE_EN scales by 30 % at most; BAT1_V_CHARGED where the log does not hold it [V].
_MOST_SCALE = 1.3
_CHARGED_V = 4.05


def rebuild(log: CleanLog, airframe: Airframe) -> Rebuilt:
    """Rebuild motor thrusts from every source that the log holds.

    What was achieved first, then the set-point as if nothing were limited, then the outputs.
    """
    found = (_from_motors(log, airframe), _from_setpoint(log, airframe), _from_outputs(log, airframe))
    factor = _thrust_model(log)
    ranges = (
        _pulse_ranges(log.log.parameters, airframe, series.n_columns) for series in log.sources("output_pwm")
    )
    known = next((each for each in ranges if each is not None), None)
    return Rebuilt(
        series=tuple(
            replace(series, by_expo=relative_by_expo(series.actuator, factor))
            for series in found
            if series is not None
        ),
        expo=AssumedExpo(value=factor, parameter="THR_MDL_FAC"),
        output_range_us=None if known is None else known[1:],
    )


def _thrust_model(log: CleanLog) -> float:
    """Return THR_MDL_FAC, 0 where it is not logged."""
    factor = log.log.parameters.get("THR_MDL_FAC", 0.0)
    return factor if 0.0 <= factor <= 1.0 else 0.0


def output_of_thrust(thrust: FloatArray, factor: float) -> FloatArray:
    """Return the output x that solves f x^2 + (1 - f) x = thrust (FunctionMotors.hpp); same shape.

    Parameters
    ----------
    thrust : ndarray
        Fraction of full thrust [1].
    factor : float
        THR_MDL_FAC, f.
    """
    thrust = np.clip(thrust, 0.0, 1.0)
    if factor <= 0.0:
        return thrust
    rest = 1.0 - factor
    return np.asarray((-rest + np.sqrt(rest**2 + 4.0 * factor * thrust)) / (2.0 * factor), dtype=np.float64)


def _from_motors(log: CleanLog, airframe: Airframe) -> MotorSeries | None:
    """Take actuator_motors: allocated thrust, before THR_MDL_FAC; NaN is a stopped motor."""
    series = log.first("motor_thrust")
    if series is None or series.n_columns < airframe.n_rotors:
        return None
    # A stopped motor gives no thrust, but a row of NaN only says nothing.
    known = np.isfinite(series.values[:, : airframe.n_rotors]).any(axis=1)
    thrust = np.nan_to_num(series.values[:, : airframe.n_rotors])
    thrust[~known] = np.nan
    command = thrust @ airframe.command_per_thrust.T
    return MotorSeries(
        base=series,
        thrust=thrust,
        command_thrust=thrust,
        actuator=output_of_thrust(thrust, _thrust_model(log)),
        command=command,
        saturated=_limited(log, series, thrust, command),
        flown=log.flown(series.time_s, np.nan_to_num(thrust).mean(axis=1)) & known,
        source=f"{series.source} through CA_ROTOR*",
        reason="the thrust that the allocation gave each motor, which includes saturation",
        achieved=True,
    )


def _limited(log: CleanLog, series: CleanSeries, thrust: FloatArray, command: FloatArray) -> BoolArray:
    """Mark the axes that got less than the sample's set-point; without one, rows with a motor at a stop."""
    limited = on_all_axes(any_motor((thrust <= 0.0) | (thrust >= 1.0)))
    setpoint = log.first("torque_command")
    if setpoint is None:
        return limited
    last = setpoint.n_samples - 1
    after = np.clip(np.searchsorted(setpoint.time_s, series.time_s), min(1, last), last)
    before = np.maximum(after - 1, 0)
    closer = np.abs(setpoint.time_s[before] - series.time_s) < np.abs(setpoint.time_s[after] - series.time_s)
    row = np.where(closer, before, after)
    same = np.abs(setpoint.time_s[row] - series.time_s) < _SAME_SAMPLE_S
    limited[same] = np.abs(command - setpoint.values[row])[same] > _LIMITED
    return limited


def _from_setpoint(log: CleanLog, airframe: Airframe) -> MotorSeries | None:
    """Take the torque set-point as the allocation would meet it without limits."""
    series = log.first("torque_command")
    throttle = log.first("throttle")
    if series is None or throttle is None or series.achieved:
        return None
    collective = throttle.at(series.time_s)
    thrust = np.column_stack([series.values, collective]) @ airframe.factors.T
    limited = on_all_axes(any_motor((thrust < 0.0) | (thrust > 1.0)))
    unallocated = log.first("unallocated_torque")
    if unallocated is not None:
        for axis in range(3):
            size = np.interp(series.time_s, unallocated.time_s, np.abs(unallocated.values[:, axis]))
            limited[:, axis] |= size > _LIMITED
    return MotorSeries(
        base=series,
        thrust=thrust,
        command_thrust=thrust,
        actuator=output_of_thrust(thrust, _thrust_model(log)),
        command=series.values,
        saturated=limited,
        flown=log.flown(series.time_s, collective),
        source=series.source,
        reason=f"{series.reason}; without saturation",
        achieved=False,
    )


def _from_outputs(log: CleanLog, airframe: Airframe) -> MotorSeries | None:
    """Take actuator_outputs back through pulse range and thrust model."""
    factor = _thrust_model(log)
    for series in log.sources("output_pwm"):
        ranges = _pulse_ranges(log.log.parameters, airframe, series.n_columns)
        if ranges is None:
            continue
        channel, low, high = ranges
        actuator = np.clip((series.values[:, channel] - low) / (high - low), 0.0, 1.0)
        thrust = factor * actuator**2 + (1.0 - factor) * actuator
        at_stop = any_motor((actuator <= 0.0) | (actuator >= 1.0))
        up = log.flown(series.time_s, thrust.mean(axis=1))
        if not actuator.any() or not up.any() or np.mean(at_stop[up]) > _OFTEN:
            continue
        return MotorSeries(
            base=series,
            thrust=thrust,
            command_thrust=thrust,
            actuator=actuator,
            command=thrust @ airframe.command_per_thrust.T,
            saturated=on_all_axes(at_stop),
            flown=up,
            source=f"{series.source} back through THR_MDL_FAC",
            reason="the outputs as sent, which include saturation",
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


def thrust_law(log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:
    """Return what PX4 makes of a command of thrust; see `Autopilot.thrust_law`.

    THR_MDL_FAC undoes the curve. With MC_BAT_SCALE_EN the set-points of torque and thrust are multiplied by
    the charged cell's voltage over that of the cell now, before the allocation. Nothing makes up for thin
    air (MulticopterRateControl.cpp, `Battery::computeScale`).
    """
    factor = float(np.clip(parameters.get("THR_MDL_FAC", 0.0), 0.0, 1.0))
    charged_v = parameters.get("BAT1_V_CHARGED", _CHARGED_V)

    def output(command: FloatArray) -> FloatArray:
        return output_of_thrust(command, factor)

    def before(voltage_v: float, n_cells: int) -> float:
        cells = int(parameters.get("BAT1_N_CELLS", 0.0)) or n_cells
        if not (parameters.get("MC_BAT_SCALE_EN", 0.0) > 0.0 and voltage_v > 0.0 and cells > 0):
            return 1.0
        return float(np.clip(charged_v * cells / voltage_v, 1.0, _MOST_SCALE))

    return AS_COMMANDED._replace(output=output, before=before)
