"""Bytes of a file, and rows cut out of them."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.containers.content import (
    FileParts,
    mean_rate_hz,
    merge_lost,
    room_for,
    rows_at,
    rows_of_types,
    time_before,
)
from quadid_logs.data.log import LostBytes
from quadid_logs.errors import LogError


def test_large_memory_begins_with_a_huge_page() -> None:
    """The system can give one only where both of its ends lie inside."""
    room = room_for(20_000_000)
    assert room.size == 20_000_000
    assert room.ctypes.data % (1 << 21) == 0


def test_rows_of_several_types_are_those_of_each_type() -> None:
    """Also where a type has no rows, or rows that lie across the parts in which the file is read."""
    rng = np.random.default_rng(1)
    data = rng.integers(0, 256, 3_000_000, dtype=np.uint8)
    last = 3_000_000 - 5 - 9
    wanted = [
        (np.sort(rng.integers(0, 2_900_000, n_rows)), np.dtype([("a", "<u4"), ("b", "u1", (n_bytes,))]))
        for n_rows, n_bytes in ((5000, 3), (0, 4), (2000, 500))
    ]
    wanted.append((np.array([(1 << 20) - 8, (1 << 20) - 5, last]), np.dtype([("a", "u1", (9,))])))
    found = rows_of_types(FileParts(io.BytesIO(data.tobytes())), wanted, behind=5)
    for rows, (offsets, dtype) in zip(found, wanted, strict=True):
        assert rows.dtype == dtype
        np.testing.assert_array_equal(rows, rows_at(data, offsets + 5, dtype))


def test_a_file_that_shrinks_while_rows_are_cut_out_is_a_clear_error(tmp_path: Path) -> None:
    """No row is made up for the bytes that are gone."""
    path = tmp_path / "log"
    path.write_bytes(bytes(100_000))
    with path.open("rb") as stream:
        file = FileParts(stream, str(path))
        os.truncate(path, 50_000)
        with pytest.raises(LogError, match="became shorter"):
            rows_of_types(file, [(np.array([90_000]), np.dtype([("a", "<u4")]))])


def test_no_types_have_no_rows() -> None:
    assert rows_of_types(FileParts(io.BytesIO(b"abc")), []) == []


@pytest.mark.parametrize("n_bytes", [0, 1, 3, 4, 5, 8])
def test_blocks_hold_every_byte_and_the_first_ones_of_the_next(n_bytes: int) -> None:
    """A place near the end, with fewer bytes behind it than the overlap, is in a block too."""
    content = bytes(range(n_bytes))
    blocks = [(start, block.tobytes()) for start, block in FileParts(io.BytesIO(content)).blocks(4, 3)]
    assert blocks == [(start, content[start : start + 7]) for start in range(0, n_bytes, 4)]


def test_a_mean_rate_counts_the_steps_between_the_rows() -> None:
    """Eleven rows in a second are ten steps."""
    assert mean_rate_hz(11, np.array([3.0, 4.0])) == pytest.approx(10.0)
    assert mean_rate_hz(11, np.array([3e6, 4e6]), 1e-6) == pytest.approx(10.0)


def test_a_row_without_a_time_takes_that_of_the_row_before_it() -> None:
    """At its own place its own; ahead of the first row with a time that one's."""
    times = time_before(np.array([5, 10, 15, 20, 99]), np.array([10, 20]), np.array([1.0, 2.0]))
    np.testing.assert_array_equal(times, [1.0, 1.0, 1.0, 2.0, 2.0])


def test_lost_bytes_inside_others_are_theirs() -> None:
    """Those that touch are joined, with the reason of the first; those apart stay apart."""
    blocks = [(0, 100), (20, 10), (100, 5), (300, 7)]
    lost = [LostBytes(offset=first, n_bytes=count, reason=str(first)) for first, count in blocks]
    found = [(one.offset, one.n_bytes, one.reason) for one in merge_lost(lost[::-1])]
    assert found == [(0, 105, "0"), (300, 7, "300")]
