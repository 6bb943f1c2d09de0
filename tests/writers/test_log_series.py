"""Stamps, held values and texts, as every writer uses them."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.writers.log_series import Stamps, changes, clip_text, held, microseconds, packed_version


def stamps(*key_us: int) -> Stamps:
    """Return stamps without a reset."""
    return Stamps(time_us=np.array(key_us), key_us=np.array(key_us))


def test_a_value_holds_from_its_own_row_on_and_is_unknown_before_the_first() -> None:
    """At the very stamp of a row it is that row's."""
    values = held(stamps(100, 200), np.array([1.0, 2.0]), np.array([50, 100, 150, 200, 900]))
    np.testing.assert_array_equal(values, [np.nan, 1.0, 1.0, 2.0, 2.0])


def test_a_series_without_rows_is_unknown_everywhere() -> None:
    """NaN of the right shape."""
    assert np.isnan(held(stamps(), np.zeros((0, 3)), np.array([1, 2]))).all()


def test_times_are_rounded_to_the_nearest_microsecond() -> None:
    """0.3 s is 299999.99999999994 us in binary."""
    np.testing.assert_array_equal(
        microseconds(np.array([0.3, 1.0000004, 1.0000006])), [300_000, 1_000_000, 1_000_001]
    )


def test_the_first_row_changes_only_against_the_state_before_it() -> None:
    """A vehicle that is armed when the log begins was armed before."""
    state = np.array([1.0, 1.0, 0.0, 1.0])
    np.testing.assert_array_equal(changes(state, before=1.0), [2, 3])
    np.testing.assert_array_equal(changes(state, before=0.0), [0, 2, 3])


@pytest.mark.parametrize(("n_bytes", "expected"), [(1, b""), (2, "ü".encode()), (3, "üx".encode())])
def test_a_text_is_cut_between_characters(n_bytes: int, expected: bytes) -> None:
    """Half a character is not UTF-8: readers refuse it."""
    assert clip_text("üxy", n_bytes) == expected


def test_a_version_has_a_byte_for_each_of_its_numbers() -> None:
    """Major, minor, patch, and 255 for a release."""
    assert packed_version("PX4 v1.16.2") == 0x011002FF
    assert packed_version("unknown") == 0
