"""The DataFlash binary reader against pymavlink's, and against damage."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from quadid_logs.autopilots.ardupilot.log import read_binary
from quadid_logs.containers import dataflash, dataflash_index
from quadid_logs.containers.content import decode_text
from quadid_logs.containers.dataflash import DataFlashFile, read_messages
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.errors import EmptyLogError, LogError, LogNotFoundError, UnknownFormatError
from tests.marks import thorough, thorough_but

from .dataflash_files import (
    ATT,
    DEFINITIONS,
    EV,
    FMT_OF_FMT,
    RATE,
    STRUCTS,
    flight,
    fmt,
    reference_rows,
    row,
)

TYPES = frozenset(
    {"RATE", "ANG", "ATT", "IMU", "IMU2", "IMU3", "RCOU", "RCO2", "MOTB", "ESC", "BAT", "CURR", "MODE", "EV"}
    | {"ARM", "PARM", "MSG", "VER", "SIDD", "CTUN", "XKF1", "XKF4", "NKF1", "EKF1", "AHR2", "DSF", "BARO"}
    | {"STAT", "GPS", "TIME", "OUT0", "ATTC", "ARSP", "BATT"}
)
INTACT = [
    "real/ac313-y6b-331s.bin",
    "real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin",
    "real/ac34rc2-erlebrain3-quadx-265s.bin",
    "real/ac364-quadx-RATE1Hz-700s.bin",
    "real/ac41-quadplus-mission-113s.bin",
    "real/ac413-quadx-25mmcut-hover1.bin",
    "real/ac413-quadx-goodprop-hover1.bin",
    "real/ac457-quadx-noATT-noRATE-50s.bin",
    "real/plane423-fastlog-real.bin",
    "real/rover246-real-61.bin",
    "real/sdlog2-quad-70s.px4log",
    "firmware/ac47_quadx_default_logging.BIN",
    "firmware/ac47_quadx_doublets.BIN",
    "firmware/ac47_quadx_esc_rpm.BIN",
    "firmware/ac47_quadx_multisine.BIN",
    "firmware/ac47_quadx_sid_roll.BIN",
    "firmware/ac47_rate_thread.BIN",
    "firmware/ac47_two_flights.BIN",
    "damaged/truncated-80k-ac462-real.bin",
]
#: Of longer logs the reference reader, which takes a second per 4 MB, sees the beginning only: every type
#: that 4 MB of them hold is among the first 2. But not of those whose end is unlike it.
_MOST_BYTES = 2_000_000
_WHOLE = ("firmware/ac47_two_flights.BIN", "firmware/ac47_quadx_default_logging.BIN")
#: Of each age and kind of vehicle one.
OF_EACH_AGE = (
    "real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin",
    "real/ac457-quadx-noATT-noRATE-50s.bin",
    "real/plane423-fastlog-real.bin",
    "real/sdlog2-quad-70s.px4log",
)
PID_TYPES = frozenset({"PIDR", "PIDP", "PIDY"})


def decode(content: bytes) -> dict[str, MessageTable]:
    """Decode all messages of a file in memory."""
    return DataFlashFile.from_bytes(content).read_messages()


def same(ours: list[Any], theirs: list[Any]) -> bool:
    """Compare values bit for bit; NaN equals NaN."""
    return len(ours) == len(theirs) and all(
        a == b or (a != a and b != b) for a, b in zip(ours, theirs, strict=True)
    )


def check_against_reference(path: Path, types: frozenset[str]) -> None:
    """Compare every field of every row of the types."""
    reference = reference_rows(path, types)
    tables = read_messages(path, types)
    assert set(tables) == set(reference)
    for name, (labels, rows) in reference.items():
        table = tables[name]
        assert table.n_rows == len(rows)
        for number, label in enumerate(labels):
            theirs = [values[number] for values in rows]
            assert same(table.columns[label].tolist(), theirs), f"{name}.{label}"


def test_the_format_characters_are_those_of_the_reference_reader() -> None:
    """Every format character has the size, scale and kind that pymavlink gives it."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT

    ours = {
        character: (np.dtype(kind.dtype).itemsize, kind.divisor)
        for character, kind in dataflash_index.FORMAT_CHARACTERS.items()
    }
    theirs = {
        character: (struct.calcsize("<" + code), 1.0 if factor is None else round(1.0 / factor, 9))
        for character, (code, factor, _) in FORMAT_TO_STRUCT.items()
    }
    assert ours == theirs


@pytest.mark.corpus
@pytest.mark.parametrize("name", thorough_but(OF_EACH_AGE, INTACT))
def test_every_field_equals_the_reference_reader_s(corpus: Path, name: str, tmp_path: Path) -> None:
    """All rows and fields of the types that are used are pymavlink's, bit for bit."""
    path = corpus / name
    if name not in _WHOLE and path.stat().st_size > _MOST_BYTES:
        with path.open("rb") as file:
            path = tmp_path / path.name
            path.write_bytes(file.read(_MOST_BYTES))
    check_against_reference(path, TYPES)


@pytest.mark.corpus
def test_pid_terms_equal_the_reference_reader_s(corpus: Path) -> None:
    """The PID messages, which stand in where RATE is missing, are pymavlink's too."""
    check_against_reference(corpus / "real/ac457-quadx-noATT-noRATE-50s.bin", PID_TYPES)


@pytest.mark.corpus
def test_every_type_is_counted_like_the_reference_reader_does(corpus: Path) -> None:
    """Types that are not decoded are counted all the same: 795 475 messages of 188 types."""
    with DataFlashFile.open(corpus / "firmware/ac47_quadx_multisine.BIN") as file:
        assert (sum(file.counts.values()), len(file.definitions)) == (795_475, 189)


@pytest.mark.corpus
def test_units_are_those_that_the_log_states(corpus: Path) -> None:
    """FMTU, UNIT and MULT give deg/s for RATE.R and hundredths for RATE.A."""
    with DataFlashFile.open(corpus / "firmware/ac47_quadx_doublets.BIN") as file:
        units = file.read_messages({"RATE"})["RATE"].units
    assert (units["R"], units["A"], "ROut" in units) == (("deg/s", 1.0), ("m/s/s", 0.01), False)


FIELD_VALUES: dict[str, st.SearchStrategy[Any]] = {
    "b": st.integers(-128, 127),
    "B": st.integers(0, 255),
    "h": st.integers(-(1 << 15), (1 << 15) - 1),
    "H": st.integers(0, (1 << 16) - 1),
    "i": st.integers(-(1 << 31), (1 << 31) - 1),
    "I": st.integers(0, (1 << 32) - 1),
    "f": st.floats(width=32),
    "d": st.floats(),
    "g": st.floats(width=16),
    "q": st.integers(-(1 << 63), (1 << 63) - 1),
    "Q": st.integers(0, (1 << 64) - 1),
    "L": st.integers(-(1 << 31), (1 << 31) - 1),
    "e": st.integers(-(1 << 31), (1 << 31) - 1),
    "C": st.integers(0, (1 << 16) - 1),
    "n": st.binary(max_size=4),
    "Z": st.binary(max_size=64),
}


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_format_decodes_like_the_reference_reader(data: st.DataObject) -> None:
    """A message of any format and content is decoded as pymavlink's formulas decode it."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT

    format_ = data.draw(st.text(st.sampled_from(sorted(FIELD_VALUES)), min_size=1, max_size=8))
    # A definition gives its length in one byte.
    assume(struct.calcsize("<" + "".join(STRUCTS[kind] for kind in format_)) <= 252)
    rows = data.draw(st.lists(st.tuples(*(FIELD_VALUES[kind] for kind in format_)), min_size=1, max_size=5))
    labels = [f"F{number}" for number in range(len(format_))]
    content = FMT_OF_FMT + fmt(7, "TEST", format_, ",".join(labels))
    content += b"".join(row(7, format_, *values) for values in rows)
    table = decode(content)["TEST"]
    for number, kind in enumerate(format_):
        factor = FORMAT_TO_STRUCT[kind][1]
        raw = [values[number] for values in rows]
        if factor is not None:
            raw = [value / (1.0 / factor) for value in raw]
        if kind in "nZ":
            raw = [decode_text(value.split(b"\0", 1)[0]) for value in raw]
        assert same(table.columns[labels[number]].tolist(), raw)


def test_arrays_of_integers_keep_their_shape() -> None:
    """A field of format a is 32 integers of 16 bits."""
    values = np.arange(32, dtype="<i2")
    table = decode(FMT_OF_FMT + fmt(9, "ISBD", "a", "x") + row(9, "a", values.tobytes()))["ISBD"]
    np.testing.assert_array_equal(table.columns["x"], values[None, :])


def test_positions_are_the_offsets_of_the_rows() -> None:
    """Each row says where in the file it stands."""
    table = decode(flight(5))["RATE"]
    content = flight(5)
    assert all(content[p : p + 3] == bytes([0xA3, 0x95, RATE]) for p in table.position.tolist())


def test_only_the_types_that_are_asked_for_are_decoded() -> None:
    """The others are counted."""
    file = DataFlashFile.from_bytes(flight(20))
    assert set(file.read_messages({"ATT", "NONE"})) == {"ATT"}
    assert file.counts == {"FMT": 4, "ATT": 20, "RATE": 20, "EV": 2}


def test_rows_before_their_definition_are_read() -> None:
    """An autopilot that drops messages may log rows first."""
    body = row(ATT, "QccC", 1, 100, 200, 300)
    content = FMT_OF_FMT + body + fmt(ATT, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw") + body
    assert decode(content)["ATT"].columns["Roll"].tolist() == [1.0, 1.0]


def test_a_redefined_id_is_decoded_by_the_definition_in_force() -> None:
    """After another firmware's FMT, the same id means another message."""
    second = fmt(ATT, "EV", "QB", "TimeUS,Id")
    content = flight(3) + second + row(ATT, "QB", 5, 17) * 2
    tables = decode(content)
    assert (tables["ATT"].n_rows, tables["EV"].columns["Id"].tolist()) == (3, [10, 17, 17])


def test_a_name_with_two_definitions_becomes_one_table() -> None:
    """A column that one of them lacks is NaN there."""
    content = (
        FMT_OF_FMT
        + fmt(1, "CURR", "Qf", "TimeUS,Volt")
        + row(1, "Qf", 1, 12.0)
        + fmt(1, "CURR", "Qff", "TimeUS,Volt,Curr")
        + row(1, "Qff", 2, 11.0, 3.0)
    )
    table = decode(content)["CURR"]
    assert table.columns["Volt"].tolist() == [12.0, 11.0]
    assert same(table.columns["Curr"].tolist(), [float("nan"), 3.0])


def test_repeated_definitions_change_nothing() -> None:
    """Each boot writes all FMT again."""
    assert decode(flight(5) + flight(5))["RATE"].n_rows == 10


def test_a_missing_definition_of_fmt_is_no_obstacle() -> None:
    """FMT itself is the same in every log."""
    content = flight(5)[len(FMT_OF_FMT) :]
    assert decode(content)["RATE"].n_rows == 5


def test_a_wrong_length_in_a_definition_is_corrected_by_the_rows() -> None:
    """Where length and format disagree, the one after which headers stand is right."""
    wrong = fmt(ATT, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw", length=99)
    content = FMT_OF_FMT + wrong + row(ATT, "QccC", 1, 100, 200, 300) * 20
    assert decode(content)["ATT"].n_rows == 20


def test_an_unknown_id_costs_only_its_own_bytes() -> None:
    """Messages around one without definition stay, and the lost bytes are named."""
    loops = flight(4)
    unknown = bytes([0xA3, 0x95, 99]) + bytes(30)
    file = DataFlashFile.from_bytes(loops + unknown + loops[len(DEFINITIONS) :])
    assert file.read_messages()["RATE"].n_rows == 8
    assert [(s.offset, s.n_bytes, s.reason) for s in file.lost] == [
        (len(loops), 33, "message id 99 has no definition")
    ]


def test_truncation_at_every_byte_loses_only_what_is_cut() -> None:
    """Every complete message before the cut is read, wherever the cut is."""
    content = flight(12)
    ends = np.sort(np.concatenate([t.position for t in decode(content).values()]))
    starts = np.append(ends, len(content))
    for length in range(len(DEFINITIONS), len(content)):
        file = DataFlashFile.from_bytes(content[:length])
        read = sum(table.n_rows for name, table in file.read_messages().items() if name != "FMT")
        complete = int(np.count_nonzero(starts[1:] <= length)) - DEFINITIONS.count(b"\xa3\x95\x80")
        assert read == complete
        assert sum(block.n_bytes for block in file.lost) == length - starts[starts <= length][-1]


def damage_cases() -> dict[str, bytes]:
    """Return contents to overwrite a block with."""
    noise = np.random.default_rng(5).integers(0, 256, 70_000, dtype=np.uint8).tobytes()
    return {
        "zeros": bytes(70_000),
        "noise": noise,
        "ones": b"\xff" * 70_000,
        "header flood": b"\xa3\x95" * 35_000,
        "known header flood": bytes([0xA3, 0x95, RATE]) * 23_000,
        "known header flood of period 4": bytes([0xA3, 0x95, ATT, 0]) * 17_000,
        "half headers": b"\xa3" * 70_000,
    }


@pytest.mark.parametrize("kind", damage_cases())
@pytest.mark.parametrize("size", [thorough(1), 7, thorough(63), 500, thorough(4096), 65_536])
def test_a_damaged_block_costs_only_itself(kind: str, size: int) -> None:
    """Lost rows are at most the damaged bytes over the mean message length plus 4; none is invented."""
    content = flight(3000)
    tables = decode(content)
    original = np.concatenate([table.position for table in tables.values()])
    mean_length = (len(content) - len(DEFINITIONS)) / (len(original) - 4)
    filling = damage_cases()[kind]
    for start in np.random.default_rng(size).integers(len(DEFINITIONS), len(content) - size, 8).tolist():
        damaged = content[:start] + filling[:size] + content[start + size :]
        file = DataFlashFile.from_bytes(damaged)
        read = np.concatenate([table.position for table in file.read_messages().values()])
        assert len(original) - len(read) <= size / mean_length + 4
        assert set(read.tolist()) <= set(original.tolist())


@settings(max_examples=120, deadline=None)
@given(insert=st.binary(max_size=300), where=st.integers(0, 10**6), removed=st.integers(0, 200))
def test_inserted_or_missing_bytes_cost_only_their_neighbours(
    insert: bytes, where: int, removed: int
) -> None:
    """Shifting the rest of the file by any number of bytes does not lose it."""
    content = flight(60)
    start = len(DEFINITIONS) + where % (len(content) - len(DEFINITIONS) - removed)
    damaged = content[:start] + insert + content[start + removed :]
    rows = decode(damaged)
    n_rows = sum(rows[name].n_rows for name in ("RATE", "ATT", "EV") if name in rows)
    mean_length = (len(content) - len(DEFINITIONS)) / 126
    assert 126 - removed / mean_length - 4 <= n_rows <= 126 + len(insert) / 12


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=600))
def test_any_bytes_are_read_or_refused_without_a_crash(content: bytes) -> None:
    """Rows and lost bytes together never exceed the file."""
    file = DataFlashFile.from_bytes(DEFINITIONS + content)
    lost = sum(block.n_bytes for block in file.lost)
    lengths = {each.name: each.length for each in file.definitions}
    read = sum(count * lengths[name] for name, count in file.counts.items())
    assert lost + read == len(DEFINITIONS) + len(content)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(DEFINITIONS) - 1), st.integers(0, 255)), max_size=6))
def test_damaged_definitions_never_crash_the_reader(flips: list[tuple[int, int]]) -> None:
    """Any bytes inside the FMT messages may be wrong."""
    content = bytearray(flight(30))
    for offset, value in flips:
        content[offset] = value
    assert DataFlashFile.from_bytes(bytes(content)).n_bytes == len(content)


def test_bytes_before_the_first_header_are_lost_and_nothing_else() -> None:
    """A file that starts with garbage is still recognised and read."""
    content = b"garbage before" * 50 + flight(20)
    file = DataFlashFile.from_bytes(content)
    assert dataflash.is_mine(content[:65_536])
    assert ([s.n_bytes for s in file.lost], file.read_messages()["RATE"].n_rows) == ([700], 20)


def test_a_chunk_border_inside_a_message_is_no_border() -> None:
    """Messages that straddle the blocks in which the file is scanned are found."""
    n_loops = 12_000
    content = flight(n_loops)
    assert len(content) > 1 << 19
    assert decode(content)["RATE"].columns["TimeUS"].tolist() == [
        1_000_000 + 2500 * loop for loop in range(n_loops)
    ]


def test_results_do_not_depend_on_how_the_file_is_cut_for_processing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Tiny blocks find the same rows and the same losses."""
    content = flight(300)
    content = content[:9000] + b"\xa3\x95 garbage" * 20 + content[9000:]
    path = tmp_path / "flight.bin"
    path.write_bytes(content)
    expected = DataFlashFile.from_bytes(content)
    monkeypatch.setattr(dataflash_index, "_SCAN_BYTES", 64)
    monkeypatch.setattr(dataflash_index, "_CHAIN_HEADERS", 5)
    monkeypatch.setattr(dataflash, "_GATHER_BYTES", 777)
    monkeypatch.setattr(dataflash, "_GATHER_ROWS", 3)
    with DataFlashFile.open(path) as file:
        assert (file.lost, file.counts) == (expected.lost, expected.counts)
        for name, table in expected.read_messages().items():
            ours = file.read_messages({name})[name]
            for label, values in table.columns.items():
                np.testing.assert_array_equal(ours.columns[label], values)


def test_a_file_and_its_bytes_read_alike(tmp_path: Path) -> None:
    """A file on disk gives the same rows as its bytes, also after it is closed."""
    path = tmp_path / "flight.bin"
    path.write_bytes(flight(50))
    table = read_messages(path, {"ATT"})["ATT"]
    np.testing.assert_array_equal(table.columns["Yaw"], decode(flight(50))["ATT"].columns["Yaw"])


@pytest.mark.parametrize(
    ("head", "mine"),
    [
        (flight(3), True),
        (flight(3)[len(FMT_OF_FMT) :], True),
        (flight(200)[len(DEFINITIONS) :], True),
        (b"", False),
        (bytes(65_536), False),
        (b"\xa3\x95\x80" + bytes(100), False),
        (fmt(2, "TIME", "Q", "StartTime"), False),
        (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", False),
        (np.random.default_rng(1).integers(0, 256, 65_536, dtype=np.uint8).tobytes(), False),
    ],
)
def test_detection_goes_by_credible_definitions(head: bytes, mine: bool) -> None:
    """Magic bytes alone make no DataFlash log; PX4's sdlog2 is another format."""
    assert dataflash.is_mine(head) is mine


@pytest.mark.corpus
@pytest.mark.parametrize("name", ["eeprom.bin", "git-lfs-pointer.bin"])
def test_other_files_called_bin_are_refused(corpus: Path, name: str) -> None:
    """A parameter memory or a pointer to a file is no log."""
    path = corpus / "damaged" / name
    assert not dataflash.is_mine(path.read_bytes()[:65_536])
    with pytest.raises(UnknownFormatError):
        read_binary(path)


@pytest.mark.corpus
def test_a_header_without_rows_is_an_empty_log(corpus: Path) -> None:
    """600 bytes of definitions are a log that ended before it began."""
    with pytest.raises(EmptyLogError, match="not one row"):
        read_binary(corpus / "damaged/only-header-600B.bin")


def test_rows_without_definitions_are_an_empty_log(tmp_path: Path) -> None:
    """Without its beginning, a log cannot be decoded, and the message says so."""
    path = tmp_path / "flight.bin"
    path.write_bytes(flight(200)[len(DEFINITIONS) :])
    with pytest.raises(EmptyLogError, match="beginning is missing"):
        read_binary(path)


def test_an_empty_or_absent_file_is_a_clear_error(tmp_path: Path) -> None:
    """Nothing to map is not a crash."""
    (tmp_path / "empty.bin").write_bytes(b"")
    with pytest.raises(EmptyLogError):
        DataFlashFile.open(tmp_path / "empty.bin")
    with pytest.raises(LogNotFoundError):
        DataFlashFile.open(tmp_path / "absent.bin")
    with pytest.raises(LogNotFoundError):
        DataFlashFile.open(tmp_path)


@pytest.mark.corpus
def test_a_log_with_damage_yields_more_than_the_reference_reader(corpus: Path) -> None:
    """Lost blocks throughout the file cost about one row each, not the rest of the file."""
    path = corpus / "damaged/garbage-tail-ac47-sitl.bin"
    theirs = reference_rows(path, {"ATT"})["ATT"][1]
    with DataFlashFile.open(path) as file:
        ours = file.read_messages({"ATT"})["ATT"].columns
        assert len(file.lost) > 200
    times = set(ours["TimeUS"].tolist())
    assert len(times) > len(theirs)
    assert sum(values[0] in times for values in theirs) >= len(theirs) - 5


def test_events_are_found_between_the_other_rows() -> None:
    """Rare messages are not lost among frequent ones."""
    assert decode(flight(100))["EV"].n_rows == 10 == flight(100).count(bytes([0xA3, 0x95, EV]))


def test_a_log_that_shrinks_while_it_is_read_is_a_clear_error(tmp_path: Path) -> None:
    """No row is made up for the bytes that are gone."""
    path = tmp_path / "flight.bin"
    path.write_bytes(flight(5000))
    with DataFlashFile.open(path) as file:
        os.truncate(path, 50_000)
        with pytest.raises(LogError, match="became shorter"):
            file.read_messages()


def test_what_is_appended_while_a_log_is_read_is_not_seen(tmp_path: Path) -> None:
    """The log is that of the moment of opening."""
    path = tmp_path / "flight.bin"
    path.write_bytes(flight(50))
    with DataFlashFile.open(path) as file:
        with path.open("ab") as stream:
            stream.write(flight(50))
        rows = file.read_messages({"RATE"})["RATE"].n_rows
    assert rows == decode(flight(50))["RATE"].n_rows


def test_a_unit_has_the_factor_that_its_character_says() -> None:
    """ "-" is logged as zero and means none; a format with a scale of its own has been applied already."""
    content = FMT_OF_FMT + b"".join(
        (
            fmt(1, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
            fmt(2, "UNIT", "QbZ", "TimeUS,Id,Label"),
            fmt(3, "MULT", "Qbd", "TimeUS,Id,Mult"),
            fmt(4, "ONE", "Qffc", "TimeUS,plain,small,scaled"),
            *(row(2, "QbZ", 1, ord(key), label) for key, label in (("s", b"s"), ("k", b"deg/s"))),
            *(row(3, "Qbd", 1, ord(key), factor) for key, factor in (("F", 1e-6), ("-", 0.0), ("B", 1e-2))),
            row(1, "QBNN", 1, 4, b"skkk", b"F-BB"),
            row(4, "Qffc", 1, 1.0, 1.0, 100),
        )
    )
    with DataFlashFile.from_bytes(content) as file:
        table = file.read_messages({"ONE"})["ONE"]
    assert {label: unit.factor for label, unit in table.units.items() if label != "TimeUS"} == {
        "plain": 1.0, "small": 0.01, "scaled": 1.0,
    }  # fmt: skip
    assert table.columns["scaled"].tolist() == [1.0]
