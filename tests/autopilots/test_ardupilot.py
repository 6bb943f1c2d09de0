"""Canonical signals of ArduPilot logs: sources, units, signs, and what flew."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.autopilots.ardupilot.identity import identify_vehicle, mode_name
from quadid_logs.autopilots.ardupilot.log import flight_log, read_binary, read_text
from quadid_logs.containers import dataflash
from quadid_logs.data.log import FlightLog
from tests.containers.dataflash_files import EV, FMT_OF_FMT, STRUCTS, fmt, row


def log_of(tmp_path: Path, *parts: bytes) -> FlightLog:
    """Read a file made of these messages."""
    path = tmp_path / "flight.bin"
    path.write_bytes(FMT_OF_FMT + b"".join(parts))
    return read_binary(path)


def corpus_flight(corpus: Path, name: str) -> FlightLog:
    """Read a corpus log, binary or text."""
    return (read_text if name.endswith(".log") else read_binary)(corpus / name)


def sources(log: FlightLog, name: str) -> list[str]:
    """Return the sources of a signal in order."""
    return [signal.source for signal in log.candidates(name)]


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "vehicle_type", "frame"),
    [
        ("real/ac30-quadV-underpowered.log", "multirotor", "quad V"),
        ("real/ac301-octo-apm2-MOT.log", "multirotor", "eight-motor X"),
        ("real/ac313-y6b-331s.bin", "multirotor", "Y6B"),
        ("real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin", "multirotor", "quad X"),
        ("real/ac41-quadplus-mission-113s.bin", "multirotor", "quad plus"),
        ("real/ac457-quadx-noATT-noRATE-50s.bin", "multirotor", "quad X"),
        ("real/plane423-fastlog-real.bin", "fixed-wing", ""),
        ("real/rover246-real-61.bin", "rover", ""),
    ],
)
def test_vehicle_and_frame_are_told(corpus: Path, name: str, vehicle_type: str, frame: str) -> None:
    """Messages, VER and parameters of all ages of firmware say what flew."""
    log = corpus_flight(corpus, name)
    assert (log.vehicle_type, log.frame, log.autopilot) == (vehicle_type, frame, "ardupilot")


@pytest.mark.corpus
@pytest.mark.parametrize(
    "name",
    [
        "firmware/ac47_quadx_doublets.BIN",
        "real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin",
        "real/ac34rc2-erlebrain3-quadx-265s.bin",
    ],
)
def test_rate_has_the_gyro_s_scale_and_signs(corpus: Path, name: str) -> None:
    """Degrees per second today and hundredths of them in 2015 both become rad/s."""
    log = corpus_flight(corpus, name)
    rate, gyro = log.candidates("body_rate")[:2]
    assert rate.source.startswith("RATE")
    reference = np.column_stack([np.interp(rate.time_s, gyro.time_s, column) for column in gyro.values.T])
    slope = np.sum(rate.values * reference, axis=0) / np.sum(reference**2, axis=0)
    np.testing.assert_allclose(slope, 1.0, atol=0.1)


@pytest.mark.corpus
def test_pid_rates_agree_with_the_gyro_where_rate_is_missing(corpus: Path) -> None:
    """PID*.Act is in rad/s."""
    log = corpus_flight(corpus, "real/ac457-quadx-noATT-noRATE-50s.bin")
    gyro, actual = log.candidates("body_rate")[0], log.candidates("body_rate")[-1]
    assert actual.source == "PIDR PIDP PIDY Act"
    np.testing.assert_allclose(actual.values.std(axis=0), gyro.values.std(axis=0), rtol=0.1)


@pytest.mark.corpus
def test_the_rebuilt_torque_command_equals_the_logged_one(corpus: Path) -> None:
    """On a log that has both, the sum of the PID terms is RATE.*Out to single precision."""
    path = corpus / "firmware/ac47_quadx_multisine.BIN"
    tables = dataflash.read_messages(path, {"RATE", "PIDR", "PIDY"})
    for pid, label in (("PIDR", "ROut"), ("PIDY", "YOut")):
        terms = [tables[pid].columns[name].astype(float) for name in ("P", "I", "D", "FF", "DFF")]
        np.testing.assert_allclose(np.sum(terms, axis=0), tables["RATE"].columns[label], atol=2e-7)


@pytest.mark.corpus
def test_a_log_without_rate_gets_a_rebuilt_torque_command_that_says_so(corpus: Path) -> None:
    """The reason names the rebuilding."""
    (signal,) = corpus_flight(corpus, "real/ac457-quadx-noATT-noRATE-50s.bin").candidates("torque_command")
    assert "sum of the PID terms" in signal.reason
    assert 0.05 < signal.values[:, 0].std() < 1.0


@pytest.mark.corpus
def test_old_torque_commands_are_brought_to_the_scale_of_one(corpus: Path) -> None:
    """Before 3.4 the full scale was 4500; values clipped at 5000 become 1.11."""
    log = corpus_flight(corpus, "real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin")
    (signal,) = log.candidates("torque_command")
    assert np.abs(signal.values).max() == pytest.approx(5000 / 4500)
    assert "4500" in signal.reason


@pytest.mark.corpus
def test_the_chirp_of_a_system_id_run_is_found(corpus: Path) -> None:
    """SIDD gives the chirp and unfiltered rates in rad/s."""
    log = corpus_flight(corpus, "firmware/ac47_quadx_sid_roll.BIN")
    assert log.candidates("sysid_chirp")[0].n_samples == 30_006
    rate, sidd = log.candidates("body_rate")[0], log.candidates("body_rate")[-1]
    slow = sidd.time_s < sidd.time_s[0] + 30.0  # later, the gyro filter delays RATE visibly
    roll = sidd.values[slow, 0]
    reference = np.interp(sidd.time_s[slow], rate.time_s, rate.values[:, 0])
    assert np.corrcoef(reference, roll)[0, 1] > 0.99
    assert roll.std() == pytest.approx(reference.std(), rel=0.05)


@pytest.mark.corpus
def test_rotor_speed_is_given_only_where_it_is_measured(corpus: Path) -> None:
    """RPM that is always zero is no measurement; real telemetry is in rad/s, one column per ESC."""
    moving = corpus_flight(corpus, "firmware/ac47_quadx_esc_rpm.BIN").candidates("rotor_speed")[0]
    assert moving.values.shape == (5000, 4)
    assert moving.values.max() == pytest.approx(11_445 * np.pi / 30, rel=1e-6)
    assert not corpus_flight(corpus, "firmware/ac47_quadx_multisine.BIN").candidates("rotor_speed")


@pytest.mark.corpus
def test_instances_with_the_same_stamp_are_not_mixed(corpus: Path) -> None:
    """Two IMUs share each time stamp; each becomes a source with rising times."""
    log = corpus_flight(corpus, "firmware/ac47_quadx_doublets.BIN")
    first, second = [s for s in log.candidates("body_rate") if s.source.startswith("IMU")]
    assert (first.source[:6], second.source[:6]) == ("IMU[0]", "IMU[1]")
    assert np.all(np.diff(first.time_s) > 0)
    np.testing.assert_array_equal(first.time_s, second.time_s)


@pytest.mark.corpus
def test_the_accelerometer_points_up_at_rest(corpus: Path) -> None:
    """In FRD axes a level vehicle feels -9.8 m/s^2 on z."""
    signal = corpus_flight(corpus, "firmware/ac47_quadx_doublets.BIN").candidates("specific_force")[0]
    assert signal.values[:, 2].mean() == pytest.approx(-9.8, abs=0.1)


@pytest.mark.corpus
def test_flights_are_marked_by_arming(corpus: Path) -> None:
    """Two flights in one file give two armed intervals; ARM and EV both report each change."""
    armed = corpus_flight(corpus, "firmware/ac47_two_flights.BIN").candidates("armed")[0]
    assert armed.values[:, 0].tolist() == [1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]
    np.testing.assert_allclose(armed.time_s[::2], [42.077, 132.757, 143.097, 228.402], atol=1e-3)


@pytest.mark.corpus
def test_dropped_messages_are_counted(corpus: Path) -> None:
    """The logger's own count is passed on."""
    assert corpus_flight(corpus, "firmware/ac47_two_flights.BIN").n_dropped == 6259


@pytest.mark.corpus
def test_a_log_without_times_says_so(corpus: Path) -> None:
    """Firmware 3.0 logged no time; its 48 rows of PM say that it ran for eight minutes."""
    log = corpus_flight(corpus, "real/ac30-quadV-underpowered.log")
    assert not log.has_time
    assert log.is_nominal_time
    time_s = log.candidates("attitude")[0].time_s
    assert (np.diff(time_s) >= 0.0).all()
    assert 470.0 < time_s[-1] < 490.0
    assert any("no time" in remark for remark in log.remarks)


def test_rows_without_time_count_ten_a_second_between_the_monitors_ten_seconds(tmp_path: Path) -> None:
    """Three seconds before the first row of PM, ten behind it, ten without any, four at the end."""
    control, monitor = "CTUN, 500, 0.1, 0.2, 0, 0, 0, 0, 500, 0", "PM, 0, 0, 0, 0, 1000, 10480, 0, 0"
    rows = [*[control] * 30, monitor, *[control] * 100, monitor, monitor, *[control] * 40]
    path = tmp_path / "old.log"
    path.write_text(
        "ArduCopter V3.0.1\nFMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\n"
        "FMT, 4, 25, CTUN, hcefhhhhh, ThrIn,SonAlt,BarAlt,WPAlt,NavThr,AngBst,CRate,ThrOut,DCRate\n"
        "FMT, 6, 17, PM, BBBHHIhB, RenCnt,RenBlw,FixCnt,NLon,NLoop,MaxT,PMT,I2CErr\n" + "\n".join(rows) + "\n"
    )
    log = read_text(path)
    assert not log.has_time
    time_s = log.candidates("throttle")[0].time_s
    np.testing.assert_allclose(time_s[[0, 29, 30, 129, 130, 169]], [7.0, 9.9, 10.0, 19.9, 30.0, 33.9])


@pytest.mark.corpus
def test_events_without_a_time_take_that_of_their_place(corpus: Path) -> None:
    """EV and MODE of firmware 3.1 have no time column, but stand between rows that have."""
    log = corpus_flight(corpus, "real/ac313-y6b-331s.bin")
    times = [mode.time_s for mode in log.modes]
    assert times == sorted(times)
    assert 312.0 < times[0] < times[-1] < 646.0


@pytest.mark.corpus
def test_the_nominal_rate_is_what_the_bitmask_promises(corpus: Path) -> None:
    """10 Hz with the default bitmask, the loop rate with ATTITUDE_FAST."""
    slow = corpus_flight(corpus, "real/ac364-quadx-RATE1Hz-700s.bin").candidates("body_rate")[0]
    fast = corpus_flight(corpus, "firmware/ac47_quadx_multisine.BIN").candidates("body_rate")[0]
    assert (slow.nominal_rate_hz, fast.nominal_rate_hz) == (10.0, 400.0)


@pytest.mark.corpus
def test_the_air_density_is_that_of_the_field(corpus: Path) -> None:
    """The simulated field lies at 584 m: 0.94 in the standard atmosphere, 0.89 in the warm air there."""
    found = corpus_flight(corpus, "firmware/ac47_quadx_doublets.BIN").candidates("air_density_ratio")
    assert [signal.source for signal in found] == ["BARO.AltAMSL", "BARO.Press GndTemp Alt"]
    medians = [float(np.median(signal.values)) for signal in found]
    np.testing.assert_allclose(medians, [0.943, 0.889], atol=0.005)


def test_angles_become_radians_within_half_a_turn(tmp_path: Path) -> None:
    """A yaw of 350 degrees is -10 degrees."""
    log = log_of(
        tmp_path, fmt(1, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw"), row(1, "QccC", 1000, 9000, -4500, 35000)
    )
    np.testing.assert_allclose(np.degrees(log.candidates("attitude")[0].values), [[90.0, -45.0, -10.0]])


def test_implausible_stamps_and_nan_pass_untouched(tmp_path: Path) -> None:
    """Judging them is not the reader's task."""
    definition = fmt(1, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw")
    stamps = [5_000_000, 4_200_000_000_000_000_000, 0, 5_002_500]
    log = log_of(tmp_path, definition, *(row(1, "Qfff", t, float("nan"), 0.0, 0.0) for t in stamps))
    attitude = log.candidates("attitude")[0]
    assert attitude.time_s.tolist() == [5.0, 4.2e12, 0.0, 5.0025]
    assert np.isnan(attitude.values[:, 0]).all()


def test_a_state_holds_nothing_but_its_events(tmp_path: Path) -> None:
    """What was before the first event is not made up."""
    events = [row(EV, "QB", 1_000_000 * number, number) for number in (10, 28, 15, 18, 11)]
    log = log_of(tmp_path, fmt(EV, "EV", "QB", "TimeUS,Id"), *events)
    armed, landed = log.candidates("armed")[0], log.candidates("landed")[0]
    assert (armed.time_s.tolist(), armed.values[:, 0].tolist()) == ([10.0, 11.0], [1.0, 0.0])
    assert (landed.time_s.tolist(), landed.values[:, 0].tolist()) == ([28.0, 18.0], [0.0, 1.0])


def test_the_primary_ekf_core_comes_first(tmp_path: Path) -> None:
    """XKF4.PI names it."""
    angles = [row(1, "QBccC", 1000, core, 0, 0, 100 * core) for core in (0, 1)]
    log = log_of(
        tmp_path,
        fmt(1, "XKF1", "QBccC", "TimeUS,C,Roll,Pitch,Yaw"),
        fmt(2, "XKF4", "QBb", "TimeUS,C,PI"),
        *angles,
        row(2, "QBb", 1000, 0, 1),
        row(2, "QBb", 1000, 1, 1),
    )
    assert sources(log, "attitude") == ["XKF1[1].Roll Pitch Yaw", "XKF1[0].Roll Pitch Yaw"]


def test_only_rates_from_behind_the_filters_carry_them(tmp_path: Path) -> None:
    """GYR holds raw samples: what RATE and IMU passed, they did not."""
    axes = "Qfff"
    log = log_of(
        tmp_path,
        fmt(1, "PARM", "QNf", "TimeUS,Name,Value"),
        fmt(2, "RATE", axes, "TimeUS,R,P,Y"),
        fmt(3, "IMU", axes, "TimeUS,GyrX,GyrY,GyrZ"),
        fmt(4, "GYR", axes, "TimeUS,GyrX,GyrY,GyrZ"),
        row(1, "QNf", 1, b"INS_GYRO_FILTER", 40.0),
        *(row(kind, axes, 2, 0.1, 0.2, 0.3) for kind in (2, 3, 4)),
    )
    found = {signal.source[:4]: signal.gyro_filter.low_pass_hz for signal in log.candidates("body_rate")}
    np.testing.assert_equal(found, {"RATE": 40.0, "IMU.": 40.0, "GYR.": np.nan})


def test_the_last_value_of_a_parameter_wins(tmp_path: Path) -> None:
    """A parameter changed in flight is logged again."""
    log = log_of(
        tmp_path,
        fmt(1, "PARM", "QNf", "TimeUS,Name,Value"),
        row(1, "QNf", 1, b"MOT_THST_EXPO", 0.5),
        row(1, "QNf", 2, b"MOT_THST_EXPO", 0.75),
    )
    assert log.parameters == {"MOT_THST_EXPO": 0.75}


def test_pid_rows_of_different_loops_are_not_summed_together(tmp_path: Path) -> None:
    """A loop of which one row was dropped gives no torque command."""
    names = ("PIDR", "PIDP", "PIDY")
    definitions = [fmt(k, name, "Qfff", "TimeUS,P,I,D") for k, name in enumerate(names, 1)]
    rows = [
        row(k, "Qfff", 2500 * loop, float(loop), 0.0, float(k))
        for loop in range(4)
        for k in (1, 2, 3)
        if (loop, k) != (2, 2)
    ]
    (signal,) = log_of(tmp_path, *definitions, *rows).candidates("torque_command")
    assert signal.values.tolist() == [[1.0, 2.0, 3.0], [2.0, 3.0, 4.0], [4.0, 5.0, 6.0]]


def test_a_battery_in_hundredths_of_a_volt_is_recognised(tmp_path: Path) -> None:
    """Firmware before 3.4 logged integers."""
    log = log_of(tmp_path, fmt(1, "CURR", "IhH", "TimeMS,Volt,Vcc"), row(1, "IhH", 5, 1644, 5000))
    assert log.candidates("battery_voltage")[0].values.tolist() == [[16.44]]


@pytest.mark.parametrize(
    ("texts", "parameters", "build", "expected"),
    [
        (["ArduCopter V4.5.7 (2a3dc4b7)"], {"FRAME_CLASS": 1, "FRAME_TYPE": 1}, 2, ("multirotor", "quad X")),
        (["ArduCopter V4.5.7"], {"FRAME_CLASS": 2, "FRAME_TYPE": 0}, None, ("multirotor", "hexa plus")),
        (["ArduCopter V4.5.7"], {"FRAME_CLASS": 5, "FRAME_TYPE": 10}, None, ("multirotor", "Y6B")),
        (["ArduCopter V4.5.7"], {"FRAME_CLASS": 6}, None, ("helicopter", "helicopter")),
        (["ArduCopter V3.2", "Frame: HELI"], {"H_COL_MAX": 1}, None, ("helicopter", "heli")),
        (["ArduCopter V4.5.7"], {"FRAME_CLASS": 10}, None, ("unknown", "bicopter")),
        (["ArduPlane V4.2.3"], {"Q_ENABLE": 0}, None, ("fixed-wing", "")),
        (
            ["ArduPlane V4.2.3"],
            {"Q_ENABLE": 1, "Q_FRAME_CLASS": 1, "Q_FRAME_TYPE": 3},
            3,
            ("vtol", "quad H"),
        ),
        (["ArduRover V4.2.3"], {"FRAME_CLASS": 2}, None, ("boat", "")),
        ([], {"SYSID_SW_TYPE": 20}, None, ("rover", "")),
        ([], {}, 7, ("submarine", "")),
        (["hello"], {"FRAME_CLASS": float("nan")}, None, ("unknown", "")),
    ],
)
def test_what_flew_is_told_from_texts_and_parameters(
    texts: list[str], parameters: dict[str, float], build: int | None, expected: tuple[str, str]
) -> None:
    """Helicopters, QuadPlanes and boats have the firmware of others."""
    found = identify_vehicle(texts, parameters, build_type=build, n_motors=0)
    assert (found.vehicle_type, found.frame) == expected


def test_a_throttle_in_per_mille_beside_the_torque_is_brought_to_one(corpus: Path) -> None:
    """RATE.AOut of 3.4-dev: a throttle of 475 made rotors of infinite speed."""
    log = read_binary(corpus / "real" / "ac34dev-erlebrain2-RATE50Hz-138s.bin")
    throttle = next(one for one in log.candidates("throttle") if one.source == "RATE.AOut")
    assert 0.3 < np.nanmedian(throttle.values) < 0.6


def test_modes_have_the_names_of_their_vehicle() -> None:
    """Other vehicles number their modes differently."""
    assert mode_name(25, "multirotor") == "SYSTEMID"
    assert mode_name(25, "rover") == "mode 25"
    assert mode_name(11, "fixed-wing") == "RTL"
    assert mode_name(19, "submarine") == "MANUAL"
    assert mode_name("Stabilize", "multirotor") == "STABILIZE"
    assert mode_name("5", "multirotor") == "LOITER"


MESSAGES = {
    "RATE": "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,AOut",
    "IMU": "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ",
    "ATT": "TimeUS,Roll,Pitch,Yaw",
    "XKF1": "TimeUS,C,Roll,Pitch,Yaw",
    "XKF4": "TimeUS,C,PI",
    "RCOU": "TimeUS,C1,C2,C3",
    "ESC": "TimeUS,Instance,RPM",
    "BARO": "TimeUS,I,Alt,Press,GndTemp",
    "EV": "TimeUS,Id",
    "ARM": "TimeUS,ArmState",
    "MODE": "TimeUS,Mode,ModeNum",
    "PARM": "TimeUS,Name,Value",
    "MSG": "TimeUS,Message",
    "VER": "TimeUS,BU,FWS",
    "DSF": "TimeUS,Dp",
    "FMTU": "TimeUS,FmtType,UnitIds,MultIds",
    "UNIT": "TimeUS,Id,Label",
    "MULT": "TimeUS,Id,Mult",
}


@pytest.mark.thorough
@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_definitions_that_lie_about_their_columns_never_crash_the_reader(data: st.DataObject) -> None:
    """Any column may turn out as text, array, NaN or a number out of all range."""
    parts = [FMT_OF_FMT, fmt(200, "SIM", "Qf", "TimeUS,x"), row(200, "Qf", 1, 0.0)]
    chosen = data.draw(st.lists(st.sampled_from(sorted(MESSAGES)), min_size=1, max_size=6, unique=True))
    for type_id, name in enumerate(chosen, 1):
        n_columns = MESSAGES[name].count(",") + 1
        format_ = data.draw(st.text(st.sampled_from(sorted(STRUCTS)), min_size=1, max_size=n_columns))
        size = struct.calcsize("<" + "".join(STRUCTS[kind] for kind in format_))
        if size > 252:
            continue
        parts.append(fmt(type_id, name, format_, MESSAGES[name]))
        payloads = data.draw(st.lists(st.binary(min_size=size, max_size=size), min_size=1, max_size=3))
        parts.extend(bytes([0xA3, 0x95, type_id]) + payload for payload in payloads)
    log = flight_log(dataflash.DataFlashFile.from_bytes(b"".join(parts)), log_format="dataflash")
    assert log.autopilot == "ardupilot"
