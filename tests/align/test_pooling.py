"""Logs put one after the other, as data: clocks, flights and what is said of the torque."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.align.pool import pool
from quadid_logs.data.flight import FlightData
from quadid_logs.data.settings import AlignSettings

from .flights import align, flown

SHORT, LONG = np.arange(500.0, 520.0, 0.01), np.arange(80.0, 140.0, 0.01)


def part(time_s: np.ndarray, **changes: object) -> FlightData:
    """Return an aligned log with other words about its torque."""
    data = align(flown(time_s), AlignSettings(sample_rate_hz=100.0))
    assert data.input is not None
    return dataclasses.replace(data, input=dataclasses.replace(data.input, **changes))  # type: ignore[arg-type]


def test_each_log_begins_a_minute_after_the_one_before_has_ended() -> None:
    """On the clock of the first, whatever the others showed."""
    first, second = part(SHORT), part(LONG)
    found = pool([first, second, second])
    ends = [
        first.start_s + first.duration_s + 60.0,
        first.start_s + first.duration_s + second.duration_s + 120.0,
    ]
    starts = [each.time_s[0] for each in found.segments]
    offset_s = second.segments[0].time_s[0] - second.start_s
    np.testing.assert_allclose(starts, [first.segments[0].time_s[0], *(end_s + offset_s for end_s in ends)])


def test_pauses_that_nobody_flew_are_not_counted() -> None:
    """The logs were put apart by a minute each; "of 6 min" told a pilot of minutes that no log has."""
    first, second = part(SHORT), part(LONG)
    assert pool([first, second, second]).duration_s == pytest.approx(
        first.duration_s + 2.0 * second.duration_s
    )


def test_flights_are_counted_on() -> None:
    """A segment of the second log is of the second flight."""
    found = pool([part(SHORT), part(LONG)])
    assert [segment.flight for segment in found.segments] == [0, 1]
    for segment, (start_s, end_s) in zip(found.segments, found.flights, strict=True):
        assert start_s <= segment.time_s[0] + 1e-9
        assert segment.time_s[-1] <= end_s + 1e-9


def test_saturation_is_that_of_all_samples() -> None:
    """A tenth of 18 s and none of 58 s."""
    first, second = part(SHORT, saturated_fraction=0.1), part(LONG, saturated_fraction=0.0)
    found = pool([first, second]).input
    assert found is not None
    expected = 0.1 * first.n_samples / (first.n_samples + second.n_samples)
    assert found.saturated_fraction == pytest.approx(expected)


def test_limits_of_an_axis_are_those_of_all_samples() -> None:
    limited, free = part(SHORT, limited_fraction=(0.0, 0.0, 0.1)), part(LONG)
    found = pool([limited, free]).input
    assert found is not None
    expected = 0.1 * limited.n_samples / (limited.n_samples + free.n_samples)
    assert found.limited_fraction == pytest.approx((0.0, 0.0, expected))


@pytest.mark.parametrize("name", ["achieved", "every_step"])
def test_what_is_true_of_one_log_only_is_not_said_of_all(name: str) -> None:
    """Torque as achieved, each step of the loop."""
    for both in (True, False):
        found = pool([part(SHORT, **{name: True}), part(LONG, **{name: both})]).input
        assert found is not None
        assert getattr(found, name) is both
