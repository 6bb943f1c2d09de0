"""What any log shows of its flight: facts from the prepared log, none of them by the identified model."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np

from quadid_logs.align import Prepared
from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.data.flight import FlightData
from quadid_logs.data.health import Health, Standstill
from quadid_logs.health.battery import find_battery
from quadid_logs.health.command_noise import find_command_noise
from quadid_logs.health.commanded import Commanded, commanded_thrust
from quadid_logs.health.course import (
    find_rates,
    find_throttle,
    find_thrust,
    find_tilt,
    find_torque,
    find_tumble,
)
from quadid_logs.health.motors import find_motors, motor_names
from quadid_logs.health.noise import find_noise
from quadid_logs.health.oscillation import find_oscillation
from quadid_logs.health.rotors import find_rotors
from quadid_logs.health.standstill import find_standstill
from quadid_logs.health.steps import find_angle_lags, find_responses, find_steps, without_chirp
from quadid_logs.health.tracking import find_tracking
from quadid_logs.health.vibration import find_vibration
from quadid_logs.numerals import number
from quadid_logs.vocabulary import NOT_A_MULTIROTOR, TABLE_FORMAT

__all__ = ["faults_of", "health_of"]

#: What a topic cannot do without, and what is wrong where all of it is logged.
_NEEDS: Final[Mapping[str, tuple[tuple[str, ...], str]]] = {
    "tracking": (
        ("body_rate", "body_rate_setpoint"),
        "the measured values and their set-points are not logged together in flight",
    ),
    "attitude": (
        ("attitude", "attitude_setpoint"),
        "the measured values and their set-points are not logged together in flight",
    ),
    "steps": (
        ("body_rate", "body_rate_setpoint"),
        "the set-points do not explain the rates, or are logged too slowly",
    ),
    "noise": (("body_rate",), "the flight is too short for a spectrum"),
    "command_noise": (
        ("torque_command",),
        "it is logged too slowly to show noise, or the flight is too short for a spectrum",
    ),
    "motors": (("outputs",), "the log does not say which outputs drive the motors, or they never change"),
    "vibration": (("specific_force",), "it is logged too slowly, or the flight is too short"),
    "throttle": (("throttle",), "it was hardly logged in flight, never changes, or is above 100 %"),
    "battery": (("battery_voltage",), "none was measured in flight"),
    "oscillation": (
        ("body_rate", "body_rate_setpoint", "torque_command"),
        "the flight is too short for a spectrum",
    ),
    "rotors": (("outputs",), "the log does not show what each rotor was sent, or the flight is too short"),
}
_NO_RANGE: Final = "its output is a torque in newton metres, and the log does not say how large that can be"
_FED_FORWARD: Final = (
    "this controller uses its rate set-points as feed-forward only, so the rates do not follow them"
)
#: Take-off and touch-down are cut off by a second each: less flight than that between them is a hop, or a
#: vehicle that is pushed about on the ground.
_LEAST_FLIGHT_S: Final = 2.0
_WORDS: Final[Mapping[str, str]] = {
    "body_rate": "body rates",
    "body_rate_setpoint": "rate set-points",
    "attitude": "attitude",
    "attitude_setpoint": "attitude set-points",
    "outputs": "motor outputs",
    "specific_force": "accelerometer",
    "throttle": "throttle",
    "battery_voltage": "battery voltage",
    "torque_command": "output of the rate controller",
}


# Damaged numbers pass on as NaN or infinity, silently.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def health_of(prepared: Prepared, data: FlightData) -> Health:
    """Say of each topic what the log shows of it in flight, or which signal is missing.

    Parameters
    ----------
    data : FlightData
        What was cut of it: its flights are looked at.
    """
    intervals = data.flights
    reason = _nothing_to_judge(prepared, data)
    sent = commanded_thrust(prepared)
    standstill = _standstill(prepared, sent, (-math.inf, math.inf))
    if reason:
        shown = _of_hops(prepared)
        return Health(
            **shown,
            standstill=standstill,
            missing=dict.fromkeys((name for name in _NEEDS if shown.get(name) is None), reason),
        )
    series = {name: one for name, one in prepared.series.items() if one.n_samples >= 2}
    rate, asked = series.get("body_rate"), series.get("body_rate_setpoint")
    angle, asked_angle = series.get("attitude"), series.get("attitude_setpoint")
    outputs = series.get("motor_thrust") or series.get("output_pwm")
    # As the controller gave it: what was rebuilt of the motors' outputs is another thing.
    output = prepared.clean.first("torque_command")
    throttle, speed = series.get("throttle"), series.get("rotor_speed")
    # Where a trajectory asks for rates, set-points only feed forward beside the attitude's error: one law.
    rate_loop = "reference_rate" not in series
    followed = asked if rate_loop else None
    # What a system-ID mode injects moves the vehicle past the set-points, which then answer it.
    undisturbed = without_chirp(intervals, series.get("sysid_chirp"))
    responses = {} if rate is None or followed is None else find_responses(rate, followed, undisturbed)
    lags = {axis: response.lag for axis, response in responses.items()}
    oscillation = (
        None
        if rate is None or asked is None or output is None
        else find_oscillation(rate, asked, output, speed, intervals, rate_loop=rate_loop)
    )
    oscillations_hz: dict[str, list[float]] = {}
    for one in () if oscillation is None else oscillation.axes:
        if not one.certain:
            continue
        oscillations_hz.setdefault(one.axis, []).append(one.line.frequency_hz)
    gyros = [one for name in ("body_rate", "gyro_samples") for one in prepared.candidates.get(name, ())]
    found: dict[str, Any] = {
        "tracking": None
        if rate is None or followed is None
        else find_tracking(rate, followed, intervals, lags, of="rates", undisturbed=undisturbed),
        "attitude": None
        if angle is None or asked_angle is None
        else find_tracking(
            angle, asked_angle, intervals, find_angle_lags(angle, asked_angle, intervals), of="angles"
        ),
        "throttle": None if throttle is None else find_throttle(throttle, intervals),
        "steps": find_steps(responses),
        "noise": find_noise(
            gyros,
            asked,
            throttle,
            speed,
            intervals,
            oscillations_hz,
            of_gyro=prepared.log.format != TABLE_FORMAT,
        ),
        "command_noise": None
        if output is None or not output.normalised
        else find_command_noise(output, prepared.log.controller_terms, prepared.clean.clock, intervals),
        "motors": None if outputs is None else find_motors(outputs, prepared.log.torque, intervals),
        "vibration": find_vibration(
            series, prepared.candidates.get("accelerometer_clips", ()), intervals, prepared.candidates
        ),
        "battery": None
        if (voltage := series.get("battery_voltage")) is None
        else find_battery(voltage, throttle, intervals, prepared.log.n_cells),
        "oscillation": oscillation,
        "rotors": find_rotors(prepared, sent, intervals),
    }
    there = {
        *series,
        *(("outputs",) if outputs is not None else ()),
        *(("torque_command",) if output else ()),
    }
    missing = {name: _lacks(name, there) for name, topic in found.items() if topic is None}
    found |= _in_place_of(found, series, intervals)
    if asked is not None and not rate_loop:
        missing |= dict.fromkeys(("tracking", "steps"), _FED_FORWARD)
    if output is not None and not output.normalised:
        missing["command_noise"] = _NO_RANGE
    return Health(**found, standstill=standstill, missing=missing)


def _of_hops(prepared: Prepared) -> dict[str, Any]:
    """Return what a log without a flight shows of moments in the air: whether the vehicle turned over.

    Motors of a vehicle that still stands, or is pushed about, are sent anything.
    """
    hops = prepared.clean.hops
    if not hops or not prepared.log.may_be_multirotor or _length_s(prepared.flights) >= _LEAST_FLIGHT_S:
        return {}
    series = {name: one for name, one in prepared.series.items() if one.n_samples >= 2}
    rate, voltage = series.get("body_rate"), series.get("battery_voltage")
    tumble = None if rate is None else find_tumble(rate, hops)
    if rate is None or tumble is None:
        return {}
    from_first_to_last = ((hops[0][0], hops[-1][1]),)
    return {
        "tilt": tumble,
        "rates": find_rates(rate, hops),
        "battery": None
        if voltage is None
        else find_battery(voltage, None, from_first_to_last, prepared.log.n_cells),
    }


def _nothing_to_judge(prepared: Prepared, data: FlightData) -> str:
    """Return why the log shows no flight of a multirotor that could be judged; empty where it does."""
    if not prepared.log.may_be_multirotor:
        return NOT_A_MULTIROTOR
    if not data.flights:
        return data.on_ground_reason or "no flight was found"
    flown_s = _length_s(data.flights)
    if flown_s < _LEAST_FLIGHT_S:
        return f"the {number(flown_s, 2)} s of flight are too short to judge the vehicle by"
    return ""


def _length_s(intervals: Sequence[Interval]) -> float:
    return sum(end_s - start_s for start_s, end_s in intervals)


def _standstill(prepared: Prepared, sent: Commanded | None, part: Interval) -> Standstill | None:
    """Look on the ground, too: a vehicle with a motor that stands still does not fly for long."""
    speed, motors = prepared.series.get("rotor_speed"), prepared.series.get("motor_thrust")
    if speed is None or speed.n_samples < 2:
        return None
    outputs = motors if sent is None else sent.series
    if outputs is None or outputs.n_samples < 2:
        return None
    speed = speed.take(speed.within(*part))
    if speed.n_samples < 2:
        return None
    n_rotors = outputs.n_columns if sent is None else len(sent.place)
    return find_standstill(outputs, speed, motor_names(prepared.log.torque, n_rotors))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def faults_of(prepared: Prepared, data: FlightData) -> Health:
    """Search for faults of rotors and sensors alone: what a fleet asks of each flight."""
    intervals = data.flights
    sent = commanded_thrust(prepared)
    # What of a log belongs to these of its flights: each ends what began after the one before.
    if not intervals:
        part = -math.inf, math.inf
    else:
        start_s, end_s = intervals[0][0], intervals[-1][1]
        before = max((last for _, last in prepared.flights if last <= start_s), default=-math.inf)
        is_last = not any(first >= end_s for first, _ in prepared.flights)
        part = before, math.inf if is_last else end_s
    standstill = _standstill(prepared, sent, part)
    if reason := _nothing_to_judge(prepared, data):
        return Health(standstill=standstill, missing=dict.fromkeys(_NEEDS, reason))
    clips = prepared.candidates.get("accelerometer_clips", ())
    series = {name: one for name, one in prepared.series.items() if one.n_samples >= 2}
    rotors, vibration = (
        find_rotors(prepared, sent, intervals),
        find_vibration(series, clips, intervals, prepared.candidates),
    )
    looked_at = {"rotors": rotors, "vibration": vibration}
    missing = {
        name: _lacks(name, series) if name in looked_at else "the flights were judged one by one"
        for name in _NEEDS
        if looked_at.get(name) is None
    }
    return Health(rotors=rotors, vibration=vibration, standstill=standstill, missing=missing)


def _in_place_of(
    found: Mapping[str, Any], series: Mapping[str, CleanSeries], intervals: Sequence[Interval]
) -> dict[str, Any]:
    """Return what a log shows by itself of that of which it holds nothing to compare with."""
    rate, angle, thrust = series.get("body_rate"), series.get("attitude"), series.get("thrust_n")
    torque = series.get("torque_n_m") or series.get("torque_command")
    return {
        "rates": None if rate is None or found["tracking"] else find_rates(rate, intervals),
        "tilt": None if angle is None else find_tilt(angle, intervals),
        "torque": None if torque is None or found["motors"] else find_torque(torque, thrust, intervals),
        "thrust": None if thrust is None else find_thrust(thrust, angle, intervals),
    }


def _lacks(topic: str, there: Collection[str]) -> str:
    """Say which signal a topic lacks, or what is wrong with what there is."""
    needed, otherwise = _NEEDS[topic]
    lacking = [_WORDS[name] for name in needed if name not in there]
    return f"the log holds no {' and no '.join(lacking)}" if lacking else otherwise
