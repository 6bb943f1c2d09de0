"""When the loop is a finding, of which level, and that it leaves the model's verdict alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.control.findings import find_in_loop
from quadid_logs.data.closed_loop import (
    AxisLoop,
    ClosedLoop,
    Estimated,
    FrameModes,
    LoopMargins,
    Margins,
    Modes,
    Prediction,
)
from quadid_logs.data.controller import FlownControllers, Replay, ReplayReason
from quadid_logs.data.diagnosis import AxisVerdict, Diagnosis, Finding
from quadid_logs.diagnose import with_findings
from tests.synthetic_results import usable_result


def figure(value: float, half: float = 0.0) -> Estimated:
    return Estimated(value, (value - half, value + half))


def loop(found: AxisLoop, *, read: bool = True) -> ClosedLoop:
    controllers = FlownControllers(
        name="PID", firmware="", version_read="read" if read else "nearest", version_note="4.7", axes={}
    )
    return ClosedLoop(controllers=controllers, axes={"roll": found})


def margins(gain_db: float, phase_deg: float, disk: float = 0.9, half: float = 0.1) -> Margins:
    return Margins(
        stable=True,
        stable_fraction=1.0,
        extrapolated=False,
        gain_margin_db=figure(gain_db, half),
        phase_margin_deg=figure(phase_deg, half),
        disk_margin=figure(disk, 0.01),
    )


def found_in(axis: AxisLoop, *, read: bool = True) -> list[Finding]:
    return list(find_in_loop(loop(axis, read=read)))


@pytest.mark.parametrize(
    ("gain_db", "phase_deg", "disk", "half", "level"),
    [
        (8.0, 50.0, 0.9, 0.1, None),
        (3.5, 50.0, 0.9, 0.1, "warning"),
        (8.0, 29.0, 0.9, 0.1, "warning"),
        (5.0, 50.0, 0.9, 0.1, "info"),
        (8.0, 50.0, 0.6, 0.1, "info"),
        (8.0, 50.0, 0.9, 6.0, "info"),
    ],
)
def test_little_margin_is_a_finding_by_the_worst_vehicle_that_the_flight_allows(
    gain_db: float, phase_deg: float, disk: float, half: float, level: str | None
) -> None:
    rate = margins(gain_db, phase_deg, disk, half)
    levels = [one.level for one in found_in(AxisLoop(margins=LoopMargins(rate=rate, full=None)))]
    assert levels == ([] if level is None else [level])


def test_the_loop_with_the_angle_loop_is_judged_where_it_is_known() -> None:
    both = LoopMargins(rate=margins(8.0, 60.0), full=margins(2.0, 15.0))
    (one,) = found_in(AxisLoop(margins=both))
    assert one.code == "QL601"
    assert one.evidence["phase_margin_deg"] == {"value": 15.0, "ci95": [14.9, 15.1]}


@pytest.mark.parametrize(
    ("gain_db", "phase_deg", "title"),
    [
        (3.5, 50.0, "Roll is close to instability"),
        (17.6, 43.0, "Roll has less margin than required"),
        (6.05, 50.0, "Roll may have less margin than required"),
    ],
)
def test_the_title_says_how_little_margin_it_is(gain_db: float, phase_deg: float, title: str) -> None:
    """43 degrees and 17.6 dB are a sound race tune."""
    (one,) = found_in(AxisLoop(margins=LoopMargins(rate=margins(gain_db, phase_deg), full=None)))
    assert one.title == title
    assert ("Land if" in one.advice) == (title == "Roll is close to instability")


@pytest.mark.parametrize(
    ("gain_db", "phase_deg", "said"),
    [
        (2.3, 12.0, "the loop itself, which has"),
        (7.2, 42.0, "the loop itself, which may have"),
        (6.05, 60.0, "the loop itself, which may have"),
        (12.0, 60.0, "stiffen"),
    ],
)
def test_a_line_beside_a_loop_near_its_limit_is_not_blamed_on_the_frame(
    gain_db: float, phase_deg: float, said: str
) -> None:
    """A simulated loop with 12 degrees, and a frame that does not bend, was told to stiffen it at 13 Hz."""
    nothing = Modes(*(np.zeros(1) for _ in Modes._fields))
    frame = FrameModes(modes=nothing, seen=True, line_hz=13.0, line_height=2.9, absent=1e-6, visible_hz=100.0)
    loops = LoopMargins(rate=margins(gain_db, phase_deg), full=None)
    (line,) = (one for one in found_in(AxisLoop(margins=loops, frame=frame)) if one.code == "QL607")
    assert said in line.advice
    assert ("more margin first" in line.advice) == (said != "stiffen")
    assert "not raise P or D" in line.advice


def test_a_gain_that_may_not_fall_is_as_little_margin_as_one_that_may_not_rise() -> None:
    """The lower end of a loop that needs its gain: what `tune` keeps, too."""
    falling = replace(margins(12.0, 50.0), gain_margin_down_db=figure(3.0, 0.1))
    (one,) = found_in(AxisLoop(margins=LoopMargins(rate=falling, full=None)))
    assert one.level == "warning"
    assert one.evidence["gain_margin_down_db"] == {"value": 3.0, "ci95": [2.9, 3.1]}


def test_the_finding_sends_gains_nowhere() -> None:
    """Up or down, and by how much, is what `tune` computes: lower gains take phase from a slow loop."""
    for rate in (margins(2.0, 15.0), margins(17.0, 20.0), margins(5.0, 50.0)):
        (one,) = found_in(AxisLoop(margins=LoopMargins(rate=rate, full=None)))
        assert "`quadid-log tune LOG`" in one.advice
        assert not {"lower", "raise", "%"} & set(one.advice.lower().replace("%", " % ").split())


def test_axes_with_as_little_room_share_one_advice() -> None:
    """Roll and pitch of one vehicle are mostly alike; two steps that differ in a name are one too many."""
    poor, fair = AxisLoop(margins=LoopMargins(rate=margins(3.1, 20.0), full=None)), loop(AxisLoop())
    good = AxisLoop(margins=LoopMargins(rate=margins(5.0, 50.0), full=None))
    found = list(find_in_loop(replace(fair, axes={"roll": poor, "pitch": poor, "yaw": good})))
    roll, pitch, yaw = (one.advice for one in found)
    assert roll == pitch != yaw


def test_a_contradicted_loop_is_told_no_margin_and_sent_nowhere() -> None:
    """Its margins are not to be relied on, neither for a landing nor for other gains."""
    poor = LoopMargins(rate=margins(2.0, 15.0), full=None)
    assert [one.code for one in found_in(AxisLoop(margins=poor, contradicted=True))] == ["QL603"]


def test_an_unstable_loop_is_a_warning() -> None:
    unstable = Margins(stable=False, stable_fraction=0.1, extrapolated=False)
    (one,) = found_in(AxisLoop(margins=LoopMargins(rate=unstable, full=None)))
    assert (one.code, one.level) == ("QL601", "warning")


def prediction(value: float, half: float) -> Prediction:
    found = usable_result().closed_loop
    assert found is not None
    first = found.axes["roll"].prediction
    assert first is not None
    return replace(first, effectiveness=figure(value, half))


@pytest.mark.parametrize(
    ("value", "half", "codes"), [(440.0, 5.0, []), (330.0, 5.0, ["QL602"]), (330.0, 150.0, [])]
)
def test_open_and_closed_loop_disagree_beyond_both_intervals(
    value: float, half: float, codes: list[str]
) -> None:
    axis = AxisLoop(prediction=prediction(value, half), effectiveness=figure(430.0, 10.0))
    assert [one.code for one in found_in(axis)] == codes


def test_the_advice_about_a_disagreement_names_the_axis() -> None:
    """It is read apart from its finding, among the next steps."""
    axis = AxisLoop(prediction=prediction(330.0, 5.0), effectiveness=figure(430.0, 10.0))
    (one,) = found_in(axis)
    assert "no gain of roll was changed" in one.advice


def test_motors_at_their_limits_are_no_disagreement() -> None:
    """The loop was open for most of what it was asked."""
    limited = replace(prediction(330.0, 5.0), at_limits=True)
    assert found_in(AxisLoop(prediction=limited, effectiveness=figure(430.0, 10.0))) == []


def test_a_failed_replay_is_named_with_what_differs() -> None:
    failed = Replay(
        relative_rms={"P": 0.2, "output": 0.1},
        agrees=False,
        reason=ReplayReason.FILTER_DIFFERS,
        parameter="FLTT",
        numbers={"in_file": 20.0, "flown": 10.0},
    )
    (one,) = found_in(AxisLoop(replay=failed))
    assert one.code == "QL604"
    assert "filter differs (FLTT)" in one.title
    assert one.evidence["flown"] == 10.0


def test_a_controller_that_could_not_be_checked_is_told_once_for_all_axes() -> None:
    """Margins are given all the same: nothing contradicts the parameters."""
    unchecked = AxisLoop(
        replay=Replay(relative_rms={}, agrees=False, reason=ReplayReason.NO_ROWS),
        margins=LoopMargins(rate=margins(9.0, 60.0), full=None),
    )
    both = replace(loop(unchecked), axes={"roll": unchecked, "pitch": unchecked})
    (one,) = find_in_loop(both)
    assert (one.code, one.level, one.axes) == ("QL604", "info", ("roll", "pitch"))


def test_an_unread_firmware_version_and_a_contradicted_model_are_told() -> None:
    assert [one.code for one in found_in(AxisLoop(contradicted=True), read=False)] == ["QL606", "QL603"]


def test_margins_leave_the_models_verdict_alone_and_a_disagreement_does_not() -> None:
    """A good model of a vehicle with a poor tune is a good model."""
    usable = AxisVerdict(verdict="usable", reasons=(), sentence="")
    before = Diagnosis(findings=(), axes=dict.fromkeys(("roll", "pitch", "yaw"), usable))
    poor = AxisLoop(margins=LoopMargins(rate=margins(2.0, 15.0), full=None))
    after = with_findings(before, find_in_loop(loop(poor)), "other")
    assert [one.code for one in after.findings] == ["QL601"]
    assert after.axes["roll"].verdict == "usable"
    apart = AxisLoop(prediction=prediction(330.0, 5.0), effectiveness=figure(430.0, 10.0))
    assert with_findings(before, find_in_loop(loop(apart)), "other").axes["roll"].verdict == "caution"
