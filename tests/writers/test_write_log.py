"""Files as a whole: formats by suffix, repeatable bytes, nothing half-written."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.writers import records, write_log

from .conftest import flight, px4_flight

NAMES = ("a.bin", "a.ulg", "a.tlog")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("make", [flight, px4_flight])
def test_the_same_log_gives_the_same_bytes(tmp_path: Path, name: str, make: Callable[[], FlightLog]) -> None:
    """Nothing but the FlightLog reaches the file: no clock, no random id, no path."""
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    for folder in ("one", "two"):
        write_log(make(), tmp_path / folder / name)
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_a_log_without_any_series_is_still_a_file(tmp_path: Path, name: str) -> None:
    """An empty flight has a header and no rows."""
    write_log(flight(signals={}, modes=(), texts=()), tmp_path / name)
    assert (tmp_path / name).stat().st_size > 16


def test_an_unknown_suffix_is_refused(tmp_path: Path) -> None:
    """The message says which suffixes there are."""
    with pytest.raises(SettingsError, match=r"\.bin, \.ulg, \.bbl, \.tlog or \.usd"):
        write_log(flight(), tmp_path / "flight.csv")


def test_a_missing_folder_is_an_output_error(tmp_path: Path) -> None:
    """With the reason and what to do."""
    with pytest.raises(OutputError, match="Check that the folder exists"):
        write_log(flight(), tmp_path / "missing" / "a.bin")


@pytest.mark.parametrize("name", NAMES)
def test_a_failed_write_leaves_nothing_behind(tmp_path: Path, name: str) -> None:
    """Neither half a file nor a temporary one; an older file stays as it was."""
    (tmp_path / name).write_bytes(b"older")
    nowhen = Signal(
        name="attitude",
        rows=Rows(np.array([np.nan]), np.zeros(1, dtype=np.int64)),
        values=np.zeros((1, 3)),
        source="ATT",
    )
    with pytest.raises(OutputError, match="finite time"):
        write_log(flight(signals={"attitude": (nowhen,)}), tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"older"


def test_a_folder_of_that_name_is_not_replaced(tmp_path: Path) -> None:
    """It is an error, and nothing is left beside it."""
    (tmp_path / "a.bin").mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        write_log(flight(), tmp_path / "a.bin")
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


@given(
    lengths=st.lists(st.integers(1, 7), min_size=1, max_size=4),
    keys=st.lists(st.lists(st.integers(0, 20), max_size=30), min_size=4, max_size=4),
    block_rows=st.integers(1, 200),
)
def test_merging_in_blocks_equals_one_stable_sort(
    lengths: list[int], keys: list[list[int]], block_rows: int
) -> None:
    """Whatever the size of a block, rows stand in the order of their keys, then of their message."""
    streams = [
        records.Records(
            dtype=np.dtype([("stream", "u1"), ("rest", "u1", (length,))]),
            key_us=np.array(sorted(keys[i]), dtype=np.int64),
            fields={"stream": i, "rest": np.array(sorted(keys[i]), dtype=np.int64)[:, np.newaxis]},
        )
        for i, length in enumerate(lengths)
    ]
    rows = [
        (key, i, bytes([i]) + bytes([key]) * length)
        for i, length in enumerate(lengths)
        for key in sorted(keys[i])
    ]
    expected = b"".join(row for _, _, row in sorted(rows, key=lambda row: row[:2]))
    file = io.BytesIO()
    before, records.BLOCK_ROWS = records.BLOCK_ROWS, block_rows
    try:
        records.write_merged(file, streams)
    finally:
        records.BLOCK_ROWS = before
    assert file.getvalue() == expected
