"""A flight is one flight through throttle cuts and dives; it ends where the vehicle rests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs.align import flights
from quadid_logs.align.series import CleanSeries
from quadid_logs.data.flight import FlightData
from quadid_logs.data.settings import AlignSettings

from .flights import align, flight_log, motion, signal

TIME_S = np.arange(0.0, 60.0, 0.01)
#: The pilot cuts the throttle for four seconds, twice.
CUT = ((TIME_S > 20.0) & (TIME_S < 24.0)) | ((TIME_S > 40.0) & (TIME_S < 44.0))
FLOWN = (TIME_S > 5.0) & (TIME_S < 55.0)
STANDARD_GRAVITY = 9.80665


def freestyle(*, still: np.ndarray, force_g: np.ndarray | None, **more: np.ndarray) -> FlightData:
    """Return the flights of a log whose throttle is cut twice, with rates that are ``still`` at times."""
    throttle = np.where(FLOWN & ~CUT, 0.4, 0.0)[:, np.newaxis]
    rate = np.where(still[:, np.newaxis], 0.0, motion(TIME_S))
    others = dict(more)
    if force_g is not None:
        others["specific_force"] = -STANDARD_GRAVITY * force_g[:, np.newaxis] * np.array([0.0, 0.6, 0.8])
    log = flight_log(
        signal("body_rate", TIME_S, rate),
        signal("torque_command", TIME_S, 0.1 * motion(TIME_S)),
        signal("throttle", TIME_S, throttle),
        *(signal(name, TIME_S, values) for name, values in others.items()),
    )
    return align(log, AlignSettings())


@pytest.mark.parametrize("armed", [True, False])
def test_throttle_cuts_in_mid_air_end_no_flight(armed: bool) -> None:
    """The vehicle tumbles on, and its accelerometer shows no weight; with or without arming in the log."""
    state = {"armed": np.ones((TIME_S.size, 1))} if armed else {}
    (flight,) = freestyle(still=~FLOWN, force_g=np.where(CUT, 0.1, 1.0), **state).flights
    assert flight == pytest.approx((6.0, 54.0), abs=0.5)


def test_a_landing_between_two_throttles_ends_a_flight() -> None:
    """On the ground the gyro is still and the accelerometer shows its weight, askew as the ground is."""
    assert len(freestyle(still=CUT | ~FLOWN, force_g=np.ones(TIME_S.size)).flights) == 3


def test_a_dive_on_a_steady_course_ends_no_flight() -> None:
    """The gyro is still, but the accelerometer shows a fall."""
    assert len(freestyle(still=CUT, force_g=np.where(CUT, 0.2, 1.0)).flights) == 1


def test_without_an_accelerometer_a_still_gyro_tells_a_landing() -> None:
    """Nothing falls for seconds without turning by some tenths of a degree."""
    assert len(freestyle(still=CUT, force_g=None).flights) == 3
    assert len(freestyle(still=~FLOWN, force_g=None).flights) == 1


def test_a_cut_that_ends_the_log_is_no_flight() -> None:
    """Nobody knows where the vehicle is then: carried home, perhaps."""
    (flight,) = freestyle(still=np.zeros(TIME_S.size, dtype=bool), force_g=None).flights
    assert flight[1] == pytest.approx(54.0, abs=0.5)


def test_a_crashed_vehicle_with_one_motor_at_full_throttle_does_not_fly() -> None:
    """It lies still after 30 s, while the rate controller pushes one motor to its limit."""
    crashed = (TIME_S > 30.0) & (TIME_S < 40.0)
    thrust = np.full((TIME_S.size, 4), 0.3)
    thrust[crashed] = [1.0, 0.0, 0.3, 0.0]
    found = freestyle(still=crashed, force_g=np.where(CUT, 0.1, 1.0), motor_thrust=thrust)
    assert not any(a < time_s < b for time_s in (31.0, 35.0, 39.0) for a, b in found.flights)


def test_a_hover_so_calm_that_its_gyro_is_still_goes_on() -> None:
    """As simulated ones are: the motors carry it, and none is at its limit."""
    calm = (TIME_S > 28.0) & (TIME_S < 36.0)
    thrust = np.full((TIME_S.size, 4), 0.3)
    assert len(freestyle(still=calm, force_g=np.where(CUT, 0.1, 1.0), motor_thrust=thrust).flights) == 1


def test_where_no_gyro_is_logged_an_idle_throttle_ends_a_flight() -> None:
    """Nothing else tells a landing."""
    log = flight_log(signal("throttle", TIME_S, np.where(FLOWN & ~CUT, 0.4, 0.0)[:, np.newaxis]))
    assert len(align(log, AlignSettings()).flights) == 3


def test_a_flown_freestyle_log_is_one_flight(corpus: Path) -> None:
    """132 s from take-off to the end of the log, with some thirty throttle cuts."""
    from quadid_logs.load import load

    (flight,) = load(corpus / "blackbox" / "bf431-freestyle.bbl").flights
    assert flight == pytest.approx((43.0, 175.0), abs=1.0)


def test_the_log_is_summed_up_as_often_for_many_throttle_cuts_as_for_few(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A flight with hundreds of them took most of its analysis there: each was a sum over the whole log."""
    summed, mean_after = [], flights._mean_after

    def counted(series: CleanSeries, start_s: np.ndarray, length_s: float) -> np.ndarray:
        summed.append(series.name)
        return mean_after(series, start_s, length_s)

    monkeypatch.setattr(flights, "_mean_after", counted)

    def n_sums(n_cuts: int) -> int:
        summed.clear()
        up = FLOWN & (np.sin(np.pi * n_cuts * TIME_S / TIME_S[-1]) ** 2 > 0.1)
        log = flight_log(
            signal("body_rate", TIME_S, motion(TIME_S)),
            signal("throttle", TIME_S, np.where(up, 0.4, 0.0)[:, np.newaxis]),
            signal("motor_thrust", TIME_S, np.where(up, 0.4, 0.0)[:, np.newaxis] * np.ones(4)),
            signal("specific_force", TIME_S, np.tile([0.0, 0.0, -STANDARD_GRAVITY], (TIME_S.size, 1))),
        )
        align(log, AlignSettings())
        return len(summed)

    assert n_sums(30) == n_sums(3) > 0
