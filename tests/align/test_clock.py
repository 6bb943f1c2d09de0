"""Epochs of a log whose clock was set back or ahead."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.align.clock import OUTLIER_S, Clock, find_clock

from .flights import motion, signal

#: Three boots of ten seconds each; every one shows less than the one before did at its end.
BOOTS = [np.arange(start, start + 10.0, 0.01) for start in (100.0, 50.0, 5.0)]
STAMPS = np.concatenate(BOOTS)
POSITION = 50 * np.arange(STAMPS.size)


@pytest.fixture(scope="module")
def clock() -> Clock:
    return find_clock([signal("body_rate", STAMPS, motion(STAMPS))])


def test_epochs_follow_each_other_a_second_apart(clock: Clock) -> None:
    """All three, so that the third is behind the second and not only behind where the second stood."""
    common = clock.common_time(STAMPS, POSITION)
    expected = np.concatenate([BOOTS[0], BOOTS[0] + 10.99, BOOTS[0] + 2.0 * 10.99])
    np.testing.assert_allclose(common, expected, atol=1e-6)


def test_the_row_at_which_the_clock_fell_is_the_first_of_its_epoch(clock: Clock) -> None:
    """And the one ahead of it the last of the epoch before."""
    first = np.array([0, BOOTS[0].size, 2 * BOOTS[0].size])
    np.testing.assert_array_equal(clock.epoch_of(POSITION[first]), [0, 1, 2])
    np.testing.assert_array_equal(clock.epoch_of(POSITION[first[1:] - 1]), [0, 1])


def test_rows_on_either_side_of_a_reset_are_no_outliers(clock: Clock) -> None:
    """Of a message between the rows that tell the clock: the next one shows another epoch's time."""
    between = POSITION[:-1] + 25
    assert not clock.is_outlier(STAMPS, POSITION, OUTLIER_S).any()
    assert not clock.is_outlier(STAMPS[:-1] + 0.005, between, OUTLIER_S).any()


def test_a_stamp_far_from_what_the_clock_showed_there_is_an_outlier(clock: Clock) -> None:
    """By more than the tolerance, to either side; NaN is one too."""
    stamps = STAMPS.copy()
    stamps[[300, 500, 700]] += [OUTLIER_S + 0.5, -OUTLIER_S - 0.5, np.nan]
    np.testing.assert_array_equal(
        np.flatnonzero(clock.is_outlier(stamps, POSITION, OUTLIER_S)), [300, 500, 700]
    )


def test_a_stamp_that_is_a_signalling_nan_is_an_outlier_without_a_warning(clock: Clock) -> None:
    """Eight damaged bytes of a table are one; subtracting it makes numpy warn."""
    stamps = STAMPS.copy()
    stamps.view(np.uint64)[300] = 0x7FF4000000000001
    with np.errstate(invalid="raise"):
        assert np.flatnonzero(clock.is_outlier(stamps, POSITION, OUTLIER_S)).tolist() == [300]
