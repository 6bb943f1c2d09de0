"""Earlier flights narrow what is known of a vehicle, and no more than their errors allow."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from quadid_logs.control.earlier_flights import by_earlier
from quadid_logs.control.earlier_flights import with_earlier as joined
from quadid_logs.data.closed_loop import AxisLoop, Plant
from quadid_logs.data.controller import Replay
from quadid_logs.data.diagnosis import AxisVerdict, Finding
from quadid_logs.data.off_nominal import AS_FLOWN
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import AxisTuning
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


@pytest.mark.thorough
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


@pytest.mark.thorough
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


def test_the_controller_of_the_first_flight_stays_known() -> None:
    """With it the pilot came: what steps on the way made faster is no wish."""
    second = calmer(flown("ardupilot"))
    loop = second.closed_loop
    assert loop is not None
    other = replace(loop.controllers.axes["roll"])
    controllers = replace(loop.controllers, axes={**loop.controllers.axes, "roll": other})
    first = replace(second, closed_loop=replace(loop, controllers=controllers))
    both = with_earlier(flown("ardupilot"), [first, second]).closed_loop
    assert both is not None
    assert both.axes["roll"].began is other


def test_the_same_log_again_adds_nothing() -> None:
    result = flown("ardupilot")
    assert with_earlier(result, [result]) is result


def test_a_log_of_another_frame_is_refused() -> None:
    result = flown("ardupilot")
    other = replace(result, log=replace(result.log, frame="something else"))
    with pytest.raises(SettingsError, match="another vehicle"):
        with_earlier(result, [other])


def gusty(result: Result, *codes: str) -> Result:
    """Return a flight that tells nothing of roll, and why."""
    loop = result.closed_loop
    assert loop is not None
    against = tuple(
        Finding(code=code, level="error", title="", evidence={}, advice="", axes=("roll",)) for code in codes
    )
    refused = AxisVerdict(verdict="refused", reasons=codes, sentence="")
    diagnosis = replace(
        result.diagnosis,
        findings=(*result.diagnosis.findings, *against),
        axes={**result.diagnosis.axes, "roll": refused},
    )
    axes = {**loop.axes, "roll": AxisLoop(replay=loop.axes["roll"].replay)}
    return replace(result, diagnosis=diagnosis, closed_loop=replace(loop, axes=axes))


def calmer(result: Result, effectiveness: float = 1.0) -> Result:
    """Return another flight, which tells of a vehicle so many times as effective about roll."""
    loop = result.closed_loop
    assert loop is not None
    roll = loop.axes["roll"]
    assert roll.plants is not None
    rows = tuple(replace(one, torque=0.5 * one.torque) for one in result.data.segments)
    axes = {**loop.axes, "roll": replace(roll, plants=roll.plants.times(effectiveness))}
    return replace(result, data=replace(result.data, segments=rows), closed_loop=replace(loop, axes=axes))


def without_posterior(result: Result) -> Result:
    (model, *others) = result.identification.models
    models = (replace(model, posterior=None), *others)
    return replace(result, identification=replace(result.identification, models=models))


@cache
def left_to_earlier() -> AxisTuning:
    """Return the gains of roll after a gusty flight and a calmer one, which take a search."""
    result = with_earlier(gusty(flown("ardupilot"), "QL504"), [calmer(flown("ardupilot"))])
    return recommend(result, axes=["roll"], ranges=AS_FLOWN).axes["roll"]


def reasons(result: Result) -> list[str]:
    return [one.code for one in recommend(result, axes=["roll"], ranges=AS_FLOWN).axes["roll"].reasons]


@pytest.mark.thorough
def test_an_axis_that_gusts_hide_is_tuned_from_an_earlier_flight() -> None:
    assert left_to_earlier().verdict == "change"


def test_that_gains_follow_from_earlier_flights_is_told() -> None:
    assert "QL627" in [one.code for one in left_to_earlier().reasons]


def test_without_earlier_flights_an_axis_that_gusts_hide_is_refused() -> None:
    assert reasons(gusty(flown("ardupilot"), "QL504")) == ["QL615"]


def test_an_axis_that_something_contradicts_is_not_left_to_earlier_flights() -> None:
    """A wrong sign is no lack of information."""
    found = with_earlier(gusty(flown("ardupilot"), "QL504", "QL506"), [calmer(flown("ardupilot"))])
    assert reasons(found) == ["QL615"]


def test_an_axis_whose_controller_did_not_replay_is_not_left_to_earlier_flights() -> None:
    now = gusty(flown("ardupilot"), "QL504")
    assert now.closed_loop is not None
    other = AxisLoop(replay=Replay(relative_rms={}, agrees=False))
    now = replace(now, closed_loop=replace(now.closed_loop, axes={**now.closed_loop.axes, "roll": other}))
    found = with_earlier(now, [calmer(flown("ardupilot"))])
    assert "roll" not in found.earlier[0].axes
    assert "QL612" in reasons(found)


def test_what_little_a_flight_tells_may_contradict_earlier_ones() -> None:
    """Without set-points, its fit alone."""
    now = gusty(flown("ardupilot"), "QL504")
    rows = tuple(replace(one, reference=None) for one in now.data.segments)
    now = replace(now, data=replace(now.data, segments=rows))
    found = with_earlier(now, [calmer(flown("ardupilot"), 2.0)])
    assert found.earlier[0].differ == ("roll",)
    assert "QL626" in reasons(found)


def test_the_response_that_a_flight_shows_may_contradict_earlier_ones() -> None:
    """Whatever its fit says, set-points show another vehicle."""
    now = without_posterior(gusty(flown("ardupilot"), "QL504"))
    found = with_earlier(now, [calmer(flown("ardupilot"), 2.0)])
    assert found.earlier[0].differ == ("roll",)


def test_earlier_flights_that_tell_of_two_vehicles_leave_an_axis_refused() -> None:
    result = flown("ardupilot")
    third = calmer(result, 2.0)
    rows = tuple(replace(one, torque=0.25 * one.torque) for one in result.data.segments)
    third = replace(third, data=replace(third.data, segments=rows))
    assert "QL626" in reasons(with_earlier(gusty(result, "QL504"), [third, calmer(result)]))


@pytest.mark.thorough
def test_intervals_of_earlier_flights_hold_a_vehicle_that_differs_from_flight_to_flight() -> None:
    """Of battery and air: 5.3 % of its effectiveness, 15 % of its damping, 1 ms (95 %)."""
    result = without_posterior(flown("ardupilot"))
    model = result.identification.recommended
    assert model is not None
    nothing = replace(result.data, segments=())
    random, inside = np.random.default_rng(5), []
    error, between = 0.3 * ERROR, np.array([15.9, 0.3, 0.0, 0.001]) / 1.96
    for seed in range(80):
        one = told(TRUTH + error * random.standard_normal(4), error, seed)
        truth = TRUTH + between * random.standard_normal(4)
        plants = by_earlier(AxisLoop(), nothing, model, 0, CONTROLLER, [one]).loop.plants
        assert plants is not None
        low, high = np.quantile(np.stack(plants[:4])[:, 1:], (0.025, 0.975), axis=1)
        inside.append((low <= truth) & (high >= truth))
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.95) < 0.05)
