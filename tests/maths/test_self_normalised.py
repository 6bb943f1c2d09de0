"""A mean and its change, judged without knowing how far the correlation reaches."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.maths.self_normalised import between, change_of, mean_of


def correlated(seed: int, n: int = 200, coefficient: float = 0.6) -> np.ndarray:
    """Return a first-order autoregressive series."""
    noise = np.random.default_rng(seed).standard_normal(n + 100)
    return np.asarray(lfilter([1.0], [1.0, -coefficient], noise))[100:]


def test_a_series_without_a_change_rarely_shows_one() -> None:
    """At 5 %: of 400 series whose neighbours are alike, no more than 8 %."""
    found = [change_of(correlated(seed)) for seed in range(400)]
    assert np.mean([one is not None and one.p_value < 0.05 for one in found]) < 0.08


def test_the_interval_of_a_mean_holds_the_truth_in_95_percent() -> None:
    """Of 400 series with the mean 3; an interval for independent samples would hold it in 60 %."""
    found = [mean_of(3.0 + correlated(seed)) for seed in range(400)]
    held = np.mean([abs(one.value - 3.0) <= one.half_width for one in found])
    assert 0.91 < held < 0.985


@pytest.mark.parametrize("ramp", [0, 60])
def test_a_change_is_found_whether_sudden_or_slow(ramp: int) -> None:
    """Of six standard deviations."""
    rise = np.clip((np.arange(200) - 100) / max(ramp, 1), 0.0, 1.0)
    found = change_of(correlated(1, coefficient=0.0) + 6.0 * rise)
    assert found is not None
    assert found.p_value < 0.002
    assert found.size.value == pytest.approx(6.0, abs=1.0)
    assert found.before.stop <= 120 <= found.after.start + 20


def test_a_dead_zone_takes_its_part_of_the_mean() -> None:
    """A mean within it is no deviation."""
    values = 0.5 + 0.1 * correlated(2)
    assert mean_of(values).p_value < 0.01
    assert mean_of(values, dead_zone=0.6).p_value == 1.0


def test_the_difference_is_that_of_the_later_part_over_the_earlier() -> None:
    """With its sign."""
    values = np.concatenate([np.zeros(50), np.ones(50)]) + 1e-3 * correlated(3, 100)
    assert between(values, slice(0, 50), slice(50, 100)).value == pytest.approx(1.0, abs=0.01)


def test_too_short_a_series_has_no_change() -> None:
    """Of 39 steps."""
    assert change_of(np.arange(39.0)) is None
