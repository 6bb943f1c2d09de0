"""Attitude, velocity and position loops against loops that are known: closed forms, and simulated flights."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots import named
from quadid_logs.control.margins import margins_of
from quadid_logs.control.outer_loops import attitude_replays, cascade_loops, cascade_replay
from quadid_logs.data.log import FlightLog, PositionRows, Rows
from quadid_logs.data.outer_loops import AttitudeReplay, CascadeController, CascadeReplay, Shown
from quadid_logs.pipeline import analyze as judged
from quadid_logs.simulator.position_hold import PositionHold
from tests.control.held_flights import HOLDS, cascade, flown, log_of, logged, true_loop
from tests.marks import thorough

AUTOPILOTS = ["ardupilot", thorough("px4")]


@pytest.fixture(scope="module")
def logs() -> Mapping[str, FlightLog]:
    return {autopilot: log_of(autopilot) for autopilot in HOLDS}


def attitude_of(log: FlightLog, changed: Mapping[str, float] | None = None) -> dict[str, AttitudeReplay]:
    autopilot, parameters = named(log.autopilot), {**log.parameters, **(changed or {})}
    rows, controllers = autopilot.attitude_rows(log, parameters, []), autopilot.outer_controllers(parameters)
    assert rows is not None
    assert controllers is not None
    return attitude_replays(rows, controllers.attitude)


def cascades_of(log: FlightLog, changed: Mapping[str, float] | None = None) -> list[CascadeReplay]:
    controllers = named(log.autopilot).outer_controllers({**log.parameters, **(changed or {})})
    assert controllers is not None
    assert controllers.horizontal is not None
    found = [cascade_replay(rows, controllers.horizontal, []) for rows in log.position_control]
    assert len(found) == 2
    return [one for one in found if one is not None]


def test_behind_an_attitude_that_lags_the_velocity_loop_has_the_margin_of_the_closed_form() -> None:
    """P / (s (1 + s / w)): crossover and phase margin are those of a text book."""
    P, w = 2.0, 5.0
    fast = CascadeController(
        position_per_s=0.0,
        proportional_per_s=P,
        integral_per_s2=0.0,
        derivative=0.0,
        error_hz=0.0,
        derivative_hz=0.0,
        slope_of_error=True,
        period_s=1e-5,
        gains={},
    )
    frequency_hz = np.geomspace(0.01, 30.0, 2000)
    tilts = 1.0 / (1.0 + 2j * np.pi * frequency_hz / w)
    velocity, position = cascade_loops(fast, tilts[np.newaxis], frequency_hz)
    found = margins_of(frequency_hz, velocity, 1, np.array([False]), np.inf)
    crossover = np.sqrt(0.5 * w**2 * (np.sqrt(1.0 + 4.0 * P**2 / w**2) - 1.0))
    assert position is None
    assert found.crossover_hz is not None
    assert found.phase_margin_deg is not None
    assert found.crossover_hz.value == pytest.approx(crossover / (2.0 * np.pi), rel=1e-3)
    assert found.phase_margin_deg.value == pytest.approx(90.0 - np.degrees(np.arctan(crossover / w)), abs=0.1)


def sway(hold: PositionHold, autopilot: str, times: float) -> FloatArray:
    """Return the rms of fast sideways motion early and late in a flight with so many times the gains."""
    louder = dataclasses.replace(
        hold,
        proportional_per_s=hold.proportional_per_s * times,
        integral_per_s2=hold.integral_per_s2 * times,
        derivative=hold.derivative * times,
    )
    record = flown(autopilot, louder, seconds=34.0)
    speed, time_s = record.channels["velocity"][:, 1], record.time_s
    found = []
    for begin_s in (10.0, 22.0):
        part = (time_s >= begin_s) & (time_s < begin_s + 4.0)
        slow = np.polyval(np.polyfit(time_s[part], speed[part], 3), time_s[part])
        found.append(float(np.std(speed[part] - slow)))
    return np.array(found)


@pytest.mark.thorough
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_velocity_gains_below_the_gain_margin_calm_down_and_gains_above_it_sway(autopilot: str) -> None:
    """The margin is that of the flown loop: 7 % beside it, 0.6 dB, the flight itself tells the side."""
    hold = dataclasses.replace(HOLDS[autopilot], moves_m=0.3)
    loop = true_loop(flown(autopilot, hold)).whole
    assert loop is not None
    assert loop.gain_margin_db is not None
    limit = 10.0 ** (loop.gain_margin_db.value / 20.0)
    # The path itself moves by less than this, without a fast part.
    early, late = sway(hold, autopilot, 0.93 * limit)
    assert late < 2e-3
    assert late <= 1.2 * early
    early, late = sway(hold, autopilot, 1.07 * limit)
    assert late > 3.0 * early


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_attitude_controller_of_the_parameters_makes_the_logged_rates(
    logs: Mapping[str, FlightLog], autopilot: str
) -> None:
    replays = attitude_of(logs[autopilot])
    assert {axis: replays[axis].shown for axis in ("roll", "pitch")} == {
        "roll": Shown.AGREES,
        "pitch": Shown.AGREES,
    }


@pytest.mark.parametrize(("autopilot", "name"), [("px4", "MC_ROLL_P"), ("ardupilot", "ATC_ANG_RLL_P")])
def test_an_angle_gain_that_did_not_fly_is_told_by_how_much(
    logs: Mapping[str, FlightLog], autopilot: str, name: str
) -> None:
    """The parameter says 1.5 times the gain that flew: the log fits two thirds of it."""
    log = logs[autopilot]
    replay = attitude_of(log, {name: 1.5 * log.parameters[name]})["roll"]
    assert replay.shown is Shown.DIFFERS
    assert replay.gain is not None
    assert replay.gain.value == pytest.approx(2.0 / 3.0, rel=0.03)


@pytest.mark.thorough
def test_an_excitation_that_is_added_to_the_rates_contradicts_no_angle_gain() -> None:
    """A sweep on rate set-points is not the attitude controller's, whose gain is as it was."""
    replays = attitude_of(log_of("ardupilot", scenario="sysid-quad-x"))
    assert {replay.shown for replay in replays.values()} == {Shown.NOT_SHOWN}


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_position_and_velocity_gains_are_found_again_in_ten_rows_a_second(
    logs: Mapping[str, FlightLog], autopilot: str
) -> None:
    for found in cascades_of(logs[autopilot]):
        assert found.position is not None
        assert found.velocity is not None
        assert found.position.value == pytest.approx(1.0, abs=1e-3)
        assert found.velocity.value == pytest.approx(1.0, abs=0.03)
        assert found.shown is Shown.AGREES


@pytest.mark.parametrize(
    ("name", "factor"), [("PSC_VELXY_P", 0.7), ("PSC_VELXY_P", 1.4), ("PSC_POSXY_P", 1.3)]
)
def test_a_gain_that_did_not_fly_differs(logs: Mapping[str, FlightLog], name: str, factor: float) -> None:
    log = logs["ardupilot"]
    found = cascades_of(log, {name: factor * log.parameters[name]})
    assert all(one.shown is Shown.DIFFERS for one in found)


def test_a_log_without_what_was_fed_forward_shows_no_gain(logs: Mapping[str, FlightLog]) -> None:
    """Firmware before 4.1 did not log it: nothing is agreed, and nothing contradicted."""
    controllers = named("ardupilot").outer_controllers(logs["ardupilot"].parameters)
    assert controllers is not None
    assert controllers.horizontal is not None
    north = logs["ardupilot"].position_control[0]
    bare = {name: values for name, values in north.values.items() if not name.endswith("_forward")}
    found = cascade_replay(dataclasses.replace(north, values=bare), controllers.horizontal, [])
    assert found is not None
    assert (found.position, found.velocity, found.shown) == (None, None, Shown.NOT_SHOWN)


@pytest.mark.parametrize("worst", [np.nan, np.inf, -np.inf, 1e300])
def test_damaged_rows_are_left_out(logs: Mapping[str, FlightLog], worst: float) -> None:
    """The longest run without one of them is as good as any."""
    controller = cascade(HOLDS["ardupilot"])
    for direction in logs["ardupilot"].position_control:
        values = {name: column.copy() for name, column in direction.values.items()}
        for column in values.values():
            column[::150] = worst
        found = cascade_replay(dataclasses.replace(direction, values=values), controller, [])
        assert found is not None
        assert found.position is not None
        assert found.position.value == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("n_rows", [0, 1, 2, 40])
def test_few_rows_tell_nothing(n_rows: int) -> None:
    rows = Rows(0.1 * np.arange(n_rows), np.arange(n_rows))
    empty = {"velocity_target": np.ones(n_rows), "velocity": np.zeros(n_rows)}
    found = cascade_replay(
        PositionRows(direction="north", rows=rows, values=empty), cascade(HOLDS["px4"]), []
    )
    assert found is None


def test_the_position_loop_takes_phase_from_the_velocity_loop() -> None:
    """1.8 + 0.4 / s with 0.95 / s around it leaves 40 degrees behind that vehicle, 70 without."""
    found = true_loop(flown("px4", HOLDS["px4"]))
    assert found.whole is not None
    assert found.velocity.phase_margin_deg is not None
    assert found.whole.phase_margin_deg is not None
    assert found.whole.phase_margin_deg.value < found.velocity.phase_margin_deg.value - 20.0


@pytest.mark.thorough
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_log_tells_the_margins_of_the_loop_that_flew(autopilot: str) -> None:
    """Through the whole analysis: the intervals hold the true margins at the voltage of the flight."""
    record = flown(autopilot, HOLDS[autopilot], scenario="sysid-quad-x", seconds=45.0)
    loop, truth = judged(logged(record)).closed_loop, true_loop(record)
    assert loop is not None
    assert loop.outer is not None
    for told in loop.outer.loops.values():
        for found, true in ((told.velocity, truth.velocity), (told.whole, truth.whole)):
            assert found is not None
            assert true is not None
            assert found.gain_margin_db is not None
            assert true.gain_margin_db is not None
            low, high = found.gain_margin_db.ci95
            assert low <= true.gain_margin_db.value <= high
    assert set(loop.outer.loops) == {"roll", "pitch"}


def test_a_position_controller_that_is_far_off_is_judged_where_it_is_linear(
    logs: Mapping[str, FlightLog],
) -> None:
    """ArduPilot's is a square root beyond: far from its target a right gain looks too low."""
    controllers = named("ardupilot").outer_controllers(logs["ardupilot"].parameters)
    assert controllers is not None
    assert controllers.horizontal is not None
    north = logs["ardupilot"].position_control[0]
    values = {name: column.copy() for name, column in north.values.items()}
    # Every third second 10 m off, where no more than 3 m/s are commanded for them.
    far = (north.rows.time_s % 3.0) < 1.0
    values["position_target"][far] += 10.0
    values["velocity_target"][far] += 3.0
    values["velocity"][far] += 3.0
    found = cascade_replay(dataclasses.replace(north, values=values), controllers.horizontal, [])
    assert found is not None
    assert found.position is not None
    assert found.position.value == pytest.approx(1.0, abs=1e-3)
    assert found.position_error_m > 4.0
