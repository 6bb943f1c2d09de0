"""Many tests at once: Holm's correction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadid_logs.maths.multiple_tests import adjusted, two_sided

P_VALUES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20)


def test_holm_gives_the_published_example() -> None:
    """Holm (1979): the smallest counts n times, the next one n - 1 times, none less than one before it."""
    assert adjusted(np.array([0.01, 0.005, 0.03, 0.04])).tolist() == pytest.approx([0.03, 0.02, 0.06, 0.06])


@given(P_VALUES)
def test_a_corrected_p_value_is_between_its_own_and_bonferronis(p_values: list[float]) -> None:
    own = np.array(p_values)
    corrected = adjusted(own)
    assert np.all(corrected >= own)
    assert np.all(corrected <= np.minimum(1.0, own * own.size) + 1e-15)


def test_one_false_call_in_twenty_families() -> None:
    """Of ten true null hypotheses, the smallest corrected p-value is below 0.05 in 5 % of cases."""
    random = np.random.default_rng(3)
    called = [adjusted(two_sided(random.standard_normal(10))).min() < 0.05 for _ in range(2000)]
    assert np.mean(called) == pytest.approx(0.05, abs=0.015)
