"""A torque that was computed from the rates is told by what it lacks, at any rate and in any format."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.align import cut
from quadid_logs.data.flight import Segment
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import TorquePath
from quadid_logs.data.settings import Settings
from quadid_logs.identify.torque_path import torque_path
from quadid_logs.load import load
from quadid_logs.simulator import simulate
from quadid_logs.writers import write_log
from tests.marks import thorough

_STEP_S = 1.0 / 1600.0
DURATION_S = 40.0


def white(seed: int) -> np.ndarray:
    """Return noise on a fine grid."""
    return np.random.default_rng(seed).standard_normal(round(DURATION_S / _STEP_S))


def behind(values: np.ndarray, lag_s: float) -> np.ndarray:
    """Return values behind a first-order lag."""
    part = -np.expm1(-_STEP_S / lag_s)
    return np.asarray(lfilter([part], [1.0, part - 1.0], values))


def flown(lag_s: float, delay_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return torque and rate of a rigid body of 200 rad/s^2 behind a rotor, with gusts and noise."""
    torque = 0.05 * behind(white(1), 0.03) / np.sqrt(_STEP_S)
    late = np.roll(torque, round(delay_s / _STEP_S))
    achieved = behind(late, lag_s) if lag_s else late
    gusts = 10.0 * behind(white(2), 0.3)
    return torque, np.cumsum(200.0 * achieved + gusts) * _STEP_S + 0.01 * behind(white(3), 0.005)


def path_of(torque: np.ndarray, rate: np.ndarray, rate_hz: float) -> TorquePath:
    """Return the path as a log of that rate shows it."""
    time_s = np.arange(torque.size) / rate_hz
    both = [np.column_stack([each] * 3) for each in (rate, torque)]
    segment = Segment(
        time_s=time_s,
        body_rate_rad_s=both[0],
        torque=both[1],
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(torque.size, dtype=np.bool_),
    )
    found = torque_path([segment], 0, 1.0 / rate_hz)
    assert found is not None
    return found


def logged(values: np.ndarray, rate_hz: float) -> np.ndarray:
    """Return every so many values."""
    return values[:: round(1.0 / (_STEP_S * rate_hz))]


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0, 400.0])
@pytest.mark.parametrize("how", ["central", "backward", "forward"])
def test_between_a_derivative_of_the_rates_and_their_acceleration_there_is_nothing(
    rate_hz: float, how: str
) -> None:
    """Where noise of the gyro was looked for near half the log's rate, a smoothed or rounded one passed."""
    _, rate = flown(0.02)
    rate = logged(rate, rate_hz)
    ends = {"backward": {"prepend": rate[0]}, "forward": {"append": rate[-1]}}
    torque = np.gradient(rate) if how == "central" else np.diff(rate, **ends[how])
    found = path_of(torque, rate, rate_hz)
    assert found.p_value < 1e-3
    assert found.explained > 0.9


def test_a_derivative_of_smoothed_rates_is_told_as_well() -> None:
    """Nothing of the gyro's noise is left in it."""
    _, rate = flown(0.02)
    torque = np.gradient(behind(behind(rate, 0.01)[::-1], 0.01)[::-1])
    assert path_of(*(logged(each, 200.0) for each in (torque, rate)), 200.0).p_value < 1e-3


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0, 400.0])
@pytest.mark.parametrize(("lag_s", "delay_s"), [(0.02, 0.0), (0.01, 0.002), (0.05, 0.01)])
def test_a_torque_behind_rotors_is_none_of_the_rates(rate_hz: float, lag_s: float, delay_s: float) -> None:
    """Whatever the rate of the log, and where the lag happens to be half a sample."""
    torque, rate = (logged(each, rate_hz) for each in flown(lag_s, delay_s))
    assert path_of(torque, rate, rate_hz).p_value > 0.01


def test_measured_rotor_speeds_lack_no_path() -> None:
    """No rotor is left, but the filter of the gyro: 4 ms, as on flown vehicles."""
    torque, rate = flown(0.0, 0.004)
    found = path_of(logged(torque, 200.0), logged(rate, 200.0), 200.0)
    assert found.p_value > 1e-3
    assert found.lag_s == pytest.approx(0.004, abs=1e-3)


def test_rotor_speeds_behind_a_filter_of_half_a_sample_are_measured() -> None:
    """Their lag alone would be that of a difference to the next sample."""
    torque, rate = flown(0.0, 0.005)
    assert path_of(logged(torque, 100.0), logged(rate, 100.0), 100.0).p_value > 1e-3


@pytest.mark.parametrize("late_s", [0.01, 0.02, 0.03, 0.05])
def test_a_late_stamp_hides_no_rotor(late_s: float) -> None:
    """Phase vanishes where it is as late as the rotor; fast torque has less of an effect all the same."""
    torque, rate = flown(0.02)
    torque = np.roll(torque, round(late_s / _STEP_S))
    assert path_of(logged(torque, 200.0), logged(rate, 200.0), 200.0).p_value > 0.5


def test_one_fault_in_torque_and_rates_is_no_evidence() -> None:
    """It may outweigh the flight a thousand times."""
    torque, rate = (logged(each, 100.0) for each in flown(0.02))
    fault = np.zeros_like(rate)
    fault[2040:2060] = np.linspace(0.0, 300.0, 20)
    rate, torque = rate + fault, torque + 5.0 * np.gradient(fault)
    assert path_of(torque, rate, 100.0).p_value > 0.01


def computed_from_rates(log: FlightLog) -> FlightLog:
    """Return a log whose torque, or the outputs that make it, is the derivative of its rates."""
    signals, rate = dict(log.signals), log.candidates("body_rate")[0]
    old = signals["torque_command"][0]
    slope = np.gradient(rate.values, rate.time_s, axis=0) / 200.0
    new = np.column_stack([np.interp(old.time_s, rate.time_s, column) for column in slope.T])
    signals["torque_command"] = (dataclasses.replace(old, values=new),)
    for name in ("motor_thrust", "output_pwm"):
        if name in signals:
            outputs = signals[name][0]
            throttle, *axes = (
                np.interp(outputs.time_s, each.time_s, column)
                for each in (log.candidates("throttle")[0], old)
                for column in each.values.T[: 1 if each is not old else 3]
            )
            mixed = np.column_stack([np.ones(outputs.time_s.size), throttle, *axes])
            mixer = np.linalg.lstsq(mixed, outputs.values, rcond=None)[0]
            mixed[:, 2:] = np.column_stack(
                [np.interp(outputs.time_s, rate.time_s, column) for column in slope.T]
            )
            # Of a column that no motor has, nothing follows.
            signals[name] = (dataclasses.replace(outputs, values=mixed @ mixer),)
    for name in ("rotor_speed", "unallocated_torque"):
        signals.pop(name, None)
    return dataclasses.replace(log, signals=signals)


@pytest.mark.parametrize(
    ("ending", "autopilot", "rate_hz"),
    [
        ("bin", "ardupilot", 50.0),
        thorough("bin", "ardupilot", 400.0),
        thorough("ulg", "px4", 100.0),
        thorough("ulg", "px4", 400.0),
        thorough("bbl", "betaflight", 100.0),
        thorough("bbl", "betaflight", 400.0),
    ],
)
def test_in_every_format_roll_or_pitch_show_it(
    ending: str, autopilot: str, rate_hz: float, tmp_path: Path
) -> None:
    """Messages of their own, outputs as whole numbers, stamps that differ."""
    log = simulate("doublets", seed=1, duration_s=30.0, rate_hz=rate_hz, autopilot=autopilot).log
    assert shows_it(log, tmp_path / f"flown.{ending}") == [False, False]
    assert any(shows_it(computed_from_rates(log), tmp_path / f"computed.{ending}"))


def shows_it(log: FlightLog, path: Path) -> list[bool]:
    """Write a log, read it, and say of roll and pitch whether their torque was computed from the rates."""
    write_log(log, path)
    data = cut(load(path), Settings().align)
    found = [torque_path(data.segments, axis, data.sample_period_s) for axis in range(2)]
    assert None not in found
    return [each is not None and each.p_value < 1e-3 and each.explained > 0.5 for each in found]
