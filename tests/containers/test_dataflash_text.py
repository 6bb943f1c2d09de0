"""The DataFlash text reader against pymavlink's, and against malformed lines."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.autopilots.ardupilot.log import read_text
from quadid_logs.containers import dataflash_text
from quadid_logs.containers.dataflash_text import TextLog
from quadid_logs.errors import EmptyLogError, UnknownFormatError

from .dataflash_files import reference_rows

TYPES = frozenset({"ATT", "CTUN", "CURR", "MODE", "EV", "PARM", "MSG", "IMU", "IMU2", "RCOU", "D32", "ERR"})
HEADER = (
    b"ArduCopter V3.1.1\n"
    b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\n"
    b"FMT, 1, 17, ATT, Icc, TimeMS,Roll,Pitch\n"
    b"FMT, 132, 67, MSG, Z, Message\n"
    b"FMT, 3, 6, MODE, Mh, Mode,ThrCrs\n"
    b"FMT, 10, 3, STRT, , \n"
)
ROWS = b"ATT, 100, 1.25, -2.50\nATT, 200, 1.50, nan\n"


def same(ours: object, theirs: object) -> bool:
    """Compare two values; NaN equals NaN."""
    return ours == theirs or (ours != ours and theirs != theirs)


@pytest.mark.corpus
@pytest.mark.parametrize("name", ["ac30-quadV-underpowered.log", "ac311-quadx-nan.log"])
def test_every_field_equals_the_reference_reader_s(corpus: Path, name: str) -> None:
    """All rows and fields are pymavlink's; it leaves out a row or line at the very end of the file."""
    path = corpus / "real" / name
    tables = TextLog.open(path).read_messages(TYPES)
    for message, (labels, rows) in reference_rows(path, TYPES).items():
        table = tables[message]
        assert table.n_rows - len(rows) in (0, 1)
        for number, label in enumerate(labels):
            pairs = zip(table.columns[label].tolist(), (values[number] for values in rows), strict=False)
            assert all(same(ours, theirs) for ours, theirs in pairs), f"{message}.{label}"


@pytest.mark.corpus
def test_a_log_that_the_reference_reader_refuses_is_read(corpus: Path) -> None:
    """Firmware 3.0.1 logged GPS without a week, over which pymavlink stumbles."""
    path = corpus / "real/ac301-octo-apm2-MOT.log"
    n_lines = sum(line.startswith(b"ATT,") for line in path.read_bytes().splitlines())
    assert TextLog.open(path).counts["ATT"] == n_lines


def test_values_are_read_as_printed() -> None:
    """Text holds scaled values; NaN is a value."""
    table = TextLog("", HEADER + ROWS).read_messages()["ATT"]
    assert table.columns["TimeMS"].tolist() == [100, 200]
    assert [str(value) for value in table.columns["Pitch"].tolist()] == ["-2.5", "nan"]


def test_a_message_text_keeps_its_commas() -> None:
    """The last field of a text message is not split."""
    table = TextLog("", HEADER + b"MSG, Bad AHRS, check, compass\n").read_messages()["MSG"]
    assert table.columns["Message"].tolist() == ["Bad AHRS, check, compass"]


def test_the_lines_before_the_definitions_are_kept() -> None:
    """Old logs state their firmware there."""
    assert TextLog("", HEADER + ROWS).preamble == ("ArduCopter V3.1.1",)


def test_positions_are_the_offsets_of_the_lines() -> None:
    """Each row says where in the file it stands."""
    content = HEADER + ROWS
    positions = TextLog("", content).read_messages()["ATT"].position.tolist()
    assert [content[position : position + 8] for position in positions] == [b"ATT, 100", b"ATT, 200"]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"ATT, 300, 1.0\n", "too few fields"),
        (b"ATT, 300, 1.0, 2.x0\n", "malformed value"),
        (b"ATT, 99999999999999999999999, 1.0, 2.0\n", "malformed value"),
        (b"XYZ, 1, 2\n", "no definition (FMT) of this line"),
        (b"\xff\xfe\x00garbage\n", "no message"),
    ],
)
def test_a_malformed_line_costs_only_itself(line: bytes, reason: str) -> None:
    """It becomes lost bytes of just that line."""
    log = TextLog("", HEADER + ROWS + line + ROWS)
    assert log.read_messages()["ATT"].n_rows == 4
    assert [(s.offset, s.n_bytes, s.reason) for s in log.lost] == [(len(HEADER + ROWS), len(line), reason)]


def test_truncation_at_every_byte_keeps_all_complete_lines() -> None:
    """Only the cut line may be missing or hold a shortened number."""
    content = HEADER + ROWS * 3
    for length in range(len(HEADER), len(content)):
        tables = TextLog("", content[:length]).read_messages()
        complete = content[len(HEADER) : length].count(b"\n")
        n_rows = tables["ATT"].n_rows if "ATT" in tables else 0
        assert complete <= n_rows <= complete + 1


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes_are_read_or_refused_without_a_crash(content: bytes) -> None:
    """Lost bytes lie inside the file and do not overlap."""
    log = TextLog("", HEADER + content)
    log.read_messages()
    end = 0
    for block in log.lost:
        assert block.offset >= end
        end = block.offset + block.n_bytes
    assert end <= log.n_bytes


@pytest.mark.parametrize(
    ("head", "mine"),
    [
        (HEADER, True),
        (b"FMT, 1, 17, ATT, Icc, TimeMS,Roll,Pitch", True),
        (HEADER.replace(b"\n", b"\r\n"), True),
        (b"FMT, what", False),
        (b"time_s,p_rad_s\n0.0,1.0\n", False),
        (b"", False),
    ],
)
def test_detection_goes_by_a_definition_line(head: bytes, mine: bool) -> None:
    """A CSV or a foreign text file is no DataFlash text log."""
    assert dataflash_text.is_mine(head) is mine


@pytest.mark.corpus
def test_a_foreign_text_log_is_refused(corpus: Path) -> None:
    """A probe's output that is also called .log is not ours."""
    path = corpus / "damaged/not-a-flightlog-aeroprobe.log"
    assert not dataflash_text.is_mine(path.read_bytes()[:65_536])
    with pytest.raises(UnknownFormatError):
        read_text(path)


def test_definitions_without_rows_are_an_empty_log(tmp_path: Path) -> None:
    """Nothing was logged, and the message says so."""
    path = tmp_path / "flight.log"
    path.write_bytes(HEADER)
    with pytest.raises(EmptyLogError, match="not one line"):
        read_text(path)
