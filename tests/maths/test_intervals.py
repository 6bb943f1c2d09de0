"""Which times lie in intervals."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from quadid_logs.maths.intervals import inside

_TIMES = st.integers(0, 20).map(float)


@given(
    st.lists(st.one_of(_TIMES, st.just(np.nan)), min_size=1, max_size=30),
    st.lists(st.tuples(_TIMES, _TIMES).map(lambda pair: (min(pair), max(pair))), max_size=6),
)
def test_a_time_is_inside_if_an_interval_holds_it_and_nowhere_without_one(
    times: list[float], intervals: list[tuple[float, float]]
) -> None:
    """In any order, overlapping or not, ends included; a time that is no number lies nowhere."""
    expected = [any(start <= time <= end for start, end in intervals) for time in times]
    assert inside(np.array(times), intervals).tolist() == expected
