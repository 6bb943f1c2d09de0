"""A notch that follows the rotors: its mean response is what it does, and the margins hold it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.autopilots.discrete import moving
from quadid_logs.control.closed_loop import close
from quadid_logs.control.filters import filter_costs, rate_crossover
from quadid_logs.control.margins import fine_grid_hz, phase_margin
from quadid_logs.data.controller import DiscreteFilter, MeanFilter
from quadid_logs.data.log import FlightLog, Notch
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.load import prepare, read_log
from quadid_logs.pipeline import judge
from quadid_logs.simulator import SCENARIOS, fly, plan_flights
from quadid_logs.simulator.closed_loop import Record
from quadid_logs.simulator.control import TrackingNotch, filter_rates
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.writers import write_log

#: As fast as ArduPilot reads a gyro by default: the notch of the simulation is that of the firmware.
LOOP_HZ = 1000.0
NOTCH = TrackingNotch(lowest_hz=40.0, width_hz=30.0)
FLIGHT = SCENARIOS["sysid-quad-x"]
#: Four times the gains: the loop crosses over at 9 Hz.
SCENARIO = replace(FLIGHT, tuning=replace(FLIGHT.tuning, notch=NOTCH, gain=4.0))


@cache
def flown() -> tuple[Record, FlightLog, Result]:
    """Fly 20 s at the gyro's rate, write, read and analyze: 6 s, once for the tests below."""
    setups = plan_flights(SCENARIO, seed=1, duration_s=20.0, rate_hz=LOOP_HZ, autopilot="ardupilot")
    record = fly(setups[0])
    with TemporaryDirectory() as folder:
        path = Path(folder) / "flight.bin"
        write_log(log_flights((record,), replace(SCENARIO.logging, rate_hz=LOOP_HZ)), path)
        log = read_log(path)
    prepared, settings = prepare(log), Settings()
    result = judge(
        prepared.log, cut(prepared, settings.align), settings, vehicle=None, published=False, timings_s={}
    )
    return record, log, result


def speeds_hz(record: Record) -> np.ndarray:
    """Return the mean speed of the rotors in the manoeuvre."""
    schedule = record.setup.schedule
    rows = slice(round(schedule.manoeuvre_s * LOOP_HZ), round(schedule.land_s * LOOP_HZ), 50)
    return np.asarray(record.channels["rotor_speed"][rows].mean(axis=1) / (2.0 * np.pi))


def true_notch(record: Record) -> MeanFilter:
    """Return the notch at every speed of the manoeuvre."""
    biquads = [NOTCH.biquad(1, float(speed), LOOP_HZ) for speed in speeds_hz(record)]
    each = tuple(
        (DiscreteFilter(np.array([b.b0, b.b1, b.b2]), np.array([1.0, b.a1, b.a2]), 1.0 / LOOP_HZ),)
        for b in biquads
    )
    return MeanFilter(each)


def true_loop_deg(result: Result, record: Record, axis: int, *, notched: bool = True) -> float:
    """Return the phase margin of the loop that the simulator flew."""
    setup = record.setup
    controller = true_controller(setup, axis)
    if notched:
        controller = replace(controller, gyro=(true_notch(record), *controller.gyro))
    frequency_hz = fine_grid_hz(controller.period_s)
    loop = close(
        controller, true_plant(setup, flight_truth((record,), scenario="", boot_s=0.0), axis), frequency_hz
    )
    return float(np.degrees(phase_margin(frequency_hz, loop.rate)[1][0]))


def test_a_notch_that_swings_does_to_a_slow_motion_what_its_mean_response_says() -> None:
    """From 70 to 130 Hz once in a second, on 12 Hz, sample by sample."""
    time_s = np.arange(0.0, 20.0, 1e-3)
    speed_hz = 100.0 + 30.0 * np.sin(2.0 * np.pi * time_s)
    sine = np.sin(2.0 * np.pi * 12.0 * time_s)
    memory, passed = ((0.0,) * 3,) * 2, []
    for value, speed in zip(sine.tolist(), speed_hz.tolist(), strict=True):
        found, memory = filter_rates((value,) * 3, memory, NOTCH.biquad(1, speed, 1000.0))
        passed.append(found[0])
    turning = np.exp(-2j * np.pi * 12.0 * time_s[1000:])
    measured = np.sum(np.array(passed)[1000:] * turning) / np.sum(sine[1000:] * turning)
    # The notch of 30 Hz at 40 Hz: of the same Q wherever it is.
    inverse_q = 40.0 / 25.0 - 25.0 / 40.0
    at = [(Notch(float(speed), inverse_q, 0.01),) for speed in speed_hz[:1000:10]]
    said = moving(tuple(at), 1e-3).response(np.array([12.0]))[0]
    assert np.degrees(np.angle(measured / said)) == pytest.approx(0.0, abs=0.1)
    assert abs(measured / said) == pytest.approx(1.0, abs=0.002)


@pytest.mark.thorough
def test_a_logged_speed_of_the_rotors_ends_the_doubt_about_the_notch() -> None:
    _, _, result = flown()
    assert result.closed_loop is not None
    assert result.closed_loop.controllers.remarks == ()


@pytest.mark.thorough
def test_the_notch_in_the_margins_stands_where_the_rotors_were() -> None:
    """The median of nine instants against that of the manoeuvre, which is most of the flight."""
    record, log, _ = flown()
    (places,) = log.candidates("body_rate")[0].gyro_filter.tracked
    found = np.median([notch.frequency_hz for (notch,) in places])
    assert found == pytest.approx(np.median(speeds_hz(record)), rel=0.02)


@pytest.mark.thorough
@pytest.mark.parametrize("number", range(3))
def test_the_phase_margin_with_a_tracked_notch_is_the_true_loops(number: int) -> None:
    record, _, result = flown()
    assert result.closed_loop is not None
    margins = result.closed_loop.axes[("roll", "pitch", "yaw")[number]].margins
    assert margins is not None
    assert margins.rate.phase_margin_deg is not None
    true_deg = true_loop_deg(result, record, number)
    assert margins.rate.phase_margin_deg.value == pytest.approx(true_deg, abs=1.0)
    low, high = margins.rate.phase_margin_deg.ci95
    assert low <= true_deg <= high


@pytest.mark.thorough
@pytest.mark.parametrize("number", range(3))
def test_the_cost_of_the_notch_is_that_in_the_true_loop(number: int) -> None:
    record, _, result = flown()
    assert result.closed_loop is not None
    axis = ("roll", "pitch", "yaw")[number]
    crossover_hz = rate_crossover(result.closed_loop.axes[axis])
    assert crossover_hz is not None
    costs = filter_costs(result.closed_loop.controllers.axes[axis], crossover_hz)
    (cost,) = [one for one in costs if one.name == "INS_HNTCH"]
    assert cost.phase_deg is not None
    true = true_notch(record).response(np.array([crossover_hz.value]))
    assert cost.phase_deg.value == pytest.approx(-float(np.degrees(np.angle(true[0]))), abs=0.2)


@pytest.mark.thorough
def test_without_its_notch_the_true_loop_would_have_degrees_more() -> None:
    """What the test above would not see if the notch were nothing: 360 x 9 Hz x 1.5 ms is 5 degrees."""
    record, _, result = flown()
    gained = true_loop_deg(result, record, 0, notched=False) - true_loop_deg(result, record, 0)
    assert gained > 3.0
