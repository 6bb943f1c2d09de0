"""Numbers as a firmware stores them: rounded, and inside their type's range."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.writers.records import fit


@pytest.mark.parametrize(
    ("value", "kind", "expected"),
    [
        (1.6, "u1", 2),
        (-1.6, "<i2", -2),
        (300.0, "u1", 255),
        (300, "u1", 255),
        (-1.0, "<u2", 0),
        (-40_000, "<i2", -32_768),
        (float("nan"), "<u2", 0),
        (float("inf"), "<i2", 32_767),
    ],
)
def test_a_number_is_rounded_and_stays_inside_an_integer_field(
    value: float, kind: str, expected: int
) -> None:
    """What is not known is zero."""
    assert fit(np.array([value]), np.dtype(kind)).tolist() == [expected]


def test_a_float_field_takes_numbers_as_they_are() -> None:
    """NaN included: it says that the value is unknown."""
    values = np.array([1.5, np.nan, -np.inf])
    np.testing.assert_array_equal(fit(values, np.dtype("<f4")), values)
