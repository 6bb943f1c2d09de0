"""The two constants of the normal distribution against SciPy's quantiles."""

from __future__ import annotations

import pytest
from scipy.stats import norm

from quadid_logs.maths.normal import MEDIAN_DEVIATION, NORMAL_95


def test_the_half_width_of_95_percent_is_the_quantile_of_97_5() -> None:
    """Two-sided."""
    assert norm.ppf(0.975) == pytest.approx(NORMAL_95, abs=1e-6)


def test_the_median_deviation_is_the_upper_quartile() -> None:
    """Half of all deviations are smaller."""
    assert norm.ppf(0.75) == pytest.approx(MEDIAN_DEVIATION, abs=1e-6)
