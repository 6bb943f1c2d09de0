"""Bytes of a log file, and rows cut out of them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, Final, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import AnyArray, FloatArray, IntArray
from quadid_logs.data.log import LostBytes, MessageCount
from quadid_logs.errors import LogError

Bytes: TypeAlias = NDArray[np.uint8]

_HUGE_PAGE: Final = 1 << 21
#: In less memory than this, what is left of the last huge page would be more than a quarter.
_WORTH_ALIGNING: Final = 1 << 23
_KEPT_BYTES: Final = 1 << 23
#: As much of a file stays in the processor's cache while the rows of all types are cut out of it.
_PART_BYTES: Final = 1 << 20
#: Text is held in memory as a whole; 100 hours of 20 columns at 100 Hz are less.
_MOST_TEXT: Final = 1 << 31


def room_for(n_bytes: int) -> Bytes:
    """Return memory that is not initialised; much of it in whole huge pages.

    For large arrays numpy asks the system for huge pages, which it can only give
    where both ends of one lie inside: the begin is moved to such a place, and the
    end left room. Of 16 MB up to 4 would come by pages of 4 kB otherwise, 1 us each.
    """
    if n_bytes < _WORTH_ALIGNING:
        return np.empty(n_bytes, np.uint8)
    room = np.empty(n_bytes + 2 * _HUGE_PAGE, np.uint8)
    begin = -room.__array_interface__["data"][0] % _HUGE_PAGE
    return room[begin : begin + n_bytes]


class FileParts:
    """An open file that is read part by part, so that it is never in memory as a whole.

    Read, not mapped: a file that shrinks while it is mapped kills the process.
    The size is that at the beginning: what is appended later is not seen.

    Parameters
    ----------
    stream : binary file
    path : str
        Its name, for errors.
    """

    def __init__(self, stream: BinaryIO, path: str = "") -> None:
        self._stream = stream
        self.path = path
        self.n_bytes = stream.seek(0, os.SEEK_END)

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a file; whoever does closes it.

        Raises
        ------
        OSError
            If it cannot be opened.
        """
        # Let the C library keep arrays of up to 8 MB that are done with, for the next ones. glibc hands back
        # what is larger than the largest block that was freed so far (mallopt(3), M_MMAP_THRESHOLD), at first
        # 128 kB. The system zeroes every page again before its next use, which costs more than most of what
        # is done with it.
        np.empty(_KEPT_BYTES, np.uint8)
        return cls(Path(path).open("rb"), str(path))

    def part(self, start: int, stop: int) -> Bytes:
        """Return the bytes from `start` up to `stop` or the end of the file.

        Raises
        ------
        LogError
            If the file has become shorter since it was opened.
        """
        return self.fill(np.empty(max(0, min(stop, self.n_bytes) - start), np.uint8), start)

    def blocks(self, size: int, overlap: int) -> Iterator[tuple[int, Bytes]]:
        """Yield the file in blocks, each with `overlap` bytes of the next one, and where they begin.

        All use one buffer, which keeps it in the processor's cache: a block
        is only valid until the next one.

        Parameters
        ----------
        size, overlap : int
            [bytes].

        Yields
        ------
        start : int
            Byte offset of the block.
        block : ndarray of uint8, shape (up to size + overlap,)
        """
        buffer = np.empty(size + overlap, np.uint8)
        for start in range(0, self.n_bytes, size):
            yield start, self.fill(buffer, start)

    def fill(self, buffer: Bytes, start: int) -> Bytes:
        """Read from `start` on until the buffer is full or the file ends; return what of it is filled.

        Raises
        ------
        LogError
            As `part`.
        """
        found = buffer[: max(0, self.n_bytes - start)]
        if len(found):
            self._stream.seek(start)
            if self._stream.readinto(found) != len(found):  # type: ignore[attr-defined]
                raise LogError(
                    f"{self.path} became shorter while it was read.",
                    hint="Wait until it is complete, or read a copy.",
                )
        return found

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def rows_at(data: Bytes, offsets: IntArray, dtype: np.dtype[np.void]) -> AnyArray:
    """Cut one row of `dtype` out of `data` at every offset.

    The gather moves whole rows as opaque bytes, then reads them as `dtype`: a
    structured dtype in the gather itself measured 2 to 3 times slower.

    Parameters
    ----------
    offsets : ndarray of int64, shape (n_rows,)
        Each with a whole row before the end of `data`.

    Returns
    -------
    ndarray of `dtype`, shape (n_rows,)
    """
    size = dtype.itemsize
    if not len(offsets) or not size:
        return np.zeros(len(offsets), dtype)
    opaque = np.ndarray(
        shape=(len(data) - size + 1,), dtype=np.dtype((np.void, size)), buffer=data, strides=(1,)
    )
    rows: AnyArray = opaque[offsets].view(dtype)
    return rows


def rows_of_types(
    file: FileParts, wanted: Sequence[tuple[IntArray, np.dtype[np.void]]], *, behind: int = 0
) -> list[AnyArray]:
    """Cut the rows of several types out of a file, all into one block of memory.

    Parameters
    ----------
    wanted : sequence of (offsets, dtype)
        As of `rows_at`, the offsets in ascending order.
    behind : int
        How many bytes each row lies behind its offset.

    Returns
    -------
    list of ndarray, each of its `dtype`, shape (n_rows,)
        Views of one array: who keeps one, keeps all.
    """
    sizes = [len(offsets) * dtype.itemsize for offsets, dtype in wanted]
    # Each type begins where a number of eight bytes may.
    ends = np.cumsum([size + -size % 8 for size in sizes], dtype=np.int64).tolist()
    room = room_for(ends[-1] if ends else 0)
    tables = [
        room[end - size - -size % 8 :][:size].reshape(len(offsets), dtype.itemsize)
        for (offsets, dtype), size, end in zip(wanted, sizes, ends, strict=True)
    ]
    edges = np.arange(0, file.n_bytes + _PART_BYTES, _PART_BYTES)
    bounds = [offsets.searchsorted(edges).tolist() for offsets, _ in wanted]
    longest = max((dtype.itemsize for _, dtype in wanted), default=0)
    for number, (start, part) in enumerate(file.blocks(_PART_BYTES, behind + longest)):
        for (offsets, dtype), rows, bound in zip(wanted, tables, bounds, strict=True):
            here = slice(bound[number], bound[number + 1])
            found = rows_at(part, offsets[here] + (behind - start), dtype)
            rows[here] = found.view(np.uint8).reshape(-1, dtype.itemsize)
    return [rows.reshape(-1).view(dtype) for rows, (_, dtype) in zip(tables, wanted, strict=True)]


def mean_rate_hz(count: int, time: FloatArray | None, unit_s: float = 1.0) -> float:
    """Return rows per second between the first and the last time, NaN where that cannot be told.

    Parameters
    ----------
    time : ndarray, shape (n_times,), or None
        The first and the last matter.
    unit_s : float
        Of the times [s].

    Returns
    -------
    float
        [Hz].
    """
    duration_s = float(time[-1] - time[0]) * unit_s if time is not None and len(time) > 1 else 0.0
    return (count - 1) / duration_s if duration_s > 0.0 else float("nan")


def message_counts(
    counts: Mapping[str, int], times: Mapping[str, FloatArray | None]
) -> tuple[MessageCount, ...]:
    """Return rows and mean rate of every message type by name, from its first and last time [s]."""
    return tuple(
        MessageCount(name=name, count=count, rate_hz=mean_rate_hz(count, times.get(name)))
        for name, count in sorted(counts.items())
    )


def time_before(position: IntArray, known_at: IntArray, known_s: FloatArray) -> FloatArray:
    """Return for places in a file the time of the last row with a time before them.

    Parameters
    ----------
    position : ndarray of int64, shape (n_rows,)
        Byte offsets.
    known_at, known_s : ndarray, shape (n_known,)
        Byte offsets, rising, and times [s] of the rows with a time.

    Returns
    -------
    ndarray, shape (n_rows,)
        Before the first of them its time; NaN where there is none.
    """
    if not len(known_at):
        return np.full(len(position), np.nan)
    before = np.searchsorted(known_at, position, side="right") - 1
    times: FloatArray = known_s[np.maximum(before, 0)]
    return times


def text_content(path: str | Path) -> bytes:
    """Read a text file as a whole.

    Raises
    ------
    LogError
        If it is larger than any flight: mostly a file with holes, which takes no room on the disk.
    OSError
        If it cannot be read.
    """
    n_bytes = Path(path).stat().st_size
    if n_bytes > _MOST_TEXT:
        raise LogError(
            f"{path} is a text of {n_bytes / 1000000000.0:.1f} GB, more than the "
            f"{_MOST_TEXT / 1000000000.0:.1f} GB that can be read.",
            hint="Split it, or give the original log of the autopilot.",
        )
    return Path(path).read_bytes()


def decode_text(raw: bytes) -> str:
    """Decode UTF-8, else Latin-1, so that no byte is refused."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def merge_lost(lost: list[LostBytes]) -> tuple[LostBytes, ...]:
    """Sort lost bytes and join those that touch.

    Parameters
    ----------
    lost : list of LostBytes
        In any order, overlapping or not.

    Returns
    -------
    tuple of LostBytes
        Rising, none empty; of those that touch, the reason of the first.
    """
    merged: list[LostBytes] = []
    for block in sorted(lost, key=lambda one: one.offset):
        before = merged[-1] if merged else None
        if before is not None and block.offset <= before.offset + before.n_bytes:
            end = max(before.offset + before.n_bytes, block.offset + block.n_bytes)
            merged[-1] = LostBytes(offset=before.offset, n_bytes=end - before.offset, reason=before.reason)
        elif block.n_bytes > 0:
            merged.append(block)
    return tuple(merged)
