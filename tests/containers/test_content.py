"""Bytes of a file, and rows cut out of them."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.containers.content import FileParts, room_for, rows_at, rows_of_types
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
