"""PX4's rate and attitude controllers of multirotors from parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.discrete import (
    butterworth,
    derivative,
    first_order,
    gain,
    gyro_filters,
    integrator,
    notches_named,
    unit,
)
from quadid_logs.autopilots.px4.filters import (
    cutoff_hz,
    derivative_filter,
    follows_unknown,
    notches_by_name,
    parameter_filter,
    rotor_notches,
)
from quadid_logs.autopilots.versions import by_short_names, finite, gains_named, read_version
from quadid_logs.data.controller import (
    AxisController,
    ControllerRemark,
    FilterPlace,
    FlownControllers,
    NamedFilter,
    RemarkKind,
)
from quadid_logs.data.log import FlightLog
from quadid_logs.vocabulary import AXES

#: Versions whose rate_control.cpp, MulticopterRateControl.cpp, AttitudeControl.cpp and
#: VehicleAngularVelocity.cpp were read: what is linear in them is the same, but that MC_YAW_TQ_CUTOFF came
#: with 1.16.
VERSIONS_READ: Final = ((1, 14), (1, 15), (1, 16), (1, 18))
#: As parameters name them: MC_ROLLRATE_P, MC_ROLL_P, MC_RR_INT_LIM.
AXIS_NAMES: Final = dict(zip(AXES, (("ROLL", "RR"), ("PITCH", "PR"), ("YAW", "YR")), strict=True))
_NEEDED: Final = ("P", "I", "D")
_OPTIONAL: Final = {"FF": 0.0, "K": 1.0}
#: Default of IMU_GYRO_RATEMAX; 0 is as fast as the gyro.
_DEFAULT_LOOP_HZ: Final = 400.0
#: Rows this fast are those of each loop, not thinned ones: the logger's own default is 50 Hz.
_LOOP_LIKE_HZ: Final = 200.0
#: A loop slower than the parameters' by so much waits for its gyro.
_WAITING: Final = 1.1
#: Gyros are sampled at 1 to 8 kHz, loops run at up to 800 Hz.
_FASTER: Final = 8.0
#: Two topics of one loop have the same period but for the rounding of stamps.
_SAME_PERIOD: Final = 0.02
#: Modes in which sticks, and nothing that answers position or speed, command the attitude.
_STICK_MODES: Final = frozenset({"MANUAL", "STABILIZED", "ALTCTL"})
_ANGLE_GAINS: Final = ("MC_ROLL_P", "MC_PITCH_P", "MC_YAW_P")


def angle_gains(mode: str, parameters: Mapping[str, float]) -> tuple[float, float, float] | None:
    """Return the gains from angles to rate set-points [1/s]; see `Autopilot.angle_gains`.

    Notes
    -----
    AttitudeControl.cpp, `update`: twice the vector part of the error's quaternion times MC_*_P; MC_YAW_WEIGHT
    is taken out of the yaw gain again by `setProportionalGain`.
    """
    if mode == "ACRO":
        return 0.0, 0.0, 0.0
    return gains_named(_ANGLE_GAINS, parameters) if mode in _STICK_MODES else None


def controllers(
    log: FlightLog,
    parameters: Mapping[str, float],
    *,
    period_s: float | None = None,
    axes: Sequence[str] = AXES,
) -> FlownControllers:
    """Return the controllers that the parameters make.

    Parameters
    ----------
    log : FlightLog
        Tells the firmware, and by its rows the loop's period.
    period_s : float or None
        Of the loop, where the log's rows turned out to be some of its steps only.

    Notes
    -----
    rate_control.cpp, MulticopterRateControl.cpp, AttitudeControl.cpp, VehicleAngularVelocity.cpp.
    """
    version_read, note = read_version(log.version, VERSIONS_READ)
    measured_s = logged_loop_period_s(log) if period_s is None else None
    period_s = period_s or measured_s or parameter_period_s(parameters)
    remarks = []
    if follows_unknown(parameters, log.followed):
        values = {"IMU_GYRO_DNF_EN": parameters["IMU_GYRO_DNF_EN"]}
        remarks.append(ControllerRemark(kind=RemarkKind.NOTCH_UNKNOWN, values=values))
    if (scaled := parameters.get("MC_BAT_SCALE_EN", 0.0)) > 0.0:
        values = {"MC_BAT_SCALE_EN": scaled}
        remarks.append(ControllerRemark(kind=RemarkKind.VARIABLE_GAIN, values=values))
    if measured_s is None:
        values = {"IMU_GYRO_RATEMAX": 1.0 / period_s}
        remarks.append(ControllerRemark(kind=RemarkKind.PERIOD_ASSUMED, values=values))
    # Period of the gyro's samples, at which its filters run and D's slope is taken [s].
    waits = period_s > _WAITING * parameter_period_s(parameters)
    gyro_s = period_s if waits else period_s / _FASTER
    if gyro_s != period_s:
        values = {"IMU_GYRO_RATEMAX": 1.0 / period_s, "gyro_hz": 1.0 / gyro_s}
        remarks.append(ControllerRemark(kind=RemarkKind.GYRO_RATE_ASSUMED, values=values))
    found: dict[str, AxisController] = {}
    for axis in axes:
        name = AXIS_NAMES[axis][0]
        wanted = [f"MC_{name}RATE_{short}" for short in _NEEDED]
        missing = [one for one in wanted if finite(parameters.get(one)) is None]
        if missing:
            values = dict.fromkeys(missing, math.nan)
            remarks.append(ControllerRemark(kind=RemarkKind.MISSING_PARAMETER, axis=axis, values=values))
        else:
            found[axis] = _axis(parameters, name, period_s, gyro_s, log.followed)
    return FlownControllers(
        name="mc_rate_control",
        firmware=log.firmware,
        version_read=version_read,
        version_note=note,
        axes=found,
        remarks=tuple(remarks),
    )


def logged_loop_period_s(log: FlightLog) -> float | None:
    """Return the period of the rate loop where its rates and torques were logged at each step [s]."""
    periods = []
    for name in ("body_rate", "torque_command"):
        times = next((one.time_s for one in log.candidates(name) if one.n_samples > 2), None)
        steps = np.diff(times) if times is not None else np.zeros(0)
        steps = steps[steps > 0.0]
        periods.append(float(np.median(steps)) if steps.size else math.inf)
    rate_s, torque_s = periods
    alike = abs(rate_s - torque_s) <= _SAME_PERIOD * rate_s if math.isfinite(rate_s + torque_s) else False
    return rate_s if alike and rate_s * _LOOP_LIKE_HZ <= 1.0 + _SAME_PERIOD else None


def rate_parameters(parameters: Mapping[str, float], name: str) -> dict[str, float]:
    """Return the parameters of one axis' rate controller by their short names.

    Parameters
    ----------
    name : str
        ROLL, PITCH or YAW.
    """
    return by_short_names(parameters, f"MC_{name}RATE_", _NEEDED, _OPTIONAL)


def _axis(
    parameters: Mapping[str, float],
    name: str,
    period_s: float,
    gyro_s: float,
    followed: Mapping[str, FloatArray],
) -> AxisController:
    """Return one axis; the periods are those of loop and gyro [s]."""
    pid = rate_parameters(parameters, name)
    error = gain(pid["P"], period_s) + integrator(period_s, late=True).scaled(pid["I"])
    of_slope = derivative_filter(parameters, gyro_s)
    torque_hz = parameters.get("MC_YAW_TQ_CUTOFF", 0.0) if name == "YAW" else 0.0
    command = first_order(torque_hz, period_s) if torque_hz > 0.0 else None
    filters = [notches_named("IMU_GYRO_DNF", one, gyro_s) for one in rotor_notches(parameters, followed)]
    filters += [notches_named(each, ((one,),), gyro_s) for each, one in notches_by_name(parameters).items()]
    low_pass_hz = parameter_filter(parameters).low_pass_hz
    if low_pass_hz > 0.0:
        low_pass = butterworth(low_pass_hz, gyro_s)
        filters.append(NamedFilter(name="IMU_GYRO_CUTOFF", place=FilterPlace.GYRO, filter=low_pass))
    if pid["D"] and cutoff_hz(parameters) > 0.0:
        bare = derivative(gyro_s).scaled(pid["K"] * pid["D"])
        filters.append(
            NamedFilter(name="IMU_DGYRO_CUTOFF", place=FilterPlace.PART, filter=of_slope, part=bare)
        )
    if command is not None:
        filters.append(NamedFilter(name="MC_YAW_TQ_CUTOFF", place=FilterPlace.COMMAND, filter=command))
    angle = finite(parameters.get(f"MC_{name}_P"))
    names = {f"MC_{name}RATE_{short}": value for short, value in pid.items()}
    return AxisController(
        period_s=period_s,
        error=error.scaled(pid["K"]),
        target=unit(period_s),
        rate=(derivative(gyro_s) * of_slope).scaled(pid["K"] * pid["D"]) if pid["D"] else None,
        feed_forward=gain(pid["FF"], period_s) if pid["FF"] else None,
        gyro=gyro_filters(parameter_filter(parameters, followed), gyro_s),
        command=command,
        filters=tuple(filters),
        angle_gain_per_s=angle,
        gains=names | ({} if angle is None else {f"MC_{name}_P": angle}),
    )


def parameter_period_s(parameters: Mapping[str, float]) -> float:
    """Return the shortest period that the loop may have, by IMU_GYRO_RATEMAX [s]."""
    rate_hz = parameters.get("IMU_GYRO_RATEMAX", _DEFAULT_LOOP_HZ)
    return 1.0 / (rate_hz if 0.0 < rate_hz < math.inf else _DEFAULT_LOOP_HZ)
