"""What is told of an axis where the flights of a log differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.model import Model, StructuralCheck
from quadid_logs.identify.flights_differ import with_flights_beside
from quadid_logs.vocabulary import ON_AXIS
from tests.synthetic_results import usable_result


def told(gain: list[list[float]], half_width: float) -> tuple[Model, Model]:
    """Return a model of flights with those effectivenesses over that of all, as it was and as it is told."""
    flights = np.array(gain).reshape(-1, 3)
    check = StructuralCheck(
        effects=(),
        timing=None,
        flight_gain=flights,
        flight_half_width=np.full(flights.shape, half_width),
        persistence=np.zeros(3),
        spread=np.zeros(3),
        feedback=np.zeros(3),
    )
    model = usable_result().identification.recommended
    assert model is not None
    model = replace(model, structural=check)
    return model, with_flights_beside(model)


def roll(model: Model) -> np.ndarray:
    entry = model.entries[ON_AXIS["roll"]]
    return np.array(entry.ci95) / entry.value


def test_two_packs_that_differ_are_both_inside() -> None:
    """8 % apart, each known to 1 %, and beyond each what is uncertain about all flights."""
    before, after = told([[0.96, 0.96, 0.96], [1.04, 1.04, 1.04]], 0.01)
    assert roll(after)[0] < 0.96 - (1.0 - roll(before)[0])
    assert roll(after)[1] > 1.04 + (roll(before)[1] - 1.0)


def test_flights_that_are_alike_leave_the_interval_as_it_is() -> None:
    """They differ by less than each is known to."""
    before, after = told([[0.995, 1.0, 1.0], [1.005, 1.0, 1.0]], 0.02)
    assert roll(after) == pytest.approx(roll(before))


def test_an_axis_that_hardly_shows_it_differs_with_the_others() -> None:
    """Battery and load change all axes: what pitch and yaw show holds for roll."""
    before, after = told([[0.985, 0.96, 0.96], [1.015, 1.04, 1.04]], 0.025)
    assert roll(after)[0] < roll(before)[0]
    assert roll(after)[1] > roll(before)[1]


def test_one_flight_is_left_alone() -> None:
    """There is nothing to differ from."""
    before, after = told([], 0.01)
    assert after is before


def test_of_many_short_flights_each_is_too_little_known_to_be_held() -> None:
    """The mean of five is told, with what lies between them."""
    flights = [[1.0 + offset] * 3 for offset in (-0.3, -0.1, 0.0, 0.1, 0.3)]
    before, after = told(flights, 0.05)
    assert after is before


def test_an_axis_that_no_flight_shows_stays_as_it_is() -> None:
    """Roll and pitch differ; of yaw nothing is known."""
    nan = float("nan")
    before, after = told([[0.96, 0.96, nan], [1.04, 1.04, nan]], 0.01)
    assert after.entries[ON_AXIS["yaw"]].ci95 == pytest.approx(before.entries[ON_AXIS["yaw"]].ci95)
    assert roll(after)[1] > roll(before)[1]
