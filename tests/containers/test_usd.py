"""Crazyflie micro-SD logs: framing, versions, checksum, damage."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.containers.usd import is_mine, read_usd
from quadid_logs.errors import EmptyLogError, LogError, UnknownFormatError
from quadid_logs.load import read_log
from tests.conftest import corpus_logs
from tests.marks import thorough_but

from . import usd_maker as maker

#: One of eight is read in a quick run.
FLOWN = corpus_logs("flown/crazyswarm2/logs")
#: Every type of a log variable.
TYPES: dict[int, maker.Type] = {
    0xFFFF: ("fixedFrequency", [("gyro.x", "f"), ("pm.state", "b"), ("a.b", "B"), ("a.h", "h")]),
    0: ("estTDOA", [("a.H", "H"), ("a.i", "i"), ("a.I", "I")]),
    3: ("empty", []),
}


def events(n: int = 400, *, step: int = 4000) -> list[maker.Event]:
    """Return events of all kinds, some after another and some in turns."""
    found = []
    for k in range(n):
        found.append(maker.Event(0xFFFF, 40_000_000 + step * k, (0.5 * k, -k % 100 - 50, k % 256, -30 * k)))
        if k % 50 > 20:
            found.append(maker.Event(0, 40_000_100 + step * k, (k, -7 * k, 2**31 + k)))
        if k % 7 == 0:
            found.append(maker.Event(3, 40_000_200 + step * k, ()))
    return found


def write(folder: Path, content: bytes) -> Path:
    """Write a file without a suffix, as it is on the card."""
    (folder / "log00").write_bytes(content)
    return folder / "log00"


def check_equal(path: Path, content: bytes) -> None:
    """Every field of every event is what the independent reader finds."""
    found, expected = read_usd(path), maker.read(content)
    assert found.tables.keys() == expected.keys()
    for name, table in found.tables.items():
        np.testing.assert_allclose(table.time_s, expected[name].pop("time"), rtol=1e-15)
        assert list(table.fields) == list(expected[name])
        for field, values in expected[name].items():
            np.testing.assert_array_equal(table.column(field), np.array(values))
    assert found.lost == ()
    assert not found.checksum_wrong


@pytest.mark.parametrize("version", [1, 2])
def test_every_field_of_both_versions_is_as_the_description_says(version: int, tmp_path: Path) -> None:
    """All types, kinds in runs and in turns."""
    content = maker.log(TYPES, events(step=4 if version == 1 else 4000), version=version)
    check_equal(write(tmp_path, content), content)


@pytest.mark.corpus
@pytest.mark.parametrize("name", thorough_but(FLOWN[::8], FLOWN))
def test_every_flown_log_equals_the_independent_reader(name: str, corpus: Path) -> None:
    """Each field of each event of each log."""
    path = corpus / "flown" / "crazyswarm2" / name
    check_equal(path, path.read_bytes())


def test_a_long_log_of_one_kind_is_read_in_runs(tmp_path: Path) -> None:
    """Longer than any one look ahead."""
    types: dict[int, maker.Type] = {0xFFFF: ("fixedFrequency", [("gyro.x", "h")])}
    content = maker.log(types, [maker.Event(0xFFFF, 1000 * k, (k % 1000,)) for k in range(30_000)])
    check_equal(write(tmp_path, content), content)


def test_a_byte_that_changed_is_told_by_the_checksum(tmp_path: Path) -> None:
    """In a value nothing else shows it."""
    content = bytearray(maker.log(TYPES, events()))
    content[len(maker.header(TYPES)) + 12] ^= 0x40
    found = read_usd(write(tmp_path, bytes(content)))
    assert found.checksum_wrong
    assert found.lost == ()
    log = read_log(tmp_path / "log00")
    assert log.checksum_wrong


def test_a_log_without_its_end_is_read_to_the_last_whole_event(tmp_path: Path) -> None:
    """Power went: there is no checksum, and that is no damage of the rest."""
    content, last = maker.log(TYPES, events()), maker.event(TYPES, events()[-1])
    whole = read_usd(write(tmp_path, content)).tables
    found = read_usd(write(tmp_path, content[: -4 - len(last) + 5]))
    assert not found.checksum_wrong
    assert [lost.n_bytes for lost in found.lost] == [5]
    n_rows = sum(len(table.position) for table in found.tables.values())
    assert n_rows == sum(len(table.position) for table in whole.values()) - 1


@pytest.mark.parametrize("seed", range(8))
def test_a_damaged_block_costs_the_events_in_it_only(seed: int, tmp_path: Path) -> None:
    """Every event that does not touch the block is read, and none is made up."""
    rng = random.Random(seed)
    content = bytearray(maker.log(TYPES, events()))
    whole = read_usd(write(tmp_path, bytes(content))).tables
    begin = rng.randrange(2000, len(content) - 2000)
    content[begin : begin + 100] = rng.randbytes(100)
    found = read_usd(write(tmp_path, bytes(content)))
    for name, table in whole.items():
        rows = found.tables[name]
        outside = (table.position < begin - 30) | (table.position > begin + 100)
        assert np.isin(table.position[outside], rows.position).all()
        assert np.isin(rows.position[(rows.position < begin) | (rows.position > begin + 100)],
                       table.position).all()  # fmt: skip
    assert found.checksum_wrong
    assert 0 < sum(lost.n_bytes for lost in found.lost) <= 150


def test_bytes_that_are_missing_cost_the_event_that_they_were_cut_from(tmp_path: Path) -> None:
    """All that follows lies elsewhere, and is read."""
    content = maker.log(TYPES, events())
    found = read_usd(write(tmp_path, content[:3000] + content[3005:]))
    n_events = sum(len(table.position) for table in found.tables.values())
    assert len(events()) - 2 <= n_events < len(events())


@pytest.mark.parametrize("into_event", [0, 5])
@pytest.mark.parametrize("fill", [b"\0", b"\xff"])
def test_an_empty_sector_holds_no_events(fill: bytes, into_event: int, tmp_path: Path) -> None:
    """A kind with the number 0 or 65535 begins like it, between two events as well as inside one."""
    content = maker.log(TYPES, events())
    at = int(read_usd(write(tmp_path, content)).tables["fixedFrequency"].position[80]) + into_event
    found = read_usd(write(tmp_path, content[:at] + fill * 512 + content[at:]))
    n_events = sum(len(table.position) for table in found.tables.values())
    assert len(events()) - 2 <= n_events <= len(events())
    assert 480 <= sum(lost.n_bytes for lost in found.lost) <= 560


def test_one_wrong_time_costs_one_event(tmp_path: Path) -> None:
    """Later by a minute: what follows is no less plausible."""
    listed = events()
    listed[100] = listed[100]._replace(time=listed[100].time + 60_000_000)
    found = read_usd(write(tmp_path, maker.log(TYPES, listed)))
    assert sum(len(table.position) for table in found.tables.values()) == len(listed) - 1


def test_logging_may_pause(tmp_path: Path) -> None:
    """A pause of a minute is one, not damage."""
    listed = [one._replace(time=one.time + 60_000_000 * (k > 300)) for k, one in enumerate(events())]
    content = maker.log(TYPES, listed)
    check_equal(write(tmp_path, content), content)


@pytest.mark.parametrize(
    "head",
    [
        struct.pack("<BHH", 0xBC, 3, 1),
        struct.pack("<BHH", 0xBC, 2, 0),
        struct.pack("<BHHH", 0xBC, 2, 1, 5) + b"name\0" + struct.pack("<H", 1) + b"gyro.x(z)\0",
        struct.pack("<BHHH", 0xBC, 2, 1, 5) + b"\0" + struct.pack("<H", 1) + b"gyro.x(f)\0",
        struct.pack("<BHHH", 0xBC, 2, 1, 5) + b"na\xe9me\0" + struct.pack("<H", 1) + b"gyro.x(f)\0",
        struct.pack("<BHHH", 0xBC, 2, 1, 5) + b"name\0" + struct.pack("<H", 60000) + b"gyro.x(f)\0",
    ],
)
def test_a_file_that_defines_no_events_is_not_taken_for_a_log(head: bytes) -> None:
    """Other versions, no types, unknown letters, names that are none."""
    assert not is_mine(head + bytes(100))


def test_a_log_is_told_by_its_first_bytes() -> None:
    """It has no suffix."""
    assert is_mine(maker.log(TYPES, events())[: 1 << 16])
    assert not is_mine(b"\xbc")


def test_a_header_that_is_cut_off_says_so(tmp_path: Path) -> None:
    """Without definitions no event can be read."""
    with pytest.raises(UnknownFormatError, match="header"):
        read_log(write(tmp_path, maker.header(TYPES)[:40]))


def test_a_log_without_events_says_so(tmp_path: Path) -> None:
    """Logging was never switched on."""
    with pytest.raises(EmptyLogError, match="no event"):
        read_log(write(tmp_path, maker.log(TYPES, [])))


def test_of_a_number_that_is_defined_twice_the_first_counts(tmp_path: Path) -> None:
    """The firmware writes the variables of the first."""
    types: dict[int, maker.Type] = {7: ("one", [("gyro.x", "f")])}
    second = maker.header({7: ("two", [("gyro.x", "f"), ("gyro.y", "f")])})[5:]
    head = maker.header(types) + second
    body = b"".join(maker.event(types, maker.Event(7, 4000 * k, (k,))) for k in range(50))
    found = read_usd(write(tmp_path, head[:3] + struct.pack("<H", 2) + head[5:] + body))
    assert list(found.tables) == ["one"]
    np.testing.assert_array_equal(found.tables["one"].column("gyro.x"), np.arange(50))


def test_a_file_larger_than_any_flight_is_refused_unread(tmp_path: Path) -> None:
    """A file with holes takes no room on the disk, and would take all memory."""
    path = write(tmp_path, maker.log(TYPES, events()))
    with path.open("r+b") as file:
        file.truncate(1 << 34)
    with pytest.raises(LogError, match="GB"):
        read_log(path)
