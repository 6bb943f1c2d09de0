"""Means over moving windows, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from quadid_logs.maths.moving_mean import Beyond, moving_mean


@pytest.mark.parametrize(
    ("beyond", "mode"), [("zero", "constant"), ("edge", "nearest"), ("mirrored", "reflect")]
)
@pytest.mark.parametrize("width", [1, 2, 7, 40, 500])
def test_a_moving_mean_is_scipys_to_the_last_digits(beyond: Beyond, mode: str, width: int) -> None:
    """Far from zero, too."""
    columns = 1e3 + np.random.default_rng(1).standard_normal((300, 2))
    expected = uniform_filter1d(columns, width, axis=0, mode=mode)
    assert moving_mean(columns, width, beyond=beyond) == pytest.approx(expected, rel=1e-12)
    assert moving_mean(columns[:, 0], width, beyond=beyond) == pytest.approx(expected[:, 0], rel=1e-12)


def test_no_rows_have_no_means() -> None:
    assert moving_mean(np.zeros((0, 2)), 5, beyond="edge").shape == (0, 2)
