"""The table of an autopilot's signals, and how signals are made by it.

Each autopilot has one table of `Source`. What to read from a file follows from it, and so do the signals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from quadid_logs.arrays import AnyArray, BoolArray, FloatArray, IntArray
from quadid_logs.data.log import NO_GYRO_FILTER, GyroFilter, Rows, Signal
from quadid_logs.maths.rotations import euler_from_quaternion

RPM: Final = 2.0 * math.pi / 60.0
#: Rows that are copied at once: they stay in the processor's cache from column to column.
_CHUNK: Final = 1 << 12


class Table(Protocol):
    """Rows of one message, in file order."""

    @property
    def position(self) -> IntArray:
        """Byte offset of each row."""

    def column(self, field: str) -> AnyArray | None:
        """Return a field of every row, None where there is none."""


T = TypeVar("T", bound=Table)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part(Generic[T]):
    """What a source is made of: the rows of a message, or of one sensor in it.

    ``name`` is the message and sensor as shown, ``note`` follows the source's
    reason, and ``log`` is what the autopilot's builders need beside the rows.
    """

    name: str
    table: T
    rows: Rows
    note: str = ""
    log: Any = None


class Built(NamedTuple):
    """What a builder made.

    Attributes
    ----------
    values : ndarray, shape (n_rows, n_columns)
    note : str
        What was decided, added to the source's reason.
    source : str
        Instead of the part's name and the source's fields.
    rows : Rows, optional
        Instead of the part's.
    """

    values: FloatArray
    note: str = ""
    source: str = ""
    rows: Rows | None = None


P = TypeVar("P", bound="Part[Any]")
Build = Callable[[P, "Source[P]"], "FloatArray | Built | None"]


def plain(part: P, source: Source[P]) -> FloatArray | None:
    """Put the fields side by side, times the scale.

    Returns
    -------
    ndarray, shape (n_rows, n_columns), or None
        None where a field is missing.
    """
    return stacked(part.table, source.fields, source.scale)


@dataclass(frozen=True, slots=True)
class Source(Generic[P]):
    """One row of an autopilot's table: where one signal comes from.

    Rows of one signal stand together, the preferred one first.

    Attributes
    ----------
    signal : str
        Canonical name, a key of `vocabulary.SIGNALS`.
    message : str
        The vendor's message or topic.
    fields : tuple of str
        Its fields; without one of them there is no signal.
    reason : str
        Why the source has its place, for the reader of the report.
    build : callable
        Makes the values, or None where the source was never in use.
    scale : float
        The signal's unit in units of the fields.
    label : str
        The fields as shown, where not by their names.
    optional : tuple of str
        Fields that the builder also takes where they are there.
    beside : tuple of str
        Messages that the builder also needs.
    filtered : bool
        Of body rates: they passed the filters that the parameters tell.
    raw : bool
        Of body rates: they passed none.
    normalised : bool
        Of torque commands: 1 is the end of their range.
    """

    signal: str
    message: str
    fields: tuple[str, ...]
    reason: str
    build: Build[P] = plain
    scale: float = 1.0
    label: str = ""
    optional: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    filtered: bool = False
    raw: bool = False
    normalised: bool = True


def messages_of(sources: Iterable[Source[Any]]) -> frozenset[str]:
    """Return every message that a table needs."""
    return frozenset(name for source in sources for name in (source.message, *source.beside))


def build_signals(
    sources: Iterable[Source[P]],
    parts_of: Callable[[Source[P]], Iterable[P]],
    *,
    separator: str = " ",
    gyro_filter: GyroFilter = NO_GYRO_FILTER,
    nominal_rate_hz: Mapping[str, float] | None = None,
) -> dict[str, tuple[Signal, ...]]:
    """Make the signals that a log holds.

    Parameters
    ----------
    parts_of : callable
        Returns what the log holds of a source: one part a sensor, none where it has no such message.
    separator : str
        Between the names of fields.
    gyro_filter : GyroFilter
        Of the filtered body rates.
    nominal_rate_hz : mapping of str to float, optional
        What the log's settings promise, by message.

    Returns
    -------
    dict of str to tuple of Signal
        By canonical name, in the order of the table.
    """
    found: dict[str, list[Signal]] = {}
    for source in sources:
        for part in parts_of(source):
            made = source.build(part, source)
            if made is None:
                continue
            built = made if isinstance(made, Built) else Built(made)
            signal = Signal(
                name=source.signal,
                rows=built.rows or part.rows,
                values=built.values,
                source=built.source or f"{part.name}.{source.label or separator.join(source.fields)}",
                reason="; ".join(filter(None, (source.reason + part.note, built.note))),
                nominal_rate_hz=(nominal_rate_hz or {}).get(source.message, math.nan),
                gyro_filter=gyro_filter if source.filtered else NO_GYRO_FILTER,
                raw=source.raw,
                normalised=source.normalised,
            )
            found.setdefault(source.signal, []).append(signal)
    return {name: tuple(signals) for name, signals in found.items()}


def stacked(
    table: Table, fields: Collection[str], scale: float = 1.0, dtype: DTypeLike = np.float64
) -> FloatArray | None:
    """Return fields side by side times a factor; None where one is missing.

    Parameters
    ----------
    fields : collection of str
        Each one number or an array of them per row.

    Returns
    -------
    ndarray, shape (n_rows, n_columns), or None
    """
    columns: list[AnyArray] = []
    for field in fields:
        column = table.column(field)
        if column is None or column.dtype.names is not None:
            return None
        columns += [column] if column.ndim == 1 else list(column.T)
    n_rows = len(table.position)
    values: FloatArray = np.empty((n_rows, len(columns)), dtype)
    with np.errstate(invalid="ignore"):  # damaged bytes can be signalling NaN
        for first in range(0, n_rows, _CHUNK):
            chunk = slice(first, first + _CHUNK)
            for number, column in enumerate(columns):
                values[chunk, number] = column[chunk]
            if scale != 1.0:
                values[chunk] *= scale
    return values


def attitude_columns(quaternion: FloatArray) -> FloatArray:
    """Return Euler 3-2-1 angles of quaternions w, x, y, z (body FRD to Earth NED).

    Parameters
    ----------
    quaternion : ndarray, shape (n_rows, 4)

    Returns
    -------
    ndarray, shape (n_rows, 3)
        Roll, pitch, yaw [rad]; NaN where the quaternion is zero, as before the estimator has started.
    """
    is_zero = ~quaternion.any(axis=1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        euler = euler_from_quaternion(quaternion)
    euler[is_zero] = np.nan
    return euler


def attitude(part: Part[Any], source: Source[Any]) -> FloatArray | None:
    """Make Euler angles of a quaternion w, x, y, z."""
    quaternion = plain(part, source)
    return None if quaternion is None else attitude_columns(quaternion)


def used_columns(values: FloatArray, in_use: BoolArray) -> FloatArray | None:
    """Leave out the columns behind the last one that is ever `in_use`; None where none is.

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_columns)
    in_use : ndarray of bool, shape (n_rows, n_columns)

    Returns
    -------
    ndarray, shape (n_rows, 1 or more), or None
    """
    columns = np.flatnonzero(in_use.any(axis=0))
    return values[:, : columns[-1] + 1] if len(columns) else None
