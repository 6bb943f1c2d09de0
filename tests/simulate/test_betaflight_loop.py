"""Betaflight's rate loop as the simulator flies and logs it."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from quadid_logs import analyze
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.data.closed_loop import Margins
from quadid_logs.data.result import Result
from quadid_logs.load import read_log
from quadid_logs.simulator import Scenario, fly, manoeuvres, plan_flights
from quadid_logs.simulator.airframes import quad_x
from quadid_logs.simulator.closed_loop import Record, final_gains
from quadid_logs.simulator.dialects import in_dialect
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.writers import write_log

RATE_HZ = 500.0


@pytest.fixture(scope="module")
def record() -> Record:
    plain = Scenario(name="", sentence="")
    scenario = dataclasses.replace(
        plain,
        airframe=quad_x,
        manoeuvre=partial(manoeuvres.sticks, tilt_rad=0.3, yaw_rate_rad_s=0.8),
        effects=dataclasses.replace(plain.effects, disturbance_rad_s2=(0.3, 0.3, 0.15)),
    )
    (setup,) = plan_flights(scenario, seed=5, duration_s=30.0, rate_hz=RATE_HZ, autopilot="betaflight")
    return fly(setup)


@pytest.fixture(scope="module")
def path(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("betaflight") / "flight.bbl"
    write_log(log_flights((record,), Logging(rate_hz=RATE_HZ)), path)
    return path


@pytest.fixture(scope="module")
def result(path: Path) -> Result:
    return analyze(path)


def test_the_gains_that_fly_are_those_of_the_header(record: Record, path: Path) -> None:
    """By pid.h: PTERM_SCALE 0.032029, ITERM_SCALE 0.244381 (2.5 times for yaw), DTERM_SCALE 0.000529."""
    header, gains = read_log(path).parameters, final_gains(record.setup)
    unit = math.degrees(1.0) / 1000.0
    assert gains.proportional[0] == pytest.approx(0.032029 * unit * header["p_roll"])
    assert gains.integral[1] == pytest.approx(0.244381 * unit * header["i_pitch"])
    assert gains.integral[2] == pytest.approx(2.5 * 0.244381 * unit * header["i_yaw"])
    assert gains.derivative[0] == pytest.approx(0.000529 * unit * header["d_roll"])
    assert gains.attitude[0] == pytest.approx(0.1 * header["levelPID[0]"])


def test_the_logged_terms_add_up_to_what_flew(record: Record, path: Path) -> None:
    """Each of three is rounded to a thousandth."""
    (told,) = read_log(path).candidates("torque_command")
    flown = record.channels["command"][-len(told.values) :]
    assert np.abs(told.values - flown).max() <= 1.5e-3 * 1.001


def test_d_brakes_what_the_rate_begins(record: Record) -> None:
    """It acts against the slope of the rate."""
    slope = np.gradient(record.channels["rate"][:, 0])
    assert np.corrcoef(record.channels["derivative"][:, 0], slope)[0, 1] < -0.5


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_the_loop_of_the_log_is_replayed(axis: str, result: Result) -> None:
    """P and D of rates and set-points are those that were logged."""
    assert result.closed_loop is not None
    replay = result.closed_loop.axes[axis].replay
    assert replay is not None
    assert replay.agrees


@pytest.mark.parametrize(("place", "axis"), [(0, "roll"), (1, "pitch")])
def test_told_margins_hold_those_of_the_loop_that_flew(
    place: int, axis: str, record: Record, result: Result
) -> None:
    """With the angle loop around it, on angles that are 10 ms old."""
    plant = true_plant(record.setup, flight_truth((record,), scenario="", boot_s=0.0), place)
    true = scaled_loops(true_controller(record.setup, place), plant, np.inf).margins().full
    assert result.closed_loop is not None
    margins = result.closed_loop.axes[axis].margins
    assert margins is not None
    assert true is not None
    assert isinstance(margins.full, Margins)
    for name in ("gain_margin_db", "phase_margin_deg"):
        told, really = getattr(margins.full, name), getattr(true, name)
        assert told.ci95[0] <= really.value <= told.ci95[1]


def test_nothing_but_the_pilot_holds_the_heading(record: Record) -> None:
    """Yaw is a rate in all of its modes."""
    assert true_controller(record.setup, 2).angle_gain_per_s is None


@pytest.mark.parametrize("dialect", ["betaflight-3", "cleanflight", "inav"])
def test_older_firmware_counts_gains_in_other_units(dialect: str, record: Record) -> None:
    """Its log holds neither gains nor terms of this law."""
    log = in_dialect(log_flights((record,), Logging(rate_hz=RATE_HZ)), dialect)
    assert not log.controller_terms
    assert not any("PID[" in name and name.startswith(("roll", "pitch", "yaw")) for name in log.parameters)
