"""A replayed controller agrees with the one that flew, or says what differs."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs import read_log
from quadid_logs.autopilots import named
from quadid_logs.control.replay import replay, thinned_from
from quadid_logs.data.controller import RemarkKind, Replay, ReplayReason
from quadid_logs.data.log import ControllerTerms, FlightLog, ParameterChange, Rows
from quadid_logs.load import load
from tests.control.flown_controller import AP_PID, AP_YAW, ApFlight, Px4Flight
from tests.marks import thorough, thorough_but


def replayed(log: FlightLog, intervals: tuple[tuple[float, float], ...] = ()) -> dict[str, Replay]:
    autopilot = named(log.autopilot)
    controllers = autopilot.controllers(log, log.parameters)
    assert controllers is not None
    return replay(controllers, autopilot.replay_inputs(log, controllers, intervals), log.parameter_changes)


def roll(log: FlightLog) -> Replay:
    return replayed(log)["roll"]


def with_rows(log: FlightLog, kept: np.ndarray) -> FlightLog:
    """Return the log with some of its rows."""
    rows = next(iter(log.signals.values()))[0].rows
    fewer = Rows(rows.time_s[kept], rows.position[kept])
    signals = {
        name: tuple(replace(one, rows=fewer, values=one.values[kept]) for one in sources)
        for name, sources in log.signals.items()
    }
    return replace(log, signals=signals, controller_terms=())


# ---------------------------------------------------------------- ArduPilot: agreement


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_each_logged_term_is_replayed(axis: str) -> None:
    found = replayed(ApFlight().log())[axis]
    assert found.agrees
    assert found.reason is None
    expected = {"P", "I", "output"} | ({"D"} if axis != "yaw" else set())
    assert {term for term, error in found.relative_rms.items() if error is not None} == expected
    assert all(found.relative_rms[term] < 1e-6 for term in expected)


def test_feed_forward_of_target_and_of_its_derivative_is_replayed() -> None:
    pid = AP_PID | {"FF": 0.05, "D_FF": 0.002}
    found = roll(ApFlight(pids={"roll": pid, "pitch": AP_PID, "yaw": AP_YAW}).log())
    assert found.agrees
    assert found.relative_rms["FF"] < 1e-6


def test_the_limit_of_the_pd_sum_is_replayed() -> None:
    pid = AP_PID | {"PDMX": 0.1}
    found = roll(ApFlight(pids={"roll": pid, "pitch": AP_PID, "yaw": AP_YAW}).log())
    assert found.agrees
    assert found.relative_rms["P"] < 1e-6


def test_the_integrators_bound_is_replayed() -> None:
    pid = AP_PID | {"IMAX": 0.01}
    found = roll(ApFlight(pids={"roll": pid, "pitch": AP_PID, "yaw": AP_YAW}).log())
    assert found.relative_rms["I"] < 1e-6


def test_without_limit_flags_the_stops_are_taken_from_the_output_and_it_is_said() -> None:
    found = roll(ApFlight().log(terms=False))
    assert found.agrees
    assert found.reason is ReplayReason.LIMIT_FLAGS_MISSING
    # Of the stopped steps, those that lead the integral towards zero are taken all the same.
    assert 0.01 < found.numbers["inferred_fraction"] < 0.05


def with_unseen_stops(log: FlightLog, size: float) -> FlightLog:
    """Move the integral of roll by so much of the output's rms, twice, where no log says why."""
    (one,) = log.signals["torque_command"]
    values = one.values.copy()
    rms = float(np.sqrt(np.mean(values[:, 0] ** 2)))
    for first, way in ((6500, 1.0), (13000, 1.0)):
        values[first:, 0] += way * size * rms
    return replace(log, signals={**log.signals, "torque_command": (replace(one, values=values),)})


def test_an_integrator_whose_stops_no_log_tells_is_no_other_controller() -> None:
    """A stop that is missed moves all that follows: from each part's own beginning the gains are right."""
    found = roll(with_unseen_stops(ApFlight(n=19500, limited_fraction=0.0).log(terms=False), 0.02))
    assert found.relative_rms["output"] > 0.01
    assert found.agrees
    assert found.reason is ReplayReason.LIMIT_FLAGS_MISSING


@pytest.mark.parametrize("size", [thorough(0.05), 0.5])
@pytest.mark.parametrize("at", [(1500,), (3000, 4000, 5000, 11000, 12500)])
def test_an_integral_that_is_set_anywhere_in_flight_is_no_other_controller(
    size: float, at: tuple[int, ...]
) -> None:
    """Wherever a jump lies, and however large it is: all but the integral is as the parameters say."""
    log = ApFlight(n=19500, limited_fraction=0.0).log(terms=False)
    (one,) = log.signals["torque_command"]
    values = one.values.copy()
    rms = float(np.sqrt(np.mean(values[:, 0] ** 2)))
    for number, first in enumerate(at):
        values[first:, 0] += (-1.0) ** number * size * rms
    found = roll(replace(log, signals={**log.signals, "torque_command": (replace(one, values=values),)}))
    assert found.relative_rms["output"] > 0.01
    assert (found.agrees, found.reason) == (True, ReplayReason.LIMIT_FLAGS_MISSING)


@pytest.mark.parametrize("seed", thorough_but(range(2), range(5)))
def test_a_clipped_px4_flight_whose_allocator_status_is_missing_flew_with_its_parameters(seed: int) -> None:
    """The integrator stood for a fifth of a second at a time, in part of the way only: no row shows it."""
    log = Px4Flight().log()
    (one,) = log.signals["torque_command"]
    values, rng = one.values.copy(), np.random.default_rng(seed)
    rms = float(np.std(values[:, 0]))
    drift = np.zeros(len(values))
    for first in rng.integers(0, len(values) - 100, 20):
        drift[first : first + 80] += rng.normal() * 0.1 * rms / 80
    values[:, 0] += np.cumsum(drift)
    found = roll(replace(log, signals={**log.signals, "torque_command": (replace(one, values=values),)}))
    assert found.agrees


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("P", 1.1), *(thorough(*one) for one in (("P", 0.9), ("I", 1.1), ("I", 0.9), ("D", 1.3)))],
)
def test_a_wrong_gain_is_no_stop_that_the_log_does_not_tell(name: str, wrong: float) -> None:
    log = with_unseen_stops(ApFlight(n=19500, limited_fraction=0.0).log(terms=False), 0.02)
    given = f"ATC_RAT_RLL_{name}"
    assert not roll(replace(log, parameters={**log.parameters, given: wrong * AP_PID[name]})).agrees


@pytest.mark.thorough
@pytest.mark.parametrize("first", [thorough(1000), thorough(16000), 17500])
def test_a_gain_that_is_as_in_the_file_is_not_said_to_differ(first: int) -> None:
    """The integral was set in the middle of some part; the steps of the output show the file's gains."""
    log = ApFlight(n=19500).log()
    (one,) = log.signals["torque_command"]
    values = one.values.copy()
    values[first:, 0] += 0.3 * float(np.sqrt(np.mean(values[:, 0] ** 2)))
    found = roll(replace(log, signals={**log.signals, "torque_command": (replace(one, values=values),)}))
    assert not found.agrees
    assert found.reason not in (ReplayReason.GAIN_DIFFERS, ReplayReason.GAINS_CHANGED)


@pytest.mark.thorough
def test_a_gain_that_differs_is_found_beside_stops_that_no_log_tells() -> None:
    log = with_unseen_stops(ApFlight(n=19500, limited_fraction=0.0).log(terms=False), 0.02)
    found = roll(replace(log, parameters={**log.parameters, "ATC_RAT_RLL_P": 1.1 * AP_PID["P"]}))
    assert not found.agrees


def test_a_rare_slew_limit_is_said_and_does_not_block() -> None:
    scale = np.where(np.arange(8000) % 100 < 2, 0.6, 1.0)
    found = roll(ApFlight(scale=scale).log())
    assert found.agrees
    assert found.reason is ReplayReason.SLEW_LIMITED
    assert found.numbers["lowest_scale"] == pytest.approx(0.6)


def scaled_for(fraction: float) -> FlightLog:
    """Fly with P and D boosted by a third in some of the rows, which ATSC tells and PIDR's Dmod does not."""
    scale = np.where(np.arange(8000) % 100 < 100.0 * fraction, 1.33, 1.0)
    log = ApFlight(scale=scale).log()
    terms: list[ControllerTerms] = []
    for one in log.controller_terms:
        boosted = scale != 1.0
        rows = Rows(one.rows.time_s[boosted], one.rows.position[boosted])
        values = {name: each for name, each in one.values.items() if name != "scale"}
        terms += [
            replace(one, values=values),
            ControllerTerms(axis=one.axis, rows=rows, values={"gain_scale": scale[boosted]}),
        ]
    return replace(log, controller_terms=tuple(terms))


def test_a_logged_scale_of_the_gains_is_replayed() -> None:
    """Throttle-gain boost for a moment: written at its loops only."""
    found = roll(scaled_for(0.02))
    assert found.agrees
    assert found.relative_rms["P"] < 1e-6


# ---------------------------------------------------------------- ArduPilot: sabotage, by name


def test_gains_that_are_scaled_for_much_of_the_flight_block() -> None:
    """The margins would be those of other gains."""
    found = roll(scaled_for(0.2))
    assert (found.agrees, found.reason) == (False, ReplayReason.GAINS_SCALED)
    assert found.numbers["highest_scale"] == pytest.approx(1.33)


def test_a_slew_limit_for_much_of_the_flight_blocks() -> None:
    scale = np.where(np.arange(8000) % 100 < 20, 0.6, 1.0)
    found = roll(ApFlight(scale=scale).log())
    assert not found.agrees
    assert found.reason is ReplayReason.SLEW_LIMITED
    assert found.numbers["fraction"] == pytest.approx(0.2, abs=0.01)


@pytest.mark.thorough
def test_a_slew_limit_without_its_logged_factor_is_named() -> None:
    scale = np.where(np.sin(np.arange(8000) / 40.0) > 0.7, 0.5, 1.0)
    log = ApFlight(scale=scale).log(terms=False, parameters={"ATC_RAT_RLL_SMAX": 5.0})
    found = roll(log)
    assert (found.agrees, found.reason) == (False, ReplayReason.SLEW_LIMITED)
    assert found.parameter == "ATC_RAT_RLL_SMAX"


@pytest.mark.parametrize("name", ["FLTT", "FLTD"])
def test_a_wrong_filter_is_named_with_the_one_that_flew(name: str) -> None:
    log = ApFlight().log(parameters={f"ATC_RAT_RLL_{name}": 11.0})
    found = roll(log)
    assert (found.agrees, found.reason) == (False, ReplayReason.FILTER_DIFFERS)
    assert found.parameter == f"ATC_RAT_RLL_{name}"
    assert found.numbers == pytest.approx({"in_file_hz": 11.0, "flown_hz": 20.0}, rel=0.02)


def test_a_cut_off_between_those_that_are_tried_is_found() -> None:
    pid = AP_PID | {"FLTT": 13.0}
    flight = ApFlight(pids={"roll": pid, "pitch": AP_PID, "yaw": AP_YAW})
    found = roll(flight.log(terms=False, parameters={"ATC_RAT_RLL_FLTT": 30.0}))
    assert found.parameter == "ATC_RAT_RLL_FLTT"
    assert found.numbers["flown_hz"] == pytest.approx(13.0, rel=0.03)


@pytest.mark.parametrize(
    ("name", "wrong"), [("P", 0.2), thorough("I", 0.8), thorough("D", 0.007), thorough("FF", 0.1)]
)
def test_a_wrong_gain_is_named_with_the_one_that_flew(name: str, wrong: float) -> None:
    found = roll(ApFlight().log(terms=False, parameters={f"ATC_RAT_RLL_{name}": wrong}))
    assert (found.agrees, found.reason) == (False, ReplayReason.GAIN_DIFFERS)
    assert found.parameter == f"ATC_RAT_RLL_{name}"
    assert found.numbers["flown"] == pytest.approx(AP_PID[name], rel=0.02, abs=1e-4)


def test_gains_changed_in_flight_are_named_by_the_logged_change() -> None:
    found = roll(ApFlight(change_at=4000, changed={"P": 0.2}).log())
    assert (found.agrees, found.reason) == (False, ReplayReason.GAINS_CHANGED)
    assert found.parameter == "ATC_RAT_RLL_P"
    assert (found.numbers["before"], found.numbers["after"]) == (0.135, 0.2)
    assert found.numbers["time_s"] == pytest.approx(60.0, abs=0.2)


def test_a_gyro_filter_that_was_changed_in_flight_is_named_though_the_replay_agrees() -> None:
    """The logged rates are those behind it: only the log's parameters can tell."""
    log = ApFlight().log()
    change = ParameterChange(time_s=60.0, position=400_000, name="INS_GYRO_FILTER", value=20.0, before=40.0)
    found = roll(replace(log, parameter_changes=(change,)))
    assert (found.agrees, found.reason) == (False, ReplayReason.GAINS_CHANGED)
    assert found.parameter == "INS_GYRO_FILTER"


@pytest.mark.thorough
def test_gains_changed_in_flight_are_found_where_no_change_was_logged() -> None:
    log = ApFlight(n=16000, change_at=9000, changed={"P": 0.2}).log(terms=False)
    found = roll(replace(log, parameter_changes=(), parameters=log.parameters | {"ATC_RAT_RLL_P": 0.135}))
    assert (found.agrees, found.reason) == (False, ReplayReason.GAINS_CHANGED)
    assert found.parameter == "ATC_RAT_RLL_P"
    assert found.numbers == pytest.approx({"before": 0.135, "after": 0.2}, rel=0.02)


def test_a_gain_changed_after_the_rows_is_no_reason() -> None:
    flight = ApFlight(change_at=7999, changed={"P": 0.2})
    assert roll(flight.log()).agrees


@pytest.mark.parametrize("shift", [1, -1, 2])
def test_set_points_shifted_by_rows_are_named(shift: int) -> None:
    log = ApFlight().log(terms=False)
    setpoint = log.signals["body_rate_setpoint"][0]
    moved = replace(setpoint, values=np.roll(setpoint.values, shift, axis=0))
    found = roll(replace(log, signals={**log.signals, "body_rate_setpoint": (moved,)}))
    assert (found.agrees, found.reason) == (False, ReplayReason.SETPOINT_SHIFTED)
    assert found.numbers == {"rows": -float(shift)}


def test_swapped_axes_are_named() -> None:
    log = ApFlight().log(terms=False)
    swapped = {
        name: (replace(log.signals[name][0], values=log.signals[name][0].values[:, [1, 0, 2]]),)
        for name in ("body_rate_setpoint", "body_rate")
    }
    found = replayed(replace(log, signals={**log.signals, **swapped}))
    assert found["roll"].reason is ReplayReason.AXES_SWAPPED
    assert found["roll"].numbers == {"axis": 1.0}
    assert found["yaw"].agrees


def test_a_wrong_loop_rate_in_the_parameters_is_named() -> None:
    found = roll(ApFlight().log(parameters={"SCHED_LOOP_RATE": 300.0}))
    assert (found.agrees, found.reason) == (False, ReplayReason.LOOP_RATE_DIFFERS)
    assert found.numbers == pytest.approx({"in_file_hz": 300.0, "flown_hz": 400.0}, rel=1e-3)


def test_stamps_that_run_at_half_the_speed_are_named() -> None:
    log = ApFlight().log(terms=False)
    rows = log.signals["body_rate"][0].rows
    slow = Rows(2.0 * rows.time_s, rows.position)
    signals = {name: (replace(sources[0], rows=slow),) for name, sources in log.signals.items()}
    found = roll(replace(log, signals=signals))
    assert found.reason is ReplayReason.LOOP_RATE_DIFFERS
    assert found.numbers["flown_hz"] == pytest.approx(400.0, rel=1e-3)


def test_a_hidden_notch_is_found_by_its_frequency() -> None:
    found = roll(ApFlight(notch_hz=14.0).log(terms=False))
    assert (found.agrees, found.reason) == (False, ReplayReason.HIDDEN_NOTCH)
    assert found.numbers["frequency_hz"] == pytest.approx(14.0, rel=0.06)


def test_thinned_rows_are_no_rows() -> None:
    log = with_rows(ApFlight(n=16000).log(), np.arange(16000) % 40 == 0)
    found = roll(log)
    assert (found.agrees, found.reason) == (False, ReplayReason.NO_ROWS)
    assert found.numbers["logged_hz"] == pytest.approx(10.0, rel=0.02)


def test_a_log_without_set_points_has_no_rows() -> None:
    log = ApFlight(n=2000).log()
    signals = {name: one for name, one in log.signals.items() if name != "body_rate_setpoint"}
    found = roll(replace(log, signals=signals))
    assert (found.agrees, found.reason, found.n_rows) == (False, ReplayReason.NO_ROWS, 0)


@pytest.mark.thorough
def test_what_nothing_explains_is_said_to_be_unexplained() -> None:
    log = ApFlight().log(terms=False)
    output = log.signals["torque_command"][0]
    noise = np.random.default_rng(0).standard_normal(output.values.shape)
    other = replace(output, values=output.values + 0.2 * noise)
    found = roll(replace(log, signals={**log.signals, "torque_command": (other,)}))
    assert (found.agrees, found.reason) == (False, ReplayReason.NOT_EXPLAINED)


def test_gaps_leave_the_longest_run_of_rows() -> None:
    kept = np.ones(8000, bool)
    kept[2000:2100] = False
    found = roll(with_rows(ApFlight().log(), kept))
    assert found.agrees
    assert found.n_rows == 5899


# ---------------------------------------------------------------- PX4


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
@pytest.mark.parametrize("derivative", [True, False])
def test_px4s_rate_controller_is_replayed(axis: str, derivative: bool) -> None:
    found = replayed(Px4Flight().log(derivative=derivative))[axis]
    assert found.agrees
    assert found.relative_rms["output"] < (1e-6 if derivative else 1e-3)


def test_px4s_feed_forward_and_common_factor_are_replayed() -> None:
    flight = Px4Flight(parameters_={"MC_ROLLRATE_FF": 0.05, "MC_ROLLRATE_K": 1.3})
    assert roll(flight.log()).relative_rms["output"] < 1e-6


def test_a_quarter_of_the_set_points_may_be_missing() -> None:
    found = roll(Px4Flight(missing_fraction=0.25).log())
    assert found.agrees
    assert found.relative_rms["output"] < 0.05


@pytest.mark.thorough
def test_set_points_that_are_mostly_missing_are_named() -> None:
    found = roll(Px4Flight(every=25).log())
    assert (found.agrees, found.reason) == (False, ReplayReason.SETPOINT_MISSING)
    assert found.numbers["missing_fraction"] == pytest.approx(0.96, abs=0.01)


def test_px4s_wrong_gain_is_named() -> None:
    found = roll(Px4Flight().log(parameters={"MC_ROLLRATE_D": 0.006}))
    assert (found.reason, found.parameter) == (ReplayReason.GAIN_DIFFERS, "MC_ROLLRATE_D")
    assert found.numbers["flown"] == pytest.approx(0.003, rel=0.03)


def every_second_step(log: FlightLog) -> FlightLog:
    """Return a PX4 log that holds every second step of the loop, whose period the parameters tell."""
    log = with_rows(replace(log, parameters=log.parameters | {"IMU_GYRO_RATEMAX": 500.0}), EVERY_SECOND)
    return replace(
        log,
        signals={
            name: tuple(
                replace(one, rows=Rows(20.0 + 0.5 * (one.rows.time_s - 20.0), one.rows.position))
                for one in sources
            )
            for name, sources in log.signals.items()
        },
    )


EVERY_SECOND = np.arange(8000) % 2 == 0


def test_rows_that_may_be_some_of_px4s_steps_only_are_no_other_controller() -> None:
    """Logged at 250 Hz from a loop of 500 Hz: set-points and slopes of the steps between are missing."""
    found = replayed(every_second_step(Px4Flight().log(derivative=False)))
    assert found["roll"].reason is ReplayReason.NO_ROWS
    assert thinned_from(found) == pytest.approx(1 / 500.0)


def test_a_slow_px4_loop_whose_rows_replay_was_not_thinned() -> None:
    """A loop waits for its gyro: at 250 Hz where the parameters allow 800."""
    log = Px4Flight(parameters_={"IMU_GYRO_RATEMAX": 800.0}).log()
    assert thinned_from(replayed(log)) is None


def test_another_gain_is_named_where_px4s_loop_may_be_faster_than_its_rows() -> None:
    found = roll(Px4Flight().log(parameters={"MC_ROLLRATE_D": 0.006, "IMU_GYRO_RATEMAX": 800.0}))
    assert (found.reason, found.parameter) == (ReplayReason.GAIN_DIFFERS, "MC_ROLLRATE_D")


def test_an_axis_that_replays_exactly_says_of_the_others_that_no_step_is_missing() -> None:
    log = Px4Flight(parameters_={"IMU_GYRO_RATEMAX": 800.0}).log()
    output = log.signals["torque_command"][0]
    noise = 0.2 * np.random.default_rng(0).standard_normal(output.values.shape) * [1.0, 0.0, 0.0]
    other = replace(output, values=output.values + noise)
    found = replayed(replace(log, signals={**log.signals, "torque_command": (other,)}))
    assert [found[axis].reason for axis in ("roll", "pitch")] == [ReplayReason.NOT_EXPLAINED, None]


def test_px4s_filter_of_the_acceleration_is_named_where_it_was_not_logged() -> None:
    log = Px4Flight(parameters_={"MC_ROLLRATE_D": 0.02}).log(derivative=False)
    found = roll(replace(log, parameters=log.parameters | {"IMU_DGYRO_CUTOFF": 80.0}))
    assert (found.reason, found.parameter) == (ReplayReason.FILTER_DIFFERS, "IMU_DGYRO_CUTOFF")
    assert found.numbers["flown_hz"] == pytest.approx(20.0, rel=0.1)


# ---------------------------------------------------------------- what the parameters say


@pytest.mark.parametrize("name", ["NTF", "NEF"])
def test_a_notch_in_the_controller_is_refused_by_name(name: str) -> None:
    log = ApFlight(n=2000).log(parameters={f"ATC_RAT_RLL_{name}": 2.0})
    controllers = named("ardupilot").controllers(log, log.parameters)
    assert controllers is not None
    assert set(controllers.axes) == {"pitch", "yaw"}
    (remark,) = controllers.remarks
    assert (remark.kind, remark.axis) == (RemarkKind.NOT_MODELLED, "roll")
    assert remark.values == {f"ATC_RAT_RLL_{name}": 2.0}


def test_a_firmware_without_these_filters_has_no_controller_here() -> None:
    log = ApFlight(n=2000).log()
    parameters = {name: value for name, value in log.parameters.items() if "FLT" not in name}
    controllers = named("ardupilot").controllers(log, parameters)
    assert controllers is not None
    assert not controllers.axes
    assert {remark.kind for remark in controllers.remarks} == {RemarkKind.MISSING_PARAMETER}
    assert math.isnan(controllers.remarks[0].values["ATC_RAT_RLL_FLTT"])


@pytest.mark.parametrize(
    ("version", "told"), [("V4.7.0", "read"), ("V4.8.0", "nearest"), ("unnumbered", "unknown")]
)
def test_it_is_said_whether_the_firmwares_source_was_read(version: str, told: str) -> None:
    log = ApFlight(n=2000).log(version=version)
    controllers = named("ardupilot").controllers(log, log.parameters)
    assert controllers is not None
    assert (controllers.version_read, controllers.version_note) == (told, "4.7")


# ---------------------------------------------------------------- real firmware

FULL_RATE = ("ac47_quadx_multisine.BIN", "ac47_quadx_doublets.BIN", "ac47_quadx_sid_roll.BIN")


@pytest.mark.parametrize("name", thorough_but(FULL_RATE[1:2], FULL_RATE))
def test_ardupilots_firmware_is_replayed_on_all_axes(corpus: Path, name: str) -> None:
    prepared = load(corpus / "firmware" / name)
    for axis, found in replayed(prepared.log, prepared.flights).items():
        assert found.agrees, (axis, found)
        assert found.relative_rms["output"] < 0.01
        for term, bar in (("P", 1e-4), ("D", 1e-4), ("FF", 1e-4), ("I", 0.01)):
            error = found.relative_rms[term]
            assert error is None or error < bar, (axis, term)


def test_px4s_firmware_is_replayed_on_all_axes(corpus: Path) -> None:
    prepared = load(corpus / "firmware" / "px4_quad_multisine.ulg")
    for axis, found in replayed(prepared.log, prepared.flights).items():
        assert found.agrees, (axis, found)
        assert found.relative_rms["output"] < 0.05


SLOW = (
    "firmware/ac47_quadx_default_logging.BIN",
    "firmware/px4_quad_default_logging.ulg",
    "real/px4-1.15-quad-hover-80s.ulg",
)


@pytest.mark.parametrize("name", SLOW)
def test_a_log_that_is_slower_than_the_loop_is_not_replayed(corpus: Path, name: str) -> None:
    prepared = load(corpus / name)
    found = replayed(prepared.log, prepared.flights)
    assert {one.reason for one in found.values()} == {ReplayReason.NO_ROWS}


def test_in_a_log_of_every_fourth_step_no_set_point_is_called_shifted() -> None:
    """A row is four steps of the loop there, and a slow yaw fits a late row within the tolerance."""
    prepared = load(Path("sample_logs/products-of-inertia.ulg"))
    found = replayed(prepared.log, prepared.flights)
    assert {one.reason for one in found.values()} == {ReplayReason.NO_ROWS}


@pytest.mark.thorough
def test_the_ground_before_the_flight_shows_as_a_reset_of_the_integrator(corpus: Path) -> None:
    found = roll(read_log(corpus / "firmware" / "ac47_quadx_multisine.BIN"))
    assert (found.agrees, found.reason) == (False, ReplayReason.INTEGRATOR_RESET)
