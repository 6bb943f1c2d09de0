"""Which rows of a log lie in flight."""

import tracemalloc

import numpy as np
import pytest

from quadid_logs.autopilots.loop_rows import within


@pytest.mark.parametrize(
    "intervals",
    [
        [(1.0, 2.0), (3.0, 4.0)],
        [(3.0, 4.0), (1.0, 2.0)],
        [(1.0, 3.5), (2.0, 2.5), (3.0, 4.0)],
        [(2.0, 2.0)],
        [],
    ],
)
def test_a_time_is_within_if_one_interval_holds_it_ends_included(intervals):
    """In any order, overlapping or not; a time that is no number lies nowhere."""
    times = np.array([4.0, 0.0, 1.0, 1.5, 2.0, 2.2, 2.75, 3.0, np.nan, 5.0, np.inf])
    expected = [
        np.isfinite(time) and (not intervals or any(a <= time <= b for a, b in intervals)) for time in times
    ]
    assert within(times, intervals).tolist() == expected


def test_thousands_of_flights_take_no_more_memory_than_one():
    """One row of all times for each flight took 13 GB of a log of 640 MB."""
    times = np.linspace(0.0, 4000.0, 200_000)
    flights = [(k + 0.2, k + 0.8) for k in range(4000)]
    tracemalloc.start()
    inside = within(times, flights)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert inside.mean() == pytest.approx(0.6, abs=0.01)
    assert peak < 5 * times.nbytes
