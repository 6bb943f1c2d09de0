"""``quadid-log compare``: a change is told from chance, and what cannot be compared is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.cli import main
from quadid_logs.comparison import compare
from quadid_logs.data.model import Model
from quadid_logs.data.result import Result
from quadid_logs.data.torque import AssumedExpo, HeldScale
from quadid_logs.figures import Figure, LeftOut
from quadid_logs.figures.loop_comparison import loop_comparison_figure
from quadid_logs.report.comparison import amount, change_words, comparison_lines, comparison_text
from quadid_logs.report.comparison_page import comparison_page
from quadid_logs.report.numbers import estimate
from tests.synthetic_results import refused_result, usable_result


def with_gain(result: Result, *, fraction: float, axis: int = 0, identifiable: bool = True) -> Result:
    """Return the result with the on-axis gain of an axis scaled, its interval with it."""
    model = result.identification.models[0]
    name = f"B{axis + 1}{axis + 1}"
    parameters = tuple(
        replace(
            item,
            value=item.value * fraction,
            ci95=(item.ci95[0] * fraction, item.ci95[1] * fraction),
            identifiable=identifiable,
        )
        if item.name == name
        else item
        for item in model.parameters
    )
    changed = replace(model, parameters=parameters)
    models = (changed, *result.identification.models[1:])
    return replace(result, identification=replace(result.identification, models=models))


@pytest.fixture(scope="module")
def flight() -> Result:
    """Return a good flight."""
    return usable_result(8.0)


def test_a_flight_compared_with_itself_has_not_changed(flight: Result) -> None:
    """Every axis was compared, and the margins say from where on a change would show."""
    comparison = compare(flight, flight)
    assert comparison.verdict == "same"
    assert set(comparison.axes.values()) == {"same"}
    assert all(quantity.margin > 0.0 for quantity in comparison.quantities)


@pytest.mark.parametrize(("fraction", "verdict"), [(1.002, "same"), (0.9, "changed"), (1.1, "changed")])
def test_a_gain_changed_if_it_left_the_intervals(fraction: float, verdict: str, flight: Result) -> None:
    """Two per thousand are chance here, ten per cent are not; the other axes stay."""
    comparison = compare(flight, with_gain(flight, fraction=fraction))
    assert comparison.verdict == verdict
    assert comparison.axes["pitch"] == "same"
    changed = {quantity.name for quantity in comparison.quantities if quantity.changed}
    assert changed == (set() if verdict == "same" else {"B11"})


def test_a_coupling_that_a_skewed_gyro_makes_is_no_change(flight: Result) -> None:
    """Roll into yaw by 0.5 % of the roll gain is much of the yaw gain, and still no change; 5 % is."""
    model = flight.identification.models[0]
    roll_gain = next(item.value for item in model.parameters if item.name == "B11")

    def coupled(fraction: float) -> Result:
        value = fraction * roll_gain
        parameters = tuple(
            replace(item, value=value, ci95=(value - 0.1, value + 0.1), identifiable=True)
            if item.name == "B31"
            else item
            for item in model.parameters
        )
        models = (replace(model, parameters=parameters), *flight.identification.models[1:])
        return replace(flight, identification=replace(flight.identification, models=models))

    assert compare(coupled(0.0), coupled(0.005)).verdict == "same"
    assert compare(coupled(0.0), coupled(0.05)).axes["yaw"] == "changed"


def test_the_verdict_does_not_depend_on_the_order(flight: Result) -> None:
    """What changed one way changed the other way round."""
    other = with_gain(flight, fraction=0.9)
    there, back = compare(flight, other), compare(other, flight)
    assert there.verdict == back.verdict == "changed"
    differences = [
        (one.difference, two.difference) for one, two in zip(there.quantities, back.quantities, strict=True)
    ]
    assert all(one == pytest.approx(-two) for one, two in differences)


def test_more_quantities_need_a_larger_difference(flight: Result) -> None:
    """Bonferroni: the margin is wider than the plain intervals' by a known factor."""
    comparison = compare(flight, flight)
    own = next(quantity for quantity in comparison.quantities if quantity.name == "B11")
    plain = np.hypot(*[0.5 * (high - low) for low, high in (own.ci95_before, own.ci95_after)])
    assert own.margin > 1.2 * plain


def test_a_refused_flight_is_not_comparable_and_says_what_to_set(flight: Result) -> None:
    """Nothing is compared, every axis has its reason, and the advice is the refused flight's."""
    comparison = compare(flight, refused_result())
    assert comparison.verdict == "not comparable"
    assert comparison.quantities == ()
    assert all("after: " in comparison.reasons[axis] for axis in ("roll", "pitch", "yaw"))
    assert any("LOG_DISARMED" in text for text in comparison.advice)


def test_flights_with_different_best_structures_are_compared_in_one_that_both_have(flight: Result) -> None:
    """The first flight's best one if the second has it, else the second's."""
    rigid = replace(flight.identification.models[0], structure="rigid-body")
    first = replace(flight, identification=replace(flight.identification, models=(rigid, *_not_best(flight))))
    assert compare(flight, first).structure == "damped"
    assert compare(first, flight).structure == "damped"


def test_flights_without_a_common_structure_are_not_called_the_same(flight: Result) -> None:
    """Nothing was compared."""
    rigid = replace(flight.identification.models[0], structure="rigid-body")
    other = replace(flight, identification=replace(flight.identification, models=(rigid,)))
    comparison = compare(flight, other)
    assert comparison.verdict == "not comparable"
    assert "no structure was fitted to both" in comparison.reasons["roll"]


def _not_best(result: Result) -> tuple[Model, ...]:
    return tuple(replace(model, recommended=False) for model in result.identification.models)


def test_an_axis_whose_gain_is_not_known_is_not_comparable(flight: Result) -> None:
    """The others still are, but the whole is not called the same."""
    comparison = compare(flight, with_gain(flight, fraction=1.0, axis=1, identifiable=False))
    assert comparison.axes == {"roll": "same", "pitch": "not comparable", "yaw": "same"}
    assert comparison.verdict == "not comparable"


def test_newton_metres_are_not_compared_with_commands(flight: Result) -> None:
    """The reason says what to do."""
    assert flight.data.input is not None
    unit = "1" if flight.data.input.unit == "N m" else "N m"
    other = replace(flight, data=replace(flight.data, input=replace(flight.data.input, unit=unit)))
    comparison = compare(flight, other)
    assert comparison.verdict == "not comparable"
    assert "--vehicle" in comparison.reasons["roll"]


@pytest.fixture
def analyzed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, flight: Result) -> Callable[..., Path]:
    """Let the file's name say what the analysis finds."""
    found = {
        "good": flight,
        "other": with_gain(flight, fraction=0.9),
        "refused": refused_result(),
    }
    monkeypatch.setattr(
        "quadid_logs.pipeline.analyze",
        lambda path, *_a, **_k: replace(
            found[Path(path).stem], log=replace(found[Path(path).stem].log, path=str(path))
        ),
    )
    monkeypatch.chdir(tmp_path)
    for name in found:
        (tmp_path / f"{name}.bin").touch()
    return lambda name: tmp_path / f"{name}.bin"


@pytest.mark.parametrize(("after", "code"), [("good", 0), ("other", 1), ("refused", 3)])
def test_the_exit_code_says_what_was_found(
    after: str, code: int, analyzed: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """0 no change, 1 changed, 3 not comparable; stdout is plain text."""
    assert main(["compare", "good.bin", f"{after}.bin"]) == code
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith(f"good.bin -> {after}.bin: ")
    assert all(line.isprintable() for line in out.splitlines())


def test_figure_and_json_are_written_and_not_overwritten(
    analyzed: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """--json prints what the file holds; a second run needs --force."""
    assert main(["compare", "good.bin", "other.bin", "-o", "out", "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(Path("out/compare.json").read_text())
    assert printed["verdict"] == "changed"
    assert Path("out/compare.png").read_bytes().startswith(b"\x89PNG")
    assert "Changed beyond the intervals" in Path("out/compare.html").read_text(encoding="utf-8")
    assert main(["compare", "good.bin", "other.bin", "-o", "out"]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["compare", "good.bin", "refused.bin", "-o", "fresh"]) == 3
    assert {path.name for path in Path("fresh").iterdir()} == {"compare.json", "compare.html"}


@pytest.mark.thorough
def test_a_full_temporary_folder_costs_no_comparison(
    analyzed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The figure went through a file there."""

    def full(*_a: object, **_k: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryDirectory.__init__", full)
    assert main(["compare", "good.bin", "other.bin", "-o", "out"]) == 1
    assert Path("out/compare.png").read_bytes().startswith(b"\x89PNG")


def test_no_figure_of_an_earlier_comparison_is_left_beside_another_one(
    analyzed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing was compared, so nothing is drawn; the old picture would say otherwise."""
    monkeypatch.setattr("quadid_logs.figures.png.write_png", lambda _figure, file: file.write(b"a picture"))
    assert main(["compare", "good.bin", "other.bin", "-o", "out"]) == 1
    assert Path("out/compare.png").exists()
    assert main(["compare", "good.bin", "refused.bin", "-o", "out", "--force"]) == 3
    assert {path.name for path in Path("out").iterdir()} == {"compare.json", "compare.html"}


@pytest.mark.thorough
def test_whole_and_cut_propellers_at_10_hz_allow_no_comparison(
    corpus: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It says that the logging is too slow and what to set."""
    logs = [str(corpus / "real" / f"ac413-quadx-{name}-hover1.bin") for name in ("goodprop", "25mmcut")]
    assert main(["compare", *logs]) == 3
    out = capsys.readouterr().out
    assert "these logs cannot be compared" in out
    assert "before: the body rate and the torque were logged at 9.78 Hz: too slowly" in out
    assert "after: the body rate and the torque were logged at 9.79 Hz: too slowly" in out
    assert "Set LOG_BITMASK to 176127" in out


def test_loops_of_both_flights_are_drawn_over_each_other(flight: Result) -> None:
    """Gain, phase and step of every axis that has a loop in both, each with both flights."""
    figure = loop_comparison_figure(flight, flight)
    assert isinstance(figure, Figure)
    assert flight.closed_loop is not None
    known = [axis for axis, found in flight.closed_loop.axes.items() if found.curve is not None]
    titles = [f"{axis.capitalize()}: {what}" for what in ("gain", "phase", "step") for axis in known]
    assert [panel.title for panel in figure.panels] == titles
    for panel in figure.panels:
        assert [curve.label for curve in panel.curves] == ["before", "after"]
        assert [ribbon.label for ribbon in panel.ribbons] == ["before, 95 %", "after, 95 %"]


def test_without_a_loop_in_both_flights_no_loop_is_drawn(flight: Result) -> None:
    """A refused flight has none."""
    assert isinstance(loop_comparison_figure(flight, replace(flight, closed_loop=None)), LeftOut)


def test_the_margins_of_both_flights_stand_beside_each_other(flight: Result) -> None:
    """In words for people, with intervals in the JSON."""
    comparison = compare(flight, flight)
    lines = [line.strip() for line in comparison_lines(flight, flight, comparison)]
    assert flight.closed_loop is not None
    margins = flight.closed_loop.axes["roll"].margins
    assert margins is not None
    assert margins.full is not None
    assert margins.full.phase_margin_deg is not None
    one = estimate(margins.full.phase_margin_deg.value, *margins.full.phase_margin_deg.ci95)
    assert f"phase margin {one} -> {one} deg" in lines
    loops = json.loads(comparison_text(flight, flight, comparison))["closed_loop"]["roll"]
    assert loops["before"]["margins"]["full"]["phase_margin_deg"]["value"] == pytest.approx(
        margins.full.phase_margin_deg.value
    )
    assert loops["before"] == loops["after"]


def at_throttle(result: Result, fraction: float) -> Result:
    """Return the result as if flown at a constant throttle."""
    segments = tuple(
        replace(segment, throttle=np.full(segment.time_s.size, fraction)) for segment in result.data.segments
    )
    return replace(result, data=replace(result.data, segments=segments))


@pytest.mark.parametrize(("throttle", "change"), [(0.40, "changed"), (0.42, "same")])
def test_yaw_may_answer_as_the_throttle_lets_it(throttle: float, change: str, flight: Result) -> None:
    """One firmware vehicle was called changed by 4 % of yaw between two flights at different throttle."""
    first = at_throttle(flight, 0.40)
    other = at_throttle(with_gain(flight, fraction=1.25, axis=2), throttle)
    assert compare(first, other).axes["yaw"] == change


def curved(result: Result) -> Result:
    """Return the result as if its firmware did not undo the thrust curve."""
    assert result.data.input is not None
    expo = AssumedExpo(value=0.5, parameter="", held=HeldScale.COMMAND)
    return replace(result, data=replace(result.data, input=replace(result.data.input, expo=expo)))


def test_the_throttle_excuses_roll_where_no_firmware_undoes_the_thrust_curve(flight: Result) -> None:
    """One vehicle was called changed by 3.2 % of roll between sticks and a chirp at less throttle."""
    first = at_throttle(curved(flight), 0.40)
    other = at_throttle(with_gain(first, fraction=1.04), 0.42)
    comparison = compare(first, other)
    assert comparison.axes["roll"] == "same"


def test_lag_and_delay_have_a_line_of_their_own(flight: Result) -> None:
    """They stood below yaw, as if they were yaw's alone."""
    lines = comparison_lines(flight, flight, compare(flight, flight))
    place = next(k for k, line in enumerate(lines) if "lag of the actuators" in line)
    assert lines[place - 1] == "  actuators  same"


def test_the_throttle_excuses_yaw_only(flight: Result) -> None:
    """Roll comes from thrust, whose command this firmware makes linear."""
    other = at_throttle(with_gain(flight, fraction=1.08), 0.42)
    assert compare(at_throttle(flight, 0.40), other).axes["roll"] == "changed"


def test_another_throttle_is_named_beside_yaw(flight: Result) -> None:
    """Who reads that 12 % would show must know that the throttle takes most of it."""
    first, other = at_throttle(flight, 0.40), at_throttle(flight, 0.42)
    text = "\n".join(comparison_lines(first, other, compare(first, other)))
    assert text.count("up to 10 % of it because the throttle was 5 % higher") == 1


def test_a_difference_larger_than_the_value_is_told_in_its_unit(flight: Result) -> None:
    """A damping "changed by -150 %" reads as nonsense."""
    gain = compare(flight, flight).quantities[0]
    damping = replace(gain, name="A11", scale_name="A11", unit="1/s", scale=0.02, margin=0.004)
    assert amount(damping, 0.01) == "50 %"
    assert amount(damping, -0.03) == "−0.0300 1/s"


def test_a_difference_has_the_decimals_of_what_would_show(flight: Result) -> None:
    """0.00712 % was told where 2.4 % would show."""
    gain = replace(
        compare(flight, flight).quantities[0], before=100.0, after=100.007, scale=100.0, margin=2.37
    )
    assert (change_words(gain), amount(gain, gain.margin)) == ("0.0 %", "2.4 %")


def test_a_damping_that_weakens_is_told_with_a_minus(flight: Result) -> None:
    """From -2.3 to -2.1 per second it read "7.9 %", as if there were more of it."""
    gain = compare(flight, flight).quantities[0]
    damping = replace(gain, before=-2.3, after=-2.1, scale=2.3, margin=0.4)
    assert change_words(damping) == "−9 %"


def test_the_page_tells_a_changed_lag_beside_the_axes(flight: Result) -> None:
    """All axes were the same below "Changed beyond the intervals"."""
    model = flight.identification.models[0]
    assert model.actuator is not None
    slower = replace(model.actuator, lag_s=model.actuator.lag_s + 0.02, lag_ci95_s=(0.049, 0.051))
    models = (replace(model, actuator=slower), *flight.identification.models[1:])
    other = replace(flight, identification=replace(flight.identification, models=models))
    page = comparison_page(flight, other, compare(flight, other))
    assert '<h3>Actuators <span class="badge">changed</span></h3>' in page


def test_a_page_without_any_comparison_says_so(flight: Result) -> None:
    """It said that "at least one axis" could not be compared where none could."""
    refused = refused_result()
    page = comparison_page(refused, flight, compare(refused, flight))
    assert "hese logs cannot be compared" in page


def _with_parameters(result: Result, parameters: dict[str, float]) -> Result:
    """Return the result of a log with these parameters alone; without a loop, no gains are searched for."""
    log = replace(result.log, autopilot="ardupilot", parameters=parameters)
    return replace(result, log=log, closed_loop=None)


def test_parameters_that_differ_are_told_with_both_values(flight: Result) -> None:
    before = _with_parameters(flight, {"ATC_RAT_RLL_P": 0.135, "ATC_RAT_PIT_P": 0.1, "ONLY_BEFORE": 1.0})
    after = _with_parameters(flight, {"ATC_RAT_RLL_P": 0.09, "ATC_RAT_PIT_P": 0.1})
    text = json.loads(comparison_text(before, after, compare(before, after)))
    assert text["parameters"] == [{"name": "ATC_RAT_RLL_P", "before": 0.135, "after": 0.09}]


def test_parameters_that_differ_stand_in_the_terminal_and_on_the_page(flight: Result) -> None:
    before, after = (_with_parameters(flight, {"ATC_RAT_RLL_P": gain}) for gain in (0.135, 0.09))
    comparison = compare(before, after)
    assert any("ATC_RAT_RLL_P 0.135 -> 0.09" in line for line in comparison_lines(before, after, comparison))
    assert "ATC_RAT_RLL_P" in comparison_page(before, after, comparison)


@pytest.mark.parametrize("name", ["STAT_FLTTIME", "INS_GYR2OFFS_X", "BARO1_GND_PRESS", "RC3_TRIM"])
def test_what_the_autopilot_counts_or_calibrates_is_no_setting(flight: Result, name: str) -> None:
    before, after = (_with_parameters(flight, {name: value}) for value in (1.0, 2.0))
    assert not compare(before, after).parameters


def test_parameters_of_two_autopilots_are_not_compared(flight: Result) -> None:
    before, after = (_with_parameters(flight, {"P": value}) for value in (1.0, 2.0))
    after = replace(after, log=replace(after.log, autopilot="px4"))
    assert not compare(before, after).parameters
