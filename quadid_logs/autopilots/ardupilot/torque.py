"""Motor thrust from an ArduPilot log: RATE through the mixer, and RCOU backwards."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from quadid_logs.actuation.airframe import Airframe, motor_prefix
from quadid_logs.actuation.motors import MotorSeries, any_motor, on_all_axes
from quadid_logs.actuation.slow import at_rows, first, flown
from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.autopilots.ardupilot.mixer import (
    MixerOutput,
    MotorSettings,
    Supply,
    actuator_of_pulse,
    actuator_of_thrust,
    compensation_gain,
    full_battery_thrust,
    mix,
    pulse_width,
    torque_of_thrust,
)
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.torque import MixerCheck
from quadid_logs.maths.resampling import typical_period

#: A fitted gain explains the outputs better than a known one by chance: rounding leaves 0.05 us.
_HANDICAP_US = 1.0
#: The row of RATE from which a row of RCOU was mixed is at most this many periods older.
_SAME_LOOP_PERIODS = 1.5
#: Whether RATE is written before or after its loop's outputs depends on the firmware's order of tasks.
_LOOPS = (0, -1, 1)
#: Share of a normal distribution within one standard deviation.
_ONE_SIGMA = 0.683
#: Fewer rows prove nothing.
_FEW_ROWS = 20
#: Rows over whose median an unknown gain is taken; it moves with weather and battery, in minutes.
_GAIN_ROWS = 9
#: Below this throttle a ratio to it is all rounding.
_LEAST_THROTTLE = 0.05
#: MOT_THST_EXPO, MOT_SPIN_MIN, MOT_SPIN_MAX (AP_Motors_Thrust_Linearization.cpp) and MOT_YAW_HEADROOM.
_DEFAULTS = {"MOT_THST_EXPO": 0.65, "MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95, "MOT_YAW_HEADROOM": 200.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rebuilt:
    """The motor series that a log allows, the check of them, and what stood in the way."""

    series: tuple[MotorSeries, ...] = ()
    check: MixerCheck | None = None
    remarks: tuple[str, ...] = ()

    @property
    def trusted(self) -> bool:
        """Whether the recomputed pulse widths fit, or could not be compared."""
        return self.check is None or self.check.fits


def rebuild(log: FlightLog, airframe: Airframe) -> Rebuilt:
    """Rebuild motor thrusts from RATE and the mixer, and from RCOU.

    Parameters
    ----------
    log : FlightLog
    airframe : Airframe

    Returns
    -------
    Rebuilt
        The series at loop rate first, unless its pulse widths do not fit.
    """
    settings = motor_settings(log)
    if settings is None:
        return Rebuilt(
            remarks=(
                "No motor thrust can be rebuilt: MOT_THST_EXPO and MOT_SPIN_MIN are not in the log "
                "(firmware before 3.4, or no parameters).",
            )
        )
    outputs = _motor_pulses(log, airframe)
    rate, throttle = _commands(log)
    found: list[MotorSeries] = []
    check, density, gain_of = None, "", None
    if rate is not None and throttle is not None:
        law = _best_law(log, airframe, settings, (rate, throttle), outputs)
        best = _trial(log, airframe, settings, (rate, throttle), law)
        check = _compare(best, outputs, settings)
        density, gain_of = best.density, best.series
        found.append(best.series)
    if outputs is not None:
        found.append(_from_pulses(log, airframe, settings, outputs, density))
    rebuilt = Rebuilt(series=tuple(found), check=check, remarks=_remarks(log, check))
    if gain_of is not None and not rebuilt.trusted:
        rebuilt = replace(rebuilt, series=tuple(series for series in found if series is not gain_of))
    return rebuilt


def motor_settings(log: FlightLog) -> MotorSettings | None:
    """Return the motor parameters; None where the log has none of them or they make no sense.

    MOT_PWM_MIN and MOT_PWM_MAX of 0 mean the throttle stick's range
    (AP_MotorsMulticopter.cpp, `get_pwm_output_min`).
    """
    known = log.parameters
    prefix = motor_prefix(known)
    if f"{prefix}MOT_THST_EXPO" not in known or f"{prefix}MOT_SPIN_MIN" not in known:
        return None
    value = {name: known.get(prefix + name, default) for name, default in _DEFAULTS.items()}
    low, high = known.get(f"{prefix}MOT_PWM_MIN", 0.0), known.get(f"{prefix}MOT_PWM_MAX", 0.0)
    if not (low > 0.0 and high > low):
        stick = known.get("RCMAP_THROTTLE", 3.0)
        channel = int(stick) if 1.0 <= stick <= 16.0 else 3
        low, high = known.get(f"RC{channel}_MIN", 1100.0), known.get(f"RC{channel}_MAX", 1900.0)
    numbers = (*value.values(), low, high)
    if not (
        all(map(math.isfinite, numbers)) and high > low and value["MOT_SPIN_MAX"] > value["MOT_SPIN_MIN"]
    ):
        return None
    return MotorSettings(
        expo=value["MOT_THST_EXPO"],
        spin_min=value["MOT_SPIN_MIN"],
        spin_max=value["MOT_SPIN_MAX"],
        pwm_min_us=low,
        pwm_max_us=high,
        yaw_headroom=value["MOT_YAW_HEADROOM"] / 1000.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pulses:
    """Logged pulse widths per motor."""

    signal: Signal
    values: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Law:
    """An air density that the compensation may have used, at given rows, and its name."""

    name: str
    source: Signal | None
    gain: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Trial:
    """The mixer's output under one law."""

    density: str
    series: MotorSeries


def _commands(log: FlightLog) -> tuple[Signal | None, FloatArray | None]:
    """Return the loop-rate torque command and the throttle in the same rows."""
    for command in log.candidates("torque_command"):
        for throttle in log.candidates("throttle"):
            if np.array_equal(throttle.position, command.position) and not command.achieved:
                return command, throttle.values[:, 0]
    return None, None


def _motor_pulses(log: FlightLog, airframe: Airframe) -> _Pulses | None:
    """Return the pulse widths in the order of the motors, None where a motor's channel is not logged."""
    signal = first(log, "output_pwm")
    if signal is None or not airframe.channels or max(airframe.channels) > signal.values.shape[1]:
        return None
    return _Pulses(signal=signal, values=signal.values[:, [channel - 1 for channel in airframe.channels]])


def _density_laws(log: FlightLog, outputs: _Pulses | None) -> Iterator[_Law]:
    """Yield the density laws of the firmware's ages, and none at all."""
    for source in log.candidates("air_density_ratio"):
        yield _Law(name=source.source, source=source)
    yield _Law(name="none", source=None)
    if outputs is not None:
        yield _Law(name="fitted to the pulse widths", source=None, gain=np.zeros(0))


def _best_law(
    log: FlightLog,
    airframe: Airframe,
    settings: MotorSettings,
    commands: tuple[Signal, FloatArray],
    outputs: _Pulses | None,
) -> _Law:
    """Return the density law whose pulse widths fit best, tried on the rows around those of RCOU."""
    laws = list(_density_laws(log, outputs))
    if outputs is None:
        return laws[0]
    rate, throttle = commands
    row, _ = _matching(rate, outputs.signal)
    near = np.unique(np.clip(row[:, None] + np.array(_LOOPS), 0, rate.n_samples - 1))
    few = (
        replace(rate, rows=Rows(rate.time_s[near], rate.position[near]), values=rate.values[near]),
        throttle[near],
    )
    return min(
        laws,
        key=lambda law: _misfit(_compare(_trial(log, airframe, settings, few, law), outputs, settings)),
    )


def _trial(
    log: FlightLog,
    airframe: Airframe,
    settings: MotorSettings,
    commands: tuple[Signal, FloatArray],
    law: _Law,
) -> _Trial:
    """Run the mixer under one density law."""
    rate, throttle = commands
    supply = _supply(log, rate.position, law.source)
    if law.gain is not None:
        supply = replace(supply, gain=_fitted_gain(log, airframe, settings, commands, supply))
    output = mix(rate.values, throttle, airframe.factors, supply, settings.yaw_headroom)
    actuator = actuator_of_thrust(output.thrust, supply, settings)
    return _Trial(
        density=law.name, series=_series(log, airframe, settings, rate, throttle, supply, output, actuator)
    )


def _series(
    log: FlightLog,
    airframe: Airframe,
    settings: MotorSettings,
    rate: Signal,
    throttle: FloatArray,
    supply: Supply,
    output: MixerOutput,
    actuator: FloatArray,
) -> MotorSeries:
    """Return what the motors made of the mixer's output."""
    thrust = full_battery_thrust(actuator, supply, settings)
    share = thrust / np.where(supply.lift_max > 0.0, supply.lift_max, 1.0)[:, None]
    command = torque_of_thrust(share, airframe.factors, supply.gain)
    # A motor at its stop limits every axis that it serves; rounding is far below a thousandth.
    limited = output.limited | (np.abs(command - rate.values) > 1e-3)
    return MotorSeries(
        time_s=rate.time_s,
        position=rate.position,
        thrust=thrust * _air(log, rate.position)[:, None],
        actuator=actuator,
        command=command,
        saturated=limited,
        flown=flown(log, rate.position, throttle),
        source=f"{rate.source} through the mixer",
        reason="what the motors could give of the rate controller's output: yaw headroom, scaling, "
        "motor limits, battery and air density as the firmware computes them",
        achieved=True,
    )


def _supply(log: FlightLog, position: IntArray, density: Signal | None) -> Supply:
    """Return battery, air and throttle limits at rows of the file."""
    lift_max = at_rows(first(log, "lift_max"), position, missing=1.0)
    return Supply(
        lift_max=lift_max,
        voltage_ratio=at_rows(first(log, "battery_ratio"), position, missing=1.0),
        gain=compensation_gain(lift_max, at_rows(density, position, missing=1.0)),
        throttle_limit=at_rows(first(log, "throttle_limit"), position, missing=1.0),
        throttle_average_max=at_rows(first(log, "throttle_average_max"), position, missing=0.0),
    )


def _air(log: FlightLog, position: IntArray) -> FloatArray:
    """Return the density ratio that thrust itself follows, 1 where it is not logged; shape of `position`."""
    air = at_rows(first(log, "air_density_ratio"), position, missing=1.0)
    return np.where((air > 0.3) & (air < 1.5), air, 1.0)


def _fitted_gain(
    log: FlightLog,
    airframe: Airframe,
    settings: MotorSettings,
    commands: tuple[Signal, FloatArray],
    supply: Supply,
) -> FloatArray:
    """Return the compensation gain that the mean thrust of all motors tells; shape of the command's rows.

    Of use where the firmware's density is not logged: it was cached until
    the altitude changed by 25 m (AP_Baro.cpp before 4.7).
    """
    rate, throttle = commands
    outputs = _motor_pulses(log, airframe)
    if outputs is None:
        return supply.gain
    row, same = _matching(rate, outputs.signal)
    inverse = _inverse(log, settings, outputs)
    usable = same & flown(log, rate.position, throttle)[row] & (throttle[row] > _LEAST_THROTTLE)
    if np.count_nonzero(usable) < _FEW_ROWS:
        return supply.gain
    ratio = inverse.mean(axis=1)[usable] / throttle[row[usable]]
    padded = np.pad(ratio, _GAIN_ROWS // 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, _GAIN_ROWS), axis=1)
    place = outputs.signal.position[usable].astype(np.float64)
    return np.asarray(np.interp(rate.position.astype(np.float64), place, smooth), dtype=np.float64)


def _inverse(log: FlightLog, settings: MotorSettings, outputs: _Pulses) -> FloatArray:
    """Return the share of the available thrust per motor from pulse widths; shape (n_rows, n_rotors)."""
    supply = _supply(log, outputs.signal.position, None)
    thrust = full_battery_thrust(actuator_of_pulse(outputs.values, settings), supply, settings)
    return thrust / np.where(supply.lift_max > 0.0, supply.lift_max, 1.0)[:, None]


def _from_pulses(
    log: FlightLog, airframe: Airframe, settings: MotorSettings, outputs: _Pulses, density: str
) -> MotorSeries:
    """Return the series that RCOU tells, at RCOU's rate."""
    signal = outputs.signal
    source = next((each for each in log.candidates("air_density_ratio") if each.source == density), None)
    supply = _supply(log, signal.position, source)
    actuator = actuator_of_pulse(outputs.values, settings)
    thrust = full_battery_thrust(actuator, supply, settings)
    share = thrust / np.where(supply.lift_max > 0.0, supply.lift_max, 1.0)[:, None]
    at_stop = any_motor((actuator <= 0.0) | (actuator >= 1.0))
    return MotorSeries(
        time_s=signal.time_s,
        position=signal.position,
        thrust=thrust * _air(log, signal.position)[:, None],
        actuator=actuator,
        command=torque_of_thrust(share, airframe.factors, supply.gain),
        saturated=on_all_axes(at_stop),
        flown=flown(log, signal.position, share.mean(axis=1)),
        source=f"{signal.source} back through the thrust curve",
        reason="the pulse widths that the motors got: saturation and spin limits are in them",
        achieved=True,
    )


def _matching(rate: Signal, outputs: Signal) -> tuple[IntArray, BoolArray]:
    """Return the row of RATE before each row of RCOU, and whether it is of the same loop."""
    row = np.searchsorted(rate.position, outputs.position, side="right") - 1
    inside = np.maximum(row, 0)
    period_s = typical_period(rate.time_s)
    age = np.abs(outputs.time_s - rate.time_s[inside])
    return inside, (row >= 0) & (age <= _SAME_LOOP_PERIODS * period_s)


def _compare(trial: _Trial, outputs: _Pulses | None, settings: MotorSettings) -> MixerCheck | None:
    """Compare recomputed with logged pulse widths on flown rows that nothing limits."""
    if outputs is None:
        return None
    checks = [_compare_loop(trial, outputs, settings, loop) for loop in _LOOPS]
    return min(checks, key=_misfit)


def _compare_loop(trial: _Trial, outputs: _Pulses, settings: MotorSettings, loop: int) -> MixerCheck | None:
    """Compare with the command of the same loop, or of a neighbouring one."""
    series = trial.series
    row, same = _matching(series.as_command(), outputs.signal)
    row = np.clip(row + loop, 0, len(series.position) - 1)
    free = np.zeros(row.shape, np.bool_) if series.saturated is None else ~series.saturated[row].any(axis=1)
    usable = same & free & series.flown[row]
    error = pulse_width(series.actuator[row[usable]], settings) - outputs.values[usable]
    if len(error) < _FEW_ROWS or not np.isfinite(error).all():
        return None
    return MixerCheck(
        n_samples=len(error),
        mean_us=float(error.mean()),
        std_us=float(error.std()),
        largest_us=float(np.abs(error).max()),
        typical_us=float(np.quantile(np.abs(error), _ONE_SIGMA)),
        density=trial.density,
    )


def _misfit(check: MixerCheck | None) -> float:
    """Return what to minimise over density laws; a fitted gain must be clearly better than a known one."""
    if check is None:
        return math.inf
    handicap = _HANDICAP_US if check.density.startswith("fitted") else 0.0
    return check.typical_us + handicap


def _remarks(log: FlightLog, check: MixerCheck | None) -> tuple[str, ...]:
    """Say what the check does not cover."""
    prefix = motor_prefix(log.parameters)
    slow = [
        name
        for name in (f"{prefix}MOT_SLEW_UP_TIME", f"{prefix}MOT_SLEW_DN_TIME")
        if log.parameters.get(name, 0.0) > 0.0
    ]
    remarks = [f"{' and '.join(slow)} slow the motors down beyond what is rebuilt here."] if slow else []
    if check is not None and check.density.startswith("fitted"):
        remarks.append(
            "The gain against thin air is not logged in this firmware: fitted to the pulse widths."
        )
    return tuple(remarks)
