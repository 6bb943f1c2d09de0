"""MAVLink logs: what is read equals pymavlink, and damage costs no more than itself."""

from __future__ import annotations

import contextlib
import struct
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from quadid_logs.autopilots.generic.mavlink import read
from quadid_logs.containers import mavlink_frames, tlog
from quadid_logs.containers.mavlink_frames import crc_of_columns, is_right
from quadid_logs.errors import EmptyLogError, LogError, SettingsError
from quadid_logs.load import read_log
from quadid_logs.writers.mavlink_packets import Messages, packet
from tests.marks import thorough_but

from . import mavlink_maker as make

INTACT = [
    "firmware/ac47_quadx_doublets.tlog",
    "firmware/ac47_quadx_multisine.tlog",
    "real/ac32dev-quad-handrotated-52s.tlog",
]
DAMAGED = "damaged/sitl-flightlogs-bad-packets-4MB.tlog"
#: Of longer logs the reference reader, which takes a second per megabyte, sees the beginning only: it holds
#: every type of message that the logs hold, and all damage but two bytes.
_MOST_BYTES = 1_000_000


def reference_messages(path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, list]:
    """Return pymavlink's messages by type."""
    monkeypatch.setenv("MAVLINK20", "1")
    from pymavlink import mavutil

    connection = mavutil.mavlink_connection(str(path), dialect="all")
    found = defaultdict(list)
    while (message := connection.recv_msg()) is not None:
        found[message.get_type()].append(message)
    connection.close()
    return found


def beginning(log: Path, folder: Path) -> Path:
    """Return a log of no more than the first bytes of another."""
    path = folder / log.name
    with log.open("rb") as file:
        path.write_bytes(file.read(_MOST_BYTES))
    return path


def plain(value: object) -> object:
    """Return a field as pymavlink shows it: texts end at the first zero byte."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, bytes):
        return value.split(b"\0", 1)[0].decode("utf-8", errors="replace")
    return value.item() if isinstance(value, np.generic) else value


def write(folder: Path, content: bytes) -> Path:
    """Write a log under a name that says nothing."""
    path = folder / "flight"
    path.write_bytes(content)
    return path


def rolls(path: Path) -> list[float]:
    """Return the roll rates, which number the attitude messages."""
    messages = tlog.read_messages(path, {"ATTITUDE"})
    return messages["ATTITUDE"].rows["rollspeed"].tolist() if messages else []


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", thorough_but(INTACT[:1], INTACT), indirect=True)
def test_every_field_of_every_message_equals_pymavlink(
    corpus_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On intact logs no value of any message differs from the reference reader's."""
    path = beginning(corpus_log, tmp_path)
    ours = tlog.read_messages(path)
    reference = reference_messages(path, monkeypatch)
    assert set(ours) == set(reference)
    for name, messages in reference.items():
        rows = ours[name].rows
        assert len(rows) == len(messages)
        assert ours[name].system_id.tolist() == [message.get_srcSystem() for message in messages]
        for field in rows.dtype.names:
            expected = [getattr(message, field) for message in messages]
            column = rows[field]
            if column.dtype.kind in "iuf":
                np.testing.assert_array_equal(
                    column, np.array(expected, dtype=column.dtype), err_msg=f"{name}.{field}"
                )
            else:
                assert [plain(value) for value in column] == expected, f"{name}.{field}"


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", INTACT, indirect=True)
def test_an_intact_log_has_no_lost_bytes(corpus_log: Path) -> None:
    """Nothing is called lost where nothing is damaged."""
    assert read_log(corpus_log).lost == ()


@pytest.mark.thorough
@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", [DAMAGED], indirect=True)
def test_at_least_as_many_messages_are_kept_as_by_pymavlink(
    corpus_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the damaged log no type has fewer messages than the reference reader's."""
    path = beginning(corpus_log, tmp_path)
    ours = tlog.read_messages(path)
    for name, messages in reference_messages(path, monkeypatch).items():
        if name != "BAD_DATA" and not name.startswith("UNKNOWN"):
            assert len(ours[name].rows) >= len(messages), name
    assert read_log(corpus_log).lost


@given(st.binary(min_size=6, max_size=280), st.integers(0, 255))
def test_a_single_checksum_is_pymavlinks(covered: bytes, extra: int) -> None:
    """The one that pymavlink computes is right, and any other is not."""
    from pymavlink.generator.mavcrc import x25crc

    checksum = x25crc([*covered, extra]).crc
    assert is_right(covered, extra, checksum.to_bytes(2, "little"))
    assert not is_right(covered, extra, (checksum ^ 0x0100).to_bytes(2, "little"))


@given(st.lists(st.binary(min_size=2, max_size=40), min_size=1, max_size=5))
def test_many_checksums_at_once_are_pymavlinks(messages: list[bytes]) -> None:
    """Messages of different lengths, aligned at their ends, each get what pymavlink computes byte by byte."""
    from pymavlink.generator.mavcrc import x25crc

    messages = sorted((message * 2 for message in messages), key=len)
    n_steps = len(messages[-1]) // 2
    words = np.full((n_steps, len(messages)), 0xDEAD, "<u2")  # what is not filled in must not count
    for column, message in enumerate(messages):
        own = np.frombuffer(message, "<u2").copy()
        own[0] ^= 0xFFFF
        words[n_steps - len(own) :, column] = own
    lengths = np.array([len(message) // 2 for message in messages])
    begun = np.searchsorted(lengths, np.arange(n_steps, 0, -1))
    assert crc_of_columns(words, begun).tolist() == [x25crc(message).crc for message in messages]


@pytest.mark.parametrize("version", [1, 2])
def test_both_versions_are_read(version: int, tmp_path: Path) -> None:
    """MAVLink 1 and 2 packets give the same rows."""
    sender = make.Sender(version=version)
    content = b"".join(sender.attitude(k) for k in range(5))
    assert rolls(write(tmp_path, content)) == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_signed_packets_are_read(tmp_path: Path) -> None:
    """The 13 bytes of a signature are stepped over."""
    sender = make.Sender(key=b"k" * 32)
    path = write(tmp_path, b"".join(sender.attitude(k) for k in range(5)))
    assert rolls(path) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert read_log(path).lost == ()


def test_truncated_payloads_are_filled_up_with_zeros(tmp_path: Path) -> None:
    """MAVLink 2 leaves out zeros at the end of a payload."""
    sender = make.Sender()
    content = sender.stamped("ATTITUDE", time_boot_ms=5) + sender.attitude(3)
    rows = tlog.read_messages(write(tmp_path, content))["ATTITUDE"].rows
    assert rows["time_boot_ms"].tolist() == [5, 1030]
    assert rows["yawspeed"].tolist() == [0.0, -1.0]


def test_a_bare_stream_without_host_stamps_is_read(tmp_path: Path) -> None:
    """Packets that follow each other directly are a MAVLink log too."""
    sender = make.Sender()
    packets = [sender.packet("ATTITUDE", time_boot_ms=1000 + k, rollspeed=float(k)) for k in range(9)]
    log = read_log(write(tmp_path, b"".join(packets)))
    assert log.lost == ()
    assert log.candidates("body_rate")[0].values[:, 0].tolist() == list(range(9))


def test_packets_of_unknown_type_are_stepped_over_and_counted(tmp_path: Path) -> None:
    """A type that no dialect has costs nothing."""
    sender = make.Sender()
    unknown = struct.pack(">Q", 1) + bytes([0xFD, 3, 0, 0, 7, 1, 1, 0xF0, 0xFF, 0xEF, 1, 2, 3, 9, 9])
    log = read_log(write(tmp_path, sender.attitude(0) + unknown + sender.attitude(1)))
    assert log.lost == ()
    assert any("1 packets are of a type" in remark for remark in log.remarks)


def test_a_wrong_checksum_costs_that_packet_only(tmp_path: Path) -> None:
    """A flipped bit in a payload is noticed, and said."""
    sender = make.Sender()
    packets = [bytearray(sender.attitude(k)) for k in range(5)]
    packets[2][25] ^= 1
    path = write(tmp_path, b"".join(packets))
    assert rolls(path) == [0.0, 1.0, 3.0, 4.0]
    (lost,) = read_log(path).lost
    assert (lost.offset, lost.n_bytes) == (sum(map(len, packets[:2])), len(packets[2]))
    assert lost.reason == "wrong checksum"


def test_a_truncation_costs_only_the_packet_that_is_cut(tmp_path: Path) -> None:
    """Cut at every byte, all packets before the cut are read, and no other."""
    sender = make.Sender()
    packets = [sender.attitude(k + 1) for k in range(4)]
    content = b"".join(packets)
    ends = np.cumsum([len(packet) for packet in packets])
    for cut in range(1, len(content) + 1):
        whole = int((ends <= cut).sum())
        assert rolls(write(tmp_path, content[:cut])) == [float(k + 1) for k in range(whole)]


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_garbage_costs_no_more_than_the_damage_and_four_packets(data: st.DataObject, tmp_path: Path) -> None:
    """Bytes put in or over lose at most their number over the packet size, plus 4; none is made up."""
    n_packets = 60
    sender = make.Sender()
    packets = [sender.attitude(k) for k in range(n_packets)]
    content = b"".join(packets)
    place = data.draw(st.integers(0, len(content)))
    size = data.draw(st.integers(1, 500))
    kind = data.draw(st.sampled_from(["zeros", "noise", "magic", "heads"]))
    garbage = {
        "zeros": bytes(size),
        "noise": np.random.default_rng(data.draw(st.integers(0, 999))).bytes(size),
        "magic": b"\xfe\xfd" * (size // 2 + 1),
        "heads": (packets[0][8:18] * size)[:size],
    }[kind]
    overwrite = data.draw(st.booleans())
    damaged = content[:place] + garbage + content[place + (len(garbage) if overwrite else 0) :]
    found = rolls(write(tmp_path, damaged))
    assert len(found) >= n_packets - (len(garbage) if overwrite else 0) / len(packets[0]) - 4
    assert found == sorted(set(found))


@pytest.mark.thorough
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(places=st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), min_size=1, max_size=40))
def test_flipped_bytes_anywhere_never_crash(places: list[tuple[int, int]], tmp_path: Path) -> None:
    """Whatever bytes change, the file opens or raises a LogError."""
    content = bytearray(make.small_log(30))
    for place, value in places:
        content[place % len(content)] = value
    with contextlib.suppress(LogError):
        assert read_log(write(tmp_path, bytes(content))).n_bytes == len(content)


def two_systems(n_rows: int = 6) -> bytes:
    """Return a log with a ground station, a copter (1) and a rover (7) that says more."""
    station, copter, rover = make.Sender(255, 190), make.Sender(1), make.Sender(7)
    content = station.heartbeat(make.GROUND_STATION, make.NO_AUTOPILOT) + copter.heartbeat()
    content += rover.heartbeat(make.ROVER, make.ARDUPILOT)
    for k in range(n_rows):
        content += station.heartbeat(make.GROUND_STATION, make.NO_AUTOPILOT) * 5
        content += copter.attitude(k) + rover.attitude(100 + k) + rover.attitude(200 + k)
    return content


@pytest.mark.parametrize("block_bytes", [40, 333, 4096])
def test_a_log_reads_the_same_in_blocks_of_any_size(
    block_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Packets lie across the ends of blocks, and some blocks hold none."""
    log = make.small_log(200)
    path = write(tmp_path, log[:3000] + bytes(10_000) + log[3000:])
    whole = tlog.read_content(path, {"ATTITUDE"})
    monkeypatch.setattr(mavlink_frames, "_BLOCK", block_bytes)
    monkeypatch.setattr(tlog, "_PART_BYTES", block_bytes)
    found = tlog.read_content(path, {"ATTITUDE"})
    assert (found.lost, found.counts, found.senders) == (whole.lost, whole.counts, whole.senders)
    for name, message in found.messages.items():
        np.testing.assert_array_equal(message.rows, whole.messages[name].rows)
        np.testing.assert_array_equal(message.position, whole.messages[name].position)


def test_the_autopilot_with_most_messages_is_chosen_and_all_are_listed(tmp_path: Path) -> None:
    """Not the ground station, though it says most."""
    log = read_log(write(tmp_path, two_systems()))
    assert [(one.system_id, one.vehicle_type, one.chosen) for one in log.systems] == [
        (1, "multirotor", False),
        (7, "rover", True),
        (255, "gcs", False),
    ]
    assert log.vehicle_type == "rover"
    assert min(log.candidates("body_rate")[0].values[:, 0]) == 100.0


def test_the_system_asked_for_is_read(tmp_path: Path) -> None:
    """No row of another system slips in."""
    log = read_log(write(tmp_path, two_systems()), system=1)
    assert log.vehicle_type == "multirotor"
    assert log.candidates("body_rate")[0].values[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_system_that_is_not_there_is_refused_with_those_that_are(tmp_path: Path) -> None:
    """The error names the systems of the file."""
    with pytest.raises(SettingsError, match="1, 7, 255"):
        read_log(write(tmp_path, two_systems()), system=9)


def test_what_most_heartbeats_of_a_sender_say_is_what_it_is(tmp_path: Path) -> None:
    """A single heartbeat of another kind, as damage makes it, renames nobody."""
    sender = make.Sender(3)
    content = sender.heartbeat(make.ROVER) + sender.heartbeat() * 2 + sender.attitude(0)
    (found,) = read_log(write(tmp_path, content)).systems
    assert (found.vehicle_type, found.autopilot, found.n_messages) == ("multirotor", "ardupilotmega", 4)


def crowd() -> bytes:
    """Return a log in which a copter (9) flies and all others of 65 280 say once that they are a station."""
    says = Messages().heartbeat(make.GROUND_STATION, make.NO_AUTOPILOT)
    stamp = struct.pack(">Q", make.HOST_EPOCH_US)
    others = (stamp + packet(says, 0, k // 256 + 1, k % 256) for k in range(65_280))
    copter = make.Sender(9)
    return b"".join(others) + copter.heartbeat() * 2 + b"".join(copter.attitude(k) for k in range(50))


def test_of_a_crowd_the_autopilot_is_read_and_a_dozen_are_named_the_rest_counted(tmp_path: Path) -> None:
    """Each of 65 280 senders cost a pass over all heartbeats, and a name in every text."""
    path = write(tmp_path, crowd())
    began = time.process_time()
    log = read_log(path)
    took_s = time.process_time() - began
    assert [one.system_id for one in log.systems if one.chosen] == [9]
    assert (len(log.systems), log.n_systems) == (12, 65_280)
    assert len(log.remarks[0]) < 300
    assert " and 65268 more." in log.remarks[0]
    copter = make.Sender(9)
    path.write_bytes(copter.heartbeat() + copter.attitude(0) * (path.stat().st_size // 40))
    began = time.process_time()
    read_log(path)
    # As large, one sender. Before: 1.5 s more.
    assert took_s < 3.0 * (time.process_time() - began) + 0.3


def test_microseconds_since_1970_are_brought_to_the_boot_clock(tmp_path: Path) -> None:
    """Their spacing stays and the host's wrong stamps play no part."""
    sender = make.Sender(1)
    content = sender.heartbeat(autopilot=make.PX4)
    for k in range(50):
        content += sender.attitude(k)
        content += sender.stamped("HIGHRES_IMU", time_usec=1_700_000_000_000_000 + 10_000 * k, xgyro=1.0)
    attitude, imu = read_log(write(tmp_path, content)).candidates("body_rate")
    assert imu.source.startswith("HIGHRES_IMU")
    np.testing.assert_allclose(imu.time_s, attitude.time_s, atol=1e-6)
    np.testing.assert_allclose(attitude.time_s, 1.0 + 0.01 * np.arange(50))


def test_a_32_bit_microsecond_counter_goes_on_over_its_wrap(tmp_path: Path) -> None:
    """SERVO_OUTPUT_RAW counts to 71.6 min; the time since boot goes on."""
    sender = make.Sender()
    content = sender.heartbeat()
    for k in range(20):
        boot_us = 2**32 - 100_000 + 10_000 * k
        content += sender.stamped("ATTITUDE", time_boot_ms=boot_us // 1000, roll=0.1)
        content += sender.stamped("SERVO_OUTPUT_RAW", time_usec=boot_us % 2**32, servo1_raw=1500)
    times = read_log(write(tmp_path, content)).candidates("output_pwm")[0].time_s
    np.testing.assert_allclose(times, (2**32 - 100_000 + 10_000 * np.arange(20)) / 1e6, atol=1e-3)


def test_messages_without_time_get_that_of_their_neighbours(tmp_path: Path) -> None:
    """A heartbeat stands at the attitude before it."""
    log = read_log(write(tmp_path, make.small_log(20)))
    armed = log.candidates("armed")[0]
    assert armed.time_s.tolist() == pytest.approx([1.0, 1.1])
    assert armed.values.ravel().tolist() == [0.0, 1.0]


def test_a_reboot_shows_as_time_that_falls(tmp_path: Path) -> None:
    """Rows stay in file order; nothing is sorted."""
    sender = make.Sender()
    content = sender.heartbeat() + b"".join(sender.attitude(k) for k in [*range(300, 320), *range(20)])
    times = read_log(write(tmp_path, content)).candidates("attitude")[0].time_s
    assert (np.diff(times) < 0).sum() == 1


def test_the_hosts_clock_is_the_last_resort_and_said_so(tmp_path: Path) -> None:
    """Only messages without time: host stamps are used, with a remark."""
    sender = make.Sender()
    content = sender.heartbeat() + b"".join(sender.stamped("VFR_HUD", throttle=50) for _ in range(5))
    log = read_log(write(tmp_path, content))
    assert np.diff(log.candidates("throttle")[0].time_s) == pytest.approx(0.1, abs=1e-5)
    assert any("computer's time stamps" in remark for remark in log.remarks)


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", ["firmware/ac47_quadx_multisine.tlog"], indirect=True)
def test_wrong_host_stamps_do_not_reach_the_signals(corpus_log: Path) -> None:
    """The log's attitude comes at its true 50 Hz, whatever the host's clock did."""
    attitude = read_log(corpus_log).candidates("attitude")[0]
    assert np.median(np.diff(attitude.time_s)) == pytest.approx(0.02, abs=1e-3)


def test_a_log_without_one_right_packet_is_called_empty(tmp_path: Path) -> None:
    """The reader itself never returns an empty log."""
    with pytest.raises(EmptyLogError):
        read(write(tmp_path, bytes(50)))


def test_packets_inside_the_payload_of_another_are_its_payload(tmp_path: Path) -> None:
    """However right their checksums are; the packet behind the carrier counts again."""
    sender = make.Sender()
    inner = sender.packet("HEARTBEAT", type=2, autopilot=3) * 2
    carrier = sender.stamped("FILE_TRANSFER_PROTOCOL", payload=[*inner, *[1] * (251 - len(inner))])
    path = tmp_path / "log.tlog"
    path.write_bytes(sender.heartbeat() + carrier + sender.heartbeat() + sender.attitude(0))
    messages = tlog.read_messages(path)
    assert {name: len(message.position) for name, message in messages.items()} == {
        "HEARTBEAT": 2,
        "FILE_TRANSFER_PROTOCOL": 1,
        "ATTITUDE": 1,
    }


def test_a_time_that_is_not_filled_in_is_that_of_the_neighbours(tmp_path: Path) -> None:
    """Zero milliseconds since boot are no time."""
    sender = make.Sender()
    content = sender.heartbeat() + sender.attitude(0)
    content += sender.stamped("ATTITUDE", time_boot_ms=0, roll=0.5) + sender.attitude(2)
    (attitude,) = read_log(write(tmp_path, content)).candidates("attitude")
    np.testing.assert_allclose(attitude.time_s, [1.0, 1.0, 1.02])


@pytest.mark.parametrize("off_ms", [-30, 0, 30])
def test_a_32_bit_counter_that_is_a_little_off_the_boot_clock_does_not_wrap(
    off_ms: int, tmp_path: Path
) -> None:
    """It may be stamped before or behind the message that tells the time."""
    sender = make.Sender()
    content = sender.heartbeat()
    for k in range(20):
        content += sender.attitude(k)
        content += sender.stamped(
            "SERVO_OUTPUT_RAW", time_usec=1_000_000 + 10_000 * k + 1000 * off_ms, servo1_raw=1500
        )
    times = read_log(write(tmp_path, content)).candidates("output_pwm")[0].time_s
    np.testing.assert_allclose(times, 1.0 + 0.01 * np.arange(20) + 1e-3 * off_ms)
