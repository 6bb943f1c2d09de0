"""The chapter "The loop": sentences that a pilot understands, and what is said where nothing is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.autopilots.discrete import butterworth, notches_named
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, Estimated, LoopMargins, Margins
from quadid_logs.data.controller import FilterPlace, NamedFilter, Replay, ReplayReason
from quadid_logs.data.health import Health, Line, Noise
from quadid_logs.data.log import Notch
from quadid_logs.data.result import Result
from quadid_logs.report.loop_json import closed_loop_dict
from quadid_logs.report.loop_view import loop_view
from quadid_logs.report.strict_json import plain
from tests.synthetic_results import refused_result, usable_result


@pytest.fixture(scope="module")
def usable() -> Result:
    return usable_result()


def figure(value: float, low: float, high: float) -> Estimated:
    return Estimated(value, (low, high))


POOR = Margins(
    stable=True,
    stable_fraction=1.0,
    extrapolated=False,
    crossover_hz=figure(20.3, 20.0, 20.6),
    phase_margin_deg=figure(16.8, 15.0, 18.0),
    gain_margin_db=figure(2.54, 2.2, 2.9),
    oscillation_hz=figure(23.7, 23.0, 24.0),
)


def with_loop(result: Result, found: AxisLoop) -> Result:
    assert result.closed_loop is not None
    return replace(
        result, closed_loop=ClosedLoop(controllers=result.closed_loop.controllers, axes={"roll": found})
    )


def sentence(result: Result, margins: Margins) -> str:
    loop = AxisLoop(margins=LoopMargins(rate=margins, full=None))
    (text,) = loop_view(with_loop(result, loop)).sentences
    return text


def test_a_pilot_reads_how_far_the_vehicle_is_from_oscillating(usable: Result) -> None:
    """Degrees, decibels, and what they are in gain and at which frequency."""
    assert sentence(usable, POOR) == (
        "Roll: 17 degrees and 2.5 dB from instability; with a 34 % higher gain (lighter vehicle, fuller "
        "battery) it would oscillate at about 24 Hz."
    )


def test_an_extrapolated_margin_is_told_by_its_lower_end(usable: Result) -> None:
    text = sentence(usable, replace(POOR, extrapolated=True))
    assert text.endswith("(extrapolated: the margins may be as small as 15 degrees and 2.2 dB).")


def test_an_extrapolated_margin_whose_lower_end_reads_the_same_contradicts_nothing(usable: Result) -> None:
    """48 degrees that may be as little as 48 degrees."""
    sharp = replace(POOR, phase_margin_deg=figure(48.1, 47.9, 48.4), gain_margin_db=figure(20.1, 19.9, 20.3))
    text = sentence(usable, replace(sharp, extrapolated=True))
    assert "48 degrees and 20 dB from instability" in text
    assert text.endswith("(extrapolated).")


def test_no_battery_is_blamed_for_ten_times_the_gain(usable: Result) -> None:
    """A lighter vehicle has a few per cent more."""
    text = sentence(usable, replace(POOR, gain_margin_db=figure(20.0, 19.0, 21.0)))
    assert "with 10 times the gain it would oscillate" in text
    assert "battery" not in text


def test_no_margin_is_told_of_a_loop_that_the_log_contradicts(usable: Result) -> None:
    """The finding beside it says not to rely on it."""
    loop = AxisLoop(margins=LoopMargins(rate=POOR, full=None), contradicted=True)
    (text,) = loop_view(with_loop(usable, loop)).sentences
    assert "contradicts the model" in text
    assert "degrees" not in text


def test_an_unstable_loop_has_no_distance(usable: Result) -> None:
    text = sentence(usable, Margins(stable=False, stable_fraction=0.0, extrapolated=False))
    assert "unstable" in text
    assert "degrees" not in text


def test_a_controller_that_did_not_fly_is_named(usable: Result) -> None:
    failed = Replay(relative_rms={}, agrees=False, reason=ReplayReason.AXES_SWAPPED)
    (text,) = loop_view(with_loop(usable, AxisLoop(replay=failed))).sentences
    assert "do not reproduce the logged output (axes swapped)" in text


def test_a_controller_that_no_row_contradicts_is_not_called_another(usable: Result) -> None:
    """Of a log at 10 Hz nothing can be replayed: it is the model that lacks."""
    unknown = Replay(relative_rms={}, agrees=False, reason=ReplayReason.NO_ROWS)
    (text,) = loop_view(with_loop(usable, AxisLoop(replay=unknown))).sentences
    assert text == "Roll: the model of this axis is not good enough to close the loop."


def test_every_loop_has_its_row(usable: Result) -> None:
    view = loop_view(usable)
    assert view.margins is not None
    assert [row[0].text for row in view.margins.rows] == [
        f"{axis}, {loop}" for axis in ("roll", "pitch", "yaw") for loop in ("rate loop", "with angle loop")
    ]
    assert "version 4.7" in view.intro


def test_without_a_model_or_a_controller_the_chapter_says_why(usable: Result) -> None:
    assert "no model" in loop_view(refused_result()).intro
    assert "controller that flew is not known" in loop_view(replace(usable, closed_loop=None)).intro
    assert usable.closed_loop is not None
    empty = replace(usable, closed_loop=replace(usable.closed_loop, axes={}))
    assert "do not describe the controller" in loop_view(empty).intro


def test_the_contract_has_every_figure_of_a_margin(usable: Result) -> None:
    """A figure that a loop does not have is null."""
    assert usable.closed_loop is not None
    rate = plain(closed_loop_dict(usable.closed_loop, {}))["axes"]["roll"]["margins"]["rate"]
    assert rate["gain_margin_down_db"] is None
    assert set(rate["phase_margin_deg"]) == {"value", "ci95"}
    needed = {"stable", "extrapolated", "crossover_hz", "delay_margin_s", "disk_margin", "peak_sensitivity"}
    assert needed <= set(rate)


def with_filters(result: Result, *filters: NamedFilter) -> Result:
    """Return the result with these filters about roll, and nothing known of the other axes."""
    assert result.closed_loop is not None
    loop = with_loop(result, AxisLoop(margins=LoopMargins(rate=POOR, full=None))).closed_loop
    assert loop is not None
    roll = replace(loop.controllers.axes["roll"], filters=filters)
    controllers = replace(loop.controllers, axes={"roll": roll})
    return replace(result, closed_loop=replace(loop, controllers=controllers))


LOW_PASS = NamedFilter(name="INS_GYRO_FILTER", place=FilterPlace.GYRO, filter=butterworth(40.0, 1e-3))
MOVED = notches_named("INS_HNTCH", tuple((Notch(hz, 0.5, 0.01),) for hz in (90.0, 100.0, 130.0)), 1e-3)


def test_every_filter_has_its_row_and_the_gyros_path_one_more(usable: Result) -> None:
    (table,) = loop_view(with_filters(usable, MOVED, LOW_PASS)).filters
    assert [row[0].text for row in table.rows] == ["INS_HNTCH", "INS_GYRO_FILTER", "whole path of the gyro"]


def test_a_notch_that_moved_says_where_it_stood(usable: Result) -> None:
    (table,) = loop_view(with_filters(usable, MOVED)).filters
    assert table.rows[0][0].detail == "100 Hz, from 90 to 130"


def test_every_line_of_the_gyro_has_its_column(usable: Result) -> None:
    lines = tuple(
        Line(frequency_hz=hz, height_db=9.0, p_value=0.0, share=1.0, rms=1.0) for hz in (130.0, 40.0)
    )
    noise = Noise(
        sentence="", after=None, before=None, lines={"roll": lines}, over_time=None, over_throttle=None,
        rotor_hz=np.zeros(0), may_be_folded=False,
    )  # fmt: skip
    (table,) = loop_view(replace(with_filters(usable, LOW_PASS), health=Health(noise=noise))).filters
    assert table.head[3:] == ("line at 40 Hz [dB]", "line at 130 Hz [dB]")
    # tan(0.13 pi) over tan(0.04 pi) is 3.42, and one over its square -21.4 dB.
    assert [cell.text for cell in table.rows[0][3:]] == ["−3.0", "−21.4"]


def test_a_contradicted_loop_tells_no_phase_of_its_filters(usable: Result) -> None:
    told = with_filters(usable, LOW_PASS)
    assert told.closed_loop is not None
    axes = {axis: replace(one, contradicted=True) for axis, one in told.closed_loop.axes.items()}
    (table,) = loop_view(replace(told, closed_loop=replace(told.closed_loop, axes=axes))).filters
    assert table.rows[0][2].text == "–"


def test_the_contract_has_the_cost_of_each_filter(usable: Result) -> None:
    loop = with_filters(usable, LOW_PASS).closed_loop
    assert loop is not None
    (told,) = plain(closed_loop_dict(loop, {}))["axes"]["roll"]["filters"]
    assert (told["name"], told["place"]) == ("INS_GYRO_FILTER", "gyro")
    # Two poles at 40 Hz, at 20.3 Hz: atan(1.414 x / (1 - x^2)) = 44 degrees.
    assert told["phase_cost_deg"]["value"] == pytest.approx(44.0, abs=0.5)


@pytest.mark.parametrize(("iterm_relax", "is_said"), [(1.0, True), (0.0, False)])
def test_a_computed_step_says_what_acts_while_a_stick_moves(
    usable: Result, iterm_relax: float, is_said: bool
) -> None:
    """A computed overshoot of 30 % stood beside a measured one of 1 %, and nothing said why."""
    log = replace(usable.log, autopilot="betaflight", parameters={"iterm_relax": iterm_relax})
    assert ("without iterm relax" in loop_view(replace(usable, log=log)).step_note) is is_said
