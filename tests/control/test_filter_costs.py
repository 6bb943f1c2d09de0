"""What each filter costs the loop in phase at its crossover, and takes from the lines of the spectrum."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots import named as autopilot_of
from quadid_logs.autopilots.ardupilot.controller import controllers as ardupilot
from quadid_logs.autopilots.px4.controller import controllers as px4
from quadid_logs.control.filters import FilterCost, filter_costs
from quadid_logs.control.loop import gyro_filters, on_rate
from quadid_logs.data.closed_loop import Estimated
from quadid_logs.data.controller import AxisController, FilterPlace, in_series
from quadid_logs.data.health import Line, LineSource
from quadid_logs.data.log import FlightLog
from quadid_logs.load import read_log

CROSSOVER = Estimated(9.0, (8.0, 10.0))
ROLL = {
    "ATC_RAT_RLL_P": 0.135, "ATC_RAT_RLL_I": 0.135, "ATC_RAT_RLL_D": 0.0036, "ATC_RAT_RLL_FLTT": 20.0,
    "ATC_RAT_RLL_FLTE": 0.0, "ATC_RAT_RLL_FLTD": 20.0, "INS_GYRO_FILTER": 20.0, "SCHED_LOOP_RATE": 400.0,
}  # fmt: skip
NOTCH = {
    "INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_MODE": 0.0, "INS_HNTCH_FREQ": 80.0, "INS_HNTCH_BW": 40.0,
    "INS_HNTCH_ATT": 40.0, "INS_HNTCH_HMNCS": 1.0,
}  # fmt: skip
SPEEDS = {"rotors_hz": np.array([[90.0], [100.0], [110.0]])}
TRACKED = NOTCH | {"INS_HNTCH_MODE": 3.0, "INS_HNTCH_REF": 1.0}


def log_of(followed: dict[str, np.ndarray] | None = None, autopilot: str = "ardupilot") -> FlightLog:
    return FlightLog(
        path="", format="", autopilot=autopilot, n_bytes=0, signals={}, firmware="ArduCopter V4.6.0",
        followed=followed or {},
    )  # fmt: skip


def roll(followed: dict[str, np.ndarray] | None = None, **changes: float) -> AxisController:
    return ardupilot(log_of(followed), ROLL | changes).axes["roll"]


def named(costs: tuple[FilterCost, ...]) -> dict[str, FilterCost]:
    return {cost.name: cost for cost in costs}


def line(frequency_hz: float, source: LineSource) -> Line:
    return Line(frequency_hz=frequency_hz, height_db=20.0, p_value=0.0, share=1.0, rms=1.0, source=source)


def phase_deg(name: str, controller: AxisController) -> float:
    found = named(filter_costs(controller, CROSSOVER))[name].phase_deg
    assert found is not None
    return found.value


def lost_deg(with_it: AxisController, without: AxisController) -> float:
    """Return the phase that the whole controller has less with a filter, at the crossover."""
    first, second = (on_rate(each, np.array([9.0]))[0] for each in (with_it, without))
    return float(np.degrees(np.angle(second / first)))


def test_the_low_pass_of_the_gyro_costs_what_the_loop_gains_without_it() -> None:
    assert phase_deg("INS_GYRO_FILTER", roll()) == pytest.approx(lost_deg(roll(), roll(INS_GYRO_FILTER=0.0)))


def test_the_filter_of_d_costs_what_the_loop_gains_without_it() -> None:
    """Which is less than its own phase of 24 degrees: P does not pass it."""
    cost_deg = phase_deg("ATC_RAT_RLL_FLTD", roll())
    assert cost_deg == pytest.approx(lost_deg(roll(), roll(ATC_RAT_RLL_FLTD=0.0)))
    assert cost_deg < 24.0


def test_the_filter_of_the_error_costs_what_the_loop_gains_without_it() -> None:
    filtered = roll(ATC_RAT_RLL_FLTE=10.0)
    assert phase_deg("ATC_RAT_RLL_FLTE", filtered) == pytest.approx(lost_deg(filtered, roll()))


def test_a_notch_costs_what_the_loop_gains_without_it() -> None:
    """About 360 x 9 Hz x 0.58 / (2 pi 80 Hz) = 3.8 degrees."""
    notched = roll(**NOTCH)
    assert phase_deg("INS_HNTCH", notched) == pytest.approx(lost_deg(notched, roll()))
    assert phase_deg("INS_HNTCH", notched) == pytest.approx(3.8, abs=0.2)


def test_a_notch_that_moved_costs_what_the_loop_gains_without_it() -> None:
    notched = roll(SPEEDS, **TRACKED)
    assert phase_deg("INS_HNTCH", notched) == pytest.approx(lost_deg(notched, roll()))


def test_all_of_the_gyros_path_costs_the_sum() -> None:
    found = roll(**NOTCH)
    each = sum(phase_deg(name, found) for name in ("INS_HNTCH", "INS_GYRO_FILTER"))
    assert phase_deg("", found) == pytest.approx(each)


def test_the_interval_of_a_cost_is_that_of_the_crossover() -> None:
    cost = named(filter_costs(roll(), CROSSOVER))["INS_GYRO_FILTER"].phase_deg
    assert cost is not None
    ends = [
        filter_costs(roll(), Estimated(hz, (hz, hz)))[0].phase_deg.value  # type: ignore[union-attr]
        for hz in (8.0, 10.0)
    ]
    assert cost.ci95 == pytest.approx(tuple(ends))


def test_the_named_filters_of_the_gyro_are_those_of_the_loop() -> None:
    found, frequency_hz = roll(SPEEDS, **TRACKED), np.array([1.0, 9.0, 70.0])
    told = in_series([one.filter for one in found.filters if one.place is FilterPlace.GYRO], frequency_hz)
    np.testing.assert_allclose(told, gyro_filters(found, frequency_hz), rtol=1e-12)


@pytest.mark.corpus
@pytest.mark.parametrize("name", ["firmware/bf_quad_sticks.bbl", "firmware/px4_quad_multisine.ulg"])
def test_the_named_filters_of_a_log_are_those_of_its_loop(corpus: Path, name: str) -> None:
    log, frequency_hz = read_log(corpus / name), np.array([1.0, 9.0, 70.0])
    found = autopilot_of(log.autopilot).controllers(log, log.parameters)
    assert found is not None
    for one in found.axes.values():
        assert one.filters
        told = in_series([f.filter for f in one.filters if f.place is FilterPlace.GYRO], frequency_hz)
        np.testing.assert_allclose(told, gyro_filters(one, frequency_hz), rtol=1e-9)


def test_without_a_crossover_no_phase_is_told() -> None:
    assert {cost.phase_deg for cost in filter_costs(roll(), None)} == {None}


def test_a_notch_on_a_line_takes_its_depth_away() -> None:
    lines = [line(80.0, LineSource.FIXED)]
    found = named(filter_costs(roll(**NOTCH), None, lines))["INS_HNTCH"]
    assert found.at_lines_db == pytest.approx((-40.0,))


def test_a_notch_that_follows_the_rotors_takes_its_depth_from_their_line() -> None:
    lines = [line(100.0, LineSource.ROTOR)]
    found = named(filter_costs(roll(SPEEDS, **TRACKED), None, lines))["INS_HNTCH"]
    assert found.at_lines_db == pytest.approx((-40.0,), abs=0.01)


def test_a_notch_that_follows_the_rotors_is_on_a_standing_line_only_now_and_then() -> None:
    """At 100 Hz a third of the flight; beside it x - 1/x against 1 / Q = 0.583, x over the sampler's warp."""
    lines = [line(100.0, LineSource.FIXED)]
    (gain_db,) = named(filter_costs(roll(SPEEDS, **TRACKED), None, lines))["INS_HNTCH"].at_lines_db
    x = np.tan(0.1 * np.pi) / np.tan(1e-3 * np.pi * np.array([90.0, 110.0]))
    off = (x - 1.0 / x) / (80.0 / 60.0 - 60.0 / 80.0)
    assert gain_db == pytest.approx(10.0 * np.log10(np.sum(off**2 / (1.0 + off**2)) / 3.0), abs=0.01)


def test_a_low_pass_takes_half_of_the_power_at_its_cut_off() -> None:
    found = filter_costs(roll(INS_GYRO_FILTER=40.0), None, [line(40.0, LineSource.FIXED)])[0]
    assert found.at_lines_db == pytest.approx((-3.01,), abs=0.01)


def test_px4_names_its_filters_in_the_order_of_the_signal() -> None:
    parameters = {
        "MC_YAWRATE_P": 0.2, "MC_YAWRATE_I": 0.1, "MC_YAWRATE_D": 0.003, "MC_YAWRATE_K": 1.0,
        "MC_YR_INT_LIM": 0.3, "MC_YAW_TQ_CUTOFF": 2.0, "IMU_GYRO_CUTOFF": 40.0, "IMU_DGYRO_CUTOFF": 30.0,
        "IMU_GYRO_NF0_FRQ": 90.0, "IMU_GYRO_NF0_BW": 20.0,
    }  # fmt: skip
    yaw = px4(replace(log_of(autopilot="px4"), firmware="PX4 v1.18.0"), parameters).axes["yaw"]
    names = [cost.name for cost in filter_costs(yaw, CROSSOVER)]
    assert names == ["IMU_GYRO_NF0", "IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF", "MC_YAW_TQ_CUTOFF", ""]


def test_filters_that_together_turn_by_more_than_half_a_circle_cost_more_than_that() -> None:
    """At 30 Hz a low-pass of 10 Hz takes 152 degrees, and a notch of 45 Hz some 30 more."""
    found = roll(INS_GYRO_FILTER=10.0, **NOTCH | {"INS_HNTCH_FREQ": 45.0, "INS_HNTCH_BW": 20.0})
    (*_, together) = filter_costs(found, Estimated(30.0, (30.0, 30.0)))
    gyro = [c for c in filter_costs(found, Estimated(30.0, (30.0, 30.0))) if c.place is FilterPlace.GYRO]
    assert together.phase_deg is not None
    each = [cost.phase_deg.value for cost in gyro if cost.name and cost.phase_deg is not None]
    assert together.phase_deg.value == pytest.approx(sum(each))
    assert together.phase_deg.value > 180.0
