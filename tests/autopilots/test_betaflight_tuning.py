"""Betaflight's next gains: whole numbers for the command line, what they promise, and the way back."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots import named
from quadid_logs.autopilots.betaflight.flight_modes import flight_modes
from quadid_logs.autopilots.betaflight.gains import tunable
from quadid_logs.containers.blackbox import FrameTable
from quadid_logs.control.loop import close, integrators
from quadid_logs.control.margins import grid_hz, margins_of
from quadid_logs.data.log import ModeChange, Rows
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, Limits, Tuning
from quadid_logs.report.gain_files import gain_files, reason_text
from quadid_logs.report.tune_card import flight_files
from quadid_logs.report.tune_view import tune_view
from quadid_logs.tuning import recommend
from tests.analyses import Analyzed
from tests.autopilots.test_betaflight_controller import HOVER, STICKS, true_plant
from tests.tuned_flights import of_axes, stiff, with_log

pytestmark = pytest.mark.usefixtures("quick_multisines")

#: The flight has 47 degrees: with 45 to keep P and I go apart, with less to keep all gains go up together.
BEARABLE = Limits(6.0, 40.0, 0.6)
HEADER = {"p_roll": 45.0, "i_roll": 80.0, "d_roll": 30.0}


@pytest.fixture(scope="module")
def sticks(corpus: Path, analyzed: Analyzed) -> Result:
    return stiff(analyzed(corpus / "firmware" / STICKS))


@pytest.fixture(scope="module")
def tuned(sticks: Result) -> Tuning:
    return recommend(sticks, BEARABLE, ["roll"])


@pytest.fixture(scope="module")
def files(sticks: Result, tuned: Tuning) -> dict[str, str]:
    return gain_files(sticks, tuned)


def settings(text: str) -> dict[str, str]:
    """Return what the lines of a command line set."""
    return dict(re.findall(r"^set (\S+) = (\S+)$", text, re.MULTILINE))


def test_gains_are_whole_numbers_rounded_down() -> None:
    """Less gain is the safe side; what is whole but for rounding stays."""
    names = tunable(HEADER).axes["roll"]
    assert [names.written(value) for value in (58.99, 80.0 * 1.3, 57.0)] == [58.0, 104.0, 57.0]


@pytest.mark.parametrize("end", ["d_min_roll", "d_max_roll"])
def test_the_other_end_of_d_is_scaled_with_it(end: str) -> None:
    """Else D-max would do more, or less, than it did."""
    assert tunable(HEADER | {end: 40.0}).axes["roll"].scaled == ("p_roll", "i_roll", "d_roll", end)


def test_an_end_that_is_off_is_not_scaled() -> None:
    """Zero means none."""
    assert tunable(HEADER | {"d_max_roll": 0.0}).axes["roll"].scaled == ("p_roll", "i_roll", "d_roll")


def test_the_range_ends_at_200_before_the_sliders() -> None:
    """It was raised with them."""
    ranges = [tunable(each).axes["roll"].ranges["p_roll"] for each in ({}, {"simplified_pids_mode": 0.0})]
    assert ranges == [(0.0, 200.0), (0.0, 250.0)]


def test_a_curve_of_throttle_attenuation_is_named() -> None:
    """Its law is not modelled."""
    assert "tpa_curve_type" in tunable({"tpa_curve_type": 1.0}).obstacle


def test_the_next_gains_are_one_step_up(sticks: Result) -> None:
    """All by one factor of two to four, but for rounding down to whole numbers."""
    changes = recommend(sticks, BEARABLE, ["pitch"], apart=False).axes["pitch"].changes
    assert set(changes) == {"p_pitch", "i_pitch", "d_pitch", "d_max_pitch"}
    lowest = max(one.next / one.now for one in changes.values())
    highest = min((one.next + 1.0) / one.now for one in changes.values())
    assert lowest <= highest
    assert highest >= 2.0
    assert lowest <= 4.0
    assert all(one.next.is_integer() and one.target.is_integer() for one in changes.values())


def test_both_ends_of_the_range_of_d_go_together(sticks: Result) -> None:
    """Each gain goes its own way, and D is one of them."""
    found = recommend(sticks, GOOD, ["roll"]).axes["roll"]
    d, highest = (found.gains[name] for name in ("d_roll", "d_max_roll"))
    assert found.reasons[0].code == "QL641"
    assert highest.next / highest.now == pytest.approx(d.next / d.now, abs=1.0 / d.now)


def test_the_promise_holds_for_the_true_vehicle(corpus: Path, sticks: Result, tuned: Tuning) -> None:
    """With the gains of the file in the controller, and the simulated vehicle around them."""
    found = tuned.axes["roll"]
    assert found.next is not None
    parameters = {**sticks.log.parameters, **{name: one.next for name, one in found.gains.items()}}
    controllers = named("betaflight").controllers(sticks.log, parameters)
    assert controllers is not None
    controller = controllers.axes["roll"]
    frequency_hz = grid_hz(controller.period_s)
    loop = close(controller, true_plant(corpus, STICKS, "roll"), frequency_hz)
    true = margins_of(frequency_hz, loop.rate, integrators(controller), np.array([False]), 1e9)
    for figure in ("phase_margin_deg", "gain_margin_db"):
        low, high = getattr(found.next.rate, figure).ci95
        assert low <= getattr(true, figure).value <= high


def test_the_file_sets_what_changes_with_the_sliders_off(files: dict[str, str], tuned: Tuning) -> None:
    """They would make the gains anew."""
    expected = {name: f"{one.next:.0f}" for name, one in tuned.changes.items()}
    assert settings(files["next.txt"]) == {"simplified_pids_mode": "OFF"} | expected


def test_the_file_saves_at_its_end(files: dict[str, str]) -> None:
    """Without that the settings are lost at the next start."""
    assert [text.splitlines()[-1] for text in files.values()] == ["save", "save"]


def test_the_way_back_is_what_flew(sticks: Result, files: dict[str, str], tuned: Tuning) -> None:
    """Every gain that a flight may change, whichever changes now, then the sliders as they stood."""
    flown = sticks.log.parameters
    back = settings(files["back.txt"])
    assert back.pop("simplified_pids_mode") == "RPY"
    assert set(tuned.changes) <= set(back)
    assert back == {name: f"{flown[name]:.0f}" for name in back}


def test_gains_that_change_each_by_themselves_are_named_by_their_letters(tuned: Tuning) -> None:
    """It said "p, I, D and the angle gain" of a controller without an angle gain."""
    title = "P, I and D are changed each by itself"
    reason = replace(tuned.axes["roll"].reasons[0], title=title)
    assert reason_text(replace(tuned.axes["roll"], reasons=(reason,))).startswith(title)


def test_the_page_says_how_gains_get_into_a_flight_controller(sticks: Result, tuned: Tuning) -> None:
    """No ground station loads them."""
    assert tune_view(sticks, tuned).steps[0].startswith("Paste next.txt into the command line")


def test_the_profile_is_to_be_chosen_first(files: dict[str, str]) -> None:
    """No log tells it."""
    assert all("PID profile" in text.split("set ")[0] for text in files.values())


def test_the_card_says_how_to_log_and_what_to_fly(sticks: Result, tuned: Tuning) -> None:
    """Lines for the command line set the chirp, and take it off."""
    card = flight_files(sticks, tuned)
    assert list(card) == ["plan.md", "chirp.txt", "chirp-off.txt"]
    assert "blackbox_sample_rate" in card["plan.md"]


def in_angle_mode(sticks: Result, **changes: object) -> Result:
    """Return the flight as if angle mode had been on."""
    modes = (ModeChange(time_s=sticks.data.segments[0].start_s, position=0, name="Angle"),)
    return with_log(of_axes(sticks, "roll"), replace(sticks.log, modes=modes, **changes))


@pytest.mark.thorough
def test_an_angle_loop_whose_gain_no_header_tells_gives_no_gains(sticks: Result) -> None:
    """It takes phase from the rate loop, nobody knows how much."""
    kept = {name: one for name, one in sticks.log.parameters.items() if not name.startswith("levelPID")}
    found = recommend(in_angle_mode(sticks, parameters=kept), GOOD, ["roll"]).axes["roll"]
    assert (found.verdict, [one.code for one in found.reasons]) == ("refused", ["QL643"])


@pytest.mark.thorough
def test_in_angle_mode_margins_are_also_those_of_the_loop_with_the_angle_loop(sticks: Result) -> None:
    """The whole loop has less phase."""
    found = recommend(in_angle_mode(sticks), GOOD, ["roll"]).axes["roll"]
    assert found.now is not None
    assert found.now.full is not None
    assert found.now.full.phase_margin_deg.value < found.now.rate.phase_margin_deg.value


def test_a_hover_is_refused(corpus: Path, analyzed: Analyzed) -> None:
    """Neither model nor controller can be told from it."""
    found = recommend(analyzed(corpus / "firmware" / HOVER), GOOD)
    assert found.refused == ("roll", "pitch", "yaw")


@pytest.mark.parametrize(
    ("code", "told"), [("QL615", True), ("QL644", True), ("QL613", False), ("QL625", False)]
)
def test_a_hover_is_refused_for_what_it_is(
    code: str, *, told: bool, corpus: Path, analyzed: Analyzed
) -> None:
    """All is in the log at 1 kHz, as rounding; and no loop was closed, stable or not."""
    roll = recommend(analyzed(corpus / "firmware" / HOVER), GOOD).axes["roll"]
    assert (code in [one.code for one in roll.reasons]) == told


@pytest.mark.thorough
def test_a_flown_axis_that_lacks_five_degrees_keeps_its_rejection_of_gusts(
    corpus: Path, analyzed: Analyzed
) -> None:
    """Its pitch was told to fly with a fifth of P, I and D; it contradicts its model now."""
    flown = analyzed(corpus / "blackbox" / "bf3-log17.bfl")
    roll = recommend(flown, GOOD, ["roll"]).axes["roll"]
    assert roll.verdict == "change"
    assert roll.attitude_error < 1.0
    assert all(one.target > 0.4 * one.now for one in roll.gains.values())


def test_modes_are_those_of_the_slow_frames() -> None:
    """Armed is bit 0, angle mode bit 1; each holds from the next main frame on."""
    flags = np.array([1, 3, 1], np.int32)
    slow = FrameTable(
        columns={"flightModeFlags": flags}, signed={"flightModeFlags": False}, position=np.array([5, 25, 45])
    )
    rows = Rows(np.array([0.0, 1.0, 2.0]), np.array([10, 30, 50]))
    found = flight_modes(slow, rows)
    assert [(one.name, one.time_s) for one in found] == [("Acro", 0.0), ("Angle", 1.0), ("Acro", 2.0)]


@pytest.mark.thorough
def test_a_rate_loop_out_of_reach_is_not_told_to_lower_an_angle_gain(sticks: Result) -> None:
    """In Acro mode none flies: what may be left is a filter, which its own note names."""
    found = recommend(sticks, Limits(39.0, 89.0, 1.9), ["roll"]).axes["roll"]
    assert {"QL624", "QL638"} & {one.code for one in found.reasons}
    assert not [one for one in found.reasons if "angle" in one.advice]
