"""The constants of the normal distribution and the tails of Student's t against SciPy's."""

from __future__ import annotations

import pytest
from scipy.stats import norm, t

from quadid_logs.maths.normal import MEDIAN_DEVIATION, NORMAL_95
from quadid_logs.maths.student import student_95, student_tail


def test_the_half_width_of_95_percent_is_the_quantile_of_97_5() -> None:
    """Two-sided."""
    assert norm.ppf(0.975) == pytest.approx(NORMAL_95, abs=1e-6)


def test_the_median_deviation_is_the_upper_quartile() -> None:
    """Half of all deviations are smaller."""
    assert norm.ppf(0.75) == pytest.approx(MEDIAN_DEVIATION, abs=1e-6)


@pytest.mark.parametrize("degrees", [1, 11, 200])
def test_the_interval_and_the_upper_tail_are_those_of_students_t(degrees: int) -> None:
    """Two-sided and one-sided."""
    assert student_95(degrees) == pytest.approx(t.ppf(0.975, degrees))
    assert student_tail(2.3, degrees) == pytest.approx(t.sf(2.3, degrees))
    assert student_tail(-2.3, degrees) == pytest.approx(t.sf(-2.3, degrees))
