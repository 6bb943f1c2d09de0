"""The median of few numbers."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.median import median


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 8, 101, 240])
def test_the_median_is_that_of_numpy(n: int) -> None:
    """To the last digit, of odd and even numbers of values, and the values stay as they lie."""
    values = np.random.default_rng(n).standard_normal(n)
    before = values.copy()
    assert median(values) == np.median(values)
    np.testing.assert_array_equal(values, before)
