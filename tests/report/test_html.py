"""report.html: complete, self-contained, and deaf to what a log says."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import quadid_logs
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.model import Inertia
from quadid_logs.data.result import Result
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.figures import figures_of
from quadid_logs.figures.interactive import interactive
from quadid_logs.report.cells import Table
from quadid_logs.report.html import packed, render_html, script_json
from quadid_logs.report.log_tables import _unit
from quadid_logs.report.provenance import provenance_of
from quadid_logs.report.text import result_lines
from quadid_logs.report.view import _milliseconds, view_of
from quadid_logs.vocabulary import AXES
from tests.synthetic_results import refused_result


class Page(HTMLParser):
    """What a browser would find: elements, their attributes, scripts, and visible text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[str, str]] = []
        self.text = ""
        self.style = ""
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = tag if tag in {"script", "style"} else ""
        if tag == "script":
            self.scripts.append((dict(attrs).get("type") or "", ""))

    def handle_endtag(self, tag: str) -> None:  # noqa: ARG002 - the parser's name
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            kind, before = self.scripts[-1]
            self.scripts[-1] = (kind, before + data)
        elif self._inside == "style":
            self.style += data
        else:
            self.text += data


def page_of(result: Result) -> Page:
    """Return the parsed page of a result."""
    figures = figures_of(result)
    return Page(render_html(view_of(result, provenance_of(result.log.path, "quadid-log analyze x")), figures))


@pytest.fixture(scope="module")
def usable_page(report_folder: Path) -> Page:
    """Return the parsed report of a good flight."""
    return Page((report_folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def hostile_page(hostile_folder: Path) -> Page:
    """Return the parsed report of the hostile result."""
    return Page((hostile_folder / "report.html").read_text(encoding="utf-8"))


def test_the_report_of_a_good_flight_is_small_enough(report_folder: Path) -> None:
    """Plotly's script has 1.9 MB compressed; the rest stays below 3.1 MB."""
    assert (report_folder / "report.html").stat().st_size < 5e6


@pytest.mark.thorough
def test_a_ten_minute_log_still_fits() -> None:
    """The size does not grow with the flight."""
    from tests.synthetic_results import usable_result

    result = usable_result(600.0)
    text = render_html(view_of(result, provenance_of("x")), figures_of(result))
    assert len(text.encode()) < 5.2e6


def test_the_first_screen_has_verdict_model_and_next_step(usable_page: Page) -> None:
    """In this order, before anything about the log."""
    text = usable_page.text
    places = [
        text.index(words)
        for words in (
            "The model can be used with caution: see the caveats below.",
            "With caution: the torque was clipped",
            "What to do next",
            "Fly gentler yaw",
            "Validation data: measured and predicted rates",
            "B: effect of each torque",
            "A: effect of the motion itself",
            "The log",
        )
    ]
    assert places == sorted(places)


def test_every_parameter_is_shown_with_its_interval(usable: Result, usable_page: Page) -> None:
    """The diagonal of B is there to the digit, and the unidentifiable entries are grey."""
    assert "439.8" in usable_page.text
    assert "433.8 to 445.8" in usable_page.text
    weak = [attrs for tag, attrs in usable_page.tags if tag == "td" and attrs.get("class") == "weak"]
    model = usable.identification.models[0]
    assert len(weak) == sum(not parameter.identifiable for parameter in model.parameters)


def test_the_page_loads_nothing_from_anywhere(usable_page: Page) -> None:
    """No element names another file or host; links stay inside the page."""
    for tag, attrs in usable_page.tags:
        assert "src" not in attrs, (tag, attrs)
        href = attrs.get("href") or "#"
        assert href.startswith("#") or href == "data:,", (tag, attrs)
    assert "@media" in usable_page.style
    assert re.findall(r"url\(|@import", usable_page.style) == []


def test_the_policy_lets_exactly_our_two_scripts_run(hostile_page: Page) -> None:
    """The hashes are those of the two executable scripts; everything else is forbidden."""
    policy = next(
        attrs["content"] or ""
        for tag, attrs in hostile_page.tags
        if attrs.get("http-equiv") == "Content-Security-Policy"
    )
    library = next(text for kind, text in hostile_page.scripts if kind == "application/gzip")
    own = [text for kind, text in hostile_page.scripts if not kind]
    executable = [gzip.decompress(base64.b64decode(library)).decode(), *own]
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in executable]
    assert len(hashes) == 2
    assert re.findall(r"sha256-([^']+)'", policy) == hashes
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy


def test_hostile_text_stays_text(hostile_page: Page) -> None:
    """Script tags of the log are visible words; no element and no attribute comes from them."""
    assert "<script>alert(1)</script>" in hostile_page.text
    assert "{{7*7}}" in hostile_page.text
    kinds = {kind for kind, _ in hostile_page.scripts}
    assert kinds == {"", "application/json", "application/gzip"}
    assert not any(tag == "img" for tag, _ in hostile_page.tags)
    assert not any(name.startswith("on") for _, attrs in hostile_page.tags for name in attrs)


def test_hostile_text_adds_no_element(usable: Result, hostile_page: Page) -> None:
    """The only scripts are ours: one per figure, the palettes, Plotly and the page's own."""
    data = [text for kind, text in hostile_page.scripts if kind == "application/json"]
    charts = [attrs for tag, attrs in hostile_page.tags if "data-key" in attrs]
    assert len(data) == len(charts) + 1
    for text in data:
        assert not set(text) & set("<>&\u2028\u2029")
        json.loads(text)


def test_control_characters_never_reach_the_page(hostile_page: Page) -> None:
    """Neither terminal sequences nor overrides of the writing direction."""
    assert not set(hostile_page.text) & {"\x1b", "\x00", "\u202e", "\u2028"}


def test_json_inside_a_script_cannot_close_it() -> None:
    """The sequences that a browser looks for are gone, the value is the same."""
    value = {"</script><!--": "\u2028]]>&"}
    text = script_json(value)
    assert not set(text) & set("<>&\u2028")
    assert json.loads(text) == value


def test_a_page_s_numbers_are_those_of_the_figure_to_a_pixel(usable: Result) -> None:
    """Whole steps of the range, a gap is a gap; along logarithmic axes they stay as they are."""
    figure = next(item for item in figures_of(usable).shown if item.key == "fit")
    content = interactive(figure)
    small = packed(content)
    for trace, whole in zip(small["data"], content["data"], strict=True):
        if not isinstance(whole["y"], dict):
            continue
        array = small["arrays"][trace["y"]["array"]]
        steps = np.frombuffer(base64.b64decode(array["bdata"]), dtype="<i2").astype(np.float64)
        values = np.frombuffer(base64.b64decode(whole["y"]["bdata"]), dtype="<f4")
        read = np.where(steps == -32768, np.nan, array["low"] + (steps + 32767) * array["step"])
        np.testing.assert_allclose(read, values, atol=0.51 * array["step"] + 1e-6)
    spectrum = packed(
        interactive(next(item for item in figures_of(usable).shown if item.key == "excitation"))
    )
    assert {array["dtype"] for array in spectrum["arrays"]} >= {"f4"}


def test_every_chart_has_a_name_and_a_caption(usable_page: Page) -> None:
    """A screen reader says what is seen and how to read it."""
    ids = {attrs.get("id") for _, attrs in usable_page.tags}
    charts = [attrs for _, attrs in usable_page.tags if "data-key" in attrs]
    assert len(charts) >= 14
    for attrs in charts:
        assert attrs["aria-label"]
        assert attrs["aria-describedby"] in ids
        assert attrs["tabindex"] == "0"


def test_no_id_is_used_twice(usable_page: Page) -> None:
    """Links and labels are unambiguous."""
    ids = [attrs["id"] for _, attrs in usable_page.tags if "id" in attrs]
    assert len(ids) == len(set(ids))


def test_a_refused_log_says_why_and_carries_no_charting_script(refused: Result) -> None:
    """The reason and the advice are on the page; the figures left out are listed."""
    page = page_of(refused)
    assert "Refused: the vehicle never flew." in page.text
    assert "LOG_BITMASK" in page.text
    assert "never armed" in page.text
    assert sum(len(text) for _, text in page.scripts) < 50_000


def test_where_nothing_is_usable_what_is_wrong_stands_before_a_folded_model(
    refused: Result, usable_page: Page
) -> None:
    """A pilot reads why, not tables of numbers that are no results; of a usable flight the model is first."""
    sections = [attrs for tag, attrs in page_of(refused).tags if tag == "section"]
    places = {attrs["id"]: attrs.get("class") for attrs in sections}
    assert list(places)[:4] == ["verdict", "shows", "findings", "model"]
    assert [places[name] for name in ("findings", "model", "loop", "gains")] == [None, "fold", "fold", "fold"]
    usable = [attrs["id"] for tag, attrs in usable_page.tags if tag == "section"]
    assert usable[:6] == ["verdict", "model", "loop", "gains", "shows", "findings"]


def test_the_report_can_be_made_again(usable_page: Page) -> None:
    """Version, command, settings and the file's hash are there."""
    digest = hashlib.sha256(b"\xa3\x95" * 1000).hexdigest()
    assert digest in usable_page.text
    assert "quadid-log analyze flight.bin" in usable_page.text
    assert "high_pass_hz = 0.3" in usable_page.text


def _without_loop(result: Result) -> Result:
    """Return the result without a loop: no gains are searched for that no test here looks at."""
    return replace(result, closed_loop=None)


def _pitch_refused(result: Result) -> Result:
    """Return the result with its pitch refused."""
    verdict = replace(result.diagnosis.axes["pitch"], verdict="refused", sentence="Pitch is refused.")
    axes = {**result.diagnosis.axes, "pitch": verdict}
    return replace(result, diagnosis=replace(result.diagnosis, axes=axes))


def test_numbers_of_a_refused_axis_do_not_look_like_results(usable: Result) -> None:
    """All of it in B and A is grey and says so; other tables put it in brackets; figures say it."""
    result = _pitch_refused(_without_loop(usable))
    view = view_of(result, provenance_of("x"))
    gains, regressors = view.model_tables[:2]
    for table in (gains, regressors):
        assert [row[0].text for row in table.rows] == [f"{axis} acceleration" for axis in AXES]
        assert [row[0].detail == "not to be trusted" for row in table.rows] == [False, True, False]
        assert all(cell.weak for cell in table.rows[1][1:])
    assert "refused" in gains.note
    assert "refused" in regressors.note
    assert view.structures is not None
    assert re.search(r"/ \([\d.]+\) /", view.structures.rows[0][1].text)
    titles = [panel.title for figure in figures_of(result).shown for panel in figure.panels]
    assert "Pitch – refused" in titles
    assert not any("Roll" in title and "refused" in title for title in titles)


def test_the_matrices_stand_in_report_and_notebook_as_in_the_equation(usable: Result) -> None:
    """Torques stood as rows here, accelerations everywhere else: p_dot by M was read as q_dot by L."""
    (model, *others) = usable.identification.models
    B, A = (np.arange(1.0, 1.0 + size).reshape(3, -1) for size in (9, model.A.size))
    names = (*model.inputs, *model.regressors)
    entries = [
        replace(
            one, value=float(np.hstack((B, A))[model.targets.index(one.target), names.index(one.regressor)])
        )
        for one in model.parameters
    ]
    changed = replace(model, B=B, A=A, parameters=tuple(entries))
    identification = replace(usable.identification, models=(changed, *others))
    result = replace(_without_loop(usable), identification=identification)
    first, second = view_of(result, provenance_of("x")).model_tables[:2]
    assert [head[-3:] for head in first.head[1:]] == ["(L)", "(M)", "(N)"]
    shown = [name in second_names(second) for name in model.regressors]
    for table, values in ((first, B), (second, A[:, shown])):
        assert [row[0].detail for row in table.rows] == ["p_dot", "q_dot", "r_dot"]
        assert [[round(float(cell.text)) for cell in row[1:]] for row in table.rows] == values.tolist()


def second_names(table: Table) -> list[str]:
    """Return the symbols of a table's columns."""
    return [head.rpartition("(")[2].rstrip(")") for head in table.head]


def test_findings_speak_in_words() -> None:
    """Meaning, advice, and evidence without any name of a programmer's."""
    finding = Finding(
        code="QL303",
        level="error",
        title="Too slow",
        evidence={"needed_hz": 40.0, "signal": "body_rate", "weak": {"rank_deficient": 3}},
        advice="Set it.",
    )
    result = refused_result()
    result = replace(result, diagnosis=replace(result.diagnosis, findings=(finding,)))
    (shown,) = view_of(result, provenance_of("x")).findings
    assert shown.meaning.startswith("Between two samples")
    assert ("needed at least [Hz]", "40") in shown.evidence
    assert not any("_" in text for pair in shown.evidence for text in pair)


def test_no_flight_of_what_does_not_hover_is_spoken_of() -> None:
    """A rover's log was told to hold ten seconds of flight."""
    result = refused_result()
    rover = replace(result, log=replace(result.log, vehicle_type="rover"))
    subtitle = view_of(rover, provenance_of("x")).subtitle
    assert "a rover" in subtitle
    assert "flight" not in subtitle


def test_a_log_without_a_model_does_not_claim_an_analysis() -> None:
    """It says what was flown, or that nothing was."""
    result = refused_result()
    assert "no flight in 52.0 s of log" in view_of(result, provenance_of("x")).subtitle
    flown = replace(result, data=replace(result.data, flights=((1.0, 31.0),)))
    assert "30.0 s of flight in 52.0 s of log, nothing identified" in result_lines(flown)[0]


def test_an_inertia_stands_beside_the_given_and_the_published_ones(usable: Result) -> None:
    """The user's own says whether it lies within the intervals; the nearest published one comes first."""
    model = usable.identification.models[0]
    matrix = np.diag([0.0229, 0.0231, 0.046])
    inertia = Inertia(matrix=matrix, ci95_low=0.97 * matrix, ci95_high=1.03 * matrix)
    models = (replace(model, inertia=inertia), *usable.identification.models[1:])
    result = replace(
        _without_loop(usable),
        identification=replace(usable.identification, models=models),
        vehicle=Vehicle(mass_kg=3.0, inertia_kg_m2=np.diag([0.023, 0.0231, 0.03])),
    )
    table = view_of(result, provenance_of("x")).more_tables[-1]
    names = [row[0].text for row in table.rows]
    assert names[:3] == ["this flight", "given with --vehicle", "ArduPilot SITL quadrotor"]
    assert table.rows[1][0].detail == "Ixx, Iyy within the interval; Izz outside the interval"
    assert [cell.text for cell in table.rows[0][2:]] == ["0.0229", "0.0231", "0.046"]


def test_only_names_of_axes_are_capitalized_by_the_templates() -> None:
    """Jinja's filter lowers all other letters: a card said rad/s²/(n m)."""
    package = Path(quadid_logs.__file__).parent
    texts = [path.read_text(encoding="utf-8") for path in package.rglob("templates/*.html")]
    found = {name for text in texts for name in re.findall(r"([\w.]+)\s*\|\s*capitalize", text)}
    assert found == {"axis.axis", "picture.axis"}


def test_a_delay_that_may_be_none_is_said_to_be_at_most_so_long() -> None:
    """The search may end at nothing but rounding: no digits of that are shown."""
    assert _milliseconds(2e-13, 0.0, 0.000174, known=False) == "at most 0.17 ms"


def test_a_delay_of_which_only_the_size_is_known_is_said_to_be_about_so_long() -> None:
    """Beside its interval."""
    assert _milliseconds(0.0021, 0.0009, 0.0033, known=False) == "about 2.1 (0.9 to 3.3) ms"


def test_a_known_lag_stands_with_its_interval() -> None:
    """With the digits that the interval allows."""
    assert _milliseconds(0.0473721, 0.0471, 0.0476, known=True).startswith("47.37 (")


def test_what_is_on_or_off_is_not_called_normalised() -> None:
    """The table of signals gave "armed" the unit of a command."""
    assert [_unit(signal) for signal in ("armed", "landed", "throttle")] == [*2 * ["on or off"], "normalised"]
