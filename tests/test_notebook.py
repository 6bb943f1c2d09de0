"""Results in a notebook: they show themselves, and their figures are ordinary ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import quadid_logs
from quadid_logs.data.result import Result
from quadid_logs.report.verdict import effect_sentence
from tests.synthetic_results import hostile_result, refused_result, usable_result


@pytest.fixture(scope="module")
def usable() -> Result:
    """Return a short good flight."""
    return usable_result(8.0)


def test_a_result_shows_verdicts_and_matrices(usable: Result) -> None:
    """As HTML where HTML is shown, as the command line's text elsewhere."""
    shown = quadid_logs.show(usable)
    page = shown._repr_html_()
    assert "roll: usable" in page
    assert effect_sentence(usable, "roll") in page
    assert "structure damped" in repr(shown)


def test_a_hostile_log_stays_text_in_a_notebook() -> None:
    """No element of the log's making."""
    page = quadid_logs.show(hostile_result())._repr_html_()
    assert "<script" not in page
    assert "<img" not in page
    assert "&lt;script&gt;" in page


@pytest.fixture(scope="module")
def drawn(usable: Result) -> dict[str, Any]:
    """Return matplotlib's figures of the flight."""
    return quadid_logs.matplotlib_figures(usable)


@pytest.mark.thorough
def test_figures_are_ordinary_matplotlib_figures(drawn: dict[str, Any], tmp_path: Path) -> None:
    """They can be changed and saved; pyplot holds none of them."""
    import matplotlib.pyplot as plt
    from matplotlib.figure import Figure

    figures = drawn
    assert all(isinstance(figure, Figure) for figure in figures.values())
    figures["lag"].savefig(tmp_path / "lag.png")
    assert (tmp_path / "lag.png").stat().st_size > 10_000
    assert plt.get_fignums() == []
    assert quadid_logs.matplotlib_figures(refused_result()) == {}


@pytest.mark.thorough
def test_figures_are_ordinary_plotly_figures(usable: Result, drawn: dict[str, Any]) -> None:
    """With colours in the place of roles, and as many traces as the report draws."""
    import plotly.graph_objects as go

    figures = quadid_logs.plotly_figures(usable)
    assert figures.keys() == drawn.keys()
    for figure in figures.values():
        assert isinstance(figure, go.Figure)
        assert len(figure.data) > 0
        assert '"@' not in json.dumps(json.loads(figure.to_json()))
