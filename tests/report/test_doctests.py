"""The examples in the docstrings of figures and report hold."""

from __future__ import annotations

import doctest
import importlib

import pytest


@pytest.mark.parametrize(
    "module",
    [
        "quadid_logs.cli.progress",
        "quadid_logs.figures.thinning",
        "quadid_logs.report.files",
        "quadid_logs.report.html",
        "quadid_logs.report.numbers",
        "quadid_logs.report.log_tables",
        "quadid_logs.report.words",
        "quadid_logs.untrusted",
    ],
)
def test_the_examples_hold(module: str) -> None:
    """There is at least one, and each gives what it says."""
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0
