"""Betaflight: signs and units, frame, filters, and models from its firmware's logs."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.actuation.airframe import Airframe, Unknown
from quadid_logs.autopilots.betaflight.airframe import find_airframe
from quadid_logs.autopilots.betaflight.filters import measured_filter, settings_filter
from quadid_logs.autopilots.betaflight.log import read
from quadid_logs.autopilots.betaflight.torque import before_linearisation, mix_factor
from quadid_logs.data.log import FlightLog
from quadid_logs.errors import UnknownFormatError
from tests.analyses import Analyzed
from tests.containers import blackbox_maker as maker

#: Betaflight's mixer for roll, pitch, yaw sums of its own axes: motors 1 to 4.
MIX = np.array([[-1, 1, 1], [-1, -1, -1], [1, 1, -1], [1, -1, 1]])
DEGREE = math.pi / 180.0


def made(tmp_path: Path, columns: dict[str, np.ndarray | int], **settings: str) -> FlightLog:
    """Write columns, all others zero, and read them as a log."""
    count = max(np.size(values) for values in columns.values())
    rows = np.zeros((count, len(maker.NAMES)), dtype=int)
    rows[:, maker.NAMES.index("vbatLatest")] = 1600
    rows[:, maker.NAMES.index("time")] = 1000 * np.arange(count) + 1_000_000
    rows[:, 0] = np.arange(count)
    for name in ("motor[0]", "motor[1]", "motor[2]", "motor[3]"):
        rows[:, maker.NAMES.index(name)] = 158
    for name, values in columns.items():
        rows[:, maker.NAMES.index(name)] = values
    path = tmp_path / "made.bbl"
    given = maker.SETTINGS | {name.replace("__", " "): value for name, value in settings.items()}
    path.write_bytes(maker.log(rows.tolist(), settings=given))
    return read(path)


def values(log: FlightLog, name: str) -> np.ndarray:
    """Return the preferred source's last row."""
    return log.candidates(name)[0].values[-1]


def test_pitch_and_yaw_change_sign_from_forward_left_up(tmp_path: Path) -> None:
    """Nose down and nose left are positive there."""
    log = made(tmp_path, {f"gyroADC[{axis}]": np.full(40, axis + 1) for axis in range(3)})
    np.testing.assert_allclose(values(log, "body_rate"), DEGREE * np.array([1.0, -2.0, -3.0]))


def test_high_resolution_logs_have_tenths_of_degrees(tmp_path: Path) -> None:
    """Of the gyro and the set-points, not of the throttle."""
    columns = {"gyroADC[0]": np.full(40, 10), "setpoint[0]": np.full(40, 20), "setpoint[3]": np.full(40, 500)}
    log = made(tmp_path, columns, blackbox_high_resolution="1")
    assert values(log, "body_rate")[0] == pytest.approx(DEGREE)
    assert values(log, "body_rate_setpoint")[0] == pytest.approx(2.0 * DEGREE)
    assert values(log, "throttle")[0] == pytest.approx(0.5)


def test_the_pid_sum_is_limited_as_in_the_mixer(tmp_path: Path) -> None:
    """500 for roll and pitch, 400 for yaw, of 1000."""
    terms = {f"axis{term}[{axis}]": np.full(40, 200) for term in "PIDF" for axis in range(3)}
    log = made(tmp_path, terms)
    np.testing.assert_allclose(values(log, "torque_command"), [0.5, -0.5, -0.4])


def test_all_four_terms_are_in_the_pid_sum(tmp_path: Path) -> None:
    """P, I, D and feed-forward."""
    terms = {
        f"axis{term}[0]": np.full(40, size) for term, size in zip("PIDF", (1, 10, 100, -50), strict=True)
    }
    assert values(made(tmp_path, terms), "torque_command")[0] == pytest.approx(0.061)


def test_at_rest_the_specific_force_points_up(tmp_path: Path) -> None:
    """+1 g on Betaflight's z axis."""
    log = made(tmp_path, {"accSmooth[2]": np.full(40, 2048)})
    np.testing.assert_allclose(values(log, "specific_force"), [0.0, 0.0, -9.80665], atol=1e-12)


def test_the_clock_of_32_bits_turns_over(tmp_path: Path) -> None:
    """Every 71 minutes."""
    times = (2**32 - 50_000 + 1000 * np.arange(100)) % 2**32
    log = made(tmp_path, {"time": times, "gyroADC[0]": np.arange(100)})
    np.testing.assert_allclose(np.diff(log.candidates("body_rate")[0].time_s), 1e-3, atol=1e-9)


@pytest.mark.parametrize(
    "revision", ["INAV 7.1.0 (abc) KAKUTEH7", "Cleanflight 2.1.0 (abc) SPF3", "Rotorflight 4.3.0 (abc) F7"]
)
def test_other_firmware_is_refused_by_its_name(revision: str, tmp_path: Path) -> None:
    """Its fields have other scales, its mixer is another."""
    with pytest.raises(UnknownFormatError, match=revision.split()[0]):
        made(tmp_path, {"gyroADC[0]": np.zeros(40)}, Firmware__revision=revision)


def mixed(tmp_path: Path, mix: np.ndarray) -> FlightLog:
    """Fly random PID sums through a mixer."""
    rng = np.random.default_rng(0)
    sums, throttle = rng.integers(-60, 60, (2000, 3)), rng.integers(300, 500, 2000)
    outputs = 158 + np.rint(1889 * (throttle[:, None] + sums @ mix.T) / 1000.0).astype(int)
    columns = {f"axisP[{axis}]": sums[:, axis] for axis in range(3)} | {"setpoint[3]": throttle}
    return made(tmp_path, columns | {f"motor[{k}]": outputs[:, k] for k in range(4)})


@pytest.mark.parametrize("direction", [1, -1])
def test_the_outputs_tell_which_way_the_rotors_turn(direction: int, tmp_path: Path) -> None:
    """No header says yaw_motors_reversed; motor 1, rear right, turns clockwise without it."""
    frame = find_airframe(mixed(tmp_path, MIX * [1, 1, direction]))
    assert isinstance(frame, Airframe)
    np.testing.assert_array_equal(frame.spin, direction * np.array([-1.0, 1.0, 1.0, -1.0]))
    np.testing.assert_allclose(frame.factors[:, :3], MIX * [1, -1, -direction])


def test_a_frame_that_mixes_otherwise_is_not_taken_for_a_quad_x(tmp_path: Path) -> None:
    """Motors in another order."""
    assert isinstance(find_airframe(mixed(tmp_path, MIX[[1, 0, 2, 3]])), Unknown)


def test_thrust_linearisation_is_undone() -> None:
    """By the formula of the firmware, e = 0.4."""
    x = np.linspace(0.0, 1.0, 21)
    output = x * (1.0 + 0.4 * (1.0 - x) * (1.0 + 0.4 * (1.0 - 2.0 * x)))
    np.testing.assert_allclose(before_linearisation(output, 0.4), x, atol=1e-5)


@pytest.mark.parametrize(("features", "expected"), [(1 << 22, [1.0, 1.0, 1.0]), (0, [0.5, 0.8, 1.0])])
def test_without_airmode_the_sums_count_less_at_low_throttle(features: int, expected: list[float]) -> None:
    """Half at none, all of them from half throttle on."""
    found = mix_factor(np.array([0.0, 0.3, 0.7]), {"features": float(features)})
    np.testing.assert_allclose(found, expected)


def test_the_delay_of_the_gyro_filters_is_measured() -> None:
    """2 ms between the gyro before and behind them is the delay of the low-pass that stands for them."""
    rng = np.random.default_rng(0)
    rate = np.convolve(rng.normal(size=8000), np.hanning(50), mode="same")[:, np.newaxis]
    found = measured_filter(rate[:-2], rate[2:], 1e-3)
    assert found is not None
    assert math.sqrt(2.0) / (2.0 * math.pi * found.low_pass_hz) == pytest.approx(2e-3, rel=0.02)


def test_low_passes_in_a_row_delay_by_their_sum() -> None:
    """One pole at 250 Hz and one at 500 Hz: 0.64 + 0.32 ms."""
    settings = {"gyro_lpf1_type": 0.0, "gyro_lpf1_static_hz": 250.0, "gyro_lpf2_static_hz": 500.0}
    cutoff_hz = settings_filter(settings, math.nan).low_pass_hz
    assert math.sqrt(2.0) / (2.0 * math.pi * cutoff_hz) == pytest.approx(1.5 / (2.0 * math.pi * 250.0))


def test_the_rpm_filter_has_a_notch_per_motor_and_harmonic() -> None:
    """Q in hundredths, where the rotors turn."""
    settings = {"rpm_filter_harmonics": 2.0, "rpm_filter_q": 500.0, "rpm_filter_min_hz": 100.0}
    notches = settings_filter(settings, 180.0).notches
    assert [notch.frequency_hz for notch in notches] == [180.0] * 4 + [360.0] * 4
    assert {notch.inverse_q for notch in notches} == {0.2}


@pytest.mark.corpus
def test_stick_flight_of_the_firmware_gives_roll_and_pitch_as_they_are(
    corpus: Path, analyzed: Analyzed
) -> None:
    """At the flight's mean motor commands, where the model is: to what the mean over a curve can tell."""
    truth = json.loads((corpus / "firmware/bf_quad_sticks.truth.json").read_text())["linear_model"]
    model = analyzed(corpus / "firmware/bf_quad_sticks.bbl").identification.recommended
    assert model is not None
    found = {parameter.name: parameter.value for parameter in model.parameters}
    expected = truth["B_roll_pitch_yaw_mean"][:2]
    np.testing.assert_allclose([found["B11"], found["B22"]], expected, rtol=0.03)


@pytest.mark.corpus
def test_a_hover_in_turbulence_is_refused_on_all_axes(corpus: Path, analyzed: Analyzed) -> None:
    """Its commands are answers to the air: least squares is at a fifth of the truth."""
    verdicts = analyzed(corpus / "firmware/bf_quad_hover.bbl").diagnosis.axes
    assert {verdict.verdict for verdict in verdicts.values()} == {"refused"}


def test_a_range_of_the_outputs_that_is_no_number_leaves_the_outputs_out(tmp_path: Path) -> None:
    """Damaged digits; a superscript two counts as a digit in Unicode."""
    log = made(tmp_path, {"gyroADC[0]": np.arange(40)})
    path = tmp_path / "damaged.bbl"
    content = Path(log.path).read_bytes()
    path.write_bytes(content.replace(b"H motorOutput:158,2047", b"H motorOutput:158,\xb2047"))
    assert read(path).candidates("motor_thrust") == ()
