"""The script of the documentation's data model page runs as it stands."""

from __future__ import annotations

import ast
import re
import runpy
import sys
import tomllib
from pathlib import Path

import pytest

import quadid_logs
from tests.conftest import REPOSITORY

PAGE, SCRIPT = REPOSITORY / "docs" / "data-model.md", REPOSITORY / "docs" / "day.py"


def test_the_page_holds_the_script() -> None:
    """The marker that includes it, letter by letter."""
    assert '--8<-- "docs/day.py"' in PAGE.read_text(encoding="utf-8").splitlines()


@pytest.mark.thorough
def test_a_day_of_a_student_ends_with_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two flights are simulated, analyzed, tuned and compared: seconds, for they are what is promised."""
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(SCRIPT), run_name="__main__")
    printed = capsys.readouterr().out
    assert "<Comparison: same" in printed
    assert re.search(r"roll +change +ATC_RAT_RLL_P [\d.]+ -> [\d.]+", printed)
    assert len((tmp_path / "day" / "parameters.csv").read_text().splitlines()) > 10
    assert (tmp_path / "day" / "fit.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "day" / "report" / "report.html").is_file()


def test_the_day_needs_nothing_that_an_extra_brings() -> None:
    """`pip install .` is the first line of the README."""
    tree = ast.parse(SCRIPT.read_text(encoding="utf-8"))
    imported = {
        (name.name if isinstance(node, ast.Import) else str(node.module)).split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in node.names
    }
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    installed = {re.split(r"[<>=]", line)[0] for line in project["dependencies"]} | {"quadid_logs"}
    assert imported - sys.stdlib_module_names <= installed


def test_every_verb_and_object_of_the_page_is_there() -> None:
    """A renamed one would leave a reader alone."""
    text = PAGE.read_text(encoding="utf-8")
    verbs = set(re.findall(r"^\| `(\w+)\(", text, re.MULTILINE))
    assert {"analyze", "tune", "check", "compare", "repeat", "plan", "fleet"} <= verbs
    assert verbs <= set(quadid_logs.__all__)
    attributes = set(re.findall(r"`r\.(\w+)", text))
    assert attributes <= set(dir(quadid_logs.Analysis))
