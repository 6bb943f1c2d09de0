"""Of a long flight the minutes with most motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.select import most_excited

from .vehicles import PERIOD_S, QUAD, flight_data, fly, multisine


def restless(n_minutes: int, moved: list[int]) -> np.ndarray:
    """Rates that are noise, but in some minutes ten times as much."""
    rng = np.random.default_rng(4)
    n = round(60.0 / PERIOD_S)
    size = np.where(np.isin(np.arange(n_minutes), moved), 1.0, 0.1)
    return np.repeat(size, n)[:, np.newaxis] * rng.standard_normal((n * n_minutes, 3))


def test_the_minutes_that_move_most_are_kept_in_order_of_time() -> None:
    """Two of six."""
    rate = restless(6, [1, 4])
    kept = most_excited(flight_data(rate, np.zeros_like(rate)), round(120.0 / PERIOD_S))
    assert [round(segment.start_s) for segment in kept.segments] == [60, 240]


def test_an_axis_that_moves_least_counts_as_much_as_the_others() -> None:
    """Yaw alone is moved in one minute, and little."""
    rate = restless(4, [0])
    rate[:, 2] *= 0.01
    minute = slice(round(180.0 / PERIOD_S), None)
    rate[minute, 2] *= 1000.0
    kept = most_excited(flight_data(rate, np.zeros_like(rate)), round(120.0 / PERIOD_S))
    assert [round(segment.start_s) for segment in kept.segments] == [0, 180]


def test_a_shorter_flight_stays_as_it_is() -> None:
    """The same object."""
    data = flight_data(np.zeros((1000, 3)), np.zeros((1000, 3)))
    assert most_excited(data, 1000) is data


@pytest.mark.thorough
def test_the_gain_of_a_part_is_the_gain_of_the_flight() -> None:
    """Half of the flight, within half a per cent."""
    data = fly(QUAD, multisine(150.0), feedback=8.0)
    found = identify(data, dataclasses.replace(IdentifySettings(), most_samples=data.n_samples // 2))
    assert found.recommended is not None
    assert found.n_samples < 0.7 * data.n_samples
    np.testing.assert_allclose(np.diag(found.recommended.B), np.diag(QUAD.B), rtol=0.005)
