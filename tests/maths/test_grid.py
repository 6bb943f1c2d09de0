"""The grid of values that whole numbers leave in a signal."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.maths.grid import step_of

TORQUE = np.random.default_rng(1).standard_normal(4000)


@pytest.mark.parametrize("to_whole", [np.trunc, np.rint])
@pytest.mark.parametrize("step", [0.02, 0.5])
def test_whole_steps_are_found_in_single_precision(to_whole: np.ufunc, step: float) -> None:
    """Cut or rounded."""
    values = (to_whole(TORQUE / step) * step).astype(np.float32).astype(np.float64)
    assert step_of(values) == pytest.approx(step, rel=1e-3)


def test_clipped_and_mixed_samples_hide_no_grid() -> None:
    """One in twenty lies beside it."""
    values = np.trunc(TORQUE / 0.1) * 0.1
    values[::20] += 0.03 * TORQUE[::20]
    assert step_of(values) == pytest.approx(0.1, rel=1e-3)


def test_what_stood_still_on_a_level_of_its_own_hides_no_grid() -> None:
    """Commands on the ground last for seconds, each a level that comes again."""
    values = np.concatenate([np.trunc(TORQUE / 0.02) * 0.02, np.full(30, 0.0133), np.full(8, 0.0154)])
    assert step_of(values) == pytest.approx(0.02, rel=1e-3)


def test_two_levels_that_rounding_tells_apart_are_no_step() -> None:
    """Of a millionth of the largest value every number is a multiple."""
    values = np.rint(TORQUE / 1e-6)
    pairs = np.concatenate([np.repeat(values[:40], 3), np.repeat(values[:40] + 3.0, 3)]) * 1e-6
    assert step_of(pairs) == 0.0


def test_one_step_to_either_side_is_a_grid() -> None:
    """The least that whole numbers can hold."""
    assert step_of(np.sign(np.trunc(TORQUE)) * 0.5) == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize(
    "values", [TORQUE, np.zeros(100), np.full(100, 2.0), np.zeros(0), np.full(9, np.nan)]
)
def test_what_takes_any_value_or_one_has_no_step(values: np.ndarray) -> None:
    """Nor what was not logged."""
    assert step_of(values) == 0.0
