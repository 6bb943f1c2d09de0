"""A table has no land detector: thrust tells when the vehicle is carried."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.align import clean
from quadid_logs.align.flights import find_flights
from quadid_logs.data.flight import FlightData
from quadid_logs.data.settings import AlignSettings

from .flights import align, flight_log, motion, signal

TIME_S = np.arange(0.0, 60.0, 0.01)
HOVER_N, IDLE_N = 0.44, 0.035


def table(
    thrust_n: np.ndarray, name: str = "thrust_n", *, moves: np.ndarray | bool = True, **more: np.ndarray
) -> FlightData:
    """Return the flights of a table with that thrust: its torque never stops, as on a running motor."""
    others = [signal(key, TIME_S, values[:, np.newaxis]) for key, values in more.items()]
    log = flight_log(
        signal("body_rate", TIME_S, motion(TIME_S) * np.broadcast_to(moves, TIME_S.shape)[:, np.newaxis]),
        signal("torque_n_m", TIME_S, 1e-4 * motion(TIME_S)),
        signal(name, TIME_S, thrust_n[:, np.newaxis]),
        *others,
        format="table",
        autopilot="other",
    )
    return align(log, AlignSettings())


def thrust(
    *, start_s: float = 5.0, end_s: float = 50.0, hover: float = HOVER_N, idle: float = IDLE_N
) -> np.ndarray:
    return np.where((start_s < TIME_S) & (end_s > TIME_S), hover, idle)


@pytest.mark.parametrize(
    ("name", "hover", "idle"),
    [("thrust_n", HOVER_N, IDLE_N), ("thrust_n", 26.0, 1.5), ("throttle", 0.63, 0.153)],
)
def test_flight_is_where_thrust_carries_the_vehicle(name: str, hover: float, idle: float) -> None:
    """Whatever it weighs, and with idling motors above the throttle of no motor."""
    (flight,) = table(thrust(hover=hover, idle=idle), name).flights
    assert flight == pytest.approx((6.0, 49.0), abs=0.3)


def test_thrust_that_falls_away_in_a_manoeuvre_ends_no_flight() -> None:
    """A third of a second of free fall, and weight again."""
    dipped = np.where((TIME_S > 20.0) & (TIME_S < 20.3), 0.0, thrust())
    assert len(table(dipped).flights) == 1


def test_a_touch_down_between_two_hops_is_in_no_flight() -> None:
    """Two seconds on the ground, motors idling."""
    rests = (TIME_S > 20.0) & (TIME_S < 22.0)
    assert len(table(np.where(rests, IDLE_N, thrust()), moves=~rests).flights) == 2


def test_a_fall_of_two_seconds_is_part_of_a_flight() -> None:
    """The vehicle turns on, which nothing does on the ground."""
    falls = (TIME_S > 20.0) & (TIME_S < 22.0)
    assert len(table(np.where(falls, IDLE_N, thrust())).flights) == 1


def test_some_absurd_thrusts_move_no_boundary() -> None:
    """Six of six thousand samples, as of an ESC that stutters."""
    absurd = thrust()
    absurd[np.linspace(1000, 4500, 6).astype(int)] = 5e4
    (flight,) = table(absurd).flights
    assert flight == pytest.approx((6.0, 49.0), abs=0.3)


def test_a_land_detector_is_believed_before_thrust() -> None:
    """An autopilot that says that it flies may dive with its motors at rest."""
    dive = np.where((TIME_S > 20.0) & (TIME_S < 22.0), IDLE_N, thrust(start_s=-1.0, end_s=61.0))
    assert len(table(dive, landed=np.zeros(TIME_S.size)).flights) == 1


def on_a_bench(rate_deg_s: np.ndarray, *signals: str) -> FlightData:
    """Return the flights of a table whose motors run up and down while the rates are these."""
    steps = 0.6 + 0.05 * np.sin(0.7 * TIME_S)
    log = flight_log(
        signal("body_rate", TIME_S, np.radians(rate_deg_s)),
        signal("torque_n_m", TIME_S, 1e-3 * motion(TIME_S)),
        *(signal(name, TIME_S, steps[:, np.newaxis]) for name in signals),
        format="table",
        autopilot="other",
    )
    return align(log, AlignSettings())


@pytest.mark.parametrize("signals", [("thrust_n",), ("throttle",), ()])
def test_rotors_that_run_on_a_bench_are_no_flight(signals: tuple[str, ...]) -> None:
    """Thrust changes and the gyro is noisy, but nothing turns."""
    noise = 0.5 * np.random.default_rng(0).standard_normal((TIME_S.size, 3))
    found = on_a_bench(noise, *signals)
    assert found.flights == ()
    assert "bench" in found.on_ground_reason


@pytest.mark.parametrize("signals", [("thrust_n",), ()])
def test_a_calm_hover_is_a_flight(signals: tuple[str, ...]) -> None:
    """One axis that sways by half a degree per second rms is enough."""
    noise = 0.5 * np.random.default_rng(0).standard_normal((TIME_S.size, 3))
    noise[:, 1] += 0.7 * np.sin(2.0 * np.pi * 0.4 * TIME_S)
    assert len(on_a_bench(noise, *signals).flights) == 1


def test_an_autopilot_that_says_it_flies_is_believed_on_a_bench() -> None:
    """Its land detector knows more than a table."""
    assert len(on_a_bench(np.zeros((TIME_S.size, 3)), "armed").flights) == 1


def test_a_clock_that_jumped_a_millennium_ahead_costs_no_memory() -> None:
    """Found by damage: the fifths of a second of 30 billion seconds do not fit into any machine."""
    time_s = np.append(TIME_S, 3e10)
    table = clean(flight_log(*(signal(name, TIME_S, motion(TIME_S)) for name in ("body_rate", "torque_n_m"))))
    late = {
        name: replace(series[0], time_s=time_s, stored=np.vstack([series[0].values, np.ones(3)]))
        for name, series in table.candidates.items()
    }
    assert len(find_flights(late, (0.0, 3e10)).intervals) == 1
