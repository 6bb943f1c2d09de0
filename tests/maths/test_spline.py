"""Curves between evenly spaced samples, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from quadid_logs.maths.spline import finer


@pytest.mark.parametrize("n", [4, 5, 30, 400])
def test_a_finer_curve_is_the_spline_of_scipy(n: int) -> None:
    """Several at once, up to both ends."""
    values = np.random.default_rng(n).standard_normal((3, n))
    expected = CubicSpline(np.arange(n), values, axis=1)(np.linspace(0.0, n - 1.0, 10 * (n - 1) + 1))
    assert finer(values, 10) == pytest.approx(expected, rel=1e-9, abs=1e-11)
