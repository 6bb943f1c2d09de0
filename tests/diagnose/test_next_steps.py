"""What to do next: once each, in the order of doing it, and nothing hidden."""

from __future__ import annotations

from dataclasses import replace

import pytest

from quadid_logs import analyze
from quadid_logs.autopilots import known
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.diagnosis import Diagnosis, Finding, Level
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.result import PooledLog, Result
from quadid_logs.diagnose import remedied
from quadid_logs.diagnose.advice import advice_for, next_steps
from quadid_logs.diagnose.file_findings import find_in_pool
from quadid_logs.diagnose.findings import finding
from quadid_logs.report.inventory import inventory_lines
from quadid_logs.report.next_flight import next_steps as flight_steps
from quadid_logs.report.text import result_lines
from quadid_logs.vocabulary import AXES
from tests.synthetic_results import usable_result

SET = "Set SOMETHING to 25."


def _log(autopilot: str = "other", log_format: str = "table") -> FlightLog:
    return FlightLog(path="", format=log_format, autopilot=autopilot, n_bytes=0, signals={})


def _finding(code: str, level: Level, *axes: str, advice: str = "Fly.") -> Finding:
    return Finding(code=code, level=level, title="", evidence={}, advice=advice, axes=axes)


THREE_WEAK_AXES = [_finding("QL403", "error", axis, advice=f"Fly {axis}.") for axis in AXES]
TOO_SLOW = _finding("QL304", "warning", advice=SET)


@pytest.mark.parametrize("autopilot", [each.name for each in known()])
def test_what_is_to_be_set_comes_before_one_manoeuvre_for_all_axes(autopilot: str) -> None:
    """A flight that is logged as the last one is for nothing, even if only a warning says so."""
    steps = next_steps((_log(autopilot), each) for each in (*THREE_WEAK_AXES, TOO_SLOW))
    assert steps == (SET, advice_for(autopilot).excitation(AXES, None))


@pytest.mark.parametrize("autopilot", [each.name for each in known()])
def test_no_step_says_that_there_is_nothing_to_do(autopilot: str) -> None:
    """A step is something to do: one that is for nothing hides the next."""
    for code in CATALOGUE:
        found = remedied([finding(code, "warning", {})], autopilot)
        steps = next_steps((_log(autopilot), each) for each in found)
        assert not [step for step in steps if "nothing to do" in step.lower()], code


def test_pooled_logs_without_a_flight_are_to_be_left_out() -> None:
    """It was advised to do nothing if all are of one vehicle."""
    pooled = [PooledLog(path="flown.bin", used_s=60.0), PooledLog(path="bench.bin", used_s=0.0)]
    (step,) = next_steps((_log(), each) for each in find_in_pool(pooled, Identification()))
    assert step.startswith("Leave out ")


def test_a_log_that_repeats_another_flight_is_no_warning() -> None:
    """ "2 of 9 logs repeat the flight of another" was the reason on the cards of all axes, and a step."""
    pooled = [
        PooledLog(path="one.bin", used_s=60.0),
        PooledLog(path="copy.bin", used_s=0.0, same_as="one.bin"),
    ]
    (repeated,) = find_in_pool(pooled, Identification())
    assert repeated.level == "info"
    assert "1 of 2 pooled logs repeat" in repeated.title
    assert not next_steps([(_log(), repeated)])
    (both,) = find_in_pool([*pooled, PooledLog(path="bench.bin", used_s=0.0)], Identification())
    assert both.level == "warning"
    assert "1 of 3 pooled logs hold no usable flight" in both.title


def test_the_manoeuvre_names_the_axes_that_need_it_and_no_other() -> None:
    """Minutes in the air are what it costs."""
    (step,) = next_steps((_log(), each) for each in THREE_WEAK_AXES[1:])
    assert "forward-back and rudder left-right" in step
    assert " left-right, " not in step


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4", "betaflight"])
@pytest.mark.parametrize("yaw", [("QL403", "error"), ("QL531", "warning"), ("QL404", "warning")], ids=str)
def test_a_log_that_is_too_slow_is_followed_by_a_flight_that_moves_every_axis(
    autopilot: str, yaw: tuple[str, Level]
) -> None:
    """A hover was to be logged faster, with the rudder moved alone: roll and pitch were refused again."""
    log = _log(autopilot, "dataflash")
    slow = _finding("QL303", "error", "roll", "pitch", advice=SET)
    steps = next_steps([(log, slow), (log, _finding(*yaw, "yaw", advice="Something of yaw."))])
    assert steps[:2] == (SET, advice_for(autopilot).excitation(AXES, None))


def test_a_table_that_is_too_slow_is_made_anew_from_the_same_flight() -> None:
    """The log behind it may be fast enough, and the axes moved."""
    assert next_steps([(_log(), _finding("QL303", "error", advice=SET))]) == (SET,)


def test_a_slow_hover_log_tells_what_to_log_and_what_to_fly() -> None:
    """The whole way, from a file: both, in that order."""
    result = analyze("sample_logs/default-logging.bin")
    steps = flight_steps(result)
    assert steps[0].startswith("Set LOG_BITMASK to ")
    assert all(stick in steps[1] for stick in (" left-right,", "forward-back", "rudder left-right"))
    lines = [line.text.strip() for line in inventory_lines(result.log, result.data)]
    (then,) = (line for line in lines if line.startswith("then: "))
    assert then == f"then: {steps[1]}"
    assert "--axes roll,pitch,yaw -o plan --like sample_logs/default-logging.bin`" in then


def test_a_step_names_the_axes_that_its_finding_calls_this_axis() -> None:
    """In a list of what to do next, "this axis" is none."""
    both = [
        _finding("QL603", "warning", axis, advice="Do not rely on this axis.") for axis in ("yaw", "roll")
    ]
    assert next_steps([(_log(), one) for one in both]) == ("Do not rely on roll and yaw.",)


def test_of_a_flight_that_is_too_short_nothing_else_is_advised() -> None:
    """Four seconds of a nano drone were told to stiffen its frame and to fly slower, and quicker."""
    log = _log()
    short = _finding("QL402", "error", advice="Fly for a minute.")
    bends = _finding("QL525", "error", "roll", advice="Stiffen what bends.")
    assert next_steps([(log, short), (log, bends)]) == ("Fly for a minute.",)


def test_of_another_kind_of_vehicle_nothing_is_to_be_set_or_flown() -> None:
    """A helicopter's old log was to be followed by newer firmware and by stick doublets."""
    log = _log("ardupilot")
    helicopter = _finding("QL201", "error", advice="Use a log of a multirotor.")
    timeless = _finding("QL104", "error", advice="Update the firmware.")
    assert next_steps([(log, timeless), (log, helicopter)]) == ("Use a log of a multirotor.",)


def test_a_log_of_another_vehicle_hides_no_step_of_a_multirotor() -> None:
    """Where several logs are compared."""
    plane = _finding("QL201", "error", advice="Use a log of a multirotor.")
    steps = next_steps([(_log("ardupilot"), plane), (_log("ardupilot", "dataflash"), TOO_SLOW)])
    assert steps == (SET, "Use a log of a multirotor.")


def test_an_axis_that_changed_in_flight_is_not_to_be_flown_again() -> None:
    """The advice is to analyze both parts; doublets would tell nothing."""
    entry = CATALOGUE["QL509"]
    change = _finding(entry.code, "error", "roll", advice=entry.advice)
    assert next_steps([(_log(), change)]) == (entry.advice,)


def test_an_axis_that_turned_enough_gets_no_manoeuvre() -> None:
    """What its own finding says to do instead stands alone."""
    enough = replace(_finding("QL504", "error", "roll", advice="Look elsewhere."), step="other")
    assert next_steps([(_log(), enough)]) == ("Look elsewhere.",)


def test_an_axis_that_another_log_lets_fly_gets_the_manoeuvre_alone() -> None:
    """Three logs of one vehicle: "larger manoeuvres would not help" stood beside "fly doublets"."""
    enough = replace(_finding("QL504", "error", "roll", advice="Look elsewhere."), step="other")
    weak = _finding("QL403", "error", "roll", advice="Move roll.")
    (step,) = next_steps([(_log(), enough), (_log(), weak)])
    assert "doublets" in step


def _with_findings(*findings: Finding) -> Result:
    result = usable_result(8.0)
    return replace(result, diagnosis=Diagnosis(findings=findings, axes=result.diagnosis.axes))


def test_the_terminal_does_not_cut_what_is_to_be_set() -> None:
    """Three lines of doublets hid it."""
    lines = result_lines(_with_findings(*THREE_WEAK_AXES, TOO_SLOW))
    steps = [line.strip() for line in lines if "next:" in line]
    assert steps[0] == f"next: {SET}"
    assert [number for number, step in enumerate(steps) if "doublets" in step] == [1]


def test_other_advice_on_a_refused_axis_waits_until_it_is_not() -> None:
    """Who is to fly roll again need not stiffen the frame for it first; for a usable pitch that stands."""
    log, refused = _log(), _finding("QL303", "error", "roll", advice=SET)
    roll = _finding("QL525", "warning", "roll", advice="Stiffen roll.")
    both = _finding("QL525", "warning", "roll", "pitch", advice="Stiffen both.")
    assert next_steps([(log, refused), (log, roll), (log, both)]) == (SET, "Stiffen both.")
    assert next_steps([(log, roll)]) == ("Stiffen roll.",)
