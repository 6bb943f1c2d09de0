"""Pages beside the report: two flights compared, and documents written as Markdown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from quadid_logs.comparison import Comparison, Quantity
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.health import Health, RotorFault, Rotors, Standstill
from quadid_logs.data.health import Quantity as HealthQuantity
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, AxisTuning, GainChange, Tuning
from quadid_logs.diagnose.findings import finding
from quadid_logs.report.comparison_page import comparison_page
from quadid_logs.report.markdown_page import markdown_page
from quadid_logs.report.meaning import beside_published, meaning_sentence
from quadid_logs.report.next_flight import next_steps
from quadid_logs.report.view import by_consequence
from quadid_logs.tuning import tuning_of
from tests.synthetic_results import HOSTILE, refused_result, usable_result

EFFECTIVENESS = Quantity(
    name="B11",
    axis="roll",
    unit="rad/s^2",
    before=200.0,
    after=240.0,
    ci95_before=(198.0, 202.0),
    ci95_after=(238.0, 242.0),
    margin=4.0,
    scale=200.0,
    scale_name="B11",
    is_on_axis=True,
    words="roll effectiveness",
    scale_words="roll effectiveness",
)


@pytest.fixture(scope="module")
def usable() -> Result:
    return usable_result(8.0)


def test_a_compared_flight_says_by_axis_what_changed_and_what_would_have_shown(usable: Result) -> None:
    same = replace(EFFECTIVENESS, axis="pitch", after=201.0, words="pitch effectiveness")
    comparison = Comparison(
        structure="damped",
        quantities=(same, EFFECTIVENESS),
        axes={"roll": "changed", "pitch": "same", "yaw": "not comparable"},
        reasons={"yaw": "in both flights yaw was poorly excited"},
        advice=("Fly again.",),
    )
    page = comparison_page(usable, usable, comparison)
    assert "Changed: roll effectiveness by 20.0 %." in page
    assert "No change detected. Smallest detectable change of effectiveness: 2.0 %." in page
    assert "In both flights yaw was poorly excited." in page
    assert page.index("roll effectiveness<small>") < page.index("pitch effectiveness<small>")
    assert "Fly again." in page


def test_a_comparison_escapes_what_the_logs_hold(usable: Result) -> None:
    axes = dict.fromkeys(("roll", "pitch", "yaw"), "not comparable")
    comparison = Comparison(
        structure="",
        quantities=(),
        axes=axes,  # type: ignore[arg-type]
        reasons={"roll": HOSTILE},
        advice=(HOSTILE,),
    )
    page = comparison_page(replace(usable, log=replace(usable.log, path=HOSTILE)), usable, comparison)
    assert "<script>alert" not in page
    assert "<img" not in page


def test_markdown_of_ours_becomes_headings_lists_tables_and_pictures() -> None:
    text = (
        "# Title\n\n## Set\n\n- one\n  and more\n- two\n\n1. first\n2. second\n\n"
        "| | a | b |\n|---|---|---|\n| x | 1 | < 2 |\n\n![A picture](p.png)\n\n**Lead.** And\ntext."
    )
    page = " ".join(markdown_page(text, {"p.png": b"\x89PNG"}).split())
    for part in (
        "<h1>Title</h1>",
        "<h2>Set</h2>",
        "<li>one and more</li> <li>two</li>",
        "<ol> <li>first</li> <li>second</li> </ol>",
        '<td data-head="b"><span>&lt; 2</span></td>',
        '<img src="data:image/png;base64,iVBORw==" alt="A picture">',
        "<strong>Lead.</strong> And text.",
    ):
        assert part in page


def test_markdown_of_a_log_loads_nothing_and_leads_nowhere() -> None:
    """The model that a plan is made for may be called anything."""
    page = markdown_page(
        f"# Plan\n\n{HOSTILE} ![x](https://evil.example/x.png) [y](https://evil.example) <b>"
    )
    body = page[page.index("<main>") :]
    assert not any(mark in body for mark in ("<script", "<img", "<a ", "<b>"))


def test_findings_that_refuse_come_first_and_lost_bytes_last(usable: Result) -> None:
    """Some bytes of many megabytes change no model: their warning follows those of a verdict."""

    def made_up(code: str) -> Finding:
        return Finding(code=code, level="warning", title=code, evidence={}, advice="")

    verdicts = {axis: replace(found, reasons=()) for axis, found in usable.diagnosis.axes.items()}
    verdicts["yaw"] = replace(verdicts["yaw"], verdict="caution", reasons=("QL402",))
    diagnosis = replace(
        usable.diagnosis,
        findings=tuple(map(made_up, ("QL101", "QL303", "QL601", "QL511", "QL402"))),
        axes=verdicts,
    )
    ranked = by_consequence(replace(usable, diagnosis=diagnosis))
    assert [each.code for each in ranked] == ["QL402", "QL511", "QL601", "QL303", "QL101"]


def test_a_usable_flight_says_what_it_is_good_for(usable: Result) -> None:
    """Export, and flying again to compare, after whatever its findings advise."""
    steps = next_steps(usable)
    assert any("quadid-log export flight.bin --model" in step for step in steps)
    assert "quadid-log compare flight.bin" in steps[-1]


def test_a_refused_model_is_not_offered_for_use(usable: Result) -> None:
    """It was fitted, and stands on the page; nobody is told to fly by it."""
    axes = {axis: replace(one, verdict="refused") for axis, one in usable.diagnosis.axes.items()}
    refused = replace(usable, diagnosis=replace(usable.diagnosis, axes=axes))
    assert not any("export" in step for step in next_steps(refused))


def test_a_motor_that_stands_still_is_looked_at_before_anything_is_flown() -> None:
    """It is no finding about the model, and the first thing to do all the same."""
    refused = refused_result()
    standstill = Standstill(
        sentence="",
        level="severe",
        findings=("QL436",),
        rotor=1,
        time_s=3.0,
        length=HealthQuantity(2.0, "s"),
    )
    health = replace(refused.health or Health(), standstill=standstill)
    assert next_steps(replace(refused, health=health))[0].startswith("Take the propellers off")


def test_the_motor_to_look_at_is_named() -> None:
    """Among other steps nobody knows which "this motor" is."""
    weak = RotorFault(
        code="QL430", rotor=1, time_s=float("nan"), size=HealthQuantity(0.2, "1"), p_value=1e-6, sentence=""
    )
    rotors = Rotors(
        sentence="",
        level="high",
        findings=("QL430",),
        names=("motor 1 (front right)", "motor 2 (back left)"),
        effectiveness=(None, None),
        change=(None, None),
        mass_offset=None,
        thrust_change=None,
        shaking=(None, None),
        faults=(weak,),
        searched=(),
    )
    refused = refused_result()
    step = next_steps(replace(refused, health=replace(refused.health or Health(), rotors=rotors)))[0]
    assert "motor 2 (back left)" in step
    assert "this motor" not in step


def test_the_step_about_gains_is_what_tune_recommends(
    usable: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Word for word: no second text works out another direction."""
    lower = finding("QL630", "info", {}, axes=("roll",))
    roll = AxisTuning(verdict="change", reasons=(lower,), gains={"P": GainChange(0.2, 0.1, 0.1)})
    pitch = AxisTuning(verdict="keep", reasons=(finding("QL634", "info", {}, axes=("pitch",)),))
    tuning = Tuning(axes={"roll": roll, "pitch": pitch}, limits=GOOD)
    monkeypatch.setattr("quadid_logs.report.next_flight.tuning_of", lambda _: tuning)
    said = "Roll: lower the gains to 50 %; pitch: keep the gains. `quadid-log tune flight.bin`"
    assert any(one.startswith(said) for one in next_steps(usable))


def test_where_no_gains_are_recommended_no_step_is_about_gains(usable: Result) -> None:
    """A made-up flight has no log to replay: every axis is refused."""
    assert {one.direction for one in tuning_of(usable).axes.values()} == {"refuse"}
    assert not any("advice" in one or "quadid-log tune" in one for one in next_steps(usable))


def test_commands_between_backticks_are_set_as_code_and_stay_escaped(usable: Result) -> None:
    advice = ("Run `quadid-log tune <b>`, or not: one ` alone.",)
    axes = dict.fromkeys(("roll", "pitch", "yaw"), "not comparable")
    comparison = Comparison(structure="", quantities=(), axes=axes, reasons={}, advice=advice)  # type: ignore[arg-type]
    page = comparison_page(usable, usable, comparison)
    assert ">Run <code>quadid-log tune &lt;b&gt;</code>, or not: one ` alone.</" in page


def test_a_refused_flight_is_not_told_to_export() -> None:
    assert not any("export" in step for step in next_steps(refused_result()))


def test_effectiveness_is_told_as_a_turn_that_a_pilot_knows(usable: Result) -> None:
    """sqrt(2 * 10 deg / (0.1 * 439.8)) = 0.089 s, after 25 ms of lag and what there is of delay."""
    model = usable.identification.models[0]
    assert model.actuator is not None
    late_s = model.actuator.lag_s + model.actuator.delay_s
    sentence = meaning_sentence(usable, "roll")
    assert sentence.startswith("A roll command of 10 % turns the vehicle by 10 degrees in ")
    assert float(sentence.split()[-2]) == pytest.approx(0.0891 + late_s, abs=0.006)


def test_effectiveness_stands_beside_published_vehicles(usable: Result) -> None:
    """m g l / Ixx: 519 rad/s² for the smallest of them."""
    assert "519 rad/s² (Crazyflie 2.0" in beside_published(usable).replace("520", "519")


def test_a_refused_axis_is_told_to_mean_nothing() -> None:
    assert meaning_sentence(refused_result(), "roll") == ""
    assert beside_published(refused_result()) == ""
