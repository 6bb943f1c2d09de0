"""What third parties read from our DataFlash logs."""

from __future__ import annotations

import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog, ModeChange, Rows, Signal
from tests.marks import thorough

from .conftest import START_S, flight, px4_flight, series, twice

Write = Callable[[FlightLog, str], Path]
Records = dict[str, list[Any]]

#: Message, fields, canonical signal, unit of the field in SI.
FIELDS = [
    ("RATE", ("R", "P", "Y"), "body_rate", np.pi / 180.0),
    ("RATE", ("RDes", "PDes", "YDes"), "body_rate_setpoint", np.pi / 180.0),
    ("RATE", ("ROut", "POut", "YOut"), "torque_command", 1.0),
    ("RATE", ("AOut",), "throttle", 1.0),
    ("ANG", ("Roll", "Pitch"), "attitude", np.pi / 180.0),
    ("IMU", ("GyrX", "GyrY", "GyrZ"), "body_rate", 1.0),
    ("IMU", ("AccX", "AccY", "AccZ"), "specific_force", 1.0),
    ("MOTB", ("BatVolt",), "battery_ratio", 1.0),
    ("MOTB", ("LiftMax",), "lift_max", 1.0),
    ("BAT", ("Volt",), "battery_voltage", 1.0),
    ("SIDD", ("Targ",), "sysid_chirp", 1.0),
]


_READ: dict[bytes, list[Any]] = {}


def rows(path: Path) -> Records:
    """Read all messages with pymavlink."""
    found: Records = defaultdict(list)
    for message in stream(path):
        found[message.get_type()].append(message)
    return found


def stream(path: Path) -> list[Any]:
    """Read all messages with pymavlink, in the order of the file; the same bytes once."""
    from pymavlink.DFReader import DFReader_binary

    content = path.read_bytes()
    if content not in _READ:
        reader = DFReader_binary(str(path))
        found = _READ[content] = []
        while (message := reader.recv_msg()) is not None:
            found.append(message)
        reader.filehandle.close()
    return _READ[content]


def column(messages: list[Any], *names: str) -> np.ndarray:
    """Return fields as columns."""
    return np.array([[getattr(message, name) for name in names] for message in messages], dtype=float)


@pytest.mark.parametrize(("message", "names", "signal", "unit"), FIELDS)
def test_dfreader_finds_the_series_that_went_in(
    written: Write, message: str, names: tuple[str, ...], signal: str, unit: float
) -> None:
    """Values agree to the resolution of a 4-byte float."""
    log = flight()
    values = log.signals[signal][0].values[:, : len(names)]
    read = column(rows(written(log, "a.bin"))[message], *names) * unit
    np.testing.assert_allclose(read, values, rtol=2e-7, atol=1e-9)


def test_dfreader_finds_the_times_that_went_in(written: Write) -> None:
    """TimeUS is the sample time in microseconds."""
    log = flight()
    read = column(rows(written(log, "a.bin"))["RATE"], "TimeUS")[:, 0]
    np.testing.assert_array_equal(read, np.rint(log.signals["body_rate"][0].time_s * 1e6))


def test_output_pulses_are_whole_microseconds(written: Write) -> None:
    """RCOU holds the rounded pulse widths."""
    log = flight()
    read = column(rows(written(log, "a.bin"))["RCOU"], "C1", "C2", "C3", "C4")
    np.testing.assert_array_equal(read, np.rint(log.signals["output_pwm"][0].values))


def test_rotor_speeds_are_one_instance_per_rotor(written: Write) -> None:
    """ESC.RPM of instance 2 is the third rotor's speed."""
    log = flight()
    esc = [message for message in rows(written(log, "a.bin"))["ESC"] if message.Instance == 2]
    expected = log.signals["rotor_speed"][0].values[:, 2] * 30.0 / np.pi
    np.testing.assert_allclose(column(esc, "RPM")[:, 0], expected, rtol=1e-6)


def test_yaw_is_a_heading_from_0_to_360(written: Write) -> None:
    """A negative yaw appears as in ArduPilot's logs, and is the same angle."""
    log = flight()
    read = column(rows(written(log, "a.bin"))["ANG"], "Yaw")[:, 0]
    assert read.min() >= 0.0
    assert read.max() < 360.0
    wrapped = (np.rad2deg(log.signals["attitude"][0].values[:, 2]) - read + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(wrapped, 0.0, atol=2e-5)


def test_att_is_ten_hertz(written: Write) -> None:
    """ATT is decimated whatever the attitude's rate, as in the firmware."""
    times = column(rows(written(flight(), "a.bin"))["ATT"], "TimeUS")[:, 0]
    assert np.all(np.diff(times) == 100_000)


def test_all_messages_stand_in_order_of_time(written: Write) -> None:
    """A reader that streams the file meets no time that falls."""
    kinds = ("RATE", "IMU", "MOTB", "MODE", "EV", "ESC")
    times = [message.TimeUS for message in stream(written(flight(), "a.bin")) if message.get_type() in kinds]
    assert len(times) > 2400
    assert np.all(np.diff(times) >= 0)


def test_arming_and_landing_are_events(written: Write) -> None:
    """ARM and EV carry the changes of the two states, at their times."""
    found = rows(written(flight(), "a.bin"))
    assert [message.ArmState for message in found["ARM"]] == [1, 0]
    assert [(message.Id, message.TimeUS) for message in found["EV"]] == [
        (10, 13_000_000),
        (28, 13_250_000),
        (18, 15_000_000),
        (11, 15_250_000),
    ]


def test_modes_texts_and_parameters_arrive(written: Write) -> None:
    """MODE has ArduCopter's numbers; MSG the version, the frame and the texts; PARM every parameter."""
    log = flight()
    found = rows(written(log, "a.bin"))
    assert [message.ModeNum for message in found["MODE"]] == [0, 2]
    assert [message.Message for message in found["MSG"]] == [
        "ArduCopter V4.6.1 (abcdef01)",
        "Frame: QUAD/X",
        "Arming motors: élan",
    ]
    read = {message.Name: message.Value for message in found["PARM"]}
    assert read == pytest.approx({"FORMAT_VERSION": 120.0} | dict(log.parameters), rel=1e-7)


def test_more_than_14_outputs_continue_in_the_next_messages(written: Write) -> None:
    """An 18-channel vehicle uses RCOU and RCO2."""
    outputs = series("output_pwm", rate_hz=10.0, n_columns=18, source="RCOU")
    found = rows(written(flight(signals={"output_pwm": (outputs,)}), "a.bin"))
    np.testing.assert_array_equal(
        column(found["RCO2"], "C15", "C16", "C17", "C18"), np.rint(outputs.values[:, 14:])
    )


def test_a_slower_series_holds_its_last_value(written: Write) -> None:
    """Torque at 100 Hz beside rates at 400 Hz repeats in RATE, and is unknown before its first row."""
    log = flight()
    torque = series(
        "torque_command", rate_hz=100.0, n_columns=3, source="RATE.ROut,POut,YOut", start_s=START_S + 0.1
    )
    slow = replace(log, signals={**log.signals, "torque_command": (torque,)})
    read = column(rows(written(slow, "a.bin"))["RATE"], "ROut")[:, 0]
    assert np.isnan(read[:40]).all()
    np.testing.assert_allclose(read[40:], np.repeat(torque.values[:, 0], 4)[: read.size - 40], rtol=2e-7)


def test_an_accelerometer_without_gyro_is_not_an_imu(written: Write) -> None:
    """No gyro value is made up for it."""
    log = flight()
    only = {"specific_force": log.signals["specific_force"]}
    found = rows(written(flight(signals=only), "a.bin"))
    assert not found["IMU"]
    np.testing.assert_allclose(
        column(found["ACC"], "AccX", "AccY", "AccZ"), log.signals["specific_force"][0].values, rtol=2e-7
    )


def test_an_unknown_mode_is_shown_as_unknown(written: Write) -> None:
    """It is not taken for one of ArduCopter's."""
    modes = (
        ModeChange(time_s=START_S, position=0, name="Thermal soaring"),
        ModeChange(time_s=START_S + 1.0, position=1, name="Mode(33)"),
    )
    found = rows(written(flight(modes=modes), "a.bin"))
    assert [message.ModeNum for message in found["MODE"]] == [255, 33]


def test_a_clock_that_starts_again_is_written_as_two_boots(written: Write) -> None:
    """The second boot's rows follow the first one's in all messages, although their times are smaller."""
    found = rows(written(twice(flight()), "a.bin"))
    for name in ("RATE", "IMU", "MOTB", "ESC"):
        times = column(found[name], "TimeUS")[:, 0]
        assert np.count_nonzero(np.diff(times) < 0) == 1
    boots = [message.TimeUS for message in found["MODE"]]
    assert boots == [12_500_000, 13_500_000, 12_500_000, 13_500_000]


def test_a_mode_without_a_place_is_put_where_its_time_first_fits(written: Write) -> None:
    """It shows no reset itself; a time beyond the first boot's end belongs to a later one."""
    both = twice(flight())
    late = (
        ModeChange(time_s=START_S + 0.5, position=0, name="LOITER"),
        ModeChange(time_s=START_S + 5.0, position=0, name="LAND"),
    )
    with_resets = Signal(
        name="attitude",
        rows=Rows(
            np.concatenate((START_S + np.arange(2000) / 1000.0, START_S + np.arange(6000) / 1000.0)),
            np.arange(8000),
        ),
        values=np.zeros((8000, 3)),
        source="ANG",
    )
    log = replace(both, signals={"attitude": (with_resets,)}, modes=late, texts=())
    path = written(log, "a.bin")
    place = [message.TimeUS for message in stream(path) if message.get_type() in ("ANG", "MODE")]
    assert place[500:502] == [13_000_000, 13_000_000]
    assert place.count(17_500_000) == 2
    assert np.count_nonzero(np.diff(place) < 0) == 1


def test_a_px4_flight_is_a_valid_dataflash_log_too(written: Write) -> None:
    """What ArduPilot has a message for is there, under ArduPilot's names."""
    found = rows(written(px4_flight(), "a.bin"))
    assert len(found["RATE"]) == 1200
    assert found["MSG"][0].Message.startswith("ArduCopter V4")


@pytest.mark.parametrize("make", [flight, thorough(px4_flight)])
def test_mavlogdump_has_no_complaint(written: Write, make: Callable[[], FlightLog]) -> None:
    """The tool prints every message and nothing on stderr."""
    path = written(make(), "a.bin")
    tool = Path(sys.executable).with_name("mavlogdump.py")
    done = subprocess.run([sys.executable, str(tool), str(path)], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.count(" RATE {") == 1200


def test_definitions_equal_the_firmware_s(written: Write, corpus: Path) -> None:
    """Fields, formats, units and multipliers are those of ArduCopter 4.7."""
    from pymavlink.DFReader import DFReader_binary

    ours, theirs = (
        DFReader_binary(str(path))
        for path in (written(flight(), "a.bin"), corpus / "firmware" / "ac47_quadx_sid_roll.BIN")
    )
    firmware = {found.name: found for found in theirs.formats.values()}
    for found in ours.formats.values():
        other = firmware[found.name]
        assert (found.len, found.format, found.columns) == (other.len, other.format, other.columns)
        assert found.units == other.units
        assert found.msg_mults == other.msg_mults
    ours.filehandle.close()
    theirs.filehandle.close()


def test_the_gyro_beside_a_chirp_is_in_degrees(written: Write) -> None:
    """SIDD's G is the IMU's last rate, which IMU itself holds in rad/s."""
    found = rows(written(flight(), "a.bin"))
    imu_us, imu = column(found["IMU"], "TimeUS")[:, 0], column(found["IMU"], "GyrX", "GyrY", "GyrZ")
    sidd_us, gyro = column(found["SIDD"], "TimeUS")[:, 0], column(found["SIDD"], "Gx", "Gy", "Gz")
    held = imu[np.searchsorted(imu_us, sidd_us, side="right") - 1]
    np.testing.assert_allclose(gyro, np.degrees(held), rtol=1e-5, atol=1e-6)
