"""Filters respond as their steps do, and the controllers made of them give the margins that were measured."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from quadid_logs.autopilots import discrete, named
from quadid_logs.data.controller import AxisController, DiscreteFilter
from quadid_logs.data.log import Notch
from quadid_logs.errors import ShapeError
from tests.control.flown_controller import AP_PID, AP_YAW, ApFlight, Px4Flight

T = 0.0025
FILTERS = {
    "first order": discrete.first_order(20.0, T),
    "integrator times slope": discrete.integrator(T) * discrete.derivative(T),
    "butterworth": discrete.butterworth(30.0, T),
    "notch": discrete.notch(Notch(40.0, 0.5, 0.1), T),
    "sum": discrete.gain(0.5, T) + discrete.first_order(5.0, T).scaled(2.0),
}


@pytest.mark.parametrize("name", FILTERS)
def test_the_response_is_that_of_the_steps_to_a_sine(name: str) -> None:
    one = FILTERS[name]
    time = T * np.arange(8000)
    for frequency_hz in (1.0, 7.0, 40.0, 120.0):
        out = signal.lfilter(one.numerator, one.denominator, np.exp(2j * np.pi * frequency_hz * time))
        settled = out[-1] / np.exp(2j * np.pi * frequency_hz * time[-1])
        assert one.response(np.array(frequency_hz)) == pytest.approx(settled, abs=2e-3)


def test_a_low_pass_without_cut_off_changes_nothing() -> None:
    assert discrete.first_order(0.0, T).response(np.array([3.0])) == pytest.approx(1.0)


def test_a_butterworth_filter_has_minus_3_db_and_90_degrees_at_its_cut_off() -> None:
    found = discrete.butterworth(20.0, 1e-3).response(np.array(20.0))
    assert found == pytest.approx(-1j * np.sqrt(0.5), abs=1e-9)


def test_a_notch_leaves_its_depth_at_the_centre_and_half_the_power_at_its_width() -> None:
    notch = discrete.notch(Notch(60.0, 0.5, 0.0), 1e-3)
    centre, edge = np.abs(notch.response(np.array([60.0, 60.0 * (np.sqrt(1.0625) + 0.25)])))
    assert centre == pytest.approx(0.0, abs=1e-9)
    assert edge == pytest.approx(np.sqrt(0.5), abs=0.02)  # the bilinear transform narrows it a little


def test_a_shallow_notch_leaves_its_depth_at_the_centre() -> None:
    notch = discrete.notch(Notch(60.0, 0.5, 0.25), 1e-3)
    assert abs(notch.response(np.array(60.0))) == pytest.approx(0.25, abs=1e-9)


def test_filters_of_different_periods_do_not_combine() -> None:
    with pytest.raises(ShapeError):
        discrete.unit(T) * discrete.unit(2 * T)


@pytest.mark.parametrize(
    ("numerator", "denominator", "period_s"), [([1.0], [0.0], T), ([1.0], [1.0], 0.0), ([[1.0]], [1.0], T)]
)
def test_a_filter_that_is_none_is_refused(numerator: list, denominator: list, period_s: float) -> None:
    with pytest.raises(ShapeError):
        DiscreteFilter(numerator, denominator, period_s)


def axes(flight: ApFlight | Px4Flight, parameters: dict | None = None) -> dict[str, AxisController]:
    log = flight.log(parameters=parameters)
    controllers = named(log.autopilot).controllers(log, log.parameters)
    assert controllers is not None
    return dict(controllers.axes)


def margins(controller: AxisController, gain: float, damping: float, lag_s: float) -> tuple[float, ...]:
    """Return crossover [Hz], phase margin [deg] and gain margin [dB] of the rate loop."""
    f = np.geomspace(0.05, 100.0, 40_000)
    s, hold_s = 2j * np.pi * f, controller.period_s
    hold = np.exp(-0.5 * s * hold_s) * np.sinc(f * hold_s)
    plant = hold * gain / (s + damping) / (1.0 + lag_s * s)
    law = controller.error.response(f) + (controller.rate.response(f) if controller.rate else 0.0)
    law = law * (controller.command.response(f) if controller.command else 1.0)
    loop = plant * law * np.prod([one.response(f) for one in controller.gyro], axis=0)
    cross = int(np.flatnonzero(np.abs(loop) > 1.0)[-1])
    axis = np.flatnonzero((loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (f[1:] > f[cross]))[0]
    return f[cross], 180.0 + np.degrees(np.angle(loop[cross])), -20.0 * np.log10(abs(loop[axis]))


def test_the_ardupilot_rate_loop_has_the_margins_of_the_reference() -> None:
    """Roll of the truth quad: 20.0 Hz, 19.9 degrees, 3.0 dB; computed outside of this package."""
    flight = ApFlight(n=2000, pids=dict.fromkeys(("roll", "pitch", "yaw"), AP_YAW | ROLL))
    found = margins(axes(flight)["roll"], 437.5, 2.0, 0.0)
    assert found == pytest.approx((20.0, 19.9, 2.96), rel=0.01)


def test_the_px4_rate_loop_has_the_margins_of_the_reference() -> None:
    """Roll of the firmware in simulation: 2.34 Hz, 63.8 degrees, 21.5 dB; computed outside of it."""
    found = margins(axes(Px4Flight(n=2000), {"MC_ROLLRATE_I": 0.2})["roll"], 113.07, 1.0, 0.0474)
    assert found == pytest.approx((2.34, 63.8, 21.5), rel=0.01)


def impulse_response(flight: ApFlight | Px4Flight) -> np.ndarray:
    error = axes(flight)["roll"].error
    return signal.lfilter(error.numerator, error.denominator, np.r_[1.0, np.zeros(3)])


def test_the_px4_integral_answers_a_loop_late() -> None:
    later = 0.05 * 0.004
    # Of the stamps' median the period is known to some 1e-9 of it.
    assert impulse_response(Px4Flight(n=2000)) == pytest.approx([0.15, later, later, later], rel=1e-6)


def test_the_ardupilot_error_path_answers_with_p_i_and_d_at_once() -> None:
    alpha = T / (T + 1.0 / (2.0 * np.pi * 20.0))
    first = AP_PID["P"] + AP_PID["I"] * T + AP_PID["D"] * alpha / T
    assert impulse_response(ApFlight(n=2000))[0] == pytest.approx(first, rel=1e-9)


def test_px4s_k_multiplies_p_i_and_d() -> None:
    """`tune` writes MC_ROLLRATE_K alone, for all three."""
    one, two = (axes(Px4Flight(n=2000), {"MC_ROLLRATE_K": k})["roll"] for k in (1.0, 2.0))
    where_hz = np.array([0.5, 5.0, 50.0])
    assert one.rate is not None
    assert two.rate is not None
    np.testing.assert_allclose(two.rate.response(where_hz), 2.0 * one.rate.response(where_hz))
    np.testing.assert_allclose(two.error.response(where_hz), 2.0 * one.error.response(where_hz))


@pytest.mark.parametrize(("number", "rate_hz"), [(0.0, 1e3), (1.0, 2e3), (2.0, 4e3), (3.0, 8e3)])
def test_ardupilots_gyro_rates_are_powers_of_two(number: float, rate_hz: float) -> None:
    """INS_GYRO_RATE: 0 is 1 kHz, 1 is 2 kHz, 2 is 4 kHz, 3 is 8 kHz."""
    found = axes(ApFlight(n=2000), {"INS_GYRO_RATE": number})["roll"]
    assert found.gyro[-1].period_s == pytest.approx(1.0 / rate_hz)


def test_the_px4_gyro_is_faster_than_a_loop_at_its_limit_and_as_fast_as_one_that_waits() -> None:
    waiting = axes(Px4Flight(n=2000), {"IMU_GYRO_RATEMAX": 800.0})["roll"]
    assert waiting.gyro[-1].period_s == waiting.period_s
    limited = axes(Px4Flight(n=2000), {"IMU_GYRO_RATEMAX": 250.0})["roll"]
    assert limited.gyro[-1].period_s == pytest.approx(limited.period_s / 8.0)
    assert limited.rate is not None
    assert limited.rate.period_s == limited.gyro[-1].period_s


def test_the_px4_yaw_torque_passes_its_low_pass() -> None:
    found = axes(Px4Flight(n=2000))["yaw"].command
    assert found is not None
    assert abs(found.response(np.array(2.0))) == pytest.approx(np.sqrt(0.5), rel=0.03)


def test_the_rate_threads_loop_has_the_gyros_period() -> None:
    found = axes(ApFlight(n=2000), {"FSTRATE_ENABLE": 1.0, "FSTRATE_DIV": 2.0, "INS_GYRO_RATE": 1.0})
    assert found["roll"].period_s == pytest.approx(1e-3)
    assert found["roll"].gyro[-1].period_s == pytest.approx(0.5e-3)


ROLL = {"P": 0.135, "I": 0.135, "D": 0.0036, "FLTE": 0.0}


def test_a_rate_thread_runs_as_often_as_its_rows_say() -> None:
    """The parameters let it follow a gyro of 1 kHz; this one got around at 400 Hz."""
    thread = {"FSTRATE_ENABLE": 1.0, "FSTRATE_DIV": 1.0, "SCHED_LOOP_RATE": 300.0}
    assert axes(ApFlight(n=2000), thread)["roll"].period_s == pytest.approx(2507e-6, rel=2e-3)


def test_rows_slower_than_the_main_loop_do_not_tell_a_rate_threads_period() -> None:
    """They were thinned by the logger."""
    thread = {"FSTRATE_ENABLE": 1.0, "FSTRATE_DIV": 1.0, "SCHED_LOOP_RATE": 500.0}
    assert axes(ApFlight(n=2000), thread)["roll"].period_s == pytest.approx(0.001)


def test_the_px4_d_filter_is_of_second_order_where_the_firmware_knows_one_notch_only() -> None:
    """At twice its cut-off a filter of second order passes a quarter, one of first order about half."""
    fast = {"IMU_GYRO_RATEMAX": 250.0, "IMU_GYRO_NF_FREQ": 0.0}
    older = axes(Px4Flight(n=2000), fast)["roll"].rate
    newer = axes(Px4Flight(n=2000), fast | {"IMU_GYRO_NF0_FRQ": 0.0})["roll"].rate
    assert older is not None
    assert newer is not None
    frequency_hz = np.array([1.0, 40.0])
    slope = 2.0 * np.pi * frequency_hz * 0.003
    passed = [np.abs(each.response(frequency_hz)) / slope for each in (older, newer)]
    assert passed[0] == pytest.approx([1.0, 1.0 / np.sqrt(17.0)], rel=0.02)
    assert passed[1] == pytest.approx([1.0, 1.0 / np.sqrt(5.0)], rel=0.03)


def test_a_filter_that_moved_answers_each_shape_and_set_of_frequencies_anew() -> None:
    """What it remembers is of exactly these frequencies."""
    places = ((Notch(60.0, 0.5, 0.0),), (Notch(90.0, 0.5, 0.0),))
    kept = discrete.moving(places, 1e-3)
    asked = (np.array([10.0, 20.0]), np.array([[10.0], [20.0]]), np.array(30.0), np.array([10.0, 30.0]))
    for frequency_hz in asked:
        expected = sum(discrete.notch(one, 1e-3).response(frequency_hz) for (one,) in places) / 2.0
        np.testing.assert_allclose(kept.response(frequency_hz), expected, rtol=1e-12)
