"""Betaflight: signs and units, frame, filters, and models from its firmware's logs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quadid_logs.actuation.airframe import Airframe, Unknown
from quadid_logs.align.series import CleanSeries
from quadid_logs.autopilots.betaflight.airframe import find_airframe
from quadid_logs.autopilots.betaflight.controller import controllers
from quadid_logs.autopilots.betaflight.filters import measured_filter, settings_filter
from quadid_logs.autopilots.betaflight.flown import flown as mean_flown
from quadid_logs.autopilots.betaflight.frames import FRAMES, Frame
from quadid_logs.autopilots.betaflight.log import read
from quadid_logs.autopilots.betaflight.mixer import before_linearisation, highest_output, mix_factor
from quadid_logs.autopilots.betaflight.rotors import COMMON_EXPO, find_rotors, full_output
from quadid_logs.autopilots.betaflight.signals import TO_FRD
from quadid_logs.data.controller import RemarkKind
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.model import Model
from quadid_logs.errors import EmptyLogError, UnknownFormatError
from quadid_logs.maths.recurrence import lag
from quadid_logs.vocabulary import ON_AXIS
from tests.analyses import Analyzed
from tests.containers import blackbox_maker as maker
from tests.marks import thorough

#: Betaflight's mixer for roll, pitch, yaw sums of its own axes: motors 1 to 4.
MIX = np.array([[-1, 1, 1], [-1, -1, -1], [1, 1, -1], [1, -1, 1]])
DEGREE = math.pi / 180.0


def made(
    tmp_path: Path,
    columns: dict[str, np.ndarray | int],
    given: Mapping[str, str] = maker.SETTINGS,
    **settings: str,
) -> FlightLog:
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
    given = {**given} | {name.replace("__", " "): value for name, value in settings.items()}
    path.write_bytes(maker.log(rows.tolist(), settings=given))
    return read(path)


def values(log: FlightLog, name: str) -> np.ndarray:
    """Return the preferred source's last row."""
    return log.candidates(name)[0].values[-1]


def test_pitch_and_yaw_change_sign_from_forward_left_up(tmp_path: Path) -> None:
    """Nose down and nose left are positive there."""
    log = made(tmp_path, {f"gyroADC[{axis}]": np.full(40, axis + 1) for axis in range(3)})
    np.testing.assert_allclose(values(log, "body_rate"), DEGREE * np.array([1.0, -2.0, -3.0]))


def test_the_id_that_all_simulated_vehicles_have_names_none(tmp_path: Path) -> None:
    """The fleet took four simulated vehicles for one."""
    settings = {
        "Firmware__revision": "Betaflight 2026.12.0-alpha (norevision) SITL",
        "DeviceUID": "0" * 23 + "2",
    }
    assert not made(tmp_path, {"gyroADC[0]": np.full(40, 1)}, **settings).hardware_id


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


def test_before_4_4_terms_were_cut_towards_zero(tmp_path: Path) -> None:
    """Half a unit each; the header does not have the setting that came with rounding."""
    terms = {"axisP[0]": np.full(40, 1), "axisI[0]": np.full(40, -2), "axisD[0]": np.full(40, 3)}
    old = {name: value for name, value in maker.SETTINGS.items() if name != "blackbox_high_resolution"}
    found = values(made(tmp_path, terms, given=old), "torque_command")
    np.testing.assert_allclose(found, [2.5e-3, 0.0, 0.0])


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
    ("revision", "kind", "name"),
    [
        ("INAV 7.1.0 (abc) KAKUTEH7", "INAV", "INAV"),
        ("EmuFlight 0.4.1 (abc) FOXEERF722", "EmuFlight", "EmuFlight"),
        ("Rotorflight 4.3.0 (abc) F7", "Rotorflight", "Rotorflight"),
        ("Cleanflight 2.1.0 (abc) SPF3", "Cleanflight", "Cleanflight"),
        ("f0e8c3a", "Cleanflight", "Cleanflight"),
        ("KISS 1.3-RC50 (abc) FCV2", "KISS", "KISS"),
        ("QuickSilver v0.1", "QuickSilver", "QuickSilver"),
        ("Indiflight 5.0.0 (norevision) STM32H743", "Cleanflight", "Indiflight"),
        ("Butterflight 4.0.0 (abc) F4", "Cleanflight", "Butterflight"),
        ("f0e8c3a", "Baseflight", "Baseflight"),
    ],
)
def test_other_firmware_is_refused_by_its_name(revision: str, kind: str, name: str, tmp_path: Path) -> None:
    """Fields may have other scales, and mixers differ; old ones log the revision of their source alone."""
    names = {"Firmware__revision": revision, "Firmware__type": kind}
    with pytest.raises(UnknownFormatError, match=f"log of {name}, not"):
        made(tmp_path, {"gyroADC[0]": np.zeros(40)}, **names)


def test_an_inverting_controller_is_told_from_a_pid(tmp_path: Path) -> None:
    """Two flown logs of Indiflight have headers with PID gains that it does not use."""
    names = {"Firmware__revision": "Indiflight 5.0.0 (norevision) STM32H743", "Firmware__type": "Cleanflight"}
    with pytest.raises(UnknownFormatError) as error:
        made(tmp_path, {"gyroADC[0]": np.zeros(40)}, **names)
    assert "(INDI)" in error.value.hint
    assert "PID sums" in error.value.hint


def test_a_header_that_ends_before_it_names_its_firmware_may_be_cut_off(tmp_path: Path) -> None:
    """Of a file of 100 bytes it was said that its firmware's scales are others."""
    names = {"Firmware__revision": "", "Firmware__type": ""}
    with pytest.raises(UnknownFormatError, match="names no firmware") as error:
        made(tmp_path, {"gyroADC[0]": np.zeros(40)}, **names)
    assert "cut off" in error.value.hint


PIDS = {"rollPID": "45,80,30", "pitchPID": "47,84,34", "yawPID": "45,80,0"}


@pytest.mark.parametrize(
    ("version", "read_as"),
    [("3.1.3", "read"), ("3.3.1", "nearest"), ("3.4.0", "read"), ("4.0.6", "nearest"),
     ("4.2.8", "nearest"), ("4.3.1", "read"), ("4.4.2", "read"), ("4.5.1", "read"),
     ("2025.12.2", "read"), ("2026.6.1", "read"), ("2026.12.0-alpha", "read")],
)  # fmt: skip
def test_a_version_whose_law_was_read_is_not_called_another(
    version: str, read_as: str, tmp_path: Path
) -> None:
    """Every report of a 4.5 or a 2025.12 said that its source had not been read."""
    log = made(
        tmp_path, {"gyroADC[0]": np.zeros(40)}, Firmware__revision=f"Betaflight {version} (a) F7", **PIDS
    )
    assert controllers(log, log.parameters).version_read == read_as


@pytest.mark.parametrize(
    ("setting", "left"), [("use_integrated_yaw", {"roll", "pitch"}), ("abs_control_gain", set())]
)
def test_a_setting_that_makes_another_law_leaves_its_axes_without_a_controller(
    setting: str, left: set[str], tmp_path: Path
) -> None:
    """Both were in the firmware up to 2026.6 and 2025.12."""
    log = made(tmp_path, {"gyroADC[0]": np.zeros(40)}, **PIDS, **{setting: "1"})
    found = controllers(log, log.parameters)
    assert set(found.axes) == left
    assert {one.kind for one in found.remarks} >= {RemarkKind.NOT_MODELLED}


@pytest.mark.parametrize(
    ("behind", "told"),
    [
        (b"", "disarmed at once"),
        (b"I\0\0", "disarmed at once"),
        (b"\x01\x02" * 4000, "not written as its header"),
    ],
    ids=["nothing", "the beginning of a frame", "other data"],
)
def test_a_log_without_a_frame_is_told_by_what_stands_behind_its_header(
    behind: bytes, told: str, tmp_path: Path
) -> None:
    """ "Disarmed at once, or cut off" was said of 1.6 MB."""
    path = tmp_path / "log.bbl"
    path.write_bytes(maker.header(maker.SETTINGS) + behind)
    with pytest.raises(EmptyLogError) as found:
        read(path)
    assert told in found.value.hint


def test_an_integrated_yaw_sum_is_named_and_no_custom_mixer(tmp_path: Path) -> None:
    """The outputs do not follow the logged sum."""
    log = replace(mixed(MIX * [1, 1, 0]), parameters={"use_integrated_yaw": 1.0})
    found = find_airframe(log)
    assert isinstance(found, Unknown)
    assert "use_integrated_yaw" in found.remark


@pytest.mark.parametrize("name", ["ff_weight", "feedforward_weight"])
def test_feed_forward_has_its_name_of_the_command_line(name: str, tmp_path: Path) -> None:
    """The header called it otherwise before 4.3."""
    log = made(tmp_path, {"gyroADC[0]": np.zeros(40)}, **{name: "120,125,90"})
    assert log.parameters["f_yaw"] == 90.0


@pytest.mark.parametrize("version", ["2,25.12.2", "2021e9", "20-15", "202²", "20\x00\x00À2.1", "9" * 25])
def test_a_damaged_version_costs_only_itself(version: str, tmp_path: Path) -> None:
    """It stays text: by its name the log is Betaflight's."""
    log = made(tmp_path, {"gyroADC[0]": np.zeros(40)}, Firmware__revision=f"Betaflight {version} (abc) F7")
    assert log.candidates("body_rate")


@pytest.mark.parametrize(
    ("kind", "revision"),
    [("Cleanflight", "Betaflight (norevision) SITL"), ("Betaflight", ""), ("", "Betaflight")],
)
def test_betaflight_without_a_version_is_not_refused_as_another_firmware(
    kind: str, revision: str, tmp_path: Path
) -> None:
    """It was "a Blackbox log of Betaflight, not of Betaflight 4.0 or later"."""
    names = {"Firmware__type": kind, "Firmware__revision": revision}
    log = made(tmp_path, {"gyroADC[0]": np.zeros(40)}, **names)
    assert (log.firmware, log.version) == ("Betaflight", None)


def test_other_firmware_is_refused_by_its_name_before_its_fields_are_understood(tmp_path: Path) -> None:
    """They may be written in ways that no frame of ours is; that is no damage."""
    path = tmp_path / "other.bbl"
    settings = maker.SETTINGS | {"Firmware revision": "INAV 7.1.0 (abc) F7"}
    path.write_bytes(maker.header(settings).replace(b"H Field I encoding:1", b"H Field I encoding:99"))
    with pytest.raises(UnknownFormatError, match="log of INAV"):
        read(path)


def mixed(mix: np.ndarray, **settings: float) -> FlightLog:
    """Fly random PID sums (Betaflight's axes) through a mixer of any number of motors."""
    rng = np.random.default_rng(0)
    sums, throttle = rng.integers(-60, 60, (2000, 3)) / 1000.0, rng.integers(300, 500, 2000) / 1000.0
    factor = mix_factor(throttle, {"features": float(1 << 22)} | settings)[:, None]
    outputs = np.rint(1889 * (throttle[:, None] + factor * sums @ mix.T)) / 1889
    rows = Rows(1e-3 * np.arange(2000), np.arange(2000))
    columns = {"torque_command": sums * TO_FRD, "throttle": throttle[:, None], "motor_thrust": outputs}
    return FlightLog(
        path="",
        format="blackbox",
        autopilot="betaflight",
        n_bytes=0,
        signals={
            name: (Signal(name=name, source="main", reason="", rows=rows, values=values),)
            for name, values in columns.items()
        },
    )


@pytest.mark.parametrize("direction", [1, -1])
def test_the_outputs_tell_which_way_the_rotors_turn(direction: int) -> None:
    """No header says yaw_motors_reversed; motor 1, rear right, turns clockwise without it."""
    frame = find_airframe(mixed(MIX * [1, 1, direction]))
    assert isinstance(frame, Airframe)
    np.testing.assert_array_equal(frame.spin, direction * np.array([-1.0, 1.0, 1.0, -1.0]))
    np.testing.assert_allclose(frame.factors[:, :3], MIX * [1, -1, -direction])


def test_a_frame_that_mixes_otherwise_is_not_taken_for_a_quad_x() -> None:
    """Motors in another order."""
    found = find_airframe(mixed(MIX[[1, 0, 2, 3]]))
    assert isinstance(found, Unknown)
    assert "a custom one" in found.remark


def test_axes_that_are_never_commanded_are_named_where_the_frame_stays_unknown() -> None:
    """Gains of zero on a test rig: "too few PID sums" was said of 38 000 rows of them."""
    log = mixed(MIX)
    sums = log.candidates("torque_command")[0]
    alone = replace(sums, values=sums.values * [1.0, 0.0, 0.0])
    found = find_airframe(replace(log, signals={**log.signals, "torque_command": (alone,)}))
    assert isinstance(found, Unknown)
    assert "never commanded pitch and yaw" in found.remark


def test_a_mixer_that_takes_half_of_the_sums_at_low_throttle_is_that_of_its_frame() -> None:
    """Without airmode, at a throttle of next to nothing."""
    log = mixed(MIX)
    sums, motors = (log.candidates(name)[0] for name in ("torque_command", "motor_thrust"))
    halved = motors.values - 0.45 * (sums.values * TO_FRD) @ MIX.T
    frame = find_airframe(
        replace(log, signals={**log.signals, "motor_thrust": (replace(motors, values=halved),)})
    )
    assert isinstance(frame, Airframe)
    assert frame.name == "quad X"


@pytest.mark.parametrize("axis", range(3))
def test_a_collective_that_moves_with_the_sums_does_not_hide_the_frame(axis: int) -> None:
    """Dynamic idle and throttle boost add to all motors what the logged throttle does not hold."""
    log = mixed(MIX)
    sums = log.candidates("torque_command")[0].values
    motors = log.candidates("motor_thrust")[0]
    raised = replace(motors, values=motors.values + 0.5 * sums[:, [axis]])
    frame = find_airframe(replace(log, signals={**log.signals, "motor_thrust": (raised,)}))
    assert isinstance(frame, Airframe)
    assert frame.name == "quad X"


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: frame.name)
@pytest.mark.parametrize("settings", [{}, {"features": 0.0}], ids=["airmode", "without"])
def test_every_frame_of_the_motor_table_is_told_by_its_outputs(frame: Frame, settings: dict) -> None:
    """By name; those whose torque is not in the thrusts are refused by it."""
    found = find_airframe(mixed(frame.mixer * TO_FRD, **settings))
    if frame.unread:
        assert isinstance(found, Unknown)
        assert frame.name in found.remark
    else:
        assert isinstance(found, Airframe)
        assert found.name == frame.name


def test_the_rotors_of_a_frame_turn_it_as_its_mixer_says() -> None:
    """Roll right by thrust on the left, pitch up by thrust in front, nose right by anticlockwise rotors."""
    for frame in FRAMES:
        if not frame.unread:
            lever = np.column_stack([-frame.position[:, 1], frame.position[:, 0], np.sign(frame.mixer[:, 2])])
            assert (
                np.sum(lever * frame.mixer, axis=0) > 0.99 * np.sum(np.abs(lever * frame.mixer), axis=0)
            ).all()
            np.testing.assert_allclose(frame.mixer.sum(axis=0), 0.0, atol=1e-5)


@pytest.mark.parametrize(("n_motors", "name"), [(1, "aeroplane"), (2, "bicopter"), (3, "tricopter")])
def test_a_frame_of_few_motors_is_refused_by_its_name(n_motors: int, name: str) -> None:
    """Servos turn it, which no thrust tells."""
    found = find_airframe(mixed(MIX[:n_motors]))
    assert isinstance(found, Unknown)
    assert name in found.remark


def test_a_build_for_wings_is_no_multirotor(tmp_path: Path) -> None:
    """It logs the S term of its control surfaces."""
    log = made(tmp_path, {"gyroADC[0]": np.zeros(40)})
    assert log.vehicle_type == "multirotor"
    content = Path(log.path).read_bytes()
    Path(log.path).write_bytes(content.replace(b"axisF[0],axisF[1]", b"axisS[0],axisF[1]"))
    assert read(log.path).vehicle_type == "fixed-wing"


def test_a_quad_that_leaves_its_outputs_out_is_known_by_its_rotors(tmp_path: Path) -> None:
    """`tune` said that a vehicle of unknown kind is not tuned here; what it lacked were the fields."""
    log = made(tmp_path, {"gyroADC[0]": np.zeros(40)})
    content = Path(log.path).read_bytes().replace(b"motor[", b"other[")
    Path(log.path).write_bytes(content)
    assert read(log.path).vehicle_type == "unknown"
    Path(log.path).write_bytes(content.replace(b"other[", b"eRPM["))
    assert read(log.path).vehicle_type == "multirotor"


@pytest.mark.parametrize("version", [(4, 5, 1), (2025, 12, 2), (2026, 6), (2026, 12), None])
def test_thrust_linearisation_is_undone(version: tuple[int, ...] | None) -> None:
    """By the formula of the firmware's version, e = 0.4."""
    x = np.linspace(0.0, 1.0, 21)
    output = x * (1.0 + 0.4 * (1.0 - x) ** 2)
    if version is None or version >= (2026, 6):
        output = x * (1.0 + 0.4 * (1.0 - x) * (1.0 + 0.4 * (1.0 - 2.0 * x)))
    np.testing.assert_allclose(before_linearisation(output, 0.4, version), x, atol=1e-5)


SAG = {
    "vbat_sag_compensation": 100.0,
    "vbatref": 1650.0,
    "vbatcellvoltage[1]": 350.0,
    "vbatcellvoltage[2]": 430.0,
}


@pytest.mark.parametrize(
    ("voltage", "expected"), [(17.2, 5 / 6), (16.8, 5 / 6), (15.4, 11 / 12), (13.0, 1.0)]
)
def test_sag_compensation_stops_motors_below_their_highest_output(voltage: float, expected: float) -> None:
    """Four cells: a sixth of the range is kept while they are full, nothing from 3.5 V a cell down."""
    assert highest_output(np.array([voltage]), SAG) == pytest.approx(expected)


@pytest.mark.parametrize("missing", SAG)
def test_without_the_cells_of_the_header_motors_stop_at_their_highest_output(missing: str) -> None:
    """Before 4.3 the header does not hold the compensation."""
    settings = {name: value for name, value in SAG.items() if name != missing}
    assert highest_output(np.array([16.8]), settings) == 1.0


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


@pytest.mark.parametrize(
    ("version", "mode", "is_gyro"),
    [
        thorough("3.3.0", 6, False),
        thorough("3.4.0", 6, True),
        ("4.4.3", 6, True),
        ("4.5.0", 6, False),
        thorough("4.3.1", 7, False),
    ],
)
def test_the_gyro_before_its_filters_is_read_from_the_debug_fields_of_one_mode(
    version: str, mode: int, is_gyro: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GYRO_SCALED, whole degrees per second in logs of tenths too; the number is another mode's since 4.5."""
    fields = (*maker.FIELDS, *((f"debug[{axis}]", 1, 0, 0, 1, 0) for axis in range(4)))
    monkeypatch.setattr(maker, "FIELDS", fields)
    monkeypatch.setattr(maker, "NAMES", tuple(field[0] for field in fields))
    rng = np.random.default_rng(0)
    rate = np.rint(np.convolve(rng.normal(0.0, 300.0, 8000), np.hanning(50), mode="same") / 5.0).astype(int)
    log = made(
        tmp_path,
        {"gyroADC[0]": 10 * rate[:-2], "debug[0]": rate[2:]},
        Firmware__revision=f"Betaflight {version} (abc) F7",
        debug_mode=str(mode),
        blackbox_high_resolution="1",
    )
    raw = [one for one in log.candidates("body_rate") if one.raw]
    assert [one.source for one in raw] == ["main.debug[0..2]"] * is_gyro
    if is_gyro:
        np.testing.assert_allclose(raw[0].values[:, 0], DEGREE * rate[2:], rtol=1e-6)
        assert mean_flown(log).gyro_delay_s == pytest.approx(2e-3, rel=0.05)


def test_low_passes_in_a_row_delay_by_their_sum() -> None:
    """One pole at 250 Hz and one at 500 Hz: 0.64 + 0.32 ms."""
    settings = {"gyro_lpf1_type": 0.0, "gyro_lpf1_static_hz": 250.0, "gyro_lpf2_static_hz": 500.0}
    cutoff_hz = settings_filter(settings, ()).low_pass_hz
    assert math.sqrt(2.0) / (2.0 * math.pi * cutoff_hz) == pytest.approx(1.5 / (2.0 * math.pi * 250.0))


@pytest.mark.parametrize(
    "rotors_hz", [[], [180.0] * 4, [170.0, 172.0, 174.0, 176.0, 178.0, 180.0], [150.0] * 8]
)
def test_the_rpm_filter_has_a_notch_per_motor_and_harmonic(rotors_hz: list[float]) -> None:
    """Q in hundredths, where each rotor turns; a hexa has six."""
    settings = {"rpm_filter_harmonics": 2.0, "rpm_filter_q": 500.0, "rpm_filter_min_hz": 100.0}
    notches = settings_filter(settings, rotors_hz).notches
    assert [notch.frequency_hz for notch in notches] == [*rotors_hz, *(2.0 * one for one in rotors_hz)]
    assert {notch.inverse_q for notch in notches} <= {0.2}


def test_digital_outputs_are_steps_and_others_microseconds() -> None:
    """Idle is in the output: 158 is step 111 of 2000, 1070 us are 7 % of the pulse's range."""
    ends = np.array([0.0, 1.0])
    digital = full_output(
        ends, {"motor_pwm_protocol": 6.0, "motorOutput[0]": 158.0, "motorOutput[1]": 2047.0}
    )
    pulses = full_output(
        ends, {"motor_pwm_protocol": 1.0, "motorOutput[0]": 1070.0, "motorOutput[1]": 2000.0}
    )
    np.testing.assert_allclose([digital, pulses], [[0.0555, 1.0], [0.07, 1.0]])


def rows_of(values: np.ndarray, period_s: float = 1e-3) -> CleanSeries:
    """Return a series of one name or another."""
    return CleanSeries(
        name="",
        rows=Rows(np.zeros(0), np.zeros(0, np.int64)),
        time_s=period_s * np.arange(len(values)),
        stored=values,
        period_s=period_s,
        source="",
        reason="",
    )


class Cleaned:
    """A cleaned log that holds some signals and nothing else."""

    def __init__(self, **signals: np.ndarray) -> None:
        self._signals = {name: rows_of(values) for name, values in signals.items()}

    def first(self, name: str) -> CleanSeries | None:
        """Return the source of a signal."""
        return self._signals.get(name)


@pytest.fixture(scope="module")
def flown() -> tuple[np.ndarray, np.ndarray]:
    """Outputs that move, and speeds of rotors with an expo of 0.7 and 30 ms, on a battery that runs down."""
    rng = np.random.default_rng(0)
    output = 0.35 + 0.05 * np.clip(lag(rng.normal(size=(20_000, 4)), 1e-3, 0.02) * 6.0, -4.0, 4.0)
    speed = lag(np.sqrt(0.3 * output + 0.7 * output**2), 1e-3, 0.03)
    return output, 2000.0 * speed * np.linspace(1.0, 0.9, 20_000)[:, np.newaxis]


def test_measured_speeds_tell_curve_and_lag(flown: tuple[np.ndarray, np.ndarray]) -> None:
    """Whatever the battery takes off meanwhile."""
    output, speed = flown
    found = find_rotors(Cleaned(rotor_speed=speed), rows_of(output), output, np.ones(len(output), bool))
    assert found.measured
    np.testing.assert_allclose([found.expo, found.lag_s], [0.7, 0.03], rtol=0.02)


def test_measured_speeds_bound_the_lag(flown: tuple[np.ndarray, np.ndarray]) -> None:
    """To a few milliseconds; the common lag is no measurement."""
    output, speed = flown
    rows, up = rows_of(output), np.ones(len(output), bool)
    low, high = find_rotors(Cleaned(rotor_speed=speed), rows, output, up).lag_range_s(1e-3)
    assert 0.025 < low < 0.03 < high < 0.035
    assert find_rotors(Cleaned(), rows, output, up).lag_range_s(1e-3) == (0.0, math.inf)


def test_measured_speeds_tell_how_thrust_falls_with_the_battery(flown: tuple[np.ndarray, np.ndarray]) -> None:
    """By a tenth of speed, a fifth of thrust."""
    output, speed = flown
    found = find_rotors(Cleaned(rotor_speed=speed), rows_of(output), output, np.ones(len(output), bool))
    assert found.drift[-2000] / found.drift[2000] == pytest.approx((0.91 / 0.99) ** 2, rel=0.01)


def test_speeds_that_do_not_follow_the_outputs_tell_no_curve(flown: tuple[np.ndarray, np.ndarray]) -> None:
    """As of a battery at its end: the curve of a common propeller is taken."""
    output, speed = flown
    found = find_rotors(Cleaned(rotor_speed=speed[::-1]), rows_of(output), output, np.ones(len(output), bool))
    assert not found.measured
    assert found.expo == COMMON_EXPO


def test_without_speeds_an_output_counts_with_the_voltage(flown: tuple[np.ndarray, np.ndarray]) -> None:
    """Over its mean in flight."""
    output, _ = flown
    voltage = np.linspace(16.0, 14.0, len(output))[:, np.newaxis]
    found = find_rotors(Cleaned(battery_voltage=voltage), rows_of(output), output, np.ones(len(output), bool))
    np.testing.assert_allclose(found.supply, voltage / 15.0)


@pytest.fixture(scope="module", params=["sticks", thorough("chirp")])
def identified(
    request: pytest.FixtureRequest, corpus: Path, analyzed: Analyzed
) -> tuple[Model, dict[str, Any]]:
    """The model of a flight of the firmware, and the truth about it."""
    truth = json.loads((corpus / f"firmware/bf_quad_{request.param}.truth.json").read_text())
    model = analyzed(corpus / f"firmware/bf_quad_{request.param}.bbl").identification.recommended
    assert model is not None
    return model, truth


@pytest.mark.corpus
def test_the_effectiveness_of_the_firmwares_flights_is_as_it_is(identified: tuple[Model, dict]) -> None:
    """Per unit of the PID sums, by least squares over the flight: 2 % of roll and pitch, 4 % of yaw."""
    model, truth = identified
    expected = truth["linear_model"]["B_roll_pitch_yaw_ls_flight"]
    found = [model.entries[on_axis].value for on_axis in ON_AXIS.values()]
    assert (np.abs(np.divide(found, expected) - 1.0) < [0.02, 0.02, 0.04]).all()


@pytest.mark.corpus
def test_the_lag_of_the_firmwares_flights_is_that_of_the_rotors(identified: tuple[Model, dict]) -> None:
    """Within 2 ms, whether or not the speeds are logged."""
    model, truth = identified
    assert model.actuator is not None
    assert abs(model.actuator.lag_s - truth["vehicle"]["motor_lag_s"][0]) < 0.002


@pytest.mark.corpus
def test_the_reaction_of_the_firmwares_rotors_in_yaw_is_as_it_is(identified: tuple[Model, dict]) -> None:
    """Within 15 %."""
    model, truth = identified
    expected = truth["linear_model"]["E_yaw_ls_flight"]
    assert model.entries["r_dot", "N_dot"].value == pytest.approx(expected, rel=0.15)


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
