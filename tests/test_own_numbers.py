"""A test that imports the number it should hold holds nothing: the number may change, and it still passes."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parent
#: Where constants decide what a pilot is told.
DECIDING = tuple(f"quadid_logs.{place}" for place in ("identify", "diagnose", "control", "serve", "tuning"))
#: (module, name): why a test may import it.
ALLOWED = {("quadid_logs.identify.response", "EVERYWHERE"): "no limit at all: from 0 to infinity"}


def imported_numbers() -> Iterator[tuple[str, str, str]]:
    """Yield test file, module and name of each number, or tuple of numbers, that a test imports."""
    for path in sorted(TESTS.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith(DECIDING):
                continue
            assert node.module is not None
            module = importlib.import_module(node.module)
            for each in node.names:
                if each.name.isupper() and is_number(getattr(module, each.name)):
                    yield path.name, node.module, each.name


def is_number(value: object) -> bool:
    """Say whether this is a number, or several."""
    if isinstance(value, tuple):
        return bool(value) and all(map(is_number, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def test_no_test_imports_the_number_that_it_should_hold() -> None:
    """Write it from the documentation, the truth of the simulator, or a closed form."""
    found = [each for each in imported_numbers() if each[1:] not in ALLOWED]
    assert found == []
