"""Turn series into rows of fixed length and merge the rows of all messages into one file.

Both DataFlash and ULog are streams of packed little-endian records. One
record type is one numpy structured dtype; its rows are made and merged in
blocks, so that a log of any length needs little more memory than the
FlightLog itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from quadid_logs.arrays import AnyArray, IntArray

#: Revolutions a minute in a rad/s.
RPM = 30.0 / math.pi
#: Rows merged at once: large enough for numpy, small enough for any memory.
BLOCK_ROWS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Column:
    """A field's values, scaled only when its rows are written.

    Attributes
    ----------
    values : ndarray, shape (n_rows,) or (n_rows, n_elements)
        One value or one array per row.
    scale : float
        Factor from the values to the field's unit.
    """

    values: AnyArray
    scale: float = 1.0

    def rows(self, start: int, stop: int) -> AnyArray:
        """Return the scaled values of some rows."""
        part = self.values[start:stop]
        return part if self.scale == 1.0 else part * self.scale


Field = Column | AnyArray | float | bytes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Records:
    """All rows of one message.

    Attributes
    ----------
    dtype : structured dtype
        The packed row as it stands in the file, its header included.
    key_us : ndarray of int64, shape (n_rows,)
        Never falling; the rows of all messages are merged in its order [µs].
    fields : mapping of str to Column, ndarray or constant
        A nested field is named with dots. What is missing is zero.
    """

    dtype: np.dtype[np.void]
    key_us: IntArray
    fields: Mapping[str, Field]

    def encode(self, start: int, stop: int) -> AnyArray:
        """Return rows start to stop as opaque items of the row's length."""
        rows = np.zeros(stop - start, dtype=self.dtype)
        for name, field in self.fields.items():
            target = rows
            for part in name.split("."):
                target = target[part]
            if isinstance(field, Column):
                field = field.rows(start, stop)
            elif isinstance(field, np.ndarray):
                field = field[start:stop]
            target[...] = fit(field, target.dtype)
        return rows.view(f"V{self.dtype.itemsize}")


def fit(values: Field, dtype: np.dtype[Any]) -> AnyArray:
    """Convert to a field's type as a firmware does: round, and stay inside the integer's range."""
    array = np.asarray(values)
    if dtype.kind not in "iu" or array.dtype.kind not in "fiu":
        return array
    limits = np.iinfo(dtype)
    if array.dtype.kind == "f":
        array = np.rint(np.nan_to_num(array, nan=0.0))
    clipped: AnyArray = np.clip(array, limits.min, limits.max)
    return clipped.astype(dtype)


def write_merged(file: BinaryIO, streams: Sequence[Records]) -> None:
    """Write the rows of all messages in the order of their keys.

    Rows of one message keep their order; at equal keys the earlier message of
    `streams` comes first.
    """
    filled = [stream for stream in streams if stream.key_us.size]
    if not filled:
        return
    starts = [0] * len(filled)
    # Cut all messages at common keys into blocks of about `BLOCK_ROWS` rows.
    n_rows = sum(stream.key_us.size for stream in filled)
    longest = max((stream.key_us for stream in filled), key=len)
    cut_rows = np.linspace(0, longest.size, n_rows // BLOCK_ROWS + 2)[1:-1].astype(np.int64)
    cuts = np.unique(longest[cut_rows])
    ends = np.stack([np.searchsorted(stream.key_us, cuts) for stream in filled], axis=-1)
    for stops in [*ends.tolist(), [stream.key_us.size for stream in filled]]:
        _write_block(file, filled, starts, stops)
        starts = stops


def _write_block(
    file: BinaryIO, streams: Sequence[Records], starts: Sequence[int], stops: Sequence[int]
) -> None:
    """Merge some rows of every message in memory and write them."""
    counts = np.subtract(stops, starts)
    sizes = np.repeat([stream.dtype.itemsize for stream in streams], counts)
    keys = np.concatenate(
        [stream.key_us[start:stop] for stream, start, stop in zip(streams, starts, stops, strict=True)]
    )
    order = np.argsort(keys, kind="stable")
    offsets = np.empty(order.size, dtype=np.int64)
    ends = np.cumsum(sizes[order])
    offsets[order] = ends - sizes[order]
    block = np.empty(int(sizes.sum()), dtype=np.uint8)
    bounds = np.concatenate(([0], np.cumsum(counts)))
    for stream, start, stop, low, high in zip(streams, starts, stops, bounds[:-1], bounds[1:], strict=True):
        if stop > start:
            size = stream.dtype.itemsize
            # One item at every byte: a row is then stored by a single indexed assignment.
            places: AnyArray = np.ndarray(
                shape=(block.size - size + 1,), dtype=f"V{size}", buffer=block.data, strides=(1,)
            )
            places[offsets[low:high]] = stream.encode(start, stop)
    file.write(block.data)
