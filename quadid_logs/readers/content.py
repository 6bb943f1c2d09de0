"""Bytes of a log file, and rows cut out of them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import AnyArray, IntArray
from quadid_logs.data.log import LostStretch
from quadid_logs.errors import LogError

Bytes: TypeAlias = NDArray[np.uint8]


def load_bytes(path: str | Path) -> Bytes:
    """Return the whole file as bytes.

    Read, not mapped: a file that shrinks while it is mapped kills the process,
    and reading runs at 2.6 GB/s.
    """
    return np.fromfile(path, dtype=np.uint8)


class FileParts:
    """An open file that is read part by part, so that it is never in memory as a whole.

    Read, not mapped, for the reason that `load_bytes` gives. The size is that
    at the beginning: what is appended later is not seen.

    Parameters
    ----------
    stream : binary file
    path : str
        Its name, for errors.
    """

    def __init__(self, stream: BinaryIO, path: str = "") -> None:
        self._stream = stream
        self._path = path
        self.n_bytes = stream.seek(0, os.SEEK_END)

    def part(self, start: int, stop: int) -> Bytes:
        """Return the bytes from `start` up to `stop` or the end of the file.

        Raises
        ------
        LogError
            If the file has become shorter since it was opened.
        """
        return self._fill(np.empty(max(0, min(stop, self.n_bytes) - start), np.uint8), start)

    def blocks(self, size: int, overlap: int) -> Iterator[tuple[int, Bytes]]:
        """Yield the file in blocks, each with `overlap` bytes of the next one, and where they begin.

        All share one buffer, which keeps it in the processor's cache: a block
        is only valid until the next one.
        """
        buffer = np.empty(size + overlap, np.uint8)
        for start in range(0, self.n_bytes - overlap, size):
            yield start, self._fill(buffer[: self.n_bytes - start], start)

    def _fill(self, found: Bytes, start: int) -> Bytes:
        """Read from `start` on until the array is full."""
        if len(found):
            self._stream.seek(start)
            if self._stream.readinto(found) != len(found):  # type: ignore[attr-defined]
                raise LogError(
                    f"{self._path} became shorter while it was read.",
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
    data : ndarray of uint8
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


def merge_stretches(stretches: list[LostStretch]) -> tuple[LostStretch, ...]:
    """Sort the lost stretches and join those that touch."""
    merged: list[LostStretch] = []
    for stretch in sorted(stretches, key=lambda lost: lost.offset):
        before = merged[-1] if merged else None
        if before is not None and stretch.offset <= before.offset + before.n_bytes:
            end = max(before.offset + before.n_bytes, stretch.offset + stretch.n_bytes)
            merged[-1] = LostStretch(offset=before.offset, n_bytes=end - before.offset, reason=before.reason)
        elif stretch.n_bytes > 0:
            merged.append(stretch)
    return tuple(merged)
