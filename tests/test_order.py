"""The order of the test files."""

from __future__ import annotations

import pytest

from tests.conftest import LONGEST_FIRST, REPOSITORY


@pytest.mark.parametrize("name", LONGEST_FIRST)
def test_a_file_that_begins_first_is_there(name: str) -> None:
    """A file that was renamed would quietly begin last, and the suite end later."""
    assert (REPOSITORY / "tests" / name).is_file()
