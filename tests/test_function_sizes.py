"""A function has one idea: it fits on a screen, and a caller can keep its parameters in mind."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "quadid_logs"
#: The verbs of the command line have one parameter per option, documented by its help.
OUTSIDE_CLI = sorted(path for path in PACKAGE.rglob("*.py") if path.parent.name != "cli")
MOST_LINES, MOST_PARAMETERS = 60, 8


def n_parameters(function: ast.FunctionDef) -> int:
    """Count what a caller passes."""
    given = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return sum(each.arg not in ("self", "cls") for each in given)


@pytest.mark.parametrize("path", OUTSIDE_CLI, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_function_is_long_or_takes_many_parameters(path: Path) -> None:
    """Docstring included."""
    functions = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    large = [
        f"{each.name}: {(each.end_lineno or 0) - each.lineno + 1} lines, {n_parameters(each)} parameters"
        for each in functions
        if (each.end_lineno or 0) - each.lineno >= MOST_LINES or n_parameters(each) > MOST_PARAMETERS
    ]
    assert not large, "; ".join(large)
