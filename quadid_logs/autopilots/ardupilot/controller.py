"""ArduPilot's rate and angle controllers of multirotors, from parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.autopilots.ardupilot.filters import (
    follows_unknown,
    gyro_period_s,
    notch_sets,
    parameter_filter,
)
from quadid_logs.autopilots.discrete import (
    butterworth,
    derivative,
    first_order,
    gain,
    gyro_filter,
    gyro_filters,
    integrator,
    notches_named,
)
from quadid_logs.autopilots.versions import by_short_names, finite, gains_named, read_version
from quadid_logs.data.controller import (
    AxisController,
    ControllerRemark,
    Filter,
    FilterPlace,
    FlownControllers,
    NamedFilter,
    RemarkKind,
)
from quadid_logs.data.log import FlightLog, whole_number
from quadid_logs.vocabulary import AXES

#: ArduCopter versions whose AC_PID, AC_AttitudeControl(_Multi), LowPassFilter2p and order of tasks were read:
#: what is linear in them is the same. 4.5 knows PDMX, D_FF, notches and a boost; 4.3 has none of these.
VERSIONS_READ: Final = ((4, 3), (4, 5), (4, 7))
#: As parameters name them: ATC_RAT_RLL_P, ATC_ANG_RLL_P, ATC_LAND_R_MULT.
AXIS_NAMES: Final = dict(zip(AXES, ("RLL", "PIT", "YAW"), strict=True))
#: Without them there is no AC_PID as below: firmware before 4.0 has one filter, FILT, for all.
_NEEDED: Final = ("P", "I", "D", "FLTT", "FLTE", "FLTD")
_OPTIONAL: Final = {"FF": 0.0, "D_FF": 0.0, "IMAX": math.inf, "SMAX": 0.0, "PDMX": 0.0}
#: AC_PID: notches on target and error by number of a filter, 0 none.
_NOTCHES: Final = ("NTF", "NEF")
_DEFAULT_LOOP_HZ: Final = 400.0
#: A rate thread that waits longer than so many of its periods stood still.
_LONGEST_STEP: Final = 20.0
#: Modes in which sticks, and nothing that answers position or speed, command attitude or rates.
_STICK_MODES: Final = frozenset({"STABILIZE", "ALT_HOLD", "ACRO", "SPORT", "SYSTEMID"})
#: Of the angle loops, by version: the names changed in 3.4.
_ANGLE_GAINS: Final = (
    ("ATC_ANG_RLL_P", "ATC_ANG_PIT_P", "ATC_ANG_YAW_P"),
    ("STB_RLL_P", "STB_PIT_P", "STB_YAW_P"),
)


def angle_gains(mode: str, parameters: Mapping[str, float]) -> tuple[float, float, float] | None:
    """Return the gains from angles to rate set-points [1/s]; see `Autopilot.angle_gains`.

    Notes
    -----
    AC_AttitudeControl.cpp, `update_ang_vel_target_from_att_error` and `input_rate_bf_roll_pitch_yaw`: the
    error of the attitude times ANG_*_P, as long as no angular acceleration is limited.
    """
    if mode not in _STICK_MODES:
        return None
    return next((found for names in _ANGLE_GAINS if (found := gains_named(names, parameters))), None)


def controllers(
    log: FlightLog,
    parameters: Mapping[str, float],
    *,
    period_s: float | None = None,
    axes: Sequence[str] = AXES,
) -> FlownControllers:
    """Return the controllers that the parameters make; see `Autopilot.controllers`.

    Parameters
    ----------
    log : FlightLog
        Tells the firmware.
    period_s : float or None
        Not used: the parameters tell the loop's period.

    Notes
    -----
    AC_PID.cpp, AC_AttitudeControl.cpp, AC_AttitudeControl_Multi.cpp. The angle loop is that of small
    errors, where its square-root controller is linear.
    """
    version_read, note = read_version(log.version, VERSIONS_READ)
    found: dict[str, AxisController] = {}
    flown_s = flown_period_s(log, parameters)
    gyro = gyro_filters(parameter_filter(parameters, log.followed, log.version), gyro_period_s(parameters))
    named_gyro = tuple(_named_gyro_filters(log, parameters))
    remarks = []
    if notches := follows_unknown(parameters, log.followed):
        remarks.append(ControllerRemark(kind=RemarkKind.NOTCH_UNKNOWN, values=notches))
    if (boost := parameters.get("ATC_THR_G_BOOST", 0.0)) > 0.0:
        remarks.append(ControllerRemark(kind=RemarkKind.VARIABLE_GAIN, values={"ATC_THR_G_BOOST": boost}))
    for axis in axes:
        name = AXIS_NAMES[axis]
        refused = list(_refusals(parameters, axis, f"ATC_RAT_{name}_"))
        remarks += refused
        if not refused:
            found[axis] = _axis(parameters, name, flown_s, gyro, named_gyro)
            landing = f"ATC_LAND_{name[0]}_MULT"
            for kind, parameter, way in (
                (RemarkKind.SLEW_LIMIT, f"ATC_RAT_{name}_SMAX", 0.0),
                (RemarkKind.PD_LIMIT, f"ATC_RAT_{name}_PDMX", 0.0),
                (RemarkKind.VARIABLE_GAIN, landing, 1.0),
            ):
                value = parameters.get(parameter, way)
                if value != way:
                    remarks.append(ControllerRemark(kind=kind, axis=axis, values={parameter: value}))
    return FlownControllers(
        name="AC_PID",
        firmware=log.firmware,
        version_read=version_read,
        version_note=note,
        axes=found,
        remarks=tuple(remarks),
    )


def loop_period_s(parameters: Mapping[str, float]) -> float:
    """Return the period of the rate loop [s]: SCHED_LOOP_RATE, or FSTRATE_DIV samples of the gyro."""
    if parameters.get("FSTRATE_ENABLE", 0.0) > 0.0:
        return gyro_period_s(parameters) * max(whole_number(parameters.get("FSTRATE_DIV"), 1), 1)
    rate_hz = parameters.get("SCHED_LOOP_RATE", _DEFAULT_LOOP_HZ)
    return 1.0 / (rate_hz if 0.0 < rate_hz < math.inf else _DEFAULT_LOOP_HZ)


def loop_rate_hz(parameters: Mapping[str, float]) -> float:
    """Return the rate of `loop_period_s` [Hz], 0 where the parameters do not say."""
    told = not {"SCHED_LOOP_RATE", "FSTRATE_ENABLE"}.isdisjoint(parameters)
    return 1.0 / loop_period_s(parameters) if told else 0.0


def flown_period_s(log: FlightLog, parameters: Mapping[str, float]) -> float:
    """Return the period that the rate loop had [s].

    That of the parameters. A rate thread runs as often as the processor lets it, which its rows tell.
    """
    promised_s = loop_period_s(parameters)
    rows = next(iter(log.candidates("body_rate_setpoint")), None)
    if parameters.get("FSTRATE_ENABLE", 0.0) <= 0.0 or rows is None:
        return promised_s
    steps_s = np.diff(rows.time_s)
    # Gaps are none of its periods.
    steps_s = steps_s[(steps_s >= 0.0) & (steps_s <= _LONGEST_STEP * promised_s)]
    mean_s = float(np.mean(steps_s)) if steps_s.size else math.nan
    main_s = loop_period_s({**parameters, "FSTRATE_ENABLE": 0.0})
    # Slower than the main loop are rows that were thinned.
    return mean_s if promised_s <= mean_s <= main_s else promised_s


def pid_parameters(parameters: Mapping[str, float], name: str) -> dict[str, float]:
    """Return the parameters of one axis' PID by their short names.

    Parameters
    ----------
    name : str
        RLL, PIT or YAW.
    """
    return by_short_names(parameters, f"ATC_RAT_{name}_", _NEEDED, _OPTIONAL)


def _axis(
    parameters: Mapping[str, float],
    name: str,
    period_s: float,
    gyro: tuple[Filter, ...],
    named_gyro: tuple[NamedFilter, ...],
) -> AxisController:
    pid = pid_parameters(parameters, name)
    slope = derivative(period_s)
    of_error, of_slope = (first_order(pid[short], period_s) for short in ("FLTE", "FLTD"))
    terms = (
        gain(pid["P"], period_s) + integrator(period_s).scaled(pid["I"]) + (slope * of_slope).scaled(pid["D"])
    )
    filters = list(named_gyro)
    if pid["FLTE"] > 0.0:
        filters.append(NamedFilter(name=f"ATC_RAT_{name}_FLTE", place=FilterPlace.ERROR, filter=of_error))
    if pid["FLTD"] > 0.0 and pid["D"] != 0.0:
        bare = (slope * of_error).scaled(pid["D"])
        filters.append(
            NamedFilter(name=f"ATC_RAT_{name}_FLTD", place=FilterPlace.PART, filter=of_slope, part=bare)
        )
    feed_forward = gain(pid["FF"], period_s) + slope.scaled(pid["D_FF"])
    angle = finite(parameters.get(f"ATC_ANG_{name}_P"))
    names = {f"ATC_RAT_{name}_{short}": value for short, value in pid.items() if math.isfinite(value)}
    return AxisController(
        period_s=period_s,
        error=terms * of_error,
        target=first_order(pid["FLTT"], period_s),
        feed_forward=feed_forward if pid["FF"] or pid["D_FF"] else None,
        gyro=gyro,
        filters=tuple(filters),
        angle_gain_per_s=angle,
        gains=names | ({} if angle is None else {f"ATC_ANG_{name}_P": angle}),
    )


def _named_gyro_filters(log: FlightLog, parameters: Mapping[str, float]) -> Iterator[NamedFilter]:
    """Yield the filters of the gyro by their parameters."""
    period_s = gyro_period_s(parameters)
    for name, places in notch_sets(parameters, log.followed, log.version).items():
        for felt in gyro_filter(math.nan, (), [places]).tracked:
            yield notches_named(name, felt, period_s)
    low_pass_hz = parameter_filter(parameters).low_pass_hz
    if low_pass_hz > 0.0:
        yield NamedFilter(
            name="INS_GYRO_FILTER", place=FilterPlace.GYRO, filter=butterworth(low_pass_hz, period_s)
        )


def _refusals(parameters: Mapping[str, float], axis: str, prefix: str) -> Iterator[ControllerRemark]:
    """Yield why an axis has no controller here."""
    needed = [parameters.get(prefix + short, math.nan) for short in _NEEDED]
    missing = [short for short, value in zip(_NEEDED, needed, strict=True) if not math.isfinite(value)]
    if missing:
        values = {prefix + short: math.nan for short in missing}
        yield ControllerRemark(kind=RemarkKind.MISSING_PARAMETER, axis=axis, values=values)
    notches = {prefix + short: parameters.get(prefix + short, 0.0) for short in _NOTCHES}
    used = {name: value for name, value in notches.items() if value}
    if used:
        yield ControllerRemark(kind=RemarkKind.NOT_MODELLED, axis=axis, values=used)
