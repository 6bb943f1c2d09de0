"""PX4's topics in canonical signals."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog
from quadid_logs.load import read_log
from quadid_logs.vocabulary import SIGNALS
from tests.containers import ulog_maker as make


def log_of(
    folder: Path, formats: dict[str, str], rows: list[tuple[str, bytes]], extra: bytes = b""
) -> FlightLog:
    """Write and read a log of topics given as format and row bytes (after the timestamp)."""
    content = make.header() + extra
    content += b"".join(
        make.message("F", f"{name}:uint64_t timestamp;{rest}".encode()) for name, rest in formats.items()
    )
    ids = {name: k for k, name in enumerate(formats)}
    content += b"".join(make.subscription(k, name) for name, k in ids.items())
    for k, (name, body) in enumerate(rows):
        content += make.message("D", struct.pack("<HQ", ids[name], 1_000_000 * (k + 1)) + body)
    path = folder / "log"
    path.write_bytes(content)
    return read_log(path)


def preferred(log: FlightLog, name: str) -> np.ndarray:
    """Return the values of the preferred source."""
    return log.candidates(name)[0].values


def test_the_sample_time_is_taken_where_it_is_plausible(tmp_path: Path) -> None:
    """timestamp_sample counts unless it is zero or more than 0.1 s off."""
    form = {"vehicle_angular_velocity": "uint64_t timestamp_sample;float[3] xyz;"}
    rows = [
        ("vehicle_angular_velocity", struct.pack("<Q3f", sampled, 0, 0, 0))
        for sampled in (999_000, 0, 2_899_000, 4_000_000)
    ]
    times = log_of(tmp_path, form, rows).candidates("body_rate")[0].time_s
    assert times.tolist() == pytest.approx([0.999, 2.0, 3.0, 4.0])


def test_the_quaternion_becomes_euler_angles(tmp_path: Path) -> None:
    """A quarter turn about each axis gives that angle; a zero quaternion gives NaN."""
    half = np.sqrt(0.5)
    form = {"vehicle_attitude": "float[4] q;"}
    quaternions = [(half, half, 0, 0), (np.cos(0.25), 0, np.sin(0.25), 0), (half, 0, 0, half), (0, 0, 0, 0)]
    log = log_of(tmp_path, form, [("vehicle_attitude", struct.pack("<4f", *q)) for q in quaternions])
    expected = [[np.pi / 2, 0, 0], [0, 0.5, 0], [0, 0, np.pi / 2], [np.nan] * 3]
    np.testing.assert_allclose(preferred(log, "attitude"), expected, atol=1e-6)


def test_thrust_points_up(tmp_path: Path) -> None:
    """PX4's thrust along body z is negative in flight; ours is positive."""
    log = log_of(
        tmp_path,
        {"vehicle_thrust_setpoint": "float[3] xyz;"},
        [("vehicle_thrust_setpoint", struct.pack("<3f", 0.0, 0.0, -0.625))],
    )
    assert preferred(log, "throttle").tolist() == [[0.625]]


def test_a_stopped_motor_stays_nan_and_unused_motors_have_no_column(tmp_path: Path) -> None:
    """NaN means stopped; twelve columns are logged, four are used."""
    form = {"actuator_motors": "float[12] control;"}
    all_run = struct.pack("<12f", 0.5, 0.5, 0.5, 0.5, *[np.nan] * 8)
    one_stopped = struct.pack("<12f", 0.5, np.nan, 0.5, 0.5, *[np.nan] * 8)
    log = log_of(tmp_path, form, [("actuator_motors", all_run), ("actuator_motors", one_stopped)])
    np.testing.assert_array_equal(preferred(log, "motor_thrust"), [[0.5] * 4, [0.5, np.nan, 0.5, 0.5]])


def test_old_control_groups_give_torque_and_throttle(tmp_path: Path) -> None:
    """actuator_controls_0 holds roll, pitch, yaw and thrust up to PX4 1.13."""
    log = log_of(
        tmp_path,
        {"actuator_controls_0": "float[8] control;"},
        [("actuator_controls_0", struct.pack("<8f", 0.25, -0.5, 0.125, 0.75, 0, 0, 0, 0))],
    )
    assert preferred(log, "torque_command").tolist() == [[0.25, -0.5, 0.125]]
    assert preferred(log, "throttle").tolist() == [[0.75]]


def test_outputs_that_are_no_pulse_widths_are_not_called_so(tmp_path: Path) -> None:
    """CAN ESCs use 0 to 8191 in the same field."""
    form = {"actuator_outputs": "uint32_t noutputs;float[4] output;"}
    can = [("actuator_outputs", struct.pack("<I4f", 4, 4000, 4100, 3900, 4000))]
    pwm = [("actuator_outputs", struct.pack("<I4f", 4, 1500, 1400, 1600, 1500))]
    assert log_of(tmp_path, form, can).candidates("output_pwm") == ()
    assert preferred(log_of(tmp_path, form, pwm), "output_pwm").tolist() == [[1500, 1400, 1600, 1500]]


def test_a_rotor_speed_that_never_moves_is_no_measurement(tmp_path: Path) -> None:
    """Constant rpm is left out, moving rpm becomes rad/s without sign."""
    esc = make.message("F", b"esc_report:uint64_t timestamp;int32_t esc_rpm;")
    form = {"esc_status": "esc_report[2] esc;"}

    def rows(*speeds: tuple[int, int]) -> list[tuple[str, bytes]]:
        return [("esc_status", struct.pack("<QiQi", 0, first, 0, second)) for first, second in speeds]

    assert log_of(tmp_path, form, rows((0, 0), (0, 0)), esc).candidates("rotor_speed") == ()
    assert log_of(tmp_path, form, rows((60, 60), (60, 60)), esc).candidates("rotor_speed") == ()
    moving = preferred(log_of(tmp_path, form, rows((60, 0), (-120, 60)), esc), "rotor_speed")
    np.testing.assert_allclose(moving, 2 * np.pi * np.array([[1, 0], [2, 1]]))


def test_modes_change_where_nav_state_changes_and_old_numbers_keep_their_old_names(tmp_path: Path) -> None:
    """Number 6 was AUTO_RCRECOVER before 1.14 and is POSITION_SLOW since."""
    form = {"vehicle_status": "uint8_t nav_state;uint8_t arming_state;"}
    rows = [("vehicle_status", bytes([mode, armed])) for mode, armed in ((2, 1), (2, 2), (6, 2))]
    old = make.keyed("I", "uint32_t ver_sw_release", struct.pack("<I", 0x010B00FF))
    new = make.keyed("I", "uint32_t ver_sw_release", struct.pack("<I", 0x011000FF))
    assert [mode.name for mode in log_of(tmp_path, form, rows, old).modes] == ["POSCTL", "AUTO_RCRECOVER"]
    log = log_of(tmp_path, form, rows, new)
    assert [(mode.time_s, mode.name) for mode in log.modes] == [(1.0, "POSCTL"), (3.0, "POSITION_SLOW")]
    assert preferred(log, "armed").ravel().tolist() == [0.0, 1.0, 1.0]
    assert log.firmware == "PX4 v1.16.0"


def test_the_last_value_of_a_changed_parameter_counts(tmp_path: Path) -> None:
    """Parameters written while logging win, and it is said."""
    path = tmp_path / "log"
    path.write_bytes(make.small_log())
    log = read_log(path)
    assert log.parameters == {"MAV_TYPE": 13.0}
    assert any("1 parameter was written" in remark for remark in log.remarks)


def test_texts_carry_the_autopilots_time(tmp_path: Path) -> None:
    """A logged text has its own stamp and place."""
    path = tmp_path / "log"
    path.write_bytes(make.small_log())
    (text,) = read_log(path).texts
    assert (text.time_s, text.text) == (1.1, "Takeoff detected")
    assert path.read_bytes()[text.position + 2 :].startswith(b"L")


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "vehicle_type", "words"),
    [
        ("firmware/px4_quad_multisine.ulg", "multirotor", "4 rotors"),
        ("real/px4-1.16-quad-v6c-indoor-85s.ulg", "multirotor", "quad X"),
        ("real/px4-1.14-octocoax-cubeorange-75s.ulg", "multirotor", "8 rotors, coaxial pairs"),
        ("real/px4-1.12-f450-tumble-3s.ulg", "multirotor", "quad X"),
        ("real/px4-1.11-vtol-babyshark-sysid-branch-1174s.ulg", "vtol", "airframe 13014"),
        ("damaged/corrupt-format-not-utf8.ulg", "fixed-wing", "airframe 3100"),
    ],
)
def test_vehicles_of_the_corpus_are_recognised(
    corpus: Path, name: str, vehicle_type: str, words: str
) -> None:
    """Type and frame come from flags and parameters."""
    log = read_log(corpus / name)
    assert log.vehicle_type == vehicle_type
    assert words in log.frame
    assert log.firmware.startswith("PX4 v1.")


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", ["firmware/px4_quad_multisine.ulg"], indirect=True)
def test_the_preferred_sources_of_a_modern_log_are_the_controllers_own(corpus_log: Path) -> None:
    """Rates, torque and motors at 250 Hz, each with a reason; every name is canonical."""
    log = read_log(corpus_log)
    sources = {name: signals[0].source for name, signals in log.signals.items()}
    assert sources["body_rate"] == "vehicle_angular_velocity.xyz"
    assert sources["torque_command"] == "vehicle_torque_setpoint.xyz"
    assert sources["motor_thrust"] == "actuator_motors.control"
    assert set(log.signals) <= set(SIGNALS)
    assert all(signal.reason for signals in log.signals.values() for signal in signals)
    assert preferred(log, "motor_thrust").shape[1] == 4
    assert np.median(np.diff(log.candidates("torque_command")[0].time_s)) == pytest.approx(0.004)


@pytest.mark.filterwarnings("error")
def test_infinite_outputs_are_no_obstacle(tmp_path: Path) -> None:
    """A damaged driver's outputs cannot be the motors: they come last, without a warning."""
    form = {"actuator_outputs": "uint32_t noutputs;float[4] output;"}
    first = ("actuator_outputs", struct.pack("<I4f", 4, 1400, -np.inf, 1500, 1500))
    second = ("actuator_outputs", struct.pack("<I4f", 4, 1500, 1500, 1600, 1500))
    log = log_of(tmp_path, form, [first, second, second])
    assert log.candidates("output_pwm")[0].n_samples == 3


def test_outputs_are_those_of_the_driver_that_moves_most(tmp_path: Path) -> None:
    """The first one drives a gimbal."""
    content = make.header() + make.message("F", b"actuator_outputs:uint64_t timestamp;float[4] output;")
    content += make.subscription(0, "actuator_outputs") + make.subscription(1, "actuator_outputs", 1)
    for k in range(20):
        for msg_id, swing in ((0, 10.0), (1, 200.0)):
            output = [1500.0 + swing * (-1) ** (k + motor) for motor in range(4)]
            content += make.message("D", struct.pack("<HQ4f", msg_id, 1_000_000 + 10_000 * k, *output))
    path = tmp_path / "log"
    path.write_bytes(content)
    np.testing.assert_allclose(np.ptp(preferred(read_log(path), "output_pwm"), axis=0), 400.0)


def test_rows_of_two_drivers_in_one_instance_are_told_apart(tmp_path: Path) -> None:
    """One of 1.12 holds those of a CAN driver without a number, and pulses of a board that drives nothing."""
    form = {"actuator_outputs": "uint32_t noutputs;float[4] output;"}
    motors = [[1200.0 + 20.0 * k, 1300.0 - 10.0 * k, 1250.0, 1260.0] for k in range(10)]
    rows = [("actuator_outputs", struct.pack("<I4f", 0, *one)) for one in motors]
    rows[3:3] = [("actuator_outputs", struct.pack("<I4f", 4, *[1500.0] * 4))] * 3
    outputs = log_of(tmp_path, form, rows).candidates("output_pwm")[0]
    np.testing.assert_allclose(outputs.values, motors)
    assert outputs.time_s.tolist() == [1.0, 2.0, 3.0, *range(7, 14)]
