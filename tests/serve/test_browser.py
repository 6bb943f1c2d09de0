"""The page in headless Chromium, driven as a person would: drop, watch, read, compare, delete."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from quadid_logs import analyze, result_dict
from tests import chromium
from tests.conftest import REPOSITORY
from tests.report.test_accessibility import RUN, axe  # noqa: F401 - a fixture
from tests.serve.running import Running

pytestmark = [
    pytest.mark.browser,
    pytest.mark.thorough,
    pytest.mark.skipif(chromium.PATH is None, reason="no Chromium on this machine"),
]

LOGS = REPOSITORY / "sample_logs"
ATTACK = "<img src=x onerror=document.title=1>"
NAME = f"{ATTACK}.bin"
WATCH = """(() => {
  window.seen = {};
  setInterval(() => {
    for (const line of document.querySelectorAll("#queue-list li")) {
      const bar = line.querySelector("progress"), stage = line.querySelector(".stage").textContent;
      const name = line.querySelector("strong").textContent;
      if (bar && stage.includes("left")) (window.seen[name] ??= []).push(bar.value);
    }
  }, 100);
})()"""
FLIGHTS = "document.querySelectorAll('.flights tbody tr').length"
QUEUE = "document.querySelectorAll('#queue-list li')"
FAILED = "document.querySelectorAll('#failed-list li')"


@dataclass
class Session:
    """What a person has before them, and what went by while the logs were analyzed."""

    server: Running
    browser: chromium.Browser
    progress: dict[str, list[float]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def home(self, width: int = 1280, *, dark: bool = False) -> chromium.Browser:
        """Open the list."""
        self.browser.show(width, dark=dark)
        self.browser.go(f"{self.server.address}/")
        self.browser.wait(f"{FLIGHTS} > 0")
        return self.browser


def hostile_log(folder: Path) -> Path:
    """Return a log that names its firmware, and itself, in HTML that runs a script."""
    content = (LOGS / "default-logging.bin").read_bytes()
    before = b"ArduCopter V4.5.7 (quadid-logs simulator)"
    assert before in content
    path = folder / NAME
    path.write_bytes(content.replace(before, ATTACK.encode().ljust(len(before), b" ")))
    return path


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """Drop three files on the page, one of them hostile and one broken, and wait for what becomes of them."""
    folder = tmp_path_factory.mktemp("serve")
    broken = folder / "broken.bin"
    broken.write_bytes((LOGS / "sysid-quad-x.bin").read_bytes()[:70])
    with (
        Running(folder / "store", "--workers", "1") as server,
        chromium.Browser(folder / "profile") as browser,
    ):
        browser.show(1280)
        browser.go(server.start_address)
        browser.wait("document.querySelector('#drop') !== null && location.pathname === '/'")
        browser.run(WATCH)
        browser.drop([hostile_log(folder), LOGS / "doublets.tlog", broken])
        browser.wait(f"{FLIGHTS} === 2 && {FAILED}.length === 1 && {QUEUE}.length === 0", 240.0)
        yield Session(
            server, browser, browser.run("window.seen"), list(browser.problems), list(browser.requests)
        )


def test_progress_moves(session: Session) -> None:
    """Of each log that is analyzed: forwards, and shown between its beginning and its end, too."""
    for values in session.progress.values():
        assert values == sorted(values)
    assert max(len(set(values)) for values in session.progress.values()) >= 3


def test_each_log_has_a_verdict_per_axis(session: Session) -> None:
    """Whatever its format."""
    badges = session.home().run("[...document.querySelectorAll('.flights .badge')].map((it) => it.innerText)")
    assert len(badges) == 6
    assert set(badges) <= {"usable", "caution", "refused"}


def test_a_file_that_is_no_log_says_why(session: Session) -> None:
    """And stays until somebody deletes it."""
    text = session.home().run("document.querySelector('#failed-list').innerText")
    assert "broken.bin" in text
    assert "not a recognised flight log" in text


def test_a_hostile_log_runs_no_script(session: Session) -> None:
    """Neither in the list nor in its report, where its texts stand as they are."""
    browser = session.home()
    assert browser.run("document.querySelectorAll('.flights img').length") == 0
    assert NAME in browser.run("document.querySelector('#vehicles').innerText")
    entry = next(each for each in session.server.entries()["entries"] if each["name"] == NAME)
    browser.go(f"{session.server.address}/reports/{entry['id']}/page")
    assert browser.run("document.querySelectorAll('img[src=x]').length") == 0
    assert ATTACK in browser.run("document.body.innerText")
    assert browser.run("document.title") != "1"


def test_a_report_opens_in_the_page_without_its_origin(session: Session) -> None:
    """Its own scripts run in the sandbox; those of the page around it are not its own."""
    browser = session.home()
    entry = next(each for each in session.server.entries()["entries"] if each["name"] == "doublets.tlog")
    browser.click(f".flights a[href='/reports/{entry['id']}']")
    browser.wait("document.querySelector('iframe')?.title.startsWith('Result of')")
    assert browser.problems == []
    address = browser.run("document.querySelector('iframe').src")
    browser.go(address)
    browser.wait("typeof Plotly === 'object'")
    assert browser.run("self.origin") == "null"


def test_nothing_leaves_the_host(session: Session) -> None:
    """Every request of the whole visit goes to the server."""
    browser = session.home()
    assert {request[: len(session.server.address)] for request in session.requests} == {
        session.server.address
    }
    assert all(request.startswith((session.server.address, "data:")) for request in browser.requests)


def test_the_console_stays_empty(session: Session) -> None:
    """No error, and no violation of a policy."""
    assert session.problems == []


def test_two_flights_are_compared(session: Session) -> None:
    """Marked with the mouse, and read in the page."""
    browser = session.home()
    browser.click("tbody [data-mark]")
    browser.run("[...document.querySelectorAll('[data-mark]')].at(-1).click()")
    browser.click("#compare")
    browser.wait("document.querySelector('#answer-list a') !== null", 120.0)
    browser.go(browser.run("document.querySelector('#answer-list a').href") + "/page")
    assert "two flights compared" in browser.run("document.body.innerText").lower()


def test_the_next_gains_are_told_or_why_not(session: Session) -> None:
    """As the verb tune does, in two clicks: where the button was, a link leads to the answer."""
    browser = session.home()
    browser.click("button[aria-label^='Next gains']")
    browser.wait("document.querySelector('.flights a[aria-label^=\"Next gains\"]') !== null", 120.0)
    browser.click(".flights a[aria-label^='Next gains']")
    browser.wait("location.pathname.startsWith('/reports/')")
    files = browser.wait("document.querySelector('.bar')?.innerText")
    assert "tune.json" in files


def test_the_history_of_a_vehicle_opens(session: Session) -> None:
    """With what a change would take."""
    browser = session.home()
    browser.click("#vehicles a[href^='/vehicles/']")
    browser.wait("location.pathname.startsWith('/vehicles/') && document.readyState === 'complete'")
    text = browser.run("document.body.innerText")
    assert "A change is reported only if" in text
    assert NAME in text
    assert browser.problems == []


def test_the_numbers_are_those_of_the_command_line(session: Session) -> None:
    """All of result.json, but for how long it took and where the log lay."""
    entry = next(each for each in session.server.entries()["entries"] if each["name"] == "doublets.tlog")
    answer = session.server.ask("GET", f"/reports/{entry['id']}/files/result.json")[2]
    served, ours = json.loads(answer), json.loads(json.dumps(result_dict(analyze(LOGS / "doublets.tlog"))))
    for content in (served, ours):
        content.pop("tool", None)
        content.pop("timings_s")
        content["log"].pop("path")
    assert served == ours


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (400, True)])
def test_nothing_scrolls_sideways(session: Session, width: int, dark: bool) -> None:
    """On a desk and on a phone."""
    browser = session.home(width, dark=dark)
    assert browser.run("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("path", ["/", "/vehicles/{id}", "/reports/{id}"])
def test_screen_readers_find_nothing_serious(session: Session, axe: str, path: str) -> None:  # noqa: F811
    """By axe-core's rules."""
    entry = next(each for each in session.server.entries()["entries"] if each["state"] == "done")
    session.home()
    session.browser.go(session.server.address + path.format(id=entry["id"]))
    session.browser.run(axe + "; 1")
    assert session.browser.run(RUN) == []


def test_logs_are_chosen_with_the_keyboard(session: Session) -> None:
    """The second stop of the Tab key, after the link that skips to the flights."""
    browser = session.home()
    for _ in range(2):
        browser.key("Tab")
    assert browser.run("document.activeElement.id") == "files"


def test_a_flight_is_compared_with_the_one_before_in_two_clicks(session: Session) -> None:
    """Of one vehicle: the newer flight has the button, and a link to the answer takes its place."""
    name = json.dumps({"name": "One quad"}).encode()
    for each in session.server.entries()["entries"]:
        if each["kind"] == "compare":
            session.server.ask("DELETE", f"/entries/{each['id']}")
        if each["kind"] == "analyze" and each["state"] == "done":
            assert session.server.ask("POST", f"/vehicles/{each['id']}/name", name)[0] == 204
    browser = session.home()
    browser.wait("document.querySelectorAll('.flights').length === 1")
    asked = "[aria-label^='Compare with last'], [aria-label^='Promise kept']"
    assert browser.run(f'document.querySelectorAll("{asked}").length') == 1
    browser.run(f'document.querySelector("{asked}").click()')
    link = "document.querySelector('.flights tbody tr .actions a[aria-label*=\"→\"]')"
    browser.wait(f"{link} !== null", 120.0)
    browser.go(browser.run(f"{link}.href") + "/page")
    assert "two flights compared" in browser.run("document.body.innerText").lower()


def test_a_deleted_flight_is_gone(session: Session) -> None:
    """From the page and from the disk, once somebody confirms it."""
    browser = session.home()
    entry = next(each for each in session.server.entries()["entries"] if each["name"] == "doublets.tlog")
    browser.click("button[aria-label='Delete doublets.tlog']")
    browser.wait("document.querySelector('#confirm').open")
    browser.click("#confirm button[value=yes]")
    browser.wait(f"{FLIGHTS} === 1")
    assert entry["id"] not in json.dumps(session.server.entries())
    assert session.server.ask("GET", f"/reports/{entry['id']}/page")[0] == 404
