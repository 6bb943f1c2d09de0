"""What the set-points predict of a flight whose vehicle and controller are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.control.frequency_response import lines_of
from quadid_logs.control.prediction import (
    AxisModel,
    Chirp,
    _answers,
    _changes,
    _Search,
    predict,
)
from quadid_logs.data.closed_loop import Plant, Prediction
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import FitSeries
from tests.control.loop_flights import AXES, PERIOD_S, flight

TRUE = AXES["roll"]
KNOWN = np.diag([0.05, 2e-4, 2e-4, 0.0]) ** 2


@pytest.fixture(scope="module")
def data() -> FlightData:
    return flight(gust=1.0)


def predicted(data: FlightData, factor: float = 1.0, *, at_mixer: bool = False) -> Prediction:
    """Predict roll with a vehicle that is so many times as effective as the true one; a third is held out."""
    time_s = data.segments[0].time_s
    nothing = np.zeros((time_s.size, 3))
    fit = FitSeries(
        time_s=time_s,
        acceleration=nothing,
        modelled_acceleration=nothing,
        rate=nothing,
        simulated_rate=nothing,
        held_out=(time_s // 5.0) % 3 == 2,
    )
    numbers = (factor * TRUE.B, TRUE.A, TRUE.lag_s, TRUE.delay_steps * PERIOD_S)
    plant = Plant(*(np.array([number]) for number in numbers))
    axis = AxisModel(0, TRUE.controller, plant, KNOWN, Chirp(at_mixer=at_mixer, delay_s=PERIOD_S))
    lines = lines_of(data, 0, PERIOD_S)
    assert lines is not None
    found = predict(data, axis, fit, lines, 0.3)
    assert found is not None
    return found


def test_the_true_vehicle_predicts_all_that_any_linear_system_could(data: FlightData) -> None:
    """Gusts are not in the set-points; what is left of the torque is theirs."""
    found = predicted(data)
    assert found.rate_fit_percent > 95.0
    assert found.torque_fit_percent > 0.97 * found.attainable_percent
    assert found.held_out_s == pytest.approx(20.0, abs=0.1)


def test_without_gusts_the_prediction_is_exact() -> None:
    found = predicted(flight(seconds=40.0))
    assert found.rate_fit_percent > 99.5
    assert found.torque_fit_percent > 99.0


def test_a_wrong_effectiveness_predicts_less_of_the_torque(data: FlightData) -> None:
    """To bring the rate to its set-point takes another torque of another vehicle."""
    right, wrong = predicted(data), predicted(data, 1.2)
    assert right.torque_fit_percent - wrong.torque_fit_percent > 8.0


@pytest.mark.parametrize("factor", [0.8, 1.0, 1.3])
def test_the_closed_loop_finds_the_effectiveness_wherever_it_begins(data: FlightData, factor: float) -> None:
    """Its interval holds the truth, and is narrow."""
    found = predicted(data, factor).effectiveness
    low, high = found.ci95
    assert low <= TRUE.B <= high
    assert found.value == pytest.approx(TRUE.B, rel=0.02)
    assert high - low < 0.15 * TRUE.B


@pytest.mark.parametrize("number", [0, 1, 2, 3, 4])
def test_derivatives_of_the_predicted_torque_are_those_of_finite_differences(
    data: FlightData, number: int
) -> None:
    """By effectiveness (relative), damping, lag, delay and reaction: the interval rests on them."""

    def reacting(step: float, number: int) -> Plant:
        numbers = [TRUE.B, TRUE.A, TRUE.lag_s, TRUE.delay_steps * PERIOD_S, 0.05 * TRUE.B]
        numbers[number] += step * (TRUE.B if number == 0 else 1.0)
        # A relative change of the effectiveness is one of all that the torque does.
        lead_s = 0.05 if number == 0 else numbers[4] / numbers[0]
        return Plant(*(np.array([value]) for value in (*numbers[:4], lead_s)))

    def searched(step: float) -> _Search:
        plant = reacting(step, number)
        axis = AxisModel(0, TRUE.controller, plant, KNOWN, Chirp(at_mixer=False, delay_s=0.0))
        answers = _answers(data, axis)
        n = answers[0].segment.n_samples
        everything = np.ones(n, dtype=bool)
        nothing = np.zeros(n, dtype=np.int64)
        return _Search(answers, np.zeros(n), everything, nothing, np.concatenate, PERIOD_S)

    step = 1e-5
    change = (np.ones_like, *_changes(reacting(0.0, 1)))
    slope = searched(0.0)._slope_by(1.0, change[number])
    differences = (searched(step)._series(1.0) - searched(-step)._series(1.0)) / (2.0 * step)
    assert np.linalg.norm(slope - differences) < 1e-3 * np.linalg.norm(differences)


def test_an_excitation_at_the_mixer_is_predicted_too() -> None:
    """Left out, most of the torque of a system-ID run would be missing."""
    data = flight(seconds=60.0, chirp_hz=15.0)
    assert predicted(data, at_mixer=True).torque_fit_percent > 97.0
    assert predicted(data, at_mixer=False).torque_fit_percent < 50.0


def test_a_flight_of_a_few_seconds_is_not_predicted(data: FlightData) -> None:
    short = replace(data, segments=(data.segments[0].rows(slice(0, 2000)),))
    with pytest.raises(AssertionError):
        predicted(short)


@pytest.mark.parametrize(("marked_s", "expected"), [((5.0, 6.0), False), ((5.0, 45.0), True)])
def test_a_flight_that_is_mostly_at_the_motors_limits_is_marked(
    data: FlightData, marked_s: tuple[float, float], expected: bool
) -> None:
    """The loop was open then; a second at the limits is left out instead."""
    (segment,) = data.segments
    first_s, last_s = segment.start_s + np.array(marked_s)
    saturated = (segment.time_s >= first_s) & (segment.time_s < last_s)
    limited = replace(data, segments=(replace(segment, saturated=saturated),))
    assert predicted(limited).at_limits is expected
