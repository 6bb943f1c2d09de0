"""How many axes of a fleet are usable, in one line."""

from __future__ import annotations

from quadid_logs.fleets.coverage import coverage_of, coverage_words


def test_reasons_that_block_as_many_axes_are_named_in_one_order() -> None:
    """A fleet and its page count in different orders, and name six reasons: they must be the same six."""
    axes = [("refused", (f"QL{number}",), 1) for number in (303, 401, 403, 504, 505, 511, 516)]
    assert coverage_words(coverage_of(axes)) == coverage_words(coverage_of(reversed(axes)))
