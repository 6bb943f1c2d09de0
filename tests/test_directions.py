"""No sentence about gains points the wrong way: each is held against the loop of the vehicle that flew."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.cli.tune import _show
from quadid_logs.data.closed_loop import LoopMargins, Margins
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, Tuning
from quadid_logs.report.gain_files import gain_files
from quadid_logs.report.loop_view import loop_view
from quadid_logs.report.next_flight import next_steps
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.text import result_lines
from quadid_logs.report.tune_card import flight_files
from quadid_logs.report.tune_page import tune_page
from quadid_logs.report.tune_view import headline
from quadid_logs.report.view import view_of
from quadid_logs.tuning import recommend, tuning_of
from quadid_logs.vocabulary import AXES
from tests.directed_flights import AUTOPILOTS, GAINS, OF_ONE_AXIS, QUICK, Case, cases_of, walked, with_gains
from tests.marks import thorough_but

pytestmark = pytest.mark.usefixtures("quick_multisines")

#: What good loops keep, and below what they are close to instability: MIL-F-9490D and ADS-33E practice.
KEPT = {"gain_margin_db": 6.0, "gain_margin_down_db": 6.0, "phase_margin_deg": 45.0, "disk_margin": 0.67}
CLOSE = {"gain_margin_db": 4.0, "gain_margin_down_db": 4.0, "phase_margin_deg": 30.0}
#: The model is not the vehicle: a tenth of a margin is what these flights of 20 s leave open.
MODEL = 0.1
NOWHERE = Provenance(version="0", command="", log_sha256="")
#: Commands that change gains; of filters none is meant.
UP, DOWN = (
    re.compile(rf"\b({words})\b", re.IGNORECASE)
    for words in ("raise|raised|increase|increased|double", "lower|lowered|reduce|reduced|halve|decrease")
)


def cases() -> list[tuple[str, str, int]]:
    """Every axis of every flight, by its place: what it recommends is known only when it has flown."""
    flights = [(autopilot, gains) for autopilot in AUTOPILOTS for gains in GAINS]
    return [(*one, place) for one in flights for place in range(1 if one[1] in OF_ONE_AXIS else len(AXES))]


QUICK_CASES = [one for one in cases() if one[1] in QUICK[one[0]]]


@pytest.fixture(params=thorough_but(QUICK_CASES, cases()), ids=lambda one: "-".join(map(str, one)))
def case(request: pytest.FixtureRequest) -> Case:
    autopilot, gains, place = request.param
    return walked(autopilot, gains)[place]


def flights(autopilot: str) -> list[Case]:
    """Return every axis of every flight of an autopilot."""
    return [one for gains in GAINS for one in walked(autopilot, gains)]


def quick_flights() -> list[Case]:
    """Return every axis of the flights that a quick run looks at."""
    return [one for autopilot, kinds in QUICK.items() for gains in kinds for one in walked(autopilot, gains)]


def outer(margins: LoopMargins) -> Margins:
    return margins.full or margins.rate


def kept(margins: LoopMargins, limits: dict[str, float] = KEPT) -> float:
    """Return the least margin over what good loops keep of it; one is enough, zero is unstable."""
    loops = [one for one in (margins.rate, margins.full) if one is not None]
    if not all(one.stable for one in loops):
        return 0.0
    pairs = ((getattr(one, name), limit) for one in loops for name, limit in limits.items())
    return min(figure.value / limit for figure, limit in pairs if figure is not None)


def up_db(margins: LoopMargins) -> float:
    figure = outer(margins).gain_margin_db
    return np.inf if figure is None else figure.value


@pytest.mark.thorough
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_walk_meets_every_direction(autopilot: str) -> None:
    """Or the other tests would hold nothing."""
    assert len(flights(autopilot)) == 17
    assert {one.view.direction for one in flights(autopilot)} >= {"raise", "lower", "keep", "refuse"}


def test_a_quick_walk_meets_every_direction() -> None:
    """Up and down at once, too: no one word is true of that."""
    met = {one.view.direction for one in quick_flights()}
    assert met == {"raise", "lower", "keep", "refuse", "reshape"}


@pytest.mark.thorough
def test_gains_of_every_axis_are_lowered_somewhere() -> None:
    walks = [one for autopilot in AUTOPILOTS for one in flights(autopilot)]
    lowered = {one.axis for one in walks if one.view.direction == "lower"}
    assert lowered == set(AXES)


def test_the_gains_of_the_file_go_where_the_sentences_say(case: Case) -> None:
    """The direction of the view is that of the numbers beside it."""
    ways = {np.sign(float(one.next) - float(one.now)) for one in case.view.gains}
    expected = {"raise": {1.0}, "lower": {-1.0}, "reshape": {1.0, -1.0}, "keep": set(), "refuse": set()}
    assert ways == expected[case.view.direction]


def test_the_true_loop_has_no_less_margin_than_it_had_or_is_to_keep(case: Case) -> None:
    """What is recommended, in either direction, on the vehicle that is meant."""
    assert kept(case.true_next) >= min(1.0, kept(case.true_now)) - MODEL * (case.view.direction == "keep")


def test_gains_are_lowered_where_the_true_loop_gains_margin(case: Case) -> None:
    if case.view.direction == "lower":
        assert kept(case.true_now) < 1.0
        assert kept(case.true_next) > kept(case.true_now)
        assert up_db(case.true_next) > up_db(case.true_now)


def test_gains_are_raised_where_the_true_loop_keeps_its_margins_or_gains_some(case: Case) -> None:
    """And is faster for it."""
    if case.view.direction == "raise":
        assert kept(case.true_next) >= 1.0 or kept(case.true_next) > kept(case.true_now)
        now, following = outer(case.true_now).crossover_hz, outer(case.true_next).crossover_hz
        assert now is not None
        assert following is not None
        assert following.value > now.value


def test_gains_that_are_kept_have_the_margins_that_good_loops_keep(case: Case) -> None:
    if case.view.direction == "keep":
        assert kept(case.true_now) >= 1.0 - MODEL


def test_a_filter_that_is_said_to_limit_an_axis_takes_that_phase_from_the_true_loop(case: Case) -> None:
    """With twice its cut-off the rate loop has about as much more as is told, and nothing else is lost."""
    for one in (one for one in case.found.reasons if one.code == "QL636"):
        name, cutoff_hz = str(one.evidence["parameter"]), float(str(one.evidence["cutoff_hz"]))
        further = case.true_with({name: 2.0 * cutoff_hz})
        before, after = (each.rate.phase_margin_deg for each in (case.true_now, further))
        assert before is not None
        assert after is not None
        told = [float(str(one.evidence[f"phase_margin_{each}deg"])) for each in ("", "with_twice_that_")]
        assert after.value - before.value == pytest.approx(told[1] - told[0], abs=3.0)
        assert kept(further) > kept(case.true_now)


def test_the_way_back_never_leads_to_less_margin_where_the_vehicle_shakes(case: Case) -> None:
    """Lowered gains have none: the flown ones shake more. Nor has a loop that was close to instability."""
    if case.view.way_back:
        assert up_db(case.true_now) >= up_db(case.true_next)
        assert kept(case.true_now, CLOSE) >= 1.0 - MODEL or kept(case.true_now) >= kept(case.true_next)
    elif case.found.changes:
        is_close = kept(case.true_now, CLOSE) < 1.0 + MODEL
        assert up_db(case.true_now) < up_db(case.true_next) or is_close


def test_not_there_yet_is_said_where_the_true_loop_may_lack_margin(case: Case) -> None:
    """And what is promised to keep the limits keeps them in truth."""
    if case.found.changes and "Not there yet" not in case.view.sentence and "miss" not in case.view.sentence:
        assert kept(case.true_next) >= 1.0
    assert "keep the margins" not in case.view.sentence


def not_told_apart(told: Finding, true: LoopMargins) -> bool:
    """Whether the flight allows both the true loop and one with less margin than is to be kept."""
    for name, limit in KEPT.items():
        figure, seen = getattr(outer(true), name), told.evidence.get(name)
        if figure is not None and seen is not None:
            low, high = seen["ci95"]
            if low < limit and low * (1.0 - MODEL) <= figure.value <= high * (1.0 + MODEL):
                return True
    return False


def test_only_loops_that_are_close_to_instability_are_called_so(case: Case) -> None:
    """Fear is for these; a sound race tune has 43 degrees. What may lack margin is no better known."""
    told = [one for one in case.result.diagnosis.findings if one.code == "QL601" and case.axis in one.axes]
    for one in told:
        close = "close to instability" in one.title
        assert close == ("Land if the vehicle shakes" in one.advice) == (one.level == "warning")
        if "may have less" in one.title:
            assert not_told_apart(one, case.true_now)
        else:
            assert kept(case.true_now, CLOSE if close else KEPT) < 1.0 + MODEL


def ways(text: str) -> set[str]:
    """Return in which directions a text sends gains; a filter's cut-off is no gain."""
    sentences = [one for one in re.split(r"(?<=[.;])\s", text) if "cut-off" not in one]
    return {way for way, words in (("raise", UP), ("lower", DOWN)) if any(map(words.search, sentences))}


def texts_of(case: Case) -> Iterator[str]:
    """Yield all that is said of one axis alone."""
    view = case.view
    yield from (view.sentence, view.promise, view.warning, view.filter_note, view.autotune)
    yield from (text for one in view.reasons for text in (one.title, one.advice))
    for one in case.result.diagnosis.findings:
        if case.axis in one.axes:
            yield from (one.title, one.advice)
    yield from (one for one in loop_view(case.result).sentences if one.lower().startswith(case.axis))
    for text in (*gain_files(case.result, case.tuning).values(), *card(case.result, case.tuning)):
        yield from (line for line in text.splitlines() if re.search(rf"^\W*{case.axis}:", line))
    mine = [one for one in headline(case.tuning).lower().split("; ") if case.axis in one.split(":")[0]]
    assert len(mine) == 1
    yield from mine


@cache
def card(result: Result, tuning: Tuning) -> tuple[str, ...]:
    return tuple(flight_files(result, tuning).values())


def test_every_text_of_an_axis_points_where_its_gains_go(case: Case) -> None:
    """Findings, loop, headline, reasons, files, card: a contradicted or refused axis is sent nowhere."""
    allowed = {case.view.direction} & {"raise", "lower"}
    assert {text: found for text in texts_of(case) if (found := ways(text)) - allowed} == {}


def test_no_other_text_points_anywhere(case: Case, capsys: pytest.CaptureFixture) -> None:
    """Steps, terminal and report repeat the headline, and know no direction of their own."""
    head = headline(tuning_of(case.result))
    steps = [one.removeprefix(head) for one in next_steps(case.result)]
    lines = [one.replace(head, "") for one in result_lines(case.result)]
    assert [one for one in (*steps, *lines) if ways(one)] == []
    report = view_of(case.result, NOWHERE)
    assert report.gains.headline == head
    assert report.steps == next_steps(case.result)
    _show(case.result, case.tuning, Path(), (), ())
    assert case.view.warning in capsys.readouterr().out


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_page_card_and_terminal_send_back_the_same_axes(
    autopilot: str, capsys: pytest.CaptureFixture
) -> None:
    """The file of the flown gains holds all axes; where it is none for one, nobody is told to load it."""
    walks = [walked(autopilot, gains) for gains in QUICK[autopilot]]
    for others in (one for one in walks if one[0].tuning.changes):
        first = others[0]
        barred = [one.axis for one in others if one.found.changes and not one.view.way_back]
        texts = (tune_page(first.result, first.tuning, NOWHERE), *card(first.result, first.tuning))
        _show(first.result, first.tuning, Path(), (), ())
        for text in (*texts, capsys.readouterr().out):
            assert not (barred and re.search(r"load back\.", text))
        for axis in barred:
            assert all(
                re.search(rf"not load the flown gains of[^.]*{axis}", text) for text in (texts[0], texts[-0])
            )


@pytest.mark.thorough
@pytest.mark.parametrize("apart", [True, False])
def test_as_many_flights_as_told_lead_to_margins_that_are_kept(apart: bool) -> None:
    """Give or take one: each flight looks anew."""
    result, changes = with_gains("px4", {"pitch": 0.4}), {}
    (flown,) = cases_of("px4", result, recommend(result, GOOD, ["pitch"], apart=apart))
    told, flights = flown.found.flights_to_limits, -1
    while kept(flown.true_now) < 1.0 and flights < 20:
        flights += 1
        changes |= {name: one.next for name, one in flown.found.changes.items()}
        result = with_gains("px4", {"pitch": 0.4}, values=changes)
        (flown,) = cases_of("px4", result, recommend(result, GOOD, ["pitch"], apart=apart))
    assert abs(flights - told) <= 1
