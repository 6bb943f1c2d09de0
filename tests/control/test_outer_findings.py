"""When attitude, velocity and position loops are a finding, and of which level."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.control.outer_findings import find_in_outer
from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.log import PositionRows, Rows
from quadid_logs.data.outer_loops import (
    AttitudeCommand,
    AttitudeReplay,
    CascadeReplay,
    OuterControllers,
    OuterLoop,
    OuterLoops,
    Shown,
)

NOTHING = OuterControllers(attitude=AttitudeCommand())


def figure(value: float, half: float = 0.0) -> Estimated:
    return Estimated(value, (value - half, value + half))


def margins(phase_deg: float, gain_db: float = 15.0, half: float = 0.1) -> Margins:
    return Margins(
        stable=True,
        stable_fraction=1.0,
        extrapolated=False,
        crossover_hz=figure(0.3),
        phase_margin_deg=figure(phase_deg, half),
        gain_margin_db=figure(gain_db, half),
    )


def loops(velocity: Margins, whole: Margins | None = None, attitude_hz: float = 2.0) -> OuterLoops:
    found = OuterLoop(attitude_hz=figure(attitude_hz), velocity=velocity, whole=whole)
    return OuterLoops(controllers=NOTHING, loops={"pitch": found})


def cascade(**changed: object) -> CascadeReplay:
    fields: dict[str, object] = {
        "position": figure(1.0, 0.01),
        "velocity": figure(1.0, 0.05),
        "integral": None,
        "position_rms": 0.0,
        "velocity_rms": 0.1,
        "velocity_error_m_s": 0.1,
        "velocity_moved_m_s": 0.5,
        "position_error_m": 0.1,
        "n_rows": 300,
        "row_s": 0.1,
    }
    return CascadeReplay(**{**fields, **changed})  # type: ignore[arg-type]


def rows(n_rows: int, velocity: float = 0.0) -> PositionRows:
    values = {"velocity_target": np.full(n_rows, velocity)}
    return PositionRows(
        direction="north", rows=Rows(0.1 * np.arange(n_rows), np.arange(n_rows)), values=values
    )


def found_in(outer: OuterLoops, *positions: PositionRows) -> list[Finding]:
    return list(find_in_outer(outer, positions))


@pytest.mark.parametrize(
    ("phase_deg", "gain_db", "half", "level"),
    [
        (40.0, 15.0, 0.1, None),
        (29.0, 15.0, 0.1, "warning"),
        (40.0, 3.5, 0.1, "warning"),
        (33.0, 15.0, 4.0, "info"),
    ],
)
def test_a_velocity_loop_close_to_instability_is_a_finding(
    phase_deg: float, gain_db: float, half: float, level: str | None
) -> None:
    """40 degrees are what firmware leaves by default; below 30, or 4 dB, the vehicle sways."""
    found = found_in(loops(margins(80.0), margins(phase_deg, gain_db, half)))
    assert [(one.code, one.level) for one in found] == ([] if level is None else [("QL652", level)])


def test_an_unstable_velocity_loop_is_a_warning() -> None:
    unstable = Margins(stable=False, stable_fraction=0.02, extrapolated=False)
    (found,) = found_in(loops(unstable))
    assert (found.code, found.level, found.axes) == ("QL652", "warning", ("pitch",))


@pytest.mark.parametrize(("attitude_hz", "codes"), [(0.7, ["QL653"]), (0.8, [])])
def test_an_attitude_slower_than_two_and_a_half_times_the_crossover_is_told(
    attitude_hz: float, codes: list[str]
) -> None:
    assert [one.code for one in found_in(loops(margins(60.0), attitude_hz=attitude_hz))] == codes


@pytest.mark.parametrize(
    ("gain", "half", "codes"), [(0.7, 0.1, ["QL651"]), (0.7, 0.25, []), (0.95, 0.01, [])]
)
def test_a_gain_is_contradicted_only_by_its_whole_interval(
    gain: float, half: float, codes: list[str]
) -> None:
    """More than a tenth off: slow rows alone are no reason to doubt the parameters."""
    outer = OuterLoops(controllers=NOTHING, cascades={"north": cascade(velocity=figure(gain, half))})
    assert [one.code for one in found_in(outer)] == codes


@pytest.mark.parametrize(("error", "moved", "codes"), [(0.6, 0.5, ["QL654"]), (0.4, 0.5, []), (0.2, 0.1, [])])
def test_an_error_larger_than_the_movement_of_the_set_point_is_told(
    error: float, moved: float, codes: list[str]
) -> None:
    """A hover's set-point rests: its error is the wind's."""
    replay = cascade(velocity_error_m_s=error, velocity_moved_m_s=moved)
    assert [one.code for one in found_in(OuterLoops(controllers=NOTHING, cascades={"east": replay}))] == codes


def test_an_angle_gain_that_did_not_fly_is_a_warning_about_its_axis() -> None:
    replay = AttitudeReplay(shown=Shown.DIFFERS, relative_rms=0.3, gain=figure(0.7, 0.01), n_rows=900)
    (found,) = found_in(OuterLoops(controllers=NOTHING, attitude={"roll": replay}))
    assert (found.code, found.level, found.axes) == ("QL650", "warning", ("roll",))


@pytest.mark.parametrize(
    ("positions", "codes"), [(rows(300), ["QL655"]), (rows(10), []), (rows(300, np.nan), [])]
)
def test_a_velocity_loop_that_flew_and_is_not_closed_is_told(
    positions: PositionRows, codes: list[str]
) -> None:
    """Not so where hardly a row, or no velocity, was commanded."""
    assert [one.code for one in found_in(OuterLoops(controllers=NOTHING), positions)] == codes


def test_a_loop_that_is_closed_leaves_nothing_to_say() -> None:
    assert not found_in(loops(margins(60.0)), rows(300))
