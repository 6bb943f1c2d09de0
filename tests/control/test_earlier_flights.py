"""Earlier flights narrow what is known of a vehicle, and no more than their errors allow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.control.earlier_flights import with_earlier as joined
from quadid_logs.data.closed_loop import AxisLoop, Plant
from quadid_logs.earlier import with_earlier
from quadid_logs.errors import SettingsError
from quadid_logs.tuning import recommend
from tests.control.loop_flights import Vehicle
from tests.tuned_flights import flown

CONTROLLER = Vehicle(P=0.05, D=0.0008).controller
#: Effectiveness, damping, lag and delay.
TRUTH = np.array([300.0, -2.0, 0.03, 0.004])
ERROR = np.array([15.0, 0.5, 0.001, 0.0004])
N = 400


def told(estimate: np.ndarray, error: np.ndarray = ERROR, seed: int = 0) -> AxisLoop:
    """Return what a flight tells of a vehicle: an estimate, and others as far off as it may be."""
    drawn = estimate + error * np.random.default_rng(seed).standard_normal((N, 4))
    return AxisLoop(plants=Plant(*np.vstack([estimate, drawn]).T), known_hz=5.0)


def half_widths(loop: AxisLoop) -> np.ndarray:
    assert loop.plants is not None
    return np.array([1.96 * np.std(each[1:]) for each in loop.plants[:4]])


def test_a_second_flight_narrows_the_effectiveness() -> None:
    found = joined(told(TRUTH), CONTROLLER, [told(TRUTH)]).loop
    assert half_widths(found)[0] == pytest.approx(1.96 * 15.0 / np.sqrt(2.0), rel=0.1)


def test_two_flights_alike_do_not_narrow_what_both_may_have_wrong_alike() -> None:
    found = joined(told(TRUTH), CONTROLLER, [told(TRUTH)]).loop
    np.testing.assert_allclose(half_widths(found)[1:], 1.96 * ERROR[1:], rtol=0.1)


def test_a_flight_that_tells_the_lag_better_narrows_it() -> None:
    vague = told(TRUTH, ERROR * np.array([1.0, 1.0, 5.0, 1.0]))
    found = joined(vague, CONTROLLER, [told(TRUTH)]).loop
    assert half_widths(found)[2] < 0.3 * half_widths(vague)[2]


def test_joined_intervals_hold_the_truth_where_errors_of_lag_and_delay_are_the_same_in_all_flights() -> None:
    random, inside = np.random.default_rng(3), []
    for seed in range(60):
        shared = ERROR * random.standard_normal(4) * [0.0, 1.0, 1.0, 1.0]
        flights = [
            told(TRUTH + shared + ERROR * random.standard_normal(4) * [1.0, 0.0, 0.0, 0.0], seed=seed + place)
            for place in range(3)
        ]
        plants = joined(flights[2], CONTROLLER, flights[:2]).loop.plants
        assert plants is not None
        low, high = np.quantile(np.stack(plants[:4])[:, 1:], (0.025, 0.975), axis=1)
        inside.append((low <= TRUTH) & (high >= TRUTH))
    assert np.mean(inside) >= 0.9


def test_a_flight_of_another_vehicle_narrows_nothing_and_is_told() -> None:
    now, other = told(TRUTH), told(TRUTH * [1.5, 1.0, 1.0, 1.0])
    assert joined(now, CONTROLLER, [told(TRUTH), other]) == (now, (), (1,))


def test_flights_of_one_vehicle_seldom_tell_of_two() -> None:
    random, alarms = np.random.default_rng(8), 0
    for seed in range(100):
        flights = [told(TRUTH + ERROR * random.standard_normal(4), seed=seed + place) for place in range(4)]
        alarms += bool(joined(flights[3], CONTROLLER, flights[:3]).differ)
    assert alarms <= 10


def test_margins_are_those_of_the_joined_vehicles() -> None:
    both = joined(told(TRUTH), CONTROLLER, [told(TRUTH)]).loop
    again = joined(both, CONTROLLER, []).loop
    assert again is both
    assert both.margins is not None
    assert both.margins.rate.crossover_hz is not None
    width = np.subtract(*both.margins.rate.crossover_hz.ci95[::-1])
    alone = joined(told(TRUTH), CONTROLLER, [told(TRUTH, 10.0 * ERROR)]).loop
    assert alone.margins is not None
    assert alone.margins.rate.crossover_hz is not None
    assert width < np.subtract(*alone.margins.rate.crossover_hz.ci95[::-1])


def test_an_axis_that_an_earlier_flight_contradicts_is_not_tuned() -> None:
    result = flown("ardupilot")
    loop = result.closed_loop
    assert loop is not None
    roll = loop.axes["roll"]
    assert roll.plants is not None
    axes = {**loop.axes, "roll": replace(roll, plants=roll.plants.times(2.0))}
    rows = tuple(replace(one, torque=0.5 * one.torque) for one in result.data.segments)
    other = replace(result, data=replace(result.data, segments=rows), closed_loop=replace(loop, axes=axes))
    both = with_earlier(result, [other])
    assert both.earlier[0].differ == ("roll",)
    assert [one.code for one in recommend(both, axes=["roll"]).axes["roll"].reasons] == ["QL626"]


def test_the_same_log_again_adds_nothing() -> None:
    result = flown("ardupilot")
    assert with_earlier(result, [result]) is result


def test_a_log_of_another_frame_is_refused() -> None:
    result = flown("ardupilot")
    other = replace(result, log=replace(result.log, frame="something else"))
    with pytest.raises(SettingsError, match="another vehicle"):
        with_earlier(result, [other])
