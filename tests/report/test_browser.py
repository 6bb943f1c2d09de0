"""The report in a real browser: no error, no request, charts drawn, no sideways scrolling."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from quadid_logs.data.result import Result
from quadid_logs.figures import figures_of
from quadid_logs.report.html import render_html
from quadid_logs.report.provenance import provenance_of
from quadid_logs.report.view import view_of
from tests import chromium
from tests.synthetic_results import hostile_result, usable_result

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium.PATH is None, reason="no Chromium on this machine"),
]

SCROLL = """(async () => {
  for (const fold of document.querySelectorAll("details")) fold.open = true;
  for (const chart of document.querySelectorAll(".chart")) {
    chart.scrollIntoView({behavior: "instant"});
    for (let turn = 0; turn < 50 && !chart.querySelector(".main-svg"); turn++)
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
PAUSE = "new Promise((done) => setTimeout(done, 500))"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of a short flight, which a browser without a graphics card draws quickly."""
    return write_page(usable_result(8.0), tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def hostile_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the report of a log in which every text is an attack."""
    return write_page(hostile_result(), tmp_path_factory.mktemp("page"))


def write_page(result: Result, folder: Path) -> Path:
    """Write the page alone, without pictures."""
    view = view_of(result, provenance_of(result.log.path, "quadid-log analyze"))
    (folder / "report.html").write_text(render_html(view, figures_of(result)), encoding="utf-8")
    return folder / "report.html"


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (400, True)])
def test_every_chart_is_drawn_and_nothing_scrolls_sideways(
    browser: chromium.Browser, page: Path, width: int, dark: bool
) -> None:
    """On a desk and on a phone, light and dark, without a message in the console."""
    browser.show(width, dark=dark)
    browser.open(page)
    browser.run(SCROLL)
    charts = browser.run("document.querySelectorAll('.chart').length")
    assert charts >= 14
    assert browser.run(COUNT) == charts
    assert browser.run("document.documentElement.scrollWidth") <= width
    names, covered, outside = browser.run(NAMES)
    assert (names > 25, covered, outside) == (True, [], [])
    assert browser.problems == []


def test_charts_wait_until_they_are_scrolled_into_view(browser: chromium.Browser, page: Path) -> None:
    """Those of the first screens are there, those of folded chapters are not."""
    browser.show(1280)
    browser.open(page)
    browser.run(PAUSE)
    assert browser.run("document.querySelectorAll('#chart-evidence .main-svg').length") > 0
    assert browser.run("document.querySelectorAll('details .chart .main-svg').length") == 0
    assert browser.run("document.documentElement.scrollHeight") < 9 * 900
    assert "The model" in browser.run("document.body.innerText")


def test_the_report_asks_no_host_for_anything(browser: chromium.Browser, page: Path) -> None:
    """The only thing that is loaded is the file itself (and its empty icon)."""
    browser.show(1280)
    browser.open(page)
    browser.run(SCROLL)
    outside = [address for address in browser.requests if not address.startswith(("file:", "data:", "blob:"))]
    assert outside == []
    assert sum(address.startswith("file:") for address in browser.requests) == 1


def test_the_policy_forbids_what_a_log_could_try(browser: chromium.Browser, page: Path) -> None:
    """Even if an attack became markup, it would not run and could not call home."""
    browser.show(1280)
    browser.open(page)
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


def test_charts_over_time_zoom_together(browser: chromium.Browser, page: Path) -> None:
    """Zooming the first chart moves the others and the names at ends of lines; a double click resets all."""
    browser.show(1280)
    browser.open(page)
    browser.run(SCROLL)
    whole = browser.run(RANGE.format("fit"))
    structures = browser.run(RANGE.format("structures"))
    flight = "document.getElementById('chart-flight')"
    browser.run(
        f"Plotly.relayout({flight}, {{'xaxis.range[0]': 26, 'xaxis.range[1]': 28}}).then(() => {PAUSE})"
    )
    for key in ("flight", "aligned", "over-time", "fit", "simulation"):
        assert browser.run(RANGE.format(key)) == pytest.approx([26, 28]), key
    assert browser.run(RANGE.format("structures")) == pytest.approx(structures)
    end, named, names = browser.run(NAMED)
    assert (named, names) == (pytest.approx(end), 2)
    browser.run(f"Plotly.relayout({flight}, {{'xaxis.autorange': true}}).then(() => {PAUSE})")
    assert browser.run(RANGE.format("fit")) == pytest.approx(whole, abs=0.5)
    assert browser.problems == []


def test_a_chart_can_be_zoomed_with_the_keyboard(browser: chromium.Browser, page: Path) -> None:
    """Plus halves the span that all charts over time show, zero shows everything again."""
    browser.show(1280)
    browser.open(page)
    browser.run(SCROLL)
    start, end = browser.run(RANGE.format("fit"))
    press = """(document.getElementById("chart-fit").dispatchEvent(
        new KeyboardEvent("keydown", {key: "%s", bubbles: true})), %s)"""
    browser.run(press % ("+", PAUSE))
    for key in ("fit", "aligned"):
        closer = browser.run(RANGE.format(key))
        assert closer[1] - closer[0] == pytest.approx((end - start) / 2.0), key
    browser.run(press % ("0", PAUSE))
    assert browser.run(RANGE.format("fit")) == pytest.approx([start, end], abs=0.5)


def test_turning_the_phone_lays_the_charts_out_anew(browser: chromium.Browser, page: Path) -> None:
    """Three columns on a wide screen become one on a narrow one."""
    domain = "document.getElementById('chart-horizon').layout.xaxis.domain[1]"
    browser.show(1280)
    browser.open(page)
    browser.run(SCROLL)
    assert browser.run(domain) < 0.4
    browser.show(400)
    browser.run(PAUSE)
    assert browser.run(domain) == 1
    assert browser.run("document.documentElement.scrollWidth") <= 400


def test_a_hostile_log_runs_no_script(browser: chromium.Browser, hostile_page: Path) -> None:
    """The attack is visible text: nothing of it became an element, and nothing had to be blocked."""
    browser.show(1280)
    browser.open(hostile_page)
    browser.run(SCROLL)
    assert browser.run("document.querySelectorAll('#chart-flight .main-svg').length") > 0
    assert "<script>alert(1)</script>" in browser.run("document.body.innerText")
    assert browser.run("document.querySelectorAll('img[src]:not(.chart img), [onerror]').length") == 0
    assert browser.problems == []


def test_a_printed_report_shows_every_chart(browser: chromium.Browser, page: Path) -> None:
    """Also those that were never scrolled into view, in light colours on a dark screen."""
    browser.show(1280, dark=True)
    browser.open(page)
    colour = "document.getElementById('chart-fit').layout.paper_bgcolor"
    browser.run(f"addEventListener('beforeprint', () => {{ window.printed = {colour}; }})")
    assert len(browser.pdf()) > 100_000
    assert browser.run("window.printed") == "#ffffff"
    assert browser.run(COUNT) == browser.run("document.querySelectorAll('.chart').length")
    assert browser.run(colour) == "#171a1f"
    assert browser.problems == []


def test_the_first_screen_holds_verdict_picture_and_steps(browser: chromium.Browser, page: Path) -> None:
    """On 1280 by 900 pixels; the links to the chapters take one line of it."""
    browser.show(1280)
    browser.open(page)
    browser.run(PAUSE)
    bottom = "document.querySelector('{}').getBoundingClientRect().bottom"
    for selector in ("#verdict-title", ".axes", "#chart-evidence", ".steps li:last-child"):
        assert browser.run(bottom.format(selector)) < 900, selector
    assert browser.run("document.querySelector('nav').getBoundingClientRect().height") < 60


def test_the_summary_is_printed_on_one_page(browser: chromium.Browser, page: Path) -> None:
    """All else is left out, and comes back afterwards."""
    browser.show(1280, media="print")
    browser.open(page)
    browser.run("document.documentElement.dataset.print = 'summary'")
    assert len(re.findall(rb"/Type\s*/Page[^s]", browser.pdf())) == 1
    browser.run(PAUSE)
    assert browser.run("document.documentElement.dataset.print") is None
    assert browser.run("document.querySelectorAll('details[open]').length") == 0


def test_a_printed_report_is_small_enough_to_send(
    browser: chromium.Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """An 80 s flight at 400 Hz took 18 MB of PDF while paper showed every point, each half transparent."""
    long_page = write_page(usable_result(), tmp_path_factory.mktemp("long"))
    browser.show(1280, media="print")
    browser.open(long_page)
    browser.run(SCROLL)
    assert len(browser.pdf()) < 3_000_000


THINNED = """(() => {
  const known = (trace) => [...trace.y].filter(Number.isFinite);
  const peak = (chart) => Math.max(...chart._fullData.flatMap(known));
  const chart = document.getElementById("chart-aligned");
  const before = [peak(chart), chart._fullData[0].x.length];
  dispatchEvent(new Event("beforeprint"));
  return [...before, peak(chart), chart._fullData[0].x.length];
})()"""


def test_paper_shows_fewer_points_and_no_lower_peak(
    browser: chromium.Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Each block of points keeps its lowest and its highest value."""
    browser.show(1280)
    browser.open(write_page(usable_result(), tmp_path_factory.mktemp("thin")))
    browser.run(SCROLL)
    peak, count, printed_peak, printed_count = browser.run(THINNED)
    assert printed_peak == pytest.approx(peak)
    assert 400 < printed_count < min(count, 2500)


FINER = """(async () => {
  const chart = document.getElementById("chart-aligned");
  const said = () => chart.parentElement.querySelector(".detail").textContent;
  const near = () => [...chart._fullData[0].x].filter((at) => at >= 30 && at <= 32).length;
  const whole = [near(), said()];
  await Plotly.relayout(chart, {"xaxis.range[0]": 30, "xaxis.range[1]": 32});
  await new Promise((done) => setTimeout(done, 1500));
  return [...whole, near(), said(), chart._fullData[0].x.length];
})()"""


def test_a_zoomed_chart_shows_more_of_the_log_and_says_how_much(
    browser: chromium.Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Of 80 s at 400 Hz, 4000 points are drawn; of two seconds more than twice as many as before."""
    browser.show(1280)
    browser.open(write_page(usable_result(), tmp_path_factory.mktemp("zoom")))
    browser.run(SCROLL)
    before, said, after, said_near, drawn = browser.run(FINER)
    assert said == "1 of 9 samples shown, peaks kept; zoom in to see more."
    assert after > 2.2 * before
    assert said_near == "1 of 3 samples shown, peaks kept."
    assert drawn < 1000
    assert browser.problems == []


def test_every_control_can_be_reached_by_keyboard(browser: chromium.Browser, page: Path) -> None:
    """The first stop is the jump to the model; links, charts and wide tables are all stops."""
    browser.show(1280)
    browser.open(page)
    key = {"type": "keyDown", "key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9}
    browser.send("Input.dispatchKeyEvent", key)
    assert browser.run("document.activeElement.className") == "skip"
    unreachable = browser.run(
        "document.querySelectorAll('.scroll:not([tabindex]), .chart:not([tabindex])').length"
    )
    assert unreachable == 0
