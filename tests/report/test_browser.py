"""The report in a real browser: no error, no request, charts drawn, no sideways scrolling."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from quadid_logs.data.result import Result
from quadid_logs.figures import figures_of
from quadid_logs.report.html import render_html
from quadid_logs.report.provenance import provenance_of
from quadid_logs.report.view import view_of
from tests import chromium
from tests.marks import thorough
from tests.synthetic_results import hostile_result, refused_result, synthetic_health, usable_result

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium.PATH is None, reason="no Chromium on this machine"),
]

SCROLL = """(async () => {
  for (const fold of document.querySelectorAll("details")) fold.open = true;
  for (const chart of document.querySelectorAll(".chart")) {
    chart.scrollIntoView({behavior: "instant"});
    for (let turn = 0; turn < 1500 && !chart.querySelector(".main-svg"); turn++)
      await new Promise((done) => setTimeout(done, 40));
  }
  scrollTo(0, 0);
})()"""
DRAWN = 'document.querySelectorAll(".chart .main-svg").length > 0 && [...document.querySelectorAll(".chart")]'
COUNT = f"({DRAWN}).filter((chart) => chart.querySelector('.main-svg .trace')).length"
RANGE = "document.getElementById('chart-{}').layout.xaxis.range"
#: How many names stand at ends of lines, those that lie on another, and those that leave their chart.
NAMES = """(() => {
  const covered = [], outside = [];
  let count = 0;
  for (const chart of document.querySelectorAll(".chart")) {
    const box = (at) => chart.querySelector(`.annotation[data-index="${at}"]`).getBoundingClientRect();
    const names = chart.layout.annotations.map((one, at) => [one, at])
      .filter(([one]) => one.name === "end").map(([one, at]) => [one.text, box(at)]);
    const frame = chart.getBoundingClientRect();
    count += names.length;
    names.forEach(([text, box], at) => {
      if (box.right > frame.right + 1) outside.push(chart.id + " " + text);
      for (const [other, against] of names.slice(at + 1))
        if (box.left < against.right && against.left < box.right && Math.abs(box.top - against.top) < 10)
          covered.push(chart.id + " " + text + ", " + other);
    });
  }
  return [count, covered, outside];
})()"""
#: Where the lower of two lines leaves the view, and where the lower of their names is, in its unit.
NAMED = """(() => {
  const chart = document.getElementById("chart-tracking"), [low, high] = chart.layout.yaxis.range;
  const last = ({ x, y }) => [...x].findLastIndex((at, place) => at <= 28.0002 && Number.isFinite(y[place]));
  const lines = chart.data.filter((one) => (one.yaxis || "y") === "y" && one.meta);
  const names = chart.layout.annotations.filter((one) => one.name === "end" && one.yref === "y domain");
  const lowest = Math.min(...names.map((one) => one.y));
  return [Math.min(...lines.map((line) => line.y[last(line)])), low + lowest * (high - low), names.length];
})()"""
#: Marks the charts that hold a text of the attack, and returns their names.
ATTACKED = """(() => {
  const told = (chart) => document.getElementById("data-" + chart.dataset.key).textContent;
  const attacked = [...document.querySelectorAll(".chart")].filter((chart) => told(chart).includes("script"));
  for (const chart of attacked) chart.classList.add("attacked");
  return attacked.map((chart) => chart.dataset.key);
})()"""
PAUSE = "new Promise((done) => setTimeout(done, 500))"
FIRST_DRAWN = "document.querySelectorAll('#chart-evidence .main-svg').length > 0"
#: How long a browser may take to answer what a test did to the page [s].
PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of a short flight, which a browser without a graphics card draws quickly."""
    return write_page(usable_result(8.0), tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def hostile_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of a log in which every text is an attack."""
    return write_page(hostile_result(), tmp_path_factory.mktemp("page"))


@pytest.fixture
def drawn(browser: chromium.Browser, page: Path, request: pytest.FixtureRequest) -> Iterator[None]:
    """Show every chart of the page on a desk, as it was loaded."""
    yield from shown(browser, page, request, draw_all)


@pytest.fixture
def loaded(browser: chromium.Browser, page: Path, request: pytest.FixtureRequest) -> Iterator[None]:
    """Show the page on a desk as it begins, for tests that leave it so."""
    yield from shown(browser, page, request, load)


@pytest.fixture
def on_paper(browser: chromium.Browser, page: Path, request: pytest.FixtureRequest) -> Iterator[None]:
    """Show the page as it is printed."""
    yield from shown(browser, page, request, open_for_print)


@pytest.fixture(scope="module")
def long_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of a flight of 80 s at 400 Hz."""
    return write_page(usable_result(), tmp_path_factory.mktemp("long"))


@pytest.fixture
def long_drawn(browser: chromium.Browser, long_page: Path, request: pytest.FixtureRequest) -> Iterator[None]:
    """Show every chart of the long flight's page on a desk, as it was loaded."""
    yield from shown(browser, long_page, request, draw_all)


def shown(
    browser: chromium.Browser,
    path: Path,
    request: pytest.FixtureRequest,
    show: Callable[[chromium.Browser, Path], None],
) -> Iterator[None]:
    """Show a page: as the test before left it, where that showed it so and kept it; a page takes seconds."""
    n_failed, how = request.session.testsfailed, json.dumps(show.__name__)
    if browser.run("location.href") != path.as_uri() or not browser.run(f"window.shown === {how}"):
        show(browser, path)
        browser.run(f"window.shown = {how}")
    yield
    if request.session.testsfailed > n_failed:
        browser.go("about:blank")


def draw_all(browser: chromium.Browser, path: Path, width: int = 1280, *, dark: bool = False) -> None:
    """Load a page and show every chart of it."""
    load(browser, path, width, dark=dark)
    browser.run(SCROLL)


def open_for_print(browser: chromium.Browser, path: Path) -> None:
    """Load a page as paper shows it."""
    browser.show(1280, media="print")
    browser.open(path)


def load(browser: chromium.Browser, path: Path, width: int = 1280, *, dark: bool = False) -> None:
    """Load a page in a window that has its size before: another size draws all charts anew."""
    browser.go("about:blank")
    browser.show(width, dark=dark)
    browser.open(path)


def becomes(browser: chromium.Browser, script: str, wanted: Any) -> None:
    """Wait until an expression in the page has this value."""
    until = time.monotonic() + PATIENCE_S
    while (found := browser.run(script)) != wanted and time.monotonic() < until:
        time.sleep(0.05)
    assert found == wanted, script


def write_page(result: Result, folder: Path) -> Path:
    """Write the page alone, without pictures."""
    view = view_of(result, provenance_of(result.log.path, "quadid-log analyze"))
    (folder / "report.html").write_text(render_html(view, figures_of(result)), encoding="utf-8")
    return folder / "report.html"


@pytest.mark.parametrize(("width", "dark"), [thorough(400, True), (1280, False)])
def test_every_chart_is_drawn_and_nothing_scrolls_sideways(
    browser: chromium.Browser, page: Path, width: int, dark: bool
) -> None:
    """On a desk and on a phone, light and dark, without a message in the console."""
    draw_all(browser, page, width, dark=dark)
    browser.run(f"window.shown = {json.dumps('draw_all' if width == 1280 and not dark else '')}")
    charts = browser.run("document.querySelectorAll('.chart').length")
    assert charts >= 14
    becomes(browser, COUNT, charts)
    becomes(browser, f"{NAMES}[0] > 25", True)
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run(NAMES)[1:] == [[], []]
    assert browser.problems == []


def test_the_report_asks_no_host_for_anything(browser: chromium.Browser, drawn: None) -> None:
    """The only thing that is loaded is the file itself (and its empty icon)."""
    outside = [address for address in browser.requests if not address.startswith(("file:", "data:", "blob:"))]
    assert outside == []
    assert sum(address.startswith("file:") for address in browser.requests) == 1


def test_charts_over_time_zoom_together(browser: chromium.Browser, drawn: None) -> None:
    """Zooming the first chart moves the others and the names at ends of lines; a double click resets all."""
    whole = browser.run(RANGE.format("fit"))
    structures = browser.run(RANGE.format("structures"))
    flight = "document.getElementById('chart-flight')"
    browser.run(f"Plotly.relayout({flight}, {{'xaxis.range[0]': 26, 'xaxis.range[1]': 28}}).then(() => null)")
    for key in ("flight", "aligned", "over-time", "fit", "simulation"):
        becomes(browser, RANGE.format(key), pytest.approx([26, 28]))
    assert browser.run(RANGE.format("structures")) == pytest.approx(structures)
    becomes(browser, f"(([end, named]) => named - end)({NAMED})", pytest.approx(0.0, abs=1e-6))
    assert browser.run(NAMED)[2] == 2
    browser.run(f"Plotly.relayout({flight}, {{'xaxis.autorange': true}}).then(() => null)")
    becomes(browser, RANGE.format("fit"), pytest.approx(whole, abs=0.5))
    assert browser.problems == []


def test_a_chart_can_be_zoomed_with_the_keyboard(browser: chromium.Browser, drawn: None) -> None:
    """Plus halves the span that all charts over time show, zero shows everything again."""
    start, end = browser.run(RANGE.format("fit"))
    press = """(document.getElementById("chart-fit").dispatchEvent(
        new KeyboardEvent("keydown", {key: "%s", bubbles: true})))"""
    browser.run(press % "+")
    for key in ("fit", "aligned"):
        becomes(
            browser, f"(([from, to]) => to - from)({RANGE.format(key)})", pytest.approx((end - start) / 2.0)
        )
    browser.run(press % "0")
    becomes(browser, RANGE.format("fit"), pytest.approx([start, end], abs=0.5))


def test_turning_the_phone_lays_the_charts_out_anew(browser: chromium.Browser, drawn: None) -> None:
    """Three columns on a wide screen become one on a narrow one."""
    domain = "document.getElementById('chart-horizon').layout.xaxis.domain[1]"
    assert browser.run(domain) < 0.4
    browser.run("window.shown = null")
    browser.show(400)
    becomes(browser, domain, 1)
    becomes(browser, "document.documentElement.scrollWidth <= 400", True)
    becomes(browser, f"{NAMES}.slice(1)", [[], []])


def test_charts_wait_until_they_are_scrolled_into_view(browser: chromium.Browser, loaded: None) -> None:
    """Those of the first screens are there, those of folded chapters are not."""
    becomes(browser, FIRST_DRAWN, True)
    browser.run(PAUSE)
    assert browser.run("document.querySelectorAll('details .chart .main-svg').length") == 0
    assert browser.run("document.documentElement.scrollHeight") < 9 * 900
    assert "The model" in browser.run("document.body.innerText")


def test_every_control_can_be_reached_by_keyboard(browser: chromium.Browser, loaded: None) -> None:
    """The first stop is the jump to the model; links, charts and wide tables are all stops."""
    key = {"type": "keyDown", "key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9}
    browser.send("Input.dispatchKeyEvent", key)
    assert browser.run("document.activeElement.className") == "skip"
    unreachable = browser.run(
        "document.querySelectorAll('.scroll:not([tabindex]), .chart:not([tabindex])').length"
    )
    assert unreachable == 0


def test_the_first_screen_holds_verdict_picture_and_steps(browser: chromium.Browser, loaded: None) -> None:
    """On 1280 by 900 pixels; the links to the chapters take one line of it."""
    becomes(browser, FIRST_DRAWN, True)
    bottom = "document.querySelector('{}').getBoundingClientRect().bottom"
    for selector in ("#verdict-title", ".axes", "#chart-evidence", ".steps li:last-child"):
        assert browser.run(bottom.format(selector)) < 900, selector
    assert browser.run("document.querySelector('nav').getBoundingClientRect().height") < 60


def test_the_policy_forbids_what_a_log_could_try(browser: chromium.Browser, page: Path) -> None:
    """Even if an attack became markup, it would not run and could not call home."""
    load(browser, page)
    browser.run(
        """(async () => {
          const script = document.createElement("script");
          script.textContent = "window.attacked = true";
          document.body.append(script);
          document.body.insertAdjacentHTML(
            "beforeend", "<img src='https://example.org/x' onerror='window.attacked = 1'>");
          await fetch("https://example.org/").catch(() => null);
        })()"""
    )
    assert browser.run("window.attacked === undefined")
    assert any("Content Security Policy" in problem for problem in browser.problems)


def test_a_hostile_log_runs_no_script(browser: chromium.Browser, hostile_page: Path) -> None:
    """The attack is visible text: nothing of it became an element, and nothing had to be blocked.

    Of the charts, those are drawn that hold it.
    """
    load(browser, hostile_page)
    attacked = browser.run(ATTACKED)
    assert "flight" in attacked
    browser.run(SCROLL.replace(".chart", ".attacked"))
    assert browser.run("document.querySelectorAll('.attacked .main-svg').length") >= len(attacked)
    assert "<script>alert(1)</script>" in browser.run("document.body.innerText")
    assert browser.run("document.querySelectorAll('img[src]:not(.chart img), [onerror]').length") == 0
    assert browser.problems == []


def test_a_printed_report_shows_every_chart(browser: chromium.Browser, page: Path) -> None:
    """Also those that were never scrolled into view, in light colours on a dark screen.

    Back on the screen each is dark again, those that had not been seen as soon as they are.
    """
    load(browser, page, dark=True)
    becomes(browser, FIRST_DRAWN, True)
    colour, of_seen = (
        f"document.getElementById('chart-{key}').layout.paper_bgcolor" for key in ("fit", "evidence")
    )
    browser.run(f"addEventListener('beforeprint', () => {{ window.printed = [{colour}, {of_seen}]; }})")
    assert len(browser.pdf()) > 100_000
    assert browser.run("window.printed") == ["#ffffff", "#ffffff"]
    becomes(browser, COUNT, browser.run("document.querySelectorAll('.chart').length"))
    becomes(browser, of_seen, "#171a1f")
    browser.run("location.hash = 'chart-fit'")
    becomes(browser, colour, "#171a1f")
    assert browser.problems == []


def test_the_summary_is_printed_on_one_page(browser: chromium.Browser, on_paper: None) -> None:
    """All else is left out, and comes back afterwards."""
    browser.run("document.documentElement.dataset.print = 'summary'")
    assert len(re.findall(rb"/Type\s*/Page[^s]", browser.pdf())) == 1
    becomes(browser, "document.documentElement.dataset.print", None)
    assert browser.run("document.querySelectorAll('details[open]').length") == 0


@pytest.mark.parametrize("refused", [False, True])
def test_the_summary_on_paper_holds_no_command_and_what_a_refused_log_shows(
    browser: chromium.Browser, on_paper: None, tmp_path: Path, refused: bool
) -> None:
    """Who gets the page has no log to run a command on; a refusal alone would tell him nothing."""
    log = replace(refused_result(), health=synthetic_health("This is the judgement."))
    if refused:
        open_for_print(browser, write_page(log, tmp_path))
    text = "document.body.innerText"
    assert refused or "quadid-log " in browser.run(text)
    browser.run("document.documentElement.dataset.print = 'summary'")
    assert "quadid-log " not in browser.run(text)
    assert ("This is the judgement." in browser.run(text)) == refused
    assert len(re.findall(rb"/Type\s*/Page[^s]", browser.pdf())) == 1


@pytest.mark.thorough
def test_a_printed_report_is_small_enough_to_send(browser: chromium.Browser, long_drawn: None) -> None:
    """An 80 s flight at 400 Hz took 18 MB of PDF while paper showed every point, each half transparent.

    Why it is small is held by `test_paper_shows_fewer_points_and_no_lower_peak`.
    """
    assert len(browser.pdf()) < 3_000_000
    becomes(browser, "document.getElementById('chart-aligned')._fullData[0].x.length > 2500", True)


UNZOOM = (
    "Plotly.relayout(document.getElementById('chart-aligned'), {'xaxis.autorange': true}).then(() => null)"
)
FINER = """(async () => {
  const chart = document.getElementById("chart-aligned");
  const said = () => chart.parentElement.querySelector(".detail").textContent;
  const near = () => [...chart._fullData[0].x].filter((at) => at >= 30 && at <= 32).length;
  const whole = [near(), said()];
  await Plotly.relayout(chart, {"xaxis.range[0]": 30, "xaxis.range[1]": 32});
  for (let turn = 0; turn < 600 && near() === whole[0]; turn++)
    await new Promise((done) => setTimeout(done, 50));
  return [...whole, near(), said(), chart._fullData[0].x.length];
})()"""


@pytest.mark.thorough
def test_a_zoomed_chart_shows_more_of_the_log_and_says_how_much(
    browser: chromium.Browser, long_drawn: None
) -> None:
    """Of 80 s at 400 Hz, 4000 points are drawn; of two seconds more than twice as many as before."""
    before, said, after, said_near, drawn = browser.run(FINER)
    assert said == "1 of 9 samples shown, peaks kept; zoom in to see more."
    assert after > 2.2 * before
    assert said_near == "1 of 3 samples shown, peaks kept."
    assert drawn < 1000
    assert browser.problems == []
    browser.run(UNZOOM)
    becomes(
        browser,
        "document.querySelector('#chart-aligned').parentElement.querySelector('.detail').textContent",
        said,
    )


THINNED = """(() => {
  const known = (trace) => [...trace.y].filter(Number.isFinite);
  const peak = (chart) => Math.max(...chart._fullData.flatMap(known));
  const chart = document.getElementById("chart-aligned");
  const before = [peak(chart), chart._fullData[0].x.length];
  dispatchEvent(new Event("beforeprint"));
  return [...before, peak(chart), chart._fullData[0].x.length];
})()"""


@pytest.mark.thorough
def test_paper_shows_fewer_points_and_no_lower_peak(browser: chromium.Browser, long_drawn: None) -> None:
    """Each block of points keeps its lowest and its highest value."""
    browser.run("window.shown = null")
    peak, count, printed_peak, printed_count = browser.run(THINNED)
    assert printed_peak == pytest.approx(peak)
    assert 400 < printed_count < min(count, 2500)
