"""The examples in the docstrings hold."""

from __future__ import annotations

import doctest
import importlib
import re

import pytest

from tests.conftest import REPOSITORY

FILES = [
    path
    for path in sorted((REPOSITORY / "quadid_logs").rglob("*.py"))
    if re.search(r"^ *>>> ", path.read_text(encoding="utf-8"), re.MULTILINE)
]
MODULES = [
    ".".join(path.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__") for path in FILES
]


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_hold(module: str) -> None:
    """Each gives what it says."""
    assert doctest.testmod(importlib.import_module(module)).failed == 0
