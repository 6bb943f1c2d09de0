"""Products with the shaped torque are those of the series themselves."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.torque_products import torque_products

from .vehicles import QUAD, fly, multisine


@pytest.fixture(scope="module")
def design() -> Design:
    found = build_design(fly(QUAD, multisine(23.7), feedback=8.0), 5.0)
    assert found is not None
    return found


@pytest.mark.parametrize("high_pass_hz", [0.0, 0.3])
@pytest.mark.parametrize(("lag_s", "delay_s"), [(0.0, 0.0), (0.0037, 0.0113), (0.03, 0.007), (0.25, 0.06)])
def test_they_equal_the_products_in_time(
    design: Design, high_pass_hz: float, lag_s: float, delay_s: float
) -> None:
    """To rounding, for any lag and delay, high-passed and not."""
    shaped = design.high_passed(high_pass_hz) if high_pass_hz else design
    directions = np.random.default_rng(0).standard_normal((design.time_s.size, 4))
    expected = directions.T @ shaped.torque.behind(lag_s, delay_s)
    found = torque_products(shaped, directions)(lag_s, delay_s)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
