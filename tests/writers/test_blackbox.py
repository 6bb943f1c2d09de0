"""A Betaflight flight that is written and read again is the same flight, to the rounding of whole numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.errors import OutputError, SimulationError
from quadid_logs.load import read_log
from quadid_logs.pipeline import analyze
from quadid_logs.simulator import Simulation, find_scenario, plan_flights, simulate
from quadid_logs.simulator.vendors import motor_order
from quadid_logs.vocabulary import ON_AXIS
from quadid_logs.writers import write_log

DEGREE = math.pi / 180.0
#: Half of what the fields count in: tenths of a degree per second, thousandths, counts of the sensors.
HALF_STEP = {
    "body_rate": 0.05 * DEGREE,
    "body_rate_setpoint": 0.05 * DEGREE,
    "attitude": 1e-4,
    "torque_command": 1.5e-3,
    "throttle": 0.5e-3,
    "motor_thrust": 0.5 / 1999.0,
    "rotor_speed": 50.0 / 7.0 * math.pi / 30.0,
    "specific_force": 0.5 * 9.80665 / 2048.0,
    "battery_voltage": 0.005,
}


@pytest.fixture(scope="module")
def flown() -> Simulation:
    """Doublets in calm air."""
    return simulate("doublets", seed=1, duration_s=18.0, rate_hz=200.0, autopilot="betaflight")


@pytest.fixture(scope="module")
def written(flown: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The flight as a file."""
    path = tmp_path_factory.mktemp("blackbox") / "flight.bbl"
    write_log(flown.log, path)
    return path


@pytest.mark.parametrize("name", sorted(HALF_STEP))
def test_each_signal_comes_back(name: str, flown: Simulation, written: Path) -> None:
    """With its times, every source in its place."""
    read = read_log(written).candidates(name)
    for found, expected in zip(read, flown.log.candidates(name), strict=True):
        np.testing.assert_allclose(found.time_s, expected.time_s, rtol=0.0, atol=0.51e-6)
        off = (found.values - expected.values + math.pi) % (2.0 * math.pi) - math.pi
        away = off if name == "attitude" else found.values - expected.values
        assert np.abs(away).max() <= HALF_STEP[name] * 1.0001


def test_an_attitude_whose_quaternion_has_a_negative_w_comes_back(tmp_path: Path) -> None:
    """The log holds x, y and z alone, of the quaternion whose w is not negative."""
    rows = Rows(1.0 + np.arange(64) * 1e-3, np.arange(64))
    attitude = np.tile([-2.5, 1.2, 2.5], (64, 1))
    signals = {
        "body_rate": (Signal(name="body_rate", rows=rows, values=np.zeros((64, 3)), source="gyro"),),
        "attitude": (Signal(name="attitude", rows=rows, values=attitude, source="attitude"),),
    }
    log = FlightLog(path="", format="blackbox", autopilot="betaflight", n_bytes=0, signals=signals)
    write_log(log, tmp_path / "f.bbl")
    (read,) = read_log(tmp_path / "f.bbl").candidates("attitude")
    np.testing.assert_allclose(read.values, attitude, rtol=0.0, atol=3e-4)


def test_settings_and_firmware_come_back(flown: Simulation, written: Path) -> None:
    """Lists too, and nothing is lost."""
    read = read_log(written)
    assert dict(read.parameters).items() >= dict(flown.log.parameters).items()
    assert (read.firmware, read.corrupt_bytes) == (flown.log.firmware, 0)


def test_the_vehicle_is_found_again(flown: Simulation, written: Path) -> None:
    """Effectiveness and lag from nothing but the file, whose thrust curve no parameter tells."""
    model = analyze(written).identification.recommended
    assert model is not None
    assert model.actuator is not None
    true = np.diag(np.array(flown.truth["models"]["damped"]["B"]))
    found = [model.entries[on_axis].value for on_axis in ON_AXIS.values()]
    np.testing.assert_allclose(found, true, rtol=0.03)
    assert model.actuator.lag_s == pytest.approx(flown.truth["actuator"]["lag_s"], abs=0.002)


def test_a_clock_beyond_32_bits_begins_anew(flown: Simulation, tmp_path: Path) -> None:
    """As the firmware's does after 71 minutes; the reader goes on counting."""
    rates = flown.log.candidates("body_rate")[0]
    late = replace(rates, rows=Rows(rates.time_s + 4280.0, rates.position))
    write_log(replace(flown.log, signals={"body_rate": (late,)}), tmp_path / "late.bbl")
    found = read_log(tmp_path / "late.bbl").candidates("body_rate")[0]
    np.testing.assert_allclose(np.diff(found.time_s), np.diff(late.time_s), atol=1.1e-6)


def test_numbers_beyond_32_bits_are_written_as_the_largest(flown: Simulation, tmp_path: Path) -> None:
    """Of a signal that is damaged: the frame must still end where the next one begins."""
    values = flown.log.candidates("body_rate")[0].values.copy()
    values[100], values[200] = 1e12, np.nan
    damaged = replace(flown.log.candidates("body_rate")[0], values=values)
    write_log(replace(flown.log, signals={"body_rate": (damaged,)}), tmp_path / "damaged.bbl")
    read = read_log(tmp_path / "damaged.bbl")
    assert len(read.candidates("body_rate")[0].time_s) == len(values)
    assert read.corrupt_bytes == 0


def test_a_log_without_rates_is_not_written(tmp_path: Path) -> None:
    """They are what a frame is about."""
    empty = FlightLog(path="", format="blackbox", autopilot="betaflight", n_bytes=0, signals={})
    with pytest.raises(OutputError, match="body rates"):
        write_log(empty, tmp_path / "empty.bbl")


def test_only_a_quad_x_flies_with_betaflight() -> None:
    """Its order of motors is known."""
    with pytest.raises(SimulationError, match="quad X"):
        simulate("octa-coax", duration_s=15.0, rate_hz=100.0, autopilot="betaflight")


def test_motors_stand_in_betaflights_order() -> None:
    """Rear right, front right, rear left, front left (``mixer_init.c``, mixerQuadX)."""
    (setup,) = plan_flights(find_scenario("sysid-quad-x"), seed=0, duration_s=20.0, rate_hz=400.0)
    forward_right = np.sign(setup.airframe.position_m[motor_order(setup), :2])
    assert forward_right.tolist() == [[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]


@pytest.fixture(scope="module")
def in_angle_mode(tmp_path_factory: pytest.TempPathFactory) -> tuple[Simulation, FlightLog]:
    """A flight whose sticks ask for angles, as it was flown and as its file is read."""
    flown = simulate("pilot-sticks", seed=2, duration_s=15.0, rate_hz=200.0, autopilot="betaflight")
    path = tmp_path_factory.mktemp("angle") / "flight.bbl"
    write_log(flown.log, path)
    return flown, read_log(path)


def test_the_flight_mode_comes_back(in_angle_mode: tuple[Simulation, FlightLog], written: Path) -> None:
    """Angles where a pilot asks for nothing else, rates elsewhere."""
    assert {mode.name for mode in in_angle_mode[1].modes} == {"Angle"}
    assert {mode.name for mode in read_log(written).modes} == {"Acro"}


def test_sticks_that_ask_for_angles_come_back(in_angle_mode: tuple[Simulation, FlightLog]) -> None:
    """To a tenth of the five hundred steps of half a stick."""
    (read,), (expected,) = (log.candidates("stick") for log in (in_angle_mode[1], in_angle_mode[0].log))
    assert np.abs(expected.values).max() > 0.1
    np.testing.assert_allclose(read.values, expected.values, atol=0.5001 / 5000.0)


def test_sticks_that_ask_for_rates_are_no_signal(written: Path) -> None:
    """The set-points are what they ask for."""
    assert not read_log(written).candidates("stick")
