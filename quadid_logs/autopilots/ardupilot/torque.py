"""Motor thrust from an ArduPilot log: RATE through the mixer, and RCOU backwards."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.actuation.motors import MotorSeries, Rebuilt, any_motor, on_all_axes
from quadid_logs.align.series import CleanLog, CleanSeries
from quadid_logs.arrays import BoolArray, FloatArray, IntArray, row_blocks
from quadid_logs.autopilots.ardupilot.airframe import motor_prefix
from quadid_logs.autopilots.ardupilot.mixer import (
    MotorSettings,
    Supply,
    actuator_of_pulse,
    actuator_of_thrust,
    compensation_gain,
    full_battery_thrust,
    mix,
    pulse_width,
    throttle_of_thrust,
    voltage_effective,
)
from quadid_logs.data.log import FlightLog
from quadid_logs.data.off_nominal import AS_COMMANDED, ThrustLaw
from quadid_logs.data.torque import AssumedExpo, DensityLaw, MixerCheck
from quadid_logs.maths.thrust_curve import relative_by_expo

#: A fitted gain explains the outputs better than a known one by chance: rounding leaves 0.05 us.
_HANDICAP_US = 1.0
#: The row of RATE from which a row of RCOU was mixed is at most this many periods older.
_SAME_LOOP_PERIODS = 1.5
#: Whether RATE is written before or after its loop's outputs depends on the firmware's order of tasks.
_LOOPS = (0, -1, 1)
#: Fraction of a normal distribution within one standard deviation.
_ONE_SIGMA = 0.683
#: Fewer rows prove nothing.
_FEW_ROWS = 20
#: Rows over whose median an unknown gain is taken; it moves with weather and battery, in minutes.
_GAIN_ROWS = 9
#: Below this throttle a ratio to it is all rounding.
_LEAST_THROTTLE = 0.05
#: A motor at its stop limits every axis that it serves; rounding is far below a thousandth.
_LIMITED = 1e-3
#: MOT_THST_EXPO, MOT_SPIN_MIN, MOT_SPIN_MAX (AP_Motors_Thrust_Linearization.cpp) and MOT_YAW_HEADROOM.
#: The lowest voltage that the firmware compensates for, of MOT_BAT_VOLT_MAX.
_LEAST_RATIO = 0.6
_DEFAULTS = {"MOT_THST_EXPO": 0.65, "MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95, "MOT_YAW_HEADROOM": 200.0}


def rebuild(log: CleanLog, airframe: Airframe) -> Rebuilt:
    """Rebuild motor thrusts from RATE and the mixer, and from RCOU.

    The series at loop rate first, unless its pulse widths do not fit.
    """
    settings = motor_settings(log.log.parameters)
    if settings is None:
        return Rebuilt(
            remarks=(
                "Motor thrust cannot be computed: MOT_SPIN_MIN is missing in the log, or the motor "
                "parameters make no sense (firmware before 3.4, or no parameters).",
            )
        )
    # The pulse widths in the order of the motors, None where a motor's channel is not logged.
    series = log.first("output_pwm")
    if series is None or not airframe.channels or max(airframe.channels) > series.n_columns:
        outputs = None
    else:
        outputs = replace(series, stored=series.stored[:, [channel - 1 for channel in airframe.channels]])
    vehicle = _Vehicle(log, airframe, settings, outputs)
    command = _command(log)
    law, mixed = _Law(DensityLaw.NONE), None
    if command is not None:
        law = _best_law(vehicle, command)
        mixed = _mixed(vehicle, command, law)
    check = None if mixed is None else _compare(vehicle, mixed, law)
    found = () if mixed is None or (check is not None and not check.fits) else (mixed,)
    if outputs is not None:
        # The series that RCOU tells, at RCOU's rate.
        supply = vehicle.supply(outputs.time_s, law.source)
        actuator = actuator_of_pulse(outputs.values, vehicle.settings)
        at_stop = any_motor((actuator <= 0.0) | (actuator >= 1.0))
        found = (
            *found,
            replace(
                _motor_series(vehicle, outputs, actuator, supply),
                saturated=on_all_axes(at_stop),
                source=f"{outputs.source} back through the thrust curve",
                reason="the pulse widths that the motors got, which include saturation and spin limits",
            ),
        )
    # Say what the check does not cover.
    parameters = log.log.parameters
    prefix = motor_prefix(parameters)
    slow = [
        name
        for name in (f"{prefix}MOT_SLEW_UP_TIME", f"{prefix}MOT_SLEW_DN_TIME")
        if parameters.get(name, 0.0) > 0.0
    ]
    remarks = [f"{' and '.join(slow)} slow the motors down, which is not modelled."] if slow else []
    if check is not None and check.law is DensityLaw.FITTED:
        remarks.append(
            "This firmware does not log its gain for thin air, so the gain was fitted to the pulse widths."
        )
    return Rebuilt(
        series=found,
        check=check,
        remarks=tuple(remarks),
        expo=AssumedExpo(value=settings.expo, parameter=f"{motor_prefix(log.log.parameters)}MOT_THST_EXPO"),
        output_range_us=settings.output_range_us(airframe.n_rotors),
    )


def motor_settings(known: Mapping[str, float]) -> MotorSettings | None:
    """Return the motor parameters; None where the log has none of them or they make no sense.

    MOT_PWM_MIN and MOT_PWM_MAX of 0 mean the throttle stick's range
    (AP_MotorsMulticopter.cpp, `get_pwm_output_min`).
    """
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


@dataclass(frozen=True, slots=True, eq=False)
class _Vehicle:
    """What stays the same in every attempt to mix."""

    log: CleanLog
    airframe: Airframe
    settings: MotorSettings
    outputs: CleanSeries | None

    def supply(self, time_s: FloatArray, density: CleanSeries | None) -> Supply:
        """Return battery, air and throttle limits at times [s]."""
        lift_max = self.log.at("lift_max", time_s, missing=1.0)
        ratio = np.ones(time_s.shape) if density is None else density.at(time_s)
        return Supply(
            lift_max=lift_max,
            voltage_ratio=self.log.at("battery_ratio", time_s, missing=1.0),
            gain=compensation_gain(lift_max, ratio),
            throttle_limit=self.log.at("throttle_limit", time_s, missing=1.0),
            throttle_average_max=self.log.at("throttle_average_max", time_s, missing=0.0),
        )

    def air(self, time_s: FloatArray) -> FloatArray:
        """Return the density ratio that thrust itself follows, 1 where it is not logged; as a column."""
        air = self.log.at("air_density_ratio", time_s, missing=1.0)
        return np.where((air > 0.3) & (air < 1.5), air, 1.0)[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class _Command:
    """Torque command of the rate loop, and the throttle at the same times (n_samples,)."""

    series: CleanSeries
    throttle: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Law:
    """An air density that the compensation may have used."""

    kind: DensityLaw
    source: CleanSeries | None = None

    @property
    def name(self) -> str:
        """For people."""
        if self.source is not None:
            return self.source.source
        return "fitted to the pulse widths" if self.kind is DensityLaw.FITTED else "none"


def _command(log: CleanLog) -> _Command | None:
    """Return the loop's torque command with the throttle of the same message."""
    for command in log.sources("torque_command"):
        for throttle in log.sources("throttle"):
            if throttle.rows is command.rows and not command.achieved:
                return _Command(command, throttle.at(command.time_s))
    return None


def _best_law(vehicle: _Vehicle, command: _Command) -> _Law:
    """Return the density law whose pulse widths fit best, tried on the rows around those of RCOU."""
    laws = [_Law(DensityLaw.LOGGED, source) for source in vehicle.log.sources("air_density_ratio")]
    laws.append(_Law(DensityLaw.NONE))
    if vehicle.outputs is None:
        return laws[0]
    laws.append(_Law(DensityLaw.FITTED))
    row, _ = _same_loop(command.series, vehicle.outputs)
    near = np.unique(np.clip(row[:, None] + np.array(_LOOPS), 0, command.series.n_samples - 1))
    few = _Command(command.series.take(near), command.throttle[near])
    return min(laws, key=lambda law: _misfit(_compare(vehicle, _mixed(vehicle, few, law), law)))


def _mixed(vehicle: _Vehicle, command: _Command, law: _Law) -> MotorSeries:
    """Return what the motors made of the mixer's output under one density law."""
    series, settings, factors = command.series, vehicle.settings, vehicle.airframe.factors
    supply = vehicle.supply(series.time_s, law.source)
    if law.kind is DensityLaw.FITTED:
        supply = replace(supply, gain=_fitted_gain(vehicle, command, supply))
    actuator = np.empty((series.n_samples, len(factors)))
    limited = np.empty((series.n_samples, 3), np.bool_)
    for rows in row_blocks(series.n_samples):
        part = supply.rows(rows)
        output = mix(series.values[rows], command.throttle[rows], factors, part, settings.yaw_headroom)
        actuator[rows], limited[rows] = actuator_of_thrust(output.thrust, part, settings), output.limited
    mixed = _motor_series(vehicle, series, actuator, supply)
    limited |= np.abs(mixed.command - series.values) > _LIMITED
    return replace(
        mixed,
        saturated=limited,
        flown=vehicle.log.flown(series.time_s, command.throttle),
        source=f"{series.source} through the mixer",
        reason=(
            "the part of the rate controller's output that the motors could give, with yaw headroom, "
            "scaling, motor limits, battery and air density as the firmware computes them"
        ),
    )


def _motor_series(vehicle: _Vehicle, base: CleanSeries, actuator: FloatArray, supply: Supply) -> MotorSeries:
    """Return what motor commands (n_samples, n_rotors) mean at a supply."""
    thrust, command_thrust, by_expo = (np.empty_like(actuator) for _ in range(3))
    available = np.empty(len(actuator))
    for rows in row_blocks(len(actuator)):
        part, driven = supply.rows(rows), actuator[rows]
        full = full_battery_thrust(driven, part, vehicle.settings)
        each = full / np.where(part.lift_max > 0.0, part.lift_max, 1.0)[:, None]
        available[rows] = each.mean(axis=1)
        command_thrust[rows] = each / part.gain[:, None]
        thrust[rows] = full * vehicle.air(base.time_s[rows])
        by_expo[rows] = relative_by_expo(voltage_effective(driven, part), vehicle.settings.expo)
    return MotorSeries(
        base=base,
        thrust=thrust,
        command_thrust=command_thrust,
        actuator=actuator,
        command=command_thrust @ vehicle.airframe.command_per_thrust.T,
        saturated=None,
        flown=vehicle.log.flown(base.time_s, available),
        source=base.source,
        reason=base.reason,
        achieved=True,
        by_expo=by_expo,
    )


def _fitted_gain(vehicle: _Vehicle, command: _Command, supply: Supply) -> FloatArray:
    """Return the compensation gain that the mean thrust of all motors tells; shape of the command's rows.

    Of use where the firmware's density is not logged: it was cached until
    the altitude changed by 25 m (AP_Baro.cpp before 4.7).
    """
    outputs = vehicle.outputs
    if outputs is None:
        return supply.gain
    row, same = _same_loop(command.series, outputs)
    at_outputs = vehicle.supply(outputs.time_s, None)
    actuator = actuator_of_pulse(outputs.values, vehicle.settings)
    available = _motor_series(vehicle, outputs, actuator, at_outputs).command_thrust
    available = available * at_outputs.gain[:, None]
    flown = vehicle.log.flown(command.series.time_s, command.throttle)
    usable = same & flown[row] & (command.throttle[row] > _LEAST_THROTTLE)
    if np.count_nonzero(usable) < _FEW_ROWS:
        return supply.gain
    ratio = available.mean(axis=1)[usable] / command.throttle[row[usable]]
    padded = np.pad(ratio, _GAIN_ROWS // 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, _GAIN_ROWS), axis=1)
    gain = np.interp(command.series.time_s, outputs.time_s[usable], smooth)
    return np.asarray(gain, dtype=np.float64)


def _same_loop(rate: CleanSeries, outputs: CleanSeries) -> tuple[IntArray, BoolArray]:
    """Return the row of RATE before each row of RCOU, and whether it is of the same loop."""
    row = rate.last_before(outputs.time_s)
    inside = np.maximum(row, 0)
    age = np.abs(outputs.time_s - rate.time_s[inside])
    return inside, (row >= 0) & (age <= _SAME_LOOP_PERIODS * rate.period_s)


def _compare(vehicle: _Vehicle, mixed: MotorSeries, law: _Law) -> MixerCheck | None:
    """Compare recomputed with logged pulse widths on flown rows that nothing limits."""
    if vehicle.outputs is None:
        return None
    before, same = _same_loop(mixed.base, vehicle.outputs)
    best = None
    # With the command of the same loop, or of a neighbouring one.
    for loop in _LOOPS:
        row = np.clip(before + loop, 0, mixed.base.n_samples - 1)
        free = np.zeros(row.shape, np.bool_) if mixed.saturated is None else ~mixed.saturated[row].any(axis=1)
        usable = same & free & mixed.flown[row]
        error = pulse_width(mixed.actuator[row[usable]], vehicle.settings) - vehicle.outputs.values[usable]
        if len(error) < _FEW_ROWS or not np.isfinite(error).all():
            continue
        check = MixerCheck(
            n_samples=len(error),
            mean_us=float(error.mean()),
            std_us=float(error.std()),
            largest_us=float(np.abs(error).max()),
            typical_us=float(np.quantile(np.abs(error), _ONE_SIGMA)),
            density=law.name,
            law=law.kind,
        )
        if _misfit(check) < _misfit(best):
            best = check
    return best


def _misfit(check: MixerCheck | None) -> float:
    """Return what to minimise over density laws; a fitted gain must be clearly better than a known one."""
    if check is None:
        return math.inf
    return check.typical_us + (_HANDICAP_US if check.law is DensityLaw.FITTED else 0.0)


def thrust_law(log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:
    """Return what ArduPilot makes of a command of thrust; see `Autopilot.thrust_law`.

    MOT_THST_EXPO undoes the curve. Between MOT_BAT_VOLT_MIN and MOT_BAT_VOLT_MAX outputs are divided by the
    battery's resting voltage over the latter, and commands by the density of the air
    (AP_Motors_Thrust_Linearization.cpp).
    """
    prefix, settings = motor_prefix(parameters), motor_settings(parameters)
    highest_v = parameters.get(f"{prefix}MOT_BAT_VOLT_MAX", 0.0)
    lowest_v = parameters.get(f"{prefix}MOT_BAT_VOLT_MIN", 0.0)

    def output(command: FloatArray) -> FloatArray:
        return command if settings is None else throttle_of_thrust(command, settings)

    def behind(voltage_v: float, n_cells: int) -> float:
        if not (highest_v > 0.0 and lowest_v < highest_v and voltage_v >= 0.25 * lowest_v):
            return 1.0
        least = max(lowest_v / highest_v, _LEAST_RATIO)
        return float(1.0 / np.clip(voltage_v / highest_v, least, 1.0))

    return AS_COMMANDED._replace(output=output, behind=behind, for_density=True)
