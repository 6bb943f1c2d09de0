"""Sabotage: whatever makes a recommendation unsafe ends in a refusal by its own name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quadid_logs.control.posterior import draw
from quadid_logs.data.closed_loop import AxisLoop
from quadid_logs.data.controller import Replay, ReplayReason
from quadid_logs.data.diagnosis import AxisVerdict, Finding
from quadid_logs.data.log import NO_GYRO_FILTER
from quadid_logs.data.off_nominal import AS_FLOWN, OFF_NOMINAL, Ranges
from quadid_logs.data.result import PooledLog, Result
from quadid_logs.data.tuning import GOOD, AxisTuning, Limits
from quadid_logs.diagnose.advice import advice_for
from quadid_logs.tuning import recommend
from tests.marks import thorough, thorough_but
from tests.tuned_flights import flown, flown_with_frame, of_axes, with_log, with_parameters


def on_log(**fields: Any) -> Callable[[Result], Result]:
    return lambda result: replace(result, log=replace(result.log, **fields))


def on_parameters(**values: float | None) -> Callable[[Result], Result]:
    return lambda result: with_parameters(result, **values)


def hidden_notch(result: Result) -> Result:
    """Follow a rotor speed that nobody logged, behind the rates that were."""
    hidden = with_parameters(result, INS_HNTCH_ENABLE=1.0, INS_HNTCH_MODE=3.0, INS_HNTCH_REF=1.0)
    return replace(hidden, data=replace(hidden.data, gyro_filter=NO_GYRO_FILTER))


def renamed(**values: float) -> Callable[[Result], Result]:
    """Other parameters that change nothing of the loop: it need not be closed anew."""
    return lambda result: replace(
        result, log=replace(result.log, parameters={**result.log.parameters, **values})
    )


def on_loop(**fields: Any) -> Callable[[Result], Result]:
    def change(result: Result) -> Result:
        assert result.closed_loop is not None
        axes: dict[str, AxisLoop] = {
            axis: replace(one, **fields) for axis, one in result.closed_loop.axes.items()
        }
        return replace(result, closed_loop=replace(result.closed_loop, axes=axes))

    return change


def on_posterior(place: int, sigma: float) -> Callable[[Result], Result]:
    """Another standard deviation of effectiveness, damping, lag or delay."""

    def change(result: Result) -> Result:
        (model, *others) = result.identification.models
        assert model.posterior is not None
        covariance = np.array(model.posterior.covariance)
        covariance[:, place, :] = covariance[:, :, place] = 0.0
        covariance[:, place, place] = sigma**2
        loose = replace(model, posterior=replace(model.posterior, covariance=covariance))
        assert result.closed_loop is not None
        axes = dict(result.closed_loop.axes)
        for number, (axis, loop) in enumerate(axes.items()):
            if loop.plants is not None and loose.posterior is not None:
                plants = draw(loose.posterior, number, result.closed_loop.controllers.axes[axis].period_s)
                assert plants is not None
                axes[axis] = replace(loop, plants=plants._replace(modes=loop.plants.modes))
        identification = replace(result.identification, models=(loose, *others))
        return replace(
            result, identification=identification, closed_loop=replace(result.closed_loop, axes=axes)
        )

    return change


def swapped(result: Result) -> Result:
    """Roll and pitch of the controller's output change places."""
    signals = {
        name: tuple(
            replace(one, values=one.values[:, [1, 0, 2]]) if name == "torque_command" else one
            for one in found
        )
        for name, found in result.log.signals.items()
    }
    terms = tuple(
        replace(one, axis={"roll": "pitch", "pitch": "roll"}.get(one.axis, one.axis))
        for one in result.log.controller_terms
    )
    return with_log(result, replace(result.log, signals=signals, controller_terms=terms))


def pooled(result: Result) -> Result:
    return replace(result, pooled=(PooledLog(path="a", used_s=9.0), PooledLog(path="b", used_s=9.0)))


def saturated(result: Result) -> Result:
    assert result.data.input is not None
    given = replace(result.data.input, saturated_fraction=0.2, limited_fraction=(0.2, 0.2, 0.2))
    return replace(result, data=replace(result.data, input=given))


def yaw_at_its_limits(result: Result) -> Result:
    """As any vehicle with little yaw authority is in a brisk manoeuvre."""
    assert result.data.input is not None
    given = replace(result.data.input, saturated_fraction=0.2, limited_fraction=(0.0, 0.0, 0.2))
    return replace(result, data=replace(result.data, input=given))


def clock_reset(result: Result) -> Result:
    reset = replace(result, data=replace(result.data, clock_resets=1))
    return with_log(reset, reset.log)


def found_mode(result: Result, axes: tuple[str, ...] = ()) -> Result:
    mode = Finding(code="QL525", level="info", title="", evidence={"frequency_hz": 9.0}, advice="", axes=axes)
    diagnosis = replace(result.diagnosis, findings=(*result.diagnosis.findings, mode))
    return replace(result, diagnosis=diagnosis)


def judged(verdict: Any, code: str = "QL503") -> Callable[[Result], Result]:
    def change(result: Result) -> Result:
        one = AxisVerdict(verdict=verdict, reasons=(code,), sentence="")
        axes = dict.fromkeys(result.diagnosis.axes, one)
        return replace(result, diagnosis=replace(result.diagnosis, axes=axes))

    return change


def unstable(result: Result) -> Result:
    """Forty times the gains in the parameters: no vehicle flies so."""
    value = result.log.parameters["ATC_RAT_RLL_P"]
    other = with_parameters(result, ATC_RAT_RLL_P=40.0 * value)
    assert other.closed_loop is not None
    agreeing = Replay(relative_rms={}, agrees=True)
    axes = {axis: replace(one, replay=agreeing) for axis, one in other.closed_loop.axes.items()}
    return replace(other, closed_loop=replace(other.closed_loop, axes=axes))


def slow(result: Result) -> Result:
    nothing = Replay(relative_rms={}, agrees=False, reason=ReplayReason.NO_ROWS)
    return on_loop(replay=nothing)(result)


def rounded_away(result: Result) -> Result:
    hidden = Replay(relative_rms={}, agrees=False, reason=ReplayReason.ROUNDED)
    return on_loop(replay=hidden)(result)


def limiting(result: Result) -> Result:
    often = Replay(relative_rms={}, agrees=False, reason=ReplayReason.SLEW_LIMITED, numbers={"fraction": 0.2})
    return on_loop(replay=often)(result)


def gains_of_another_day(result: Result) -> Result:
    """The last value of a parameter is not the one that flew: changed after the analyzed part."""
    from quadid_logs.data.log import ParameterChange

    last = max(int(one.rows.position[-1]) for one in result.log.signals["body_rate"])
    before = result.log.parameters["ATC_RAT_RLL_P"]
    change = ParameterChange(
        time_s=1e6, position=last + 1, name="ATC_RAT_RLL_P", value=2.0 * before, before=before
    )
    log = replace(
        result.log,
        parameters={**result.log.parameters, "ATC_RAT_RLL_P": 2.0 * before},
        parameter_changes=(*result.log.parameter_changes, change),
    )
    return replace(result, log=log)


def unlogged_limiter(result: Result) -> Result:
    """It may have acted: the log holds P, I and D, and not by what they were scaled."""
    terms = tuple(
        replace(one, values={name: each for name, each in one.values.items() if name != "scale"})
        for one in result.log.controller_terms
    )
    parameters = {**result.log.parameters, "ATC_RAT_RLL_SMAX": 5.0}
    return with_log(result, replace(result.log, controller_terms=terms, parameters=parameters))


HIGH = Limits(39.0, 89.0, 1.9)
#: What makes a flight useless does so whatever else the vehicle is to bear; the vehicle as it flew is quick.
RANGES = pytest.mark.parametrize(
    "ranges",
    [
        pytest.param(AS_FLOWN, id="as flown"),
        pytest.param(OFF_NOMINAL, id="ranges", marks=pytest.mark.thorough),
    ],
)
SABOTAGES: dict[str, tuple[str, Callable[[Result], Result]]] = {
    "settings of another autopilot": ("QL611", on_log(autopilot="betaflight")),
    "no autopilot": ("QL610", on_log(autopilot="other")),
    "a plane": ("QL610", on_log(vehicle_type="fixed-wing")),
    "a quadplane": ("QL610", renamed(Q_ENABLE=1.0)),
    "a helicopter": ("QL610", renamed(FRAME_CLASS=6.0)),
    "a tail-sitter": ("QL610", renamed(FRAME_CLASS=10.0)),
    "a custom controller": ("QL610", renamed(CC_TYPE=1.0)),
    "missing parameters": ("QL611", on_parameters(ATC_RAT_RLL_FLTD=None)),
    "a gain that is no number": ("QL611", on_parameters(ATC_RAT_RLL_P=float("nan"))),
    "a notch on the error": ("QL611", on_parameters(ATC_RAT_RLL_NEF=1.0)),
    "a wrong filter in the file": ("QL612", on_parameters(ATC_RAT_RLL_FLTT=5.0)),
    "a wrong gain in the file": ("QL612", on_parameters(ATC_RAT_RLL_D=0.004)),
    "swapped axes": ("QL612", swapped),
    "a wrong loop rate": ("QL612", on_parameters(SCHED_LOOP_RATE=1000.0)),
    "a log too slow to replay": ("QL613", slow),
    "a clock that was reset": ("QL613", clock_reset),
    "a contradicted response": ("QL614", on_loop(contradicted=True)),
    "a model that something contradicts": ("QL615", judged("caution", "QL602")),
    "a refused model": ("QL615", judged("refused")),
    "a slew limiter that nobody logged": ("QL616", unlogged_limiter),
    "a slew limiter that acted": ("QL616", limiting),
    "motors at their limits": ("QL617", saturated),
    "a posterior too wide in effectiveness": ("QL618", on_posterior(0, 400.0)),
    # A standard deviation as large as the lag itself.
    "a lag that is hardly known": ("QL618", on_posterior(2, 0.03)),
    "a payload that swings": ("QL619", found_mode),
    "a payload that swings about another axis": ("QL619", partial(found_mode, axes=("pitch",))),
    "a hidden notch behind the logged rates": ("QL620", hidden_notch),
    "a firmware without a version": (
        "QL621",
        lambda result: with_log(result, replace(result.log, firmware="")),
    ),
    "gains that were changed afterwards": ("QL622", gains_of_another_day),
    "two vehicles pooled": ("QL623", pooled),
    "an unstable loop": ("QL625", unstable),
    "a log whose rounding hides the terms": ("QL644", rounded_away),
}
#: Searches for gains of vehicles that are hardly known take longest.
LONG = {"a posterior too wide in effectiveness"}


@cache
def unharmed(axis: str) -> AxisTuning:
    """What is recommended for the flight as it was."""
    return recommend(flown("ardupilot"), GOOD, [axis], ranges=AS_FLOWN).axes[axis]


def test_gains_are_not_called_right_where_motors_at_their_limits_hide_what_others_would_do() -> None:
    """A yaw with seven times the error of the best gains and 28 dB to spare was told to keep them."""
    result = flown("ardupilot")
    assert result.data.input is not None
    given = replace(result.data.input, saturated_fraction=0.07, limited_fraction=(0.07, 0.0, 0.0))
    near = replace(result, data=replace(result.data, input=given))
    # Higher gains keep lower limits still: only the motors hold these.
    tuned = recommend(near, Limits(3.0, 25.0, 0.3), ["roll"]).axes["roll"]
    assert (tuned.verdict, [one.code for one in tuned.reasons]) == ("refused", ["QL635"])


def test_gains_of_a_vehicle_at_its_limits_fall_where_they_leave_too_little_margin() -> None:
    """A freestyle quad with 29 degrees, at its limits in a tenth of the flight, was told to fly gentler."""
    demanding = Limits(6.0, 55.0, 0.67)
    free, limited = (
        recommend(one, demanding, ["roll"], ranges=AS_FLOWN).axes["roll"]
        for one in (flown("ardupilot"), saturated(flown("ardupilot")))
    )
    assert any(one.next > one.now for one in free.gains.values())
    assert limited.verdict == "change"
    assert all(one.next <= one.now for one in limited.gains.values())
    assert "QL617" in {one.code for one in limited.reasons}


@pytest.mark.parametrize("limits", [Limits(10.0, 50.0, 0.7), Limits(12.0, 60.0, 0.8)])
def test_no_gains_are_called_right_or_out_of_reach_where_motors_at_their_limits_hold_them(
    limits: Limits,
) -> None:
    """Higher ones, which a flight free of limits would try, were called no better, or not to be had."""
    free, limited = (
        recommend(one, limits, ["roll"], ranges=AS_FLOWN).axes["roll"]
        for one in (flown("ardupilot"), saturated(flown("ardupilot")))
    )
    assert free.verdict == "change"
    assert [one.code for one in limited.reasons] == ["QL617"]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_mode_that_is_merely_not_ruled_out_lowers_gains_no_further(autopilot: str) -> None:
    """Of a flown quad, D fell to a quarter and gusts moved it 2.3 times as far for one that nobody saw."""
    high = Limits(24.0, 45.0, 0.67)
    stiff, unknown = (
        recommend(one, high, ["roll"], ranges=AS_FLOWN).axes["roll"]
        for one in (flown(autopilot), flown_with_frame(autopilot))
    )
    assert stiff.verdict == "change"
    assert unknown.gains == stiff.gains


def test_the_loop_of_a_refused_model_is_not_called_unstable() -> None:
    """None was closed: that a controller or a model is not what flew would be made up."""
    refused = judged("refused")(on_loop(margins=None)(flown("ardupilot")))
    codes = [one.code for one in recommend(refused, GOOD, ["roll"]).axes["roll"].reasons]
    assert "QL615" in codes
    assert "QL625" not in codes


def test_the_loop_of_a_controller_that_did_not_fly_is_not_called_unstable() -> None:
    """Beside "does not reproduce the logged output" stood "There is no stable loop to start from"."""
    other = Replay(relative_rms={}, agrees=False, reason=ReplayReason.NOT_EXPLAINED)
    differing = on_loop(margins=None, replay=other)(flown("ardupilot"))
    codes = [one.code for one in recommend(differing, GOOD, ["roll"]).axes["roll"].reasons]
    assert "QL612" in codes
    assert "QL625" not in codes


def test_the_loop_of_a_log_too_slow_for_the_controller_is_not_called_unstable() -> None:
    """Of a vehicle that hovered for two minutes: "There is no stable loop to start from"."""
    slow_yaw = slow(judged("caution", "QL531")(on_loop(margins=None)(flown("ardupilot"))))
    codes = [one.code for one in recommend(slow_yaw, GOOD, ["roll"]).axes["roll"].reasons]
    assert codes == ["QL615", "QL613"]


def test_telemetry_without_parameters_is_sent_to_the_card_and_not_to_another_controller() -> None:
    """ "Log all parameters, and fly with the standard rate controller": it had flown with it."""
    result = flown("ardupilot")
    telemetry = replace(result.log, format="tlog", parameters={"BARO_ALT_OFFSET": 0.0})
    bare = replace(result, log=telemetry, closed_loop=None)
    reasons = recommend(bare, GOOD, ["roll"]).axes["roll"].reasons
    (one,) = (each for each in reasons if each.code == "QL611")
    assert one.advice.startswith("A telemetry log is too slow for this: use the log on the vehicle's card.")


def test_a_controller_is_known_by_its_parameters_where_no_model_was_found() -> None:
    """A flight that was logged too slowly was told to log its parameters, which it did."""
    without = judged("refused", "QL303")(flown("ardupilot"))
    without = replace(
        without,
        closed_loop=None,
        identification=replace(without.identification, models=()),
    )
    codes = [one.code for one in recommend(without, GOOD, ["roll"]).axes["roll"].reasons]
    assert codes == ["QL615"]


@pytest.mark.parametrize(
    ("autopilot", "version", "told"),
    [
        ("ardupilot", (3, 6, 4), "Update the firmware to 4.0"),
        ("ardupilot", (4, 5, 7), ""),
        ("betaflight", (3, 0), "Update the firmware to 3.1"),
        ("betaflight", (3, 1), ""),
    ],
)
def test_firmware_too_old_for_gains_is_told_to_be_updated(
    autopilot: str, version: tuple[int, ...], told: str
) -> None:
    """Its log holds all its parameters, and those of today's controller are not among them."""
    assert advice_for(autopilot).controller_note(version).startswith(told)
    assert bool(told) == bool(advice_for(autopilot).controller_note(version))


@RANGES
@pytest.mark.parametrize("name", thorough_but(SABOTAGES.keys() - LONG, SABOTAGES))
def test_a_sabotaged_flight_is_refused_by_name(name: str, ranges: Ranges) -> None:
    """Every one of these would make the promise of margins a lie."""
    code, sabotage = SABOTAGES[name]
    result = sabotage(of_axes(flown("ardupilot"), "roll"))
    found = recommend(result, GOOD, ["roll"], ranges=ranges).axes["roll"]
    assert found.verdict == "refused"
    assert code in [one.code for one in found.reasons]
    assert not found.gains


@pytest.mark.parametrize("axis", ["roll", thorough("pitch")])
def test_yaw_at_its_limits_holds_no_other_axis(axis: str) -> None:
    found = recommend(yaw_at_its_limits(flown("ardupilot")), GOOD, [axis], ranges=AS_FLOWN)
    assert found.axes[axis].gains == unharmed(axis).gains


def test_a_refused_model_is_named_with_its_reason() -> None:
    """That it is "not usable" sent its reader to another command."""
    found = recommend(judged("refused")(flown("ardupilot")), GOOD, ["roll"]).axes["roll"]
    title = next(one.title for one in found.reasons if one.code == "QL615")
    assert title.startswith("No model can be used: ")


def test_a_caution_that_only_widens_intervals_is_no_refusal() -> None:
    """The response around the crossover decides about gains, and it is measured."""
    cautious = judged("caution", "QL503")(flown("ardupilot"))
    found = recommend(cautious, GOOD, ["roll"], ranges=AS_FLOWN)
    assert found.axes["roll"].verdict == "change"


def test_a_caution_above_whose_band_nothing_was_measured_is_refused() -> None:
    """Then nothing but the model in question tells of the crossover."""
    cautious = judged("caution", "QL503")(on_loop(known_hz=0.5)(flown("ardupilot")))
    assert "QL615" in [one.code for one in recommend(cautious, GOOD, ["roll"]).axes["roll"].reasons]


def test_the_flight_itself_is_not_refused() -> None:
    """Otherwise the sabotages prove nothing."""
    assert unharmed("roll").verdict != "refused"


@pytest.mark.thorough
@RANGES
@pytest.mark.parametrize("apart", [False, thorough(True)])
def test_limits_that_no_factor_keeps_are_refused_by_name(apart: bool, ranges: Ranges) -> None:
    """39 dB and 89 degrees: no gain is low enough for that."""
    found = recommend(flown("ardupilot"), HIGH, ["roll"], apart=apart, ranges=ranges).axes["roll"]
    assert [one.code for one in found.reasons] == ["QL624"]


def test_a_vtol_is_refused_by_name() -> None:
    """It also flies as a plane, with other gains."""
    result = replace(flown("px4"), log=replace(flown("px4").log, parameters={"CA_AIRFRAME": 2.0}))
    found = recommend(result, GOOD, ["roll"]).axes["roll"]
    assert [one.code for one in found.reasons] == ["QL610"]


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"vehicle_type": "fixed-wing"}, "a fixed-wing aircraft"),
        ({"autopilot": "cleanflight"}, "Cleanflight"),
    ],
)
def test_a_refusal_of_all_gains_names_the_vehicle_or_the_autopilot(
    changes: dict[str, str], named: str
) -> None:
    """Where a pilot reads first, not in the evidence."""
    result = flown("ardupilot")
    found = recommend(replace(result, log=replace(result.log, **changes)), GOOD, ["roll"]).axes["roll"]  # type: ignore[arg-type]
    assert named in found.reasons[0].title


def test_the_manual_lists_every_sabotage_by_name() -> None:
    """Beside the code that refuses it."""
    rows = [
        line.split(" | ") for line in Path("docs/tune.md").read_text().splitlines() if line.startswith("| QL")
    ]
    told = {name: row[0].strip("| ") for row in rows for name in row[1].rstrip(" |").split(", ")}
    assert told == {name: code for name, (code, _) in SABOTAGES.items()}
