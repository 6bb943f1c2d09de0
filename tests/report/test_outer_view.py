"""What the report and result.json say of attitude, velocity and position loops."""

from __future__ import annotations

from dataclasses import replace

import jsonschema
import pytest

from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.data.outer_loops import (
    AttitudeCommand,
    AttitudeReplay,
    CascadeReplay,
    OuterControllers,
    OuterLoop,
    OuterLoops,
    ShaperReplay,
    Shown,
)
from quadid_logs.data.result import Result
from quadid_logs.report.json import result_dict
from quadid_logs.report.loop_view import loop_view
from quadid_logs.report.outer_view import outer_sentences, outer_tables
from quadid_logs.report.schema import result_schema
from tests.synthetic_results import usable_result


def figure(value: float) -> Estimated:
    return Estimated(value, (value - 0.2, value + 0.2))


STABLE = Margins(
    stable=True,
    stable_fraction=1.0,
    extrapolated=False,
    crossover_hz=figure(0.32),
    phase_margin_deg=figure(57.3),
    gain_margin_db=figure(22.4),
    delay_margin_s=figure(0.44),
)
CASCADE = CascadeReplay(
    position=figure(1.0),
    velocity=figure(0.98),
    integral=None,
    position_rms=0.0,
    velocity_rms=0.17,
    velocity_error_m_s=0.083,
    velocity_moved_m_s=0.4,
    position_error_m=0.06,
    n_rows=300,
    row_s=0.1,
)
OUTER = OuterLoops(
    controllers=OuterControllers(attitude=AttitudeCommand(gains={"ATC_INPUT_TC": 0.15})),
    attitude={"roll": AttitudeReplay(shown=Shown.AGREES, relative_rms=0.002, gain=figure(1.0), n_rows=900)},
    shaper={"roll": ShaperReplay(relative_rms=0.04, unshaped_rms=0.16, n_rows=900)},
    cascades={"north": CASCADE},
    loops={"pitch": OuterLoop(attitude_hz=figure(2.8), velocity=STABLE, whole=STABLE)},
)


def test_the_sentence_names_the_margins_and_the_delay_that_the_loop_bears() -> None:
    (text,) = outer_sentences(OUTER)
    assert text.startswith("Velocity forward, by pitch: 57 degrees and 22 dB from instability")
    assert text.endswith("0.44 s.")


def test_an_unstable_loop_has_no_figures() -> None:
    unstable = Margins(stable=False, stable_fraction=0.1, extrapolated=False)
    loop = OuterLoop(attitude_hz=figure(2.8), velocity=unstable, whole=None)
    outer = replace(OUTER, loops={"roll": loop})
    (text,) = outer_sentences(outer)
    assert "unstable" in text
    assert outer_tables(outer)[0].rows[0][1].text == "unstable"


def test_each_loop_and_each_replay_has_its_row() -> None:
    margins, attitude, cascades = outer_tables(OUTER)
    assert [row[0].text for row in margins.rows] == ["velocity, forward", "velocity and position, forward"]
    assert [cell.text for cell in attitude.rows[0]][:3] == ["roll", "reproduces the log", "0.2 %"]
    assert [row[0].text for row in cascades.rows] == ["north"]


def test_nothing_is_said_of_loops_that_nobody_looked_at() -> None:
    assert list(outer_sentences(None)) == []
    assert outer_tables(None) == ()


@pytest.fixture(scope="module")
def with_outer() -> Result:
    result = usable_result()
    assert result.closed_loop is not None
    return replace(result, closed_loop=replace(result.closed_loop, outer=OUTER))


def test_the_chapter_of_the_loop_shows_them(with_outer: Result) -> None:
    view = loop_view(with_outer)
    assert len(view.outer) == 3
    assert any(sentence.startswith("Velocity forward") for sentence in view.sentences)


def test_result_json_holds_them_by_its_schema(with_outer: Result) -> None:
    content = result_dict(with_outer)
    jsonschema.validate(content, result_schema())
    outer = content["closed_loop"]["outer"]
    assert outer["gains"] == {"ATC_INPUT_TC": 0.15}
    assert outer["attitude"]["roll"]["shown"] == "agrees"
    assert outer["cascades"]["north"]["velocity_gain_over_parameter"]["value"] == 0.98
    assert outer["loops"]["pitch"]["whole"]["phase_margin_deg"]["value"] == 57.3
