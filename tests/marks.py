"""Cases that only `make check-all` tries."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def thorough(*values: Any) -> Any:
    """Return a case beside quicker ones that make the same claim."""
    return pytest.param(*values, marks=pytest.mark.thorough)


def thorough_but(kept: Collection[Any], cases: Iterable[Any]) -> list[Any]:
    """Return all cases; only those that are kept are of a quick run."""
    return [case if case in kept else thorough(case) for case in cases]
