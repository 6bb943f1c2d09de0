"""The page about a fleet: what it says, and that it can be read by anyone, anywhere."""

from __future__ import annotations

import re

import pytest

from quadid_logs.cli import main
from quadid_logs.fleets.history import read_fleet
from tests import chromium
from tests.fleet.synthetic_store import make_store
from tests.report.test_accessibility import RUN, axe  # noqa: F401 - a fixture

#: Tables that scroll inside the page.
WIDER_THAN_THE_PAGE = """[...document.querySelectorAll(".scroll")]
  .filter((box) => box.scrollWidth > box.clientWidth + 1)
  .map((box) => box.getAttribute("aria-label"))"""
HOSTILE = '<img src=x onerror="alert(1)">'
#: One long word: unbroken, it made the page wider than a phone.
HARDWARE_ID = "000200000000353338373138511600380018"
NAMES = ("quad-1", "quad-2", "quad-3", "quad-4", "quad-5", "quad-6", HARDWARE_ID, HOSTILE)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Eight vehicles; one wears from its seventh flight on."""
    return make_store(tmp_path_factory.mktemp("page") / "store", NAMES, worn="quad-4", reports=True)


@pytest.fixture(scope="module")
def page(store):
    """The page about it."""
    path = store.parent / "page" / "index.html"
    assert main(["fleet-report", str(store), "-o", str(path)]) == 1
    return path


def test_the_worn_vehicle_is_found_and_no_other(store):
    """From the flight on that it happened; it is also the one outlier."""
    fleet = read_fleet(store)
    changed = {
        history.vehicle: [change.flight for change in history.changes]
        for history in fleet.histories
        if history.changes
    }
    assert changed == {"quad-4": [6]}
    assert [history.vehicle for history in fleet.histories if history.outliers] == ["quad-4"]


def test_a_refused_axis_is_left_out(store):
    """Flight 4 of every vehicle refuses yaw: its gain is a hole in the series."""
    for history in read_fleet(store).histories:
        assert 3 not in history.of("gain", "yaw").known
        assert 3 in history.of("gain", "roll").known


def test_the_command_says_what_it_found(store, tmp_path, capsys):
    """How many axes are usable, one line a change and an outlier; exit code 1 for scripts."""
    assert main(["fleet-report", str(store), "-o", str(tmp_path / "x.html")]) == 1
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith("280 of 288 axes are usable; 8 are refused: logged too slowly")
    assert out[1].startswith("quad-4 changed with flight 7 of 12, 2026-03-07 12:00")
    assert out[2].startswith("quad-4 is an outlier among ardupilot quad X")
    assert len(out) == 4


def test_a_quiet_fleet_ends_with_zero(tmp_path, capsys):
    """Nothing changed, no outlier."""
    store = make_store(tmp_path / "store", NAMES)
    assert main(["fleet-report", str(store), "-o", str(tmp_path / "x.html")]) == 0
    assert "No vehicle changed" in (tmp_path / "x.html").read_text()


def test_nothing_is_overwritten_without_force(store, page, capsys):
    """As everywhere."""
    assert main(["fleet-report", str(store), "-o", str(page)]) == 2
    assert main(["fleet-report", str(store), "-o", str(page), "--force"]) == 1


def test_texts_of_logs_are_escaped(page):
    """Names and errors come from files of strangers."""
    text = page.read_text()
    assert "<script" not in text
    assert "<img" not in text
    assert "&lt;b&gt;log&lt;/b&gt;" in text


def test_flights_link_to_their_reports(page):
    """Relative, so that store and page can move together."""
    links = re.findall(r'href="(\.\./store/reports/[0-9a-f]{64}-0\.html)"', page.read_text())
    assert len(links) == len(NAMES) * 12
    assert all((page.parent / link).is_file() for link in links[:5])


def test_the_page_asks_no_host_for_anything(page):
    """One file that works offline."""
    assert not re.findall(r"(?:src|href)=\"(?:https?:)?//", page.read_text())


def test_every_drawing_says_what_it_shows(page):
    """For those who do not see it."""
    drawings = re.findall(r"<svg[^>]*>", page.read_text())
    assert len(drawings) >= 6 * len(NAMES)
    assert all('role="img"' in one and 'aria-label="' in one for one in drawings)


def test_an_empty_store_gives_a_page(tmp_path):
    """Before the first log, or if none could be read."""
    store = make_store(tmp_path / "store", ())
    assert main(["fleet-report", str(store), "-o", str(tmp_path / "x.html")]) == 0
    assert "A fleet of 0 vehicles" in (tmp_path / "x.html").read_text()


@pytest.mark.thorough
@pytest.mark.browser
@pytest.mark.skipif(chromium.PATH is None, reason="no Chromium on this machine")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (400, True)])
def test_a_browser_shows_it_without_complaint(page, request, tmp_path, width, dark):
    """No error, no request, nothing that sticks out, a target that opens its list, nothing for axe-core."""
    with chromium.Browser(tmp_path / "profile") as browser:
        browser.show(width, dark=dark)
        browser.open(page)
        browser.run("document.querySelectorAll('details').forEach((fold) => { fold.open = true; })")
        # Not innerWidth: a phone's grows with what does not fit.
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert browser.run(WIDER_THAN_THE_PAGE) == []
        opened = "(location.hash = '#v3', document.querySelector('#v3').closest('details').open)"
        browser.run(opened)
        assert browser.run("document.querySelector('#v3').closest('details').open") is True
        assert browser.problems == []
        browser.run(f"{request.getfixturevalue('axe')};0")
        assert browser.run(RUN) == []
        assert [address for address in browser.requests if not address.startswith(("file:", "data:"))] == []


def test_vehicles_with_a_result_stand_before_those_without(tmp_path):
    """Thirty-one vehicles without any hid the three that had one."""

    def change(row, _flight):
        if row["vehicle"] == "a":
            row |= {"verdict": "refused", "reasons": ["QL303"], "gain": None, "damping": None}

    store = make_store(tmp_path / "store", ("a", "b"), 2, change=change)
    assert main(["fleet-report", str(store), "-o", str(tmp_path / "x.html")]) == 0
    page = (tmp_path / "x.html").read_text()
    assert 0 < page.index('href="#v1"') < page.index('href="#v0"')
