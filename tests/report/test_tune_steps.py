"""What `tune` says where it gives no gains: every reason, and the steps themselves."""

from __future__ import annotations

from dataclasses import replace

import pytest

from quadid_logs import analyze
from quadid_logs.cli import main
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.diagnosis import AxisVerdict, Diagnosis, Finding
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, AxisTuning, GainChange, Tuning
from quadid_logs.diagnose.findings import finding
from quadid_logs.report.tune_card import flight_files
from quadid_logs.report.tune_view import TuneView, tune_view
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES


@pytest.fixture(scope="module")
def slow() -> Result:
    """Return a flight of an ArduPilot that was logged at 10 Hz."""
    return analyze("sample_logs/default-logging.bin")


def seen(result: Result) -> TuneView:
    return tune_view(result, recommend(result))


def judged(result: Result, *findings: Finding) -> Result:
    """Return the result with other findings, each of which refuses its axes."""
    axes = {
        axis: AxisVerdict(
            verdict="refused",
            reasons=tuple(one.code for one in findings if axis in (one.axes or AXES)),
            sentence="No.",
        )
        for axis in AXES
    }
    return replace(result, diagnosis=Diagnosis(findings=findings, axes=axes))


def test_a_refusal_shows_the_steps_themselves_each_once(slow: Result) -> None:
    """ "Do what the findings of this axis advise" stood there three times, and no finding beside it."""
    steps = seen(slow).steps
    assert len(set(steps)) == len(steps)
    assert steps[0].startswith("Set LOG_BITMASK to ")
    assert all(stick in steps[1] for stick in (" left-right,", "forward-back", "rudder left-right"))
    assert not any("findings" in step for step in steps)
    assert sum("LOG_BITMASK" in step for step in steps) == 1


def test_a_refusal_names_every_reason(slow: Result) -> None:
    """The second was found in the third flight."""
    view, tuning = seen(slow), recommend(slow)
    titles = {axis.axis: [one.title for one in tuning.axes[axis.axis].reasons] for axis in view.axes}
    assert len(titles["roll"]) == len(titles["pitch"]) == 2
    assert all(title in axis.sentence for axis in view.axes for title in titles[axis.axis])


def test_the_steps_to_a_usable_model_are_those_of_the_analysis(slow: Result) -> None:
    """And the reason itself gives them, in the page's list and in the JSON."""
    stiffen = finding("QL525", "error", {}, axes=("roll",))
    result = judged(slow, stiffen)
    assert stiffen.advice in seen(result).steps
    (reason, *_) = recommend(result).axes["roll"].reasons
    assert reason.code == "QL615"
    assert reason.advice == stiffen.advice


def test_what_is_to_be_set_is_told_beside_what_refused_the_axis(slow: Result) -> None:
    """Errors alone are reasons of a refusal: of the slow log, a warning, nothing was said."""
    stiffen = finding("QL525", "error", {}, axes=("roll",))
    faster = finding("QL304", "warning", {}, advice="Log faster.")
    result = judged(slow, stiffen)
    result = replace(result, diagnosis=replace(result.diagnosis, findings=(stiffen, faster)))
    steps = seen(result).steps
    assert steps.index("Log faster.") < steps.index(stiffen.advice)


def test_a_step_for_some_axes_names_them(slow: Result) -> None:
    """A chirp on all three costs two flights more than one on roll."""
    tuning = recommend(slow)
    own = finding("QL614", "warning", {}, axes=("roll",))
    axes = {**tuning.axes, "roll": replace(tuning.axes["roll"], reasons=(own,))}
    assert f"Roll: {own.advice}" in tune_view(slow, replace(tuning, axes=axes)).steps


def test_no_advice_asks_a_pilot_to_look_at_units_and_signs() -> None:
    """Who flies an autopilot has made no column; the table's reader is asked in its own words."""
    for entry in CATALOGUE.values():
        assert "belong together" not in entry.advice


#: What replaces the manoeuvre where an axis turned enough (tests/diagnose/test_model_findings.py).
ENOUGH = ("QL404", "QL503", "QL504", "QL505", "QL511")


@pytest.mark.parametrize("code", ENOUGH)
def test_an_explanation_agrees_with_the_advice_on_an_axis_that_turned_enough(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It said "fly with stronger excitation" where the report said that larger manoeuvres do not help."""
    assert main(["explain", code]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "Below 20 deg/s, fly stronger manoeuvres" in told
    assert "Above that, larger manoeuvres do not help. Fly in calm air" in told


def test_an_explanation_says_what_an_autopilot_s_own_advice_is(capsys: pytest.CaptureFixture[str]) -> None:
    """The report shows that in place of the catalogue's."""
    assert main(["explain", "QL604"]) == 0
    assert "Betaflight: Keep profiles and gains as they are" in " ".join(capsys.readouterr().out.split())


def test_a_card_without_a_file_of_settings_tells_how_to_keep_them(slow: Result) -> None:
    """Betaflight's are set by hand, and no log holds all of them: `diff all` prints what brings them back."""
    raised = AxisTuning(
        verdict="change",
        gains={"p_roll": GainChange(45.0, 58.0, 58.0)},
        reasons=(finding("QL631", "info", {}, axes=("roll",)),),
    )
    log = replace(slow.log, autopilot="betaflight", format="blackbox")
    files = flight_files(replace(slow, log=log), Tuning(axes={"roll": raised}, limits=GOOD))
    set_first, then = (files["plan.md"].index(words) for words in ("`diff all`", "blackbox_sample_rate"))
    assert set_first < then
