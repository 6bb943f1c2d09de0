"""The examples in the docstrings hold."""

from __future__ import annotations

import doctest
import functools
import importlib
import re
from collections.abc import Callable

import pytest

import quadid_logs
from quadid_logs import pipeline
from quadid_logs.data.result import Result
from tests.conftest import REPOSITORY
from tests.marks import thorough_but

FILES = [
    path
    for path in sorted((REPOSITORY / "quadid_logs").rglob("*.py"))
    if re.search(r"^ *>>> ", path.read_text(encoding="utf-8"), re.MULTILINE)
]
MODULES = [
    ".".join(path.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__") for path in FILES
]
#: Whose examples analyze a flight that no other example does.
LONG = {"quadid_logs.api.analysis", "quadid_logs.notebook", "quadid_logs.report.folder"}


@pytest.fixture(scope="module")
def analyze_once() -> Callable[..., Result]:
    """Return `analyze`, which remembers: most examples are about the same sample log."""
    remembered = functools.cache(pipeline.analyze)
    return lambda logs, *rest, **named: remembered(
        tuple(logs) if isinstance(logs, list) else logs, *rest, **named
    )


@pytest.mark.parametrize("module", thorough_but(set(MODULES) - LONG, MODULES))
def test_the_examples_hold(
    module: str, analyze_once: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each gives what it says."""
    monkeypatch.chdir(REPOSITORY)
    monkeypatch.setattr(pipeline, "analyze", analyze_once)
    assert doctest.testmod(importlib.import_module(module)).failed == 0


def test_the_script_in_the_readme_runs(
    analyze_once: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nine lines of a researcher: load, model, intervals, table, simulation, another flight, margins."""
    (script,) = re.findall(r"```python\n(.*?)```", (REPOSITORY / "README.md").read_text(), re.DOTALL)
    monkeypatch.chdir(REPOSITORY)
    monkeypatch.setattr(pipeline, "analyze", analyze_once)
    names: dict[str, object] = {}
    exec(script, names)
    assert {"r", "series", "rates", "scores", "margin"} <= names.keys()
    assert len(script.strip().splitlines()) == 9


@pytest.mark.parametrize("name", sorted({*quadid_logs.__all__} - {"__version__", "TERMS"}))
def test_every_public_name_has_an_example(name: str) -> None:
    """One that can be run, and shows the name itself."""
    examples = doctest.DocTestParser().get_examples(getattr(quadid_logs, name).__doc__ or "")
    shown = [one for one in examples if not one.options.get(doctest.SKIP, False)]
    assert any(re.search(rf"\b{name}\b|\banalyze\b", one.source) for one in shown)
