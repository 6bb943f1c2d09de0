"""The page of recommended gains in a real browser: what a pilot sees first, and what answers a key."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import chromium
from tests.synthetic_tuning import synthetic_tune_page

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium.PATH is None, reason="no Chromium on this machine"),
]
WORDS = "document.getElementById('what-if-words').textContent"
FOCUSED = "document.activeElement.closest('label')?.firstChild.textContent ?? ''"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tune") / "tune.html"
    path.write_text(synthetic_tune_page(), encoding="utf-8")
    return path


def focus_on(browser: chromium.Browser, name: str) -> None:
    """Press Tab until a choice of that name has the focus."""
    for _ in range(20):
        browser.key("Tab")
        if browser.run(FOCUSED) == name:
            return
    raise AssertionError(f"no key leads to {name}")


@pytest.mark.parametrize("width", [1280, 400])
def test_nothing_scrolls_sideways_and_nothing_is_amiss(
    browser: chromium.Browser, page: Path, width: int
) -> None:
    browser.show(width)
    browser.open(page)
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.problems == []
    assert len(browser.requests) == 1


@pytest.mark.parametrize("width", [1280, 400])
def test_the_first_screen_says_what_changes_what_it_promises_and_when_to_land(
    browser: chromium.Browser, page: Path, width: int
) -> None:
    """Of the axis that changes; a pilot has ten seconds."""
    browser.show(width)
    browser.open(page)
    seen = browser.run(
        "[...document.querySelectorAll('h2, article:first-of-type *')]"
        ".filter((one) => one.getBoundingClientRect().bottom < 900).map((one) => one.textContent).join('|')"
    )
    for words in (
        "Roll: raise the gains to 130 %",
        "0.1 → 0.13",
        "Promised margins: 13",
        "Land if roll shakes",
    ):
        assert words in seen


def test_another_gain_answers_by_the_keyboard(browser: chromium.Browser, page: Path) -> None:
    """One step up of P: the grid's next row, and another line beside the dashed one."""
    browser.show(1280)
    browser.open(page)
    assert "Margins: 15 dB" in browser.run(WORDS)
    focus_on(browser, "ATC_RAT_RLL_P")
    browser.key("ArrowDown")
    assert "Margins: 18 dB" in browser.run(WORDS)
    drawn = "document.getElementById('what-if-{}').getAttribute('points')"
    assert browser.run(drawn.format("before")) != browser.run(drawn.format("after"))


def test_a_combination_that_would_be_unstable_is_named(browser: chromium.Browser, page: Path) -> None:
    """And no line is drawn for it."""
    browser.show(1280)
    browser.open(page)
    for name in ("ATC_RAT_RLL_P", "INS_GYRO_FILTER"):
        focus_on(browser, name)
        browser.key("ArrowDown")
    assert browser.run(WORDS) == "This loop would be unstable."
    assert browser.run("document.getElementById('what-if-after').getAttribute('points')") == ""


def test_a_zoom_over_frequency_moves_gain_and_phase_of_all_axes(
    browser: chromium.Browser, page: Path
) -> None:
    """A margin is read off both."""
    browser.show(1280)
    browser.open(page)
    browser.run("document.getElementById('loop').scrollIntoView()")
    chart = "document.getElementById('chart-next-loop')"
    browser.wait(f"Boolean({chart}._fullLayout?.xaxis4)")
    zoomed = {"xaxis.range[0]": 0.5, "xaxis.range[1]": 1.0}
    browser.run(f"Plotly.relayout({chart}, {json.dumps(zoomed)}).then(() => null)")
    for number in ("", 2, 3, 4):
        assert browser.run(f"{chart}._fullLayout.xaxis{number}.range") == pytest.approx([0.5, 1.0])
    assert browser.problems == []


def test_another_axis_begins_with_what_flew(browser: chromium.Browser, page: Path) -> None:
    browser.show(400)
    browser.open(page)
    focus_on(browser, "ATC_RAT_RLL_P")
    browser.key("ArrowDown")
    browser.open(page)
    focus_on(browser, "axis")
    browser.key("ArrowDown")
    assert browser.run("document.querySelector('[name=axis]').value") == "pitch"
    assert "Margins: 15 dB" in browser.run(WORDS)
