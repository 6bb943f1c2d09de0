"""Betaflight's rate controller from the settings in a log's header.

What follows throttle and sticks (D-max, throttle attenuation, dynamic low-passes) is taken as it was on the
average of the flight, and said. The loop is that of sticks that rest: while they move, iterm relax holds the
integral back, and the feed-forward adds to the set-point's way, not to the loop.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from operator import mul
from typing import Final

import numpy as np

from quadid_logs.autopilots.betaflight.filters import (
    D_LOW_PASSES,
    GYRO_LOW_PASSES,
    cutoff_hz,
    has_dynamic_notches,
    has_rpm_notches,
    loop_filters,
    named_gyro_filters,
)
from quadid_logs.autopilots.betaflight.flown import Flown, flown
from quadid_logs.autopilots.betaflight.law import (
    OLDEST_LAW,
    angle_delay_s,
    angle_gain_per_s,
    attenuates_p,
    attenuation,
    d_filter,
    d_filters,
    loop_period_s,
    p_filter,
    rate_gains,
)
from quadid_logs.autopilots.betaflight.replay import d_parts
from quadid_logs.autopilots.betaflight.signals import PID_SCALE
from quadid_logs.autopilots.discrete import derivative, gain, integrator, unit
from quadid_logs.autopilots.versions import finite, read_version
from quadid_logs.data.controller import (
    AxisController,
    CommandUnit,
    ControllerRemark,
    DiscreteFilter,
    FilterPlace,
    FlownControllers,
    NamedFilter,
    RemarkKind,
)
from quadid_logs.data.log import FlightLog
from quadid_logs.vocabulary import AXES

#: Versions whose pid.c, pid_init.c and filter.c were read: P, I, D, their filters and throttle attenuation
#: are the same in all; filters that became others in 2026.6 have the same response.
VERSIONS_READ: Final = ((3, 1), (3, 4), (4, 3), (4, 4), (4, 5), (2025, 12), (2026, 6), (2026, 12))
#: Settings of some versions that make another controller, of yaw or of all axes.
_OTHER_LAWS: Final = {"use_integrated_yaw": ("yaw",), "abs_control_gain": AXES}
#: The first version without the averaging filter of D.
_NO_AVERAGE_SINCE = (3, 4)
_AVERAGE: Final = 2.0
#: Filters are compared where motion is, far below their cut-offs [Hz].
_SLOW_HZ: Final = np.array([5.0])
#: Settings of notches that follow what a log need not hold.
_DYNAMIC_NOTCH: Final = ("dyn_notch_count", "dyn_notch_q")
_RPM_NOTCH: Final = ("rpm_filter_harmonics", "gyro_rpm_notch_harmonics")
#: Self-levelling modes hold these angles; yaw stays a rate.
_LEVELLED: Final = ("roll", "pitch")
#: Of a factor by the throttle: less is no matter for a margin.
_FELT: Final = 0.02


def controllers(
    log: FlightLog,
    parameters: Mapping[str, float],
    *,
    period_s: float | None = None,
    axes: Sequence[str] = AXES,
) -> FlownControllers | None:
    """Return the controllers that the settings make; None for a version whose law is another.

    Parameters
    ----------
    log : FlightLog
        Tells the firmware, and throttle, rotor speeds and filter delays of the flight.
    period_s : float or None
        Not used: the header tells the loop's period.

    Notes
    -----
    ``pid.c``, ``pid_init.c``, ``gyro_filter_impl.c``, ``rpm_filter.c``.
    """
    if log.version is not None and log.version < OLDEST_LAW:
        return None
    version_read, note = read_version(log.version, VERSIONS_READ)
    found: dict[str, AxisController] = {}
    remarks = list(_common_remarks(parameters, flown(log), log.version))
    for axis in axes:
        # Tell whether a setting makes another controller of an axis.
        other = {
            name: parameters[name]
            for name in _OTHER_LAWS
            if (axis in _OTHER_LAWS[name] and (finite(parameters.get(name)) or 0.0) > 0.0)
        }
        # D passes an average over rows then, whose length no header holds.
        older = log.version is not None and log.version < _NO_AVERAGE_SINCE
        if older and parameters.get("dterm_filter_type") == _AVERAGE:
            other["dterm_filter_type"] = _AVERAGE
        needed = [f"{short}_{axis}" for short in "pid"]
        given = {name: finite(parameters.get(name)) for name in needed}
        # A damaged header may hold any number; a gain below zero is none.
        absent = [name for name, value in given.items() if value is None or value < 0.0]
        missing = absent if loop_period_s(parameters) > 0.0 else [*absent, "looptime"]
        if other:
            remarks.append(ControllerRemark(kind=RemarkKind.NOT_MODELLED, axis=axis, values=other))
        elif missing:
            values = dict.fromkeys(missing, math.nan)
            remarks.append(ControllerRemark(kind=RemarkKind.MISSING_PARAMETER, axis=axis, values=values))
        else:
            found[axis] = _axis(log, parameters, axis)
            if axis in _LEVELLED and flown(log).levelling and _angle(log, parameters) is None:
                remarks.append(ControllerRemark(kind=RemarkKind.ANGLE_LOOP_UNKNOWN, axis=axis))
            gains = rate_gains(parameters, axis)
            if gains.most_derivative > gains.derivative > 0.0:
                names = (f"{short}_{axis}" for short in ("d", "d_min", "d_max"))
                parts = {name: parameters[name] for name in names if name in parameters}
                parts["mean_part"] = d_parts(log)[axis]
                remarks.append(ControllerRemark(kind=RemarkKind.VARIABLE_GAIN, axis=axis, values=parts))
    return FlownControllers(
        name="Betaflight's rate loop",
        firmware=log.firmware,
        version_read=version_read,
        version_note=note,
        axes=found,
        remarks=tuple(remarks),
        command_unit=CommandUnit("unit of the PID sum", 1.0 / PID_SCALE),
    )


def _axis(log: FlightLog, parameters: Mapping[str, float], axis: str) -> AxisController:
    mean, period_s = flown(log), loop_period_s(parameters)
    gains = rate_gains(parameters, axis, log.version)
    factor = float(attenuation(parameters, mean.throttle, log.version))
    of_p = gains.proportional * (factor if attenuates_p(parameters) else 1.0)
    of_d = gains.between(d_parts(log)[axis]) * factor
    error = p_filter(parameters, axis, period_s).scaled(of_p) + integrator(period_s).scaled(gains.integral)
    angle = _angle(log, parameters) if axis in _LEVELLED else None
    settings = (f"{short}_{axis}" for short in ("p", "i", "d", "d_min", "d_max", "f"))
    return AxisController(
        period_s=period_s,
        error=error,
        target=unit(period_s),
        rate=d_filter(parameters, mean.throttle, period_s).scaled(of_d) if of_d else None,
        gyro=_gyro(log, parameters, mean, period_s),
        filters=tuple(_named_filters(log, parameters, axis, mean)),
        predictable=False,
        angle_gain_per_s=angle,
        angle_delay_steps=1 if angle is None else max(1, round(angle_delay_s(log.version) / period_s)),
        gains={name: parameters[name] for name in settings if finite(parameters.get(name)) is not None},
    )


def _angle(log: FlightLog, parameters: Mapping[str, float]) -> float | None:
    """Return the gain of the angle loop that flew around roll and pitch; None where none did."""
    modes = flown(log).levelling
    return angle_gain_per_s(parameters, modes, log.version) if modes else None


def _named_filters(
    log: FlightLog, parameters: Mapping[str, float], axis: str, mean: Flown
) -> Iterator[NamedFilter]:
    """Yield the filters that the measured rate passes, by their settings."""
    loop_s = loop_period_s(parameters)
    periods_s = (1e-6 * log.parameters.get("looptime", 1e6 * loop_s), loop_s)
    yield from named_gyro_filters(parameters, mean.rotors_hz, mean.throttle, periods_s)
    known = loop_filters(parameters, mean.rotors_hz, mean.throttle, periods_s)
    for late in _gyro(log, parameters, mean, loop_s)[len(known) :]:
        name = "dynamic notches" if has_dynamic_notches(parameters) else "further delay"
        yield NamedFilter(name=name, place=FilterPlace.GYRO, filter=late)
    gains = rate_gains(parameters, axis, log.version)
    factor = float(attenuation(parameters, mean.throttle, log.version))
    of_d = gains.between(d_parts(log)[axis]) * factor
    slope = derivative(loop_s).scaled(of_d)
    of_slope = d_filters(parameters, mean.throttle, loop_s) if of_d else {}
    for name, one in of_slope.items():
        others = (other for each, other in of_slope.items() if each != name)
        yield NamedFilter(name=name, place=FilterPlace.PART, filter=one, part=reduce(mul, others, slope))
    of_p = gains.proportional * (factor if attenuates_p(parameters) else 1.0)
    if axis == "yaw" and (finite(parameters.get("yaw_lowpass_hz")) or 0.0) > 0.0:
        yield NamedFilter(
            name="yaw_lowpass_hz",
            place=FilterPlace.PART,
            filter=p_filter(parameters, axis, loop_s),
            part=gain(of_p, loop_s),
        )


def _gyro(
    log: FlightLog, parameters: Mapping[str, float], mean: Flown, loop_s: float
) -> tuple[DiscreteFilter, ...]:
    """Return the gyro's filters; what is later than the known ones that flew is a delay."""
    periods_s = (1e-6 * log.parameters.get("looptime", 1e6 * loop_s), loop_s)
    flown_filters, known = (
        loop_filters(each, mean.rotors_hz, mean.throttle, periods_s) for each in (log.parameters, parameters)
    )
    phase = sum(float(np.angle(each.response(_SLOW_HZ)[0])) for each in flown_filters)
    later_s = mean.gyro_delay_s + phase / (2.0 * math.pi * float(_SLOW_HZ[0]))
    return (*known, DiscreteFilter(np.array([0.0, 1.0]), np.ones(1), later_s)) if later_s > 0.0 else known


def _common_remarks(
    parameters: Mapping[str, float], mean: Flown, version: tuple[int, ...] | None
) -> Iterator[ControllerRemark]:
    """Yield what concerns all axes."""
    unseen = (*_DYNAMIC_NOTCH,) if has_dynamic_notches(parameters) else ()
    if has_rpm_notches(parameters) and not mean.rotors_hz:
        unseen = (*unseen, *_RPM_NOTCH)
    if unseen and not math.isfinite(mean.gyro_delay_s):
        values = {name: parameters[name] for name in unseen if name in parameters}
        yield ControllerRemark(kind=RemarkKind.NOTCH_UNKNOWN, values=values)
    if float(attenuation(parameters, mean.highest_throttle, version)) < 1.0 - _FELT:
        names = ("tpa_rate", "tpa_breakpoint")
        values = {name: parameters[name] for name in names} | {"mean_throttle": mean.throttle}
        yield ControllerRemark(kind=RemarkKind.VARIABLE_GAIN, values=values)
    moving = {
        names.dynamic: cutoff_hz(parameters, names, mean.throttle)
        for names in (*GYRO_LOW_PASSES, *D_LOW_PASSES)
        if parameters.get(f"{names.dynamic}[0]", 0.0) > 0.0
    }
    if moving:
        yield ControllerRemark(kind=RemarkKind.VARIABLE_FILTER, values=moving)
