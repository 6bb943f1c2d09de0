"""Rotor speeds of which a motor's are missing throughout."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.actuation.rotor_speed import _correlation


@pytest.mark.filterwarnings("error")
def test_a_motor_without_any_speed_leaves_the_others_comparable() -> None:
    """As a damaged log has it; all motors missing is no likeness at all."""
    speed = np.random.default_rng(0).standard_normal((50, 4))
    speed[:, 2] = np.nan
    assert _correlation(speed, 3.0 * speed + 1.0) == pytest.approx(1.0)
    assert _correlation(np.full((50, 4), np.nan), speed) == 0.0
