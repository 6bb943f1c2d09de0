"""Rotor speeds of which a motor's are missing throughout, or for a while."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.actuation.rotor_speed import _Deviations

SPEED = np.random.default_rng(0).standard_normal((50, 4))


@pytest.mark.filterwarnings("error")
def test_a_motor_without_any_speed_leaves_the_others_comparable() -> None:
    """As a damaged log has it; all motors missing is no likeness at all."""
    speed = SPEED.copy()
    speed[:, 2] = np.nan
    assert _Deviations.of(speed).correlation(3.0 * speed + 1.0) == pytest.approx(1.0)
    assert _Deviations.of(np.full((50, 4), np.nan)).correlation(SPEED) == 0.0


@pytest.mark.parametrize("lacking", ["one", "other", "both"])
def test_rows_that_one_of_both_lacks_count_in_neither(lacking: str) -> None:
    """Neither in the sums nor in the means."""
    one, other = SPEED.copy(), 3.0 * SPEED + 100.0
    if lacking != "other":
        one[:20, 1] = np.nan
    if lacking != "one":
        other[5:9, 3] = np.nan
    assert _Deviations.of(one).correlation(other) == pytest.approx(1.0)
