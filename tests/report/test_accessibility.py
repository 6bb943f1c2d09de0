"""axe-core on the report: nothing serious, whatever the verdict."""

from __future__ import annotations

import functools
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

from quadid_logs.comparison import compare
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
from tests.report.test_browser import SCROLL
from tests.synthetic_results import hostile_result, refused_result, usable_result
from tests.synthetic_tuning import synthetic_tune_page
from tests.test_repeat import flights

pytestmark = [
    pytest.mark.browser,
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


@functools.cache
def pages() -> dict[str, str]:
    """Return the pages to look at: a usable, a refused and a hostile report, and those beside it."""
    results = {"usable": usable_result(8.0), "refused": refused_result(), "hostile": hostile_result()}
    texts = {
        name: render_html(view_of(result, provenance_of("x", "quadid-log analyze x")), figures_of(result))
        for name, result in results.items()
    }
    return {
        **texts,
        "index": index_page([index_row(result, name) for name, result in results.items()]),
        "compare": comparison_page(*[results["usable"]] * 2, compare(*[results["usable"]] * 2)),
        "repeat": repetition_page(repeat(flights([430.0, 440.0, 470.0]))),
        "tune": synthetic_tune_page(),
        "document": markdown_page("# Plan\n\n## Set\n\n- this\n\n| | a |\n|---|---|\n| b | 1 |"),
    }


PAGES = ("usable", "refused", "hostile", "index", "compare", "repeat", "tune", "document")
#: A hostile report on a phone has the parts of a usable one.
CASES = [(name, width, dark) for name in PAGES for width, dark in ((1280, False), (400, True))]
QUICK = [one for one in CASES if one != ("hostile", 400, True)]


@pytest.mark.parametrize(
    ("name", "width", "dark"),
    [pytest.param(*one, marks=() if one in QUICK else pytest.mark.thorough) for one in CASES],
)
def test_axe_finds_no_serious_problem(
    browser: chromium.Browser, axe: str, tmp_path: Path, name: str, width: int, dark: bool
) -> None:
    """Contrast, names, roles, headings, on a desk in daylight and on a phone at night."""
    path = tmp_path / f"{name}.html"
    path.write_text(pages()[name], encoding="utf-8")
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
