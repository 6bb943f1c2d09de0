"""axe-core on the report: nothing serious, whatever the verdict."""

from __future__ import annotations

import functools
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

from quadid_logs.comparison import compare
from quadid_logs.data.result import Result
from quadid_logs.figures import figures_of
from quadid_logs.repetition import repeat
from quadid_logs.report.comparison_page import comparison_page
from quadid_logs.report.html import render_html
from quadid_logs.report.index import index_page, index_row
from quadid_logs.report.markdown_page import markdown_page
from quadid_logs.report.provenance import provenance_of
from quadid_logs.report.repetition_page import repetition_page
from quadid_logs.report.view import view_of
from tests import chromium
from tests.marks import thorough
from tests.report.test_browser import SCROLL
from tests.synthetic_results import hostile_result, refused_result, usable_result
from tests.synthetic_tuning import synthetic_tune_page
from tests.test_repeat import flights

pytestmark = [
    pytest.mark.browser,
    pytest.mark.thorough,
    pytest.mark.skipif(chromium.PATH is None, reason="no Chromium on this machine"),
]

#: The first three points of a cloud stand for all of it: axe-core takes most of its time for such likes.
RUN = """(async () => {
  for (const point of document.querySelectorAll(".point:nth-of-type(n + 4)")) point.remove();
  const found = await axe.run(document, {resultTypes: ["violations"]});
  return found.violations
    .filter((item) => item.impact === "serious" || item.impact === "critical")
    .map((item) => `${item.id}: ${item.nodes.slice(0, 3).map((node) => node.html).join(" | ")}`);
})()"""


@pytest.fixture(scope="session")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return axe-core's script, fetched with npm; skip where that is not possible."""
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("no npm to fetch axe-core with")
    folder = tmp_path_factory.mktemp("axe")
    try:
        subprocess.run(
            [npm, "pack", "axe-core@4", "--silent"], cwd=folder, check=True, capture_output=True, timeout=60
        )
    except (subprocess.SubprocessError, OSError) as error:
        pytest.skip(f"npm cannot fetch axe-core: {error}")
    with tarfile.open(next(folder.glob("*.tgz"))) as package:
        member = package.extractfile("package/axe.min.js")
        assert member is not None
        return member.read().decode("utf-8")


RESULTS = {"usable": lambda: usable_result(8.0), "refused": refused_result, "hostile": hostile_result}


@functools.cache
def result_of(name: str) -> Result:
    return RESULTS[name]()


def page_of(name: str) -> str:
    """Return a page to look at: a usable, a refused or a hostile report, or one of those beside it."""
    if name in RESULTS:
        result = result_of(name)
        return render_html(view_of(result, provenance_of("x", "quadid-log analyze x")), figures_of(result))
    if name == "index":
        return index_page([index_row(result_of(one), one) for one in RESULTS])
    if name == "compare":
        both = [result_of("usable")] * 2
        return comparison_page(*both, compare(*both))
    if name == "repeat":
        return repetition_page(repeat(flights([430.0, 440.0, 470.0])))
    if name == "tune":
        return synthetic_tune_page()
    return markdown_page("# Plan\n\n## Set\n\n- this\n\n| | a |\n|---|---|\n| b | 1 |")


PAGES = ("usable", "refused", "hostile", "index", "compare", "repeat", "tune", "document")
CASES = [(name, width, dark) for name in PAGES for width, dark in ((1280, False), (400, True))]
#: Each page once, and each of the two styles on pages of every kind; a hostile report has the parts of a
#: usable one.
QUICK = [
    ("usable", 1280, False),
    ("refused", 400, True),
    ("index", 400, True),
    ("compare", 1280, False),
    ("repeat", 400, True),
    ("tune", 400, True),
    ("document", 1280, False),
]


@pytest.mark.parametrize(
    ("name", "width", "dark"), [one if one in QUICK else thorough(*one) for one in CASES]
)
def test_axe_finds_no_serious_problem(
    browser: chromium.Browser, axe: str, tmp_path: Path, name: str, width: int, dark: bool
) -> None:
    """Contrast, names, roles, headings, on a desk in daylight and on a phone at night."""
    path = tmp_path / f"{name}.html"
    path.write_text(page_of(name), encoding="utf-8")
    browser.show(width, dark=dark)
    browser.open(path)
    browser.run(SCROLL)
    browser.run(f"{axe};0")
    assert browser.run(RUN) == []


def test_axe_sees_what_is_bad(browser: chromium.Browser, axe: str, tmp_path: Path) -> None:
    """The check is no rubber stamp: pale text and a button without a name are found."""
    path = tmp_path / "bad.html"
    path.write_text(
        "<!DOCTYPE html><html lang='en'><title>x</title><main><h1>x</h1><button></button>"
        "<p style='color:#bbb;background:#fff'>pale</p></main></html>"
    )
    browser.show(1280)
    browser.open(path)
    browser.run(f"{axe};0")
    found = browser.run(RUN)
    assert {line.split(":")[0] for line in found} == {"button-name", "color-contrast"}
