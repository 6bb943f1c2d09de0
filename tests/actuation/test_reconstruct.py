"""From logged outputs to achieved torque, saturation and newton metres."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.actuation import reconstruct
from quadid_logs.align import Prepared, clean, cut
from quadid_logs.align.series import CleanSeries
from quadid_logs.autopilots import named
from quadid_logs.data.log import FlightLog
from quadid_logs.data.settings import AlignSettings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.load import load, prepare, read_log
from quadid_logs.simulator import simulate
from tests.actuation.logs import PARAMETERS, ardupilot_log, signal
from tests.analyses import Analyzed
from tests.marks import thorough_but

ARDUPILOT = [
    "ac47_quadx_default_logging",
    "ac47_quadx_doublets",
    "ac47_quadx_esc_rpm",
    "ac47_quadx_multisine",
    "ac47_quadx_sid_roll",
    "ac47_rate_thread",
    "ac47_two_flights",
]
#: At the rate of the loop, at that of a rate thread, and with an interruption.
OF_EACH_RATE = ("ac47_quadx_doublets", "ac47_rate_thread", "ac47_two_flights")
#: Not excited, or too slow, on these axes: no inertia is claimed there.
TOLD = {"ac47_quadx_default_logging": 0, "ac47_quadx_sid_roll": 1}


def truth_of(path: Path) -> dict[str, object]:
    """Return the truth file beside a log."""
    return dict(json.loads(path.with_suffix(".truth.json").read_text()))


def torques_of(log: Prepared) -> list[CleanSeries]:
    """Return the sources of the normalised torque, the preferred one first."""
    return list(log.candidates["torque_command"])


def marks_of(log: Prepared) -> CleanSeries:
    """Return where the chosen torque is saturated."""
    assert log.torque is not None
    assert log.torque.saturated is not None
    return log.torque.saturated


def moments(truth: dict[str, object]) -> np.ndarray:
    """Return Ixx, Iyy, Izz of a truth file."""
    given = truth["inertia_kg_m2"]
    return np.array([given["Ixx"], given["Iyy"], given["Izz"]] if isinstance(given, dict) else np.diag(given))


@pytest.mark.parametrize("name", thorough_but(OF_EACH_RATE, ARDUPILOT))
def test_recomputed_pulse_widths_meet_the_logged_ones(corpus: Path, name: str) -> None:
    """Mean error below 1 us and standard deviation below 2 us outside saturated samples."""
    model = load(corpus / "firmware" / f"{name}.BIN").log.torque
    assert model is not None
    assert model.check is not None
    assert model.check.n_samples > 300
    assert abs(model.check.mean_us) < 1.0
    assert model.check.std_us < 2.0


def test_flown_vehicles_confirm_the_mixer_too(corpus: Path) -> None:
    """The recomputed pulse widths of a real quad, firmware 4.1, are right to a microsecond."""
    model = load(corpus / "real" / "ac413-quadx-goodprop-hover1.bin").log.torque
    assert model is not None
    assert model.check is not None
    assert model.check.largest_us <= 1.0


@pytest.mark.parametrize("name", ["px4_quad_multisine", "px4_quad_default_logging"])
def test_px4_motors_return_the_set_point_where_nothing_is_limited(corpus: Path, name: str) -> None:
    """actuator_motors through the allocation is vehicle_torque_setpoint to single precision."""
    cleaned = clean(read_log(corpus / "firmware" / f"{name}.ulg"))
    first, second = reconstruct(cleaned, named("px4")).sources[:2]
    assert first.saturated is not None
    achieved, commanded, free = first.series, second.series, first.saturated.values.sum(axis=1) == 0.0
    row = np.searchsorted(commanded.time_s, achieved.time_s)
    row = np.minimum(row, commanded.n_samples - 1)
    same = free & (np.abs(commanded.time_s[row] - achieved.time_s) < 1e-6)
    assert same.mean() > 0.9
    assert np.abs(achieved.values[same] - commanded.values[row[same]]).max() < 1e-3


# The multisine flight is in the next test.
@pytest.mark.parametrize(
    "name",
    thorough_but(
        ["ac47_quadx_default_logging"],
        [name for name in ARDUPILOT if name != "ac47_quadx_multisine"],
    ),
)
def test_mass_and_arm_alone_give_the_inertia_of_roll_and_pitch(
    corpus: Path, analyzed: Analyzed, name: str
) -> None:
    """Ixx and Iyy within 3 %; what the flight or the file does not tell stays empty."""
    path = corpus / "firmware" / f"{name}.BIN"
    truth = truth_of(path)
    vehicle = Vehicle(mass_kg=truth["mass_kg"], arm_length_m=truth["arm_m_per_motor"])
    model = analyzed(path, vehicle).identification.recommended
    told = TOLD.get(name, 2)
    assert model is not None
    if told == 0:
        assert model.inertia is None or np.isnan(np.diag(model.inertia.matrix)[:2]).all()
        return
    assert model.inertia is not None
    found = np.diag(model.inertia.matrix)
    assert np.abs(found[:told] / moments(truth)[:told] - 1.0).max() < 0.03
    assert np.isnan(found[told:]).all()


@pytest.mark.thorough
def test_the_torque_ratio_adds_the_inertia_of_yaw(corpus: Path, analyzed: Analyzed) -> None:
    """Ixx and Iyy within 3 %, Izz within 8 %, and the truth of every axis inside its interval."""
    path = corpus / "firmware" / "ac47_quadx_multisine.BIN"
    truth = truth_of(path)
    vehicle = Vehicle(
        mass_kg=truth["mass_kg"],
        arm_length_m=truth["arm_m_per_motor"],
        torque_to_thrust_m=truth["yaw_torque_coeff_m"],
    )
    result = analyzed(path, vehicle)
    assert result.data.input is not None
    assert result.data.input.unit == "N m"
    inertia = result.identification.models[0].inertia
    assert inertia is not None
    assert (np.abs(np.diag(inertia.matrix) / moments(truth) - 1.0) < [0.03, 0.03, 0.08]).all()
    assert (np.diag(inertia.ci95_low) < moments(truth)).all()
    assert (np.diag(inertia.ci95_high) > moments(truth)).all()


@pytest.mark.thorough
def test_px4_needs_no_more_than_mass_arm_and_ratio(corpus: Path, analyzed: Analyzed) -> None:
    """All three moments of the simulated PX4 quad within 3 % (8 % for yaw)."""
    path = corpus / "firmware" / "px4_quad_multisine.ulg"
    truth = truth_of(path)
    vehicle = Vehicle(
        mass_kg=truth["mass_kg"],
        arm_length_m=math.hypot(truth["arm_roll_m"], truth["arm_pitch_m"]),
        torque_to_thrust_m=truth["yaw_torque_max_n_m"] / truth["thrust_max_n"],
    )
    inertia = analyzed(path, vehicle).identification.models[0].inertia
    assert inertia is not None
    assert (np.abs(np.diag(inertia.matrix) / moments(truth) - 1.0) < [0.03, 0.03, 0.08]).all()


@pytest.fixture(scope="module")
def made() -> FlightLog:
    """Return a made flight with some saturation."""
    return ardupilot_log(size=0.25)


def test_unsaturated_torque_is_the_command_and_saturated_torque_is_less(made: FlightLog) -> None:
    """Achieved equals commanded outside the marks, and never exceeds it inside."""
    log = prepare(made)
    achieved, commanded = torques_of(log)[:2]
    limited = marks_of(log).values > 0.5
    assert achieved.achieved
    assert 0.01 < limited[:, 2].mean() < 0.9
    np.testing.assert_allclose(achieved.values[~limited], commanded.values[~limited], atol=1e-3)
    assert (
        np.abs(achieved.values[limited[:, 2], 2]) <= np.abs(commanded.values[limited[:, 2], 2]) + 1e-9
    ).all()


def test_hover_gives_newtons(made: FlightLog) -> None:
    """Mass times specific force over the motors' fraction of full thrust is the thrust of a rotor."""
    log = prepare(made, Vehicle(mass_kg=2.0, arm_length_m=0.3)).log
    assert log.torque is not None
    known = log.torque.calibration
    assert known.max_thrust_n == pytest.approx(10.0, rel=2e-3)
    assert known.known == (True, True, False)
    assert 0.01 < known.relative_sigma[0] < 0.03


def test_torque_in_newton_metres_is_that_of_rotors_at_their_places(made: FlightLog) -> None:
    """Roll by one unit of command: four rotors of 0.5 times 10 N at 0.3 m / sqrt 2, each way."""
    vehicle = Vehicle(max_thrust_n=10.0, arm_length_m=0.3, torque_to_thrust_m=0.016)
    prepared = prepare(made, vehicle)
    assert prepared.log.torque is not None
    per_command = prepared.log.torque.calibration.n_m_per_command
    # The compensation gain cancels lift_max; density is not logged here.
    assert per_command[0] == pytest.approx(4 * 0.5 * 10.0 * 0.3 / math.sqrt(2.0), rel=1e-3)
    assert per_command[2] == pytest.approx(4 * 0.5 * 10.0 * 0.016, rel=1e-3)
    torque = prepared.candidates["torque_n_m"][0]
    command = prepared.candidates["torque_command"][0]
    np.testing.assert_allclose(torque.values, command.values * per_command, atol=1e-2)


def test_given_thrust_is_checked_against_the_weight(made: FlightLog) -> None:
    """The hover is the second opinion on a thrust that the user gives."""
    log = prepare(made, Vehicle(max_thrust_n=20.0, arm_length_m=0.3, mass_kg=2.0)).log
    assert log.torque is not None
    assert log.torque.calibration.route.startswith("largest thrust")
    assert log.torque.calibration.second_opinion == pytest.approx(0.5, rel=1e-2)


def test_pulse_widths_that_do_not_fit_leave_the_command_first(made: FlightLog) -> None:
    """With a wrong expo in the parameters the mixer is not believed, and the report says so."""
    wrong = replace(made, parameters={**PARAMETERS, "MOT_THST_EXPO": 0.2})
    prepared = prepare(wrong, Vehicle(mass_kg=2.0, arm_length_m=0.3, torque_to_thrust_m=0.016))
    assert prepared.log.torque is not None
    assert not torques_of(prepared)[0].achieved
    assert all(series.n_samples > 1000 for series in prepared.candidates["torque_n_m"])
    assert any("pulse widths differ" in remark for remark in prepared.log.torque.remarks)


def test_parameters_from_before_3_4_rebuild_nothing(made: FlightLog) -> None:
    """Without the thrust curve the command stays as logged, and the reason is given."""
    old = replace(made, parameters={"FRAME": 1.0, "MOT_TCRV_MIDPCT": 52.0})
    prepared = prepare(old)
    assert prepared.log.torque is not None
    assert torques_of(prepared) == list(prepared.clean.sources("torque_command"))
    assert any("MOT_SPIN_MIN" in remark for remark in prepared.log.torque.remarks)


def test_saturated_samples_are_marked_after_alignment(made: FlightLog) -> None:
    """The fraction in the input is that of the grid points near a limited sample."""
    data = cut(prepare(made), AlignSettings())
    assert data.input is not None
    assert data.input.achieved
    marks = np.concatenate([segment.saturated for segment in data.segments])
    assert data.input.saturated_fraction == pytest.approx(marks.mean())
    assert marks.any()


def test_speeds_computed_from_the_command_are_no_measurement(made: FlightLog) -> None:
    """A simulator's RPM repeats the motor command; zeros are worth nothing either."""
    output = made.candidates("output_pwm")[0]
    repeated = signal("rotor_speed", np.repeat(output.values[:, :4] - 900.0, 10, axis=0), every=10)
    computed = replace(made, signals={**made.signals, "rotor_speed": (repeated,)})
    model = prepare(computed).log.torque
    assert model is not None
    assert "computed from the command" in model.rotor_speed
    flat = replace(repeated, values=np.zeros_like(repeated.values))
    still = prepare(replace(made, signals={**made.signals, "rotor_speed": (flat,)})).log.torque
    assert still is not None
    assert "zero or constant" in still.rotor_speed


@pytest.mark.thorough
def test_a_log_slower_than_its_loop_still_shows_where_the_mixer_limits() -> None:
    """Rows between those of RCOU differ where the command jumps, and no more than there."""
    flight = simulate("saturation", seed=2, rate_hz=125.0, duration_s=25.0)
    data = cut(prepare(flight.log), AlignSettings())
    assert data.input is not None
    assert data.input.saturated_fraction > 0.01


def test_marks_of_saturation_go_with_the_torque_as_commanded_where_the_mixer_is_mistrusted(
    made: FlightLog,
) -> None:
    """Pulse widths that are off by 20 us everywhere: another mixer than the one computed."""
    output = made.candidates("output_pwm")[0]
    rng = np.random.default_rng(0)
    noisy = replace(output, values=output.values + 20.0 * rng.standard_normal(output.values.shape))
    log = prepare(replace(made, signals={**made.signals, "output_pwm": (noisy,)}))
    data = cut(log, AlignSettings())
    assert data.input is not None
    assert not data.input.achieved
    assert data.input.saturated_fraction > 0.0
