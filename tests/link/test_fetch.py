"""Logs from fake vehicles: whole or refused, whatever the link does and whatever the vehicle says."""

from __future__ import annotations

import os
import random
import select
import socket
import threading
import tty
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.cli import main
from quadid_logs.errors import LinkError, LogNotFoundError, OutputError, SettingsError
from quadid_logs.link.fetch import Logs
from quadid_logs.link.file_transfer import _entry
from quadid_logs.link.vehicle import Patience, device_of
from tests.link.fake_vehicle import FakeVehicle

QUICK = Patience(heartbeat_s=2.0, answer_s=0.1, tries=6)
CONTENT = random.Random(0).randbytes(30_000)
PATH = "/APM/LOGS/00000007.BIN"


def fetched(vehicle: FakeVehicle, folder: Path) -> bytes:
    """Fetch the last log."""
    with Logs(vehicle.address, QUICK) as logs:
        return logs.fetch(logs.logs[-1], folder).path.read_bytes()


@pytest.mark.parametrize("path", [PATH, "/fs/microsd/log/2026-05-31/12_30_00.ulg", "@MAV_LOG/1.BIN"])
def test_a_log_arrives_byte_for_byte(path: str, tmp_path: Path) -> None:
    """From each place where firmwares keep them."""
    with FakeVehicle({path: CONTENT}) as vehicle:
        assert fetched(vehicle, tmp_path) == CONTENT


@pytest.mark.parametrize("fault", ["loss", "reorder", "duplicate"])
def test_a_bad_link_costs_no_byte(fault: str, tmp_path: Path) -> None:
    """A twentieth of the packets."""
    with FakeVehicle({PATH: CONTENT}, **{fault: 0.05}) as vehicle:
        assert fetched(vehicle, tmp_path) == CONTENT


def test_a_file_may_have_more_packets_than_a_sequence_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its packets must not be taken for late ones of an earlier file."""
    monkeypatch.setattr("quadid_logs.link.file_transfer._WINDOW", 100)
    with FakeVehicle({PATH: CONTENT}) as vehicle:
        assert fetched(vehicle, tmp_path) == CONTENT


def test_a_serial_line_serves_as_well(tmp_path: Path) -> None:
    """A pseudo terminal, with the vehicle at its other end."""
    pytest.importorskip("serial")
    primary, secondary = os.openpty()
    tty.setraw(secondary)
    done = threading.Event()
    with FakeVehicle({PATH: CONTENT}) as vehicle:
        carrier = threading.Thread(target=carry, args=(primary, vehicle.address, done))
        carrier.start()
        try:
            with Logs(os.ttyname(secondary), QUICK) as logs:
                content = logs.fetch(logs.logs[-1], tmp_path).path.read_bytes()
        finally:
            done.set()
            carrier.join()
    os.close(primary)
    os.close(secondary)
    assert content == CONTENT


@pytest.mark.parametrize("stays", [True, False])
def test_a_tcp_connection_serves_until_it_is_closed(
    stays: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A closed one is said in one line, and nothing of it stands among the results."""
    done = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server, FakeVehicle({PATH: CONTENT}) as vehicle:

        def serve() -> None:
            with server.accept()[0] as connection:
                if stays:
                    carry(connection.fileno(), vehicle.address, done)

        carrier = threading.Thread(target=serve)
        carrier.start()
        try:
            address = f"tcp:127.0.0.1:{server.getsockname()[1]}"
            if stays:
                with Logs(address, QUICK) as logs:
                    path = logs.fetch(logs.logs[-1], tmp_path).path
                done.set()
                assert path.read_bytes() == CONTENT
            else:
                with pytest.raises(LinkError, match=r"closed|failed"):
                    Logs(address, QUICK)
        finally:
            done.set()
            carrier.join()
    assert capsys.readouterr().out == ""


def carry(line: int, address: str, done: threading.Event) -> None:
    """Carry bytes between a line and a vehicle's socket until `done`."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.connect(("127.0.0.1", int(address.rpartition(":")[2])))
    with link:
        while not done.is_set():
            for ready in select.select([line, link], [], [], 0.05)[0]:
                if ready is link:
                    os.write(line, link.recv(2048))
                else:
                    link.send(os.read(line, 2048))


def test_older_messages_serve_where_there_is_no_file_transfer(tmp_path: Path) -> None:
    """With losses; the ending follows from the content."""
    content = b"ULog\x01\x12\x35" + CONTENT
    files = {"1": b"\xa3\x95" + CONTENT, "2": content}
    with FakeVehicle(files, ftp=False, loss=0.02) as vehicle, Logs(vehicle.address, QUICK) as logs:
        path = logs.fetch(logs.logs[-1], tmp_path).path
    assert path.read_bytes() == content
    assert path.name == "log2-2023-11-14-221320.ulg"


def test_an_interrupted_fetch_goes_on_where_it_stopped(tmp_path: Path) -> None:
    """What is there is not asked for again."""
    with FakeVehicle({PATH: CONTENT}, silent_after=60) as vehicle, pytest.raises(LinkError, match="again"):
        fetched(vehicle, tmp_path)
    (part,) = tmp_path.iterdir()
    there = part.stat().st_size
    assert 0 < there < len(CONTENT)
    with FakeVehicle({PATH: CONTENT}) as vehicle:
        assert fetched(vehicle, tmp_path) == CONTENT
        assert vehicle.first_offset == there
    assert [path.name for path in tmp_path.iterdir()] == ["00000007.BIN"]


def test_an_armed_vehicle_is_left_alone(tmp_path: Path) -> None:
    """Nothing is asked of it."""
    with (
        FakeVehicle({PATH: CONTENT}, armed=True) as vehicle,
        pytest.raises(LinkError, match=r"armed.*disarm"),
    ):
        fetched(vehicle, tmp_path)
    assert vehicle.chunks == 0


def test_arming_ends_a_fetch(tmp_path: Path) -> None:
    """The part stays for later."""
    content = CONTENT * 20
    with FakeVehicle({PATH: content}, armed_after=100) as vehicle, pytest.raises(LinkError, match="armed"):
        fetched(vehicle, tmp_path)
    assert 0 < next(tmp_path.iterdir()).stat().st_size < len(content)


def test_what_another_client_is_sent_is_not_ours(tmp_path: Path) -> None:
    """Its replies come over the same link."""
    with FakeVehicle({PATH: CONTENT}, other_client=True) as vehicle:
        assert fetched(vehicle, tmp_path) == CONTENT


def test_a_session_that_another_client_holds_is_waited_for(tmp_path: Path) -> None:
    """And not taken away."""
    with FakeVehicle({PATH: CONTENT}, no_session=2) as vehicle:
        assert fetched(vehicle, tmp_path) == CONTENT


def test_a_wrong_checksum_is_said_and_leaves_no_file(tmp_path: Path) -> None:
    """Neither a part, which would be gone on with."""
    with (
        FakeVehicle({PATH: CONTENT}, wrong_checksum=True) as vehicle,
        pytest.raises(LinkError, match="checksum"),
    ):
        fetched(vehicle, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_size_that_is_too_large_is_no_log(tmp_path: Path) -> None:
    """The vehicle has less than it said."""
    vehicle = FakeVehicle({PATH: CONTENT}, listed_sizes={PATH: len(CONTENT) + 5000})
    with vehicle, pytest.raises(LinkError, match="30000 of 35000"):
        fetched(vehicle, tmp_path)


def test_a_log_that_the_disk_cannot_hold_is_refused_before_a_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A size is only what somebody says."""
    monkeypatch.setattr("quadid_logs.link.fetch.shutil.disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    vehicle = FakeVehicle({PATH: CONTENT}, listed_sizes={PATH: 4_000_000_000})
    with vehicle, pytest.raises(OutputError, match="no room for 4000 MB"):
        fetched(vehicle, tmp_path)
    assert vehicle.chunks == 0


def test_a_size_that_the_protocol_cannot_count_is_no_log() -> None:
    """Offsets have 32 bits."""
    vehicle = FakeVehicle({PATH: CONTENT, "/APM/LOGS/1.BIN": b"x"}, listed_sizes={PATH: 1 << 32})
    with vehicle, Logs(vehicle.address, QUICK) as logs:
        assert [log.name for log in logs.logs] == ["1.BIN"]


def test_hostile_names_stay_in_the_folder(tmp_path: Path) -> None:
    """Whatever a listing holds."""
    lines = [
        b"F../../evil.bin\t5",
        b"F/etc/evil.bin\t5",
        b"F..\t5",
        b"D..",
        b"Fa\x1b[31m.bin\t5",
        b"Fx\\y.bin\t5",
    ]
    with FakeVehicle({PATH: CONTENT}, raw_lines=lines) as vehicle, Logs(vehicle.address, QUICK) as logs:
        names = [log.name for log in logs.logs]
    assert "00000007.BIN" in names
    assert all("/" not in name and "\\" not in name and name.isprintable() for name in names)
    assert not any("evil" in name for name in names)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=60))
def test_no_line_of_a_listing_leads_out_of_its_folder(line: bytes) -> None:
    """Any bytes."""
    entry = _entry(line) if line else None
    assert entry is None or (entry.size >= 0 and not {"/", "\\"} & set(entry.name) and entry.name != "..")


@pytest.mark.parametrize("name", ["00000007.BIN", "00000007.BIN.30000.part"])
def test_nothing_is_written_through_a_link(name: str, tmp_path: Path) -> None:
    """Neither of the log nor of its part."""
    outside, folder = tmp_path / "outside", tmp_path / "logs"
    outside.write_bytes(b"kept")
    folder.mkdir()
    (folder / name).symlink_to(outside)
    with FakeVehicle({PATH: CONTENT}) as vehicle, pytest.raises(OutputError):
        fetched(vehicle, folder)
    assert outside.read_bytes() == b"kept"


def test_a_log_that_is_there_is_not_fetched_again(tmp_path: Path) -> None:
    """By name and size."""
    (tmp_path / "00000007.BIN").write_bytes(CONTENT)
    with FakeVehicle({PATH: CONTENT}) as vehicle:
        fetched(vehicle, tmp_path)
    assert vehicle.chunks == 0


def test_noise_between_the_messages_is_passed_over(tmp_path: Path) -> None:
    """As on a serial line."""
    with FakeVehicle({PATH: CONTENT}, noise=b"garbage") as vehicle:
        assert fetched(vehicle, tmp_path) == CONTENT


def test_the_last_log_is_the_one_of_the_highest_number() -> None:
    """10 comes after 9."""
    paths = {f"/APM/LOGS/{number}.BIN": b"x" for number in (10, 9, 2)}
    with FakeVehicle(paths) as vehicle, Logs(vehicle.address, QUICK) as logs:
        assert [log.name for log in logs.logs] == ["2.BIN", "9.BIN", "10.BIN"]


def test_after_the_numbers_began_again_the_last_log_is_the_one_that_the_vehicle_names() -> None:
    """ArduPilot keeps LOG_MAX_FILES logs: then 1 replaces the oldest, and 3 is newer than 500."""
    paths = {f"/APM/LOGS/{number:08}.BIN": b"x" for number in (1, 2, 3, 499, 500)}
    with (
        FakeVehicle({**paths, "/APM/LOGS/LASTLOG.TXT": b"3\r\n"}) as vehicle,
        Logs(vehicle.address, QUICK) as logs,
    ):
        assert [int(log.name.removesuffix(".BIN")) for log in logs.logs] == [499, 500, 1, 2, 3]


@pytest.mark.parametrize("content", [b"three", b"\xff" * 12, b"-1", b"9" * 20])
def test_a_name_of_the_last_log_that_is_none_changes_nothing(content: bytes) -> None:
    """Whatever stands in that file."""
    paths = {f"/APM/LOGS/{number}.BIN": b"x" for number in (9, 10)}
    with (
        FakeVehicle({**paths, "/APM/LOGS/LASTLOG.TXT": content}) as vehicle,
        Logs(vehicle.address, QUICK) as logs,
    ):
        assert [log.name for log in logs.logs] == ["9.BIN", "10.BIN"]


def test_a_log_that_fails_does_not_keep_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file of the second one's name is there, with other content: it stays, and the exit code is 2."""
    card, folder = tmp_path / "card", tmp_path / "logs"
    card.mkdir()
    folder.mkdir()
    for number, name in enumerate(("a.bin", "b.bin", "c.bin")):
        (card / name).write_bytes(CONTENT)
        os.utime(card / name, (1_600_000_000 + number, 1_600_000_000 + number))
    (folder / "b.bin").write_bytes(b"mine")
    assert main(["fetch", str(card), "-o", str(folder), "--all"]) == 2
    assert (folder / "a.bin").read_bytes() == (folder / "c.bin").read_bytes() == CONTENT
    assert (folder / "b.bin").read_bytes() == b"mine"
    assert "b.bin" in capsys.readouterr().err


def test_nobody_at_the_address_is_said() -> None:
    """With what to check."""
    with pytest.raises(LinkError, match=r"No autopilot answers.*baud"):
        Logs("udpout:127.0.0.1:9", Patience(heartbeat_s=0.2, answer_s=0.1, tries=1))


def test_a_closed_port_is_said() -> None:
    """No traceback of a socket."""
    with pytest.raises(LinkError, match="failed"):
        Logs("tcp:127.0.0.1:1", QUICK)


@pytest.mark.parametrize(
    "address", ["", "nonsense", "udp:", "udp:x", "tcp:1", "udp:99999", "file:/etc/passwd"]
)
def test_an_address_of_no_known_form_is_refused(address: str) -> None:
    """And never read as a file."""
    with pytest.raises(SettingsError, match="a serial port"):
        device_of(address)


def test_a_card_gives_its_logs_and_nothing_through_links(tmp_path: Path) -> None:
    """As mass storage of a flight controller."""
    card, folder = tmp_path / "card", tmp_path / "logs"
    (card / "LOGS").mkdir(parents=True)
    (card / "LOGS" / "BTFL_001.BBL").write_bytes(CONTENT)
    (card / "FREESPAC.E").write_bytes(b"x")
    (card / "evil.bin").symlink_to("/etc/passwd")
    with Logs(str(card)) as logs:
        path = logs.fetch(logs.logs[-1], folder).path
        assert len(logs.logs) == 1
    assert path.read_bytes() == CONTENT
    assert path == folder / "LOGS_BTFL_001.BBL"


def test_an_empty_card_is_said(tmp_path: Path) -> None:
    """Not an empty list."""
    with pytest.raises(LogNotFoundError, match="no log"):
        Logs(str(tmp_path))


def test_the_verb_lists_and_fetches_by_date(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The day is that of the file."""
    card = tmp_path / "card"
    card.mkdir()
    for name, time_s in (("old.bin", 1_600_000_000), ("new.bin", 1_700_000_000)):
        (card / name).write_bytes(CONTENT)
        os.utime(card / name, (time_s, time_s))
    monkeypatch.chdir(tmp_path)
    assert main(["fetch", str(card), "--list"]) == 0
    assert "2020-09-13  old.bin" in capsys.readouterr().out
    assert main(["fetch", str(card), "--since", "2023-01-01"]) == 0
    assert [path.name for path in (tmp_path / "logs").iterdir()] == ["new.bin"]


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ([], {"c.bin"}),
        (["--last"], {"c.bin"}),
        (["-n", "2"], {"b.bin", "c.bin"}),
        (["--all"], {"a.bin", "b.bin", "c.bin"}),
    ],
)
def test_the_last_logs_are_fetched(tmp_path: Path, options: list[str], names: set[str]) -> None:
    """One without an option."""
    card, folder = tmp_path / "card", tmp_path / "logs"
    card.mkdir()
    for number, name in enumerate(("a.bin", "b.bin", "c.bin")):
        (card / name).write_bytes(CONTENT)
        os.utime(card / name, (1_600_000_000 + number, 1_600_000_000 + number))
    assert main(["fetch", str(card), "-o", str(folder), *options]) == 0
    assert {path.name for path in folder.iterdir()} == names


def test_options_that_exclude_each_other_end_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    """Before any link is opened."""
    assert main(["fetch", "udp:14550", "--all", "--list"]) == 2
    assert "Only one of" in capsys.readouterr().err


def test_a_fetched_log_is_analyzed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The exit code is the one of analyze: this one is no flight log."""
    card = tmp_path / "card"
    card.mkdir()
    (card / "flight.bin").write_bytes(CONTENT)
    monkeypatch.chdir(tmp_path)
    assert main(["fetch", str(card), "--analyze"]) == 2
    assert (tmp_path / "logs" / "flight.bin").is_file()
