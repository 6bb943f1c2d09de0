"""How fast and how well damped answers to set-points are, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from quadid_logs.control.attitude import attitude_of, resonance_db

HZ = np.geomspace(0.01, 100.0, 20_000)


@pytest.mark.parametrize("damping_ratio", [0.2, 0.35, 0.6])
def test_a_rate_of_second_order_resonates_as_its_damping_ratio_says(damping_ratio: float) -> None:
    """Ogata, Modern Control Engineering, 8-2: 1 / (2 z sqrt(1 - z^2))."""
    s = 2j * np.pi * HZ / (2.0 * np.pi * 3.0)
    loop = (1.0 / (s * (s + 2.0 * damping_ratio)))[np.newaxis]
    found = attitude_of(HZ, loop, None, loop)
    expected = 20.0 * math.log10(1.0 / (2.0 * damping_ratio * math.sqrt(1.0 - damping_ratio**2)))
    assert found.resonance_db[0] == pytest.approx(expected, abs=0.01)
    assert resonance_db(damping_ratio) == pytest.approx(expected, abs=1e-9)


def test_an_attitude_that_resonates_counts_though_its_rate_does_not() -> None:
    """The rate lags by 1 / a second; three times its bandwidth around it leaves a damping ratio of 0.29."""
    s = 2j * np.pi * HZ
    rate = (1.0 / s)[np.newaxis]
    full = rate + 3.0 / s**2
    found = attitude_of(HZ, rate, full, rate)
    damping_ratio = 1.0 / (2.0 * math.sqrt(3.0))
    assert found.resonance_db[0] == pytest.approx(resonance_db(damping_ratio), abs=0.01)
