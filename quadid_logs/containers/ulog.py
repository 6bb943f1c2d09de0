"""PX4's ULog: topics as columns, parameters, texts and dropouts, and what was lost."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from quadid_logs.arrays import AnyArray, IntArray
from quadid_logs.containers.content import FileParts, mean_rate_hz, rows_of_types
from quadid_logs.containers.ulog_definitions import Definitions
from quadid_logs.containers.ulog_frames import Frames, frame
from quadid_logs.data.log import LostBytes, MessageCount

TopicKey = tuple[str, int]
"""Name of a topic and its instance."""

_MESSAGE_HEADER = 5
"""Size, type and id before a row."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TopicTable:
    """The rows of one topic instance, in file order.

    Attributes
    ----------
    name, multi_id : str, int
        Topic and instance.
    rows : structured ndarray, shape (n_rows,)
        Arrays are sub-arrays, nested types nested structures.
    position : ndarray of int64, shape (n_rows,)
        Byte offset of each message in the file.
    """

    name: str
    multi_id: int
    rows: AnyArray
    position: IntArray

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the top-level fields."""
        return tuple(self.rows.dtype.names or ())

    def has(self, field: str, kinds: str = "iu") -> bool:
        """Tell whether a field holds one number of these kinds (of numpy dtypes) per row."""
        return holds(self.rows.dtype, field, kinds)

    def column(self, field: str) -> AnyArray | None:
        """Return a field of every row, as ``roll``, ``xyz`` or ``q[1]``; None where there is none."""
        name, _, index = field.partition("[")
        if name not in self.fields:
            return None
        values: AnyArray = self.rows[name]
        if not index:
            return values
        k = int(index.rstrip("]"))
        return values[:, k] if values.ndim == 2 and k < values.shape[1] else None

    def columns(self) -> dict[str, AnyArray]:
        """Return one array per number, with names as ``control[0]`` or ``esc[1].esc_rpm``."""
        return _flatten("", self.rows)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UlogContent:
    """A ULog file: some of its topics, and everything else that it says.

    `n_unknown` counts messages that no subscription or type explains,
    `n_joined` the further files that were appended to the first one.
    """

    topics: Mapping[TopicKey, TopicTable]
    definitions: Definitions
    counts: tuple[MessageCount, ...]
    lost: tuple[LostBytes, ...]
    n_unknown: int
    n_joined: int
    n_bytes: int


def holds(layout: np.dtype[np.void], field: str, kinds: str) -> bool:
    """Tell whether a row has the field, as one number of these kinds; a damaged format makes arrays of it."""
    return field in (layout.names or ()) and layout[field].kind in kinds


def read_topics(path: str | Path, topics: Collection[str] | None = None) -> dict[TopicKey, TopicTable]:
    """Return the rows of the topics.

    Parameters
    ----------
    topics : collection of str, optional
        Names to decode; all by default.
    """
    return dict(read_content(path, topics).topics)


def read_content(path: str | Path, topics: Collection[str] | None = None) -> UlogContent:
    """Read a ULog file, decoding only the rows of the given topics (all by default)."""
    with closing(FileParts.open(path)) as file:
        frames = frame(file)
        chosen = _wanted_rows(frames, topics)
        wanted = [(starts, layout) for _, layout, starts in chosen]
        found = rows_of_types(file, wanted, behind=_MESSAGE_HEADER)
        counts = _counts(file, frames)
    tables: dict[TopicKey, list[TopicTable]] = {}
    for (key, _, starts), rows in zip(chosen, found, strict=True):
        table = TopicTable(name=key[0], multi_id=key[1], rows=rows, position=starts)
        tables.setdefault(key, []).append(table)
    return UlogContent(
        topics={key: _join(parts) for key, parts in sorted(tables.items())},
        definitions=frames.definitions,
        counts=counts,
        lost=frames.lost,
        n_unknown=frames.n_unknown,
        n_joined=frames.n_joined,
        n_bytes=file.n_bytes,
    )


def _wanted_rows(
    frames: Frames, topics: Collection[str] | None
) -> list[tuple[TopicKey, np.dtype[np.void], IntArray]]:
    """Return where the rows of every wanted topic and layout are: a topic can be subscribed many times."""
    starts_of: dict[tuple[TopicKey, int], list[IntArray]] = {}
    layouts: dict[int, np.dtype[np.void]] = {}
    for subscription, starts in zip(frames.definitions.subscriptions, frames.starts, strict=True):
        if len(starts) and (topics is None or subscription.name in topics):
            # By identity: a layout that did not change is the same object, and comparing goes by fields.
            number = id(subscription.dtype)
            layouts[number] = subscription.dtype
            starts_of.setdefault(((subscription.name, subscription.multi_id), number), []).append(starts)
    return [
        (key, layouts[number], parts[0] if len(parts) == 1 else np.sort(np.concatenate(parts)))
        for (key, number), parts in starts_of.items()
    ]


def _flatten(prefix: str, values: AnyArray) -> dict[str, AnyArray]:
    """Split nested structures and sub-arrays into columns of numbers."""
    columns: dict[str, AnyArray] = {}
    for name in values.dtype.names or ():
        part = values[name]
        named = {f"{prefix}{name}": part}
        if part.ndim > 1:
            named = {f"{prefix}{name}[{k}]": part[:, k] for k in range(part.shape[1])}
        for column_name, column in named.items():
            if column.dtype.names is None:
                columns[column_name] = column
            else:
                columns |= _flatten(f"{column_name}.", column)
    return columns


def _join(tables: list[TopicTable]) -> TopicTable:
    """Put the tables of one topic together: it can be subscribed again, or come from a joined file."""
    first = tables[0]
    if len(tables) == 1:
        return first
    if any(table.rows.dtype != first.rows.dtype for table in tables):
        # Firmware changed between joined files: keep what all of them have.
        shared = [
            name
            for name in first.fields
            if all(
                name in table.fields and table.rows.dtype[name] == first.rows.dtype[name] for table in tables
            )
        ]
        # Packed: a dtype without holes.
        rows = np.concatenate(
            [
                table.rows[shared].astype(np.dtype([(name, first.rows.dtype[name]) for name in shared]))
                for table in tables
            ]
        )
    else:
        rows = np.concatenate([table.rows for table in tables])
    position = np.concatenate([table.position for table in tables])
    order = np.argsort(position, kind="stable")
    return TopicTable(name=first.name, multi_id=first.multi_id, rows=rows[order], position=position[order])


def _counts(file: FileParts, frames: Frames) -> tuple[MessageCount, ...]:
    """Count the rows of every topic, with their mean rate."""
    counts = []
    for subscription, starts in zip(frames.definitions.subscriptions, frames.starts, strict=True):
        if len(starts):
            name = subscription.name + (f"[{subscription.multi_id}]" if subscription.multi_id else "")
            # When the first and the last row were logged [us]; None where they have no time, or are one.
            layout = subscription.dtype
            first_and_last_us = None
            if len(starts) >= 2 and holds(layout, "timestamp", "iuf"):
                ends = (starts[[0, -1]] + _MESSAGE_HEADER).tolist()
                first_and_last_us = np.array(
                    [float(file.part(at, at + layout.itemsize).view(layout)["timestamp"][0]) for at in ends]
                )
            rate_hz = mean_rate_hz(len(starts), first_and_last_us, 1e-6)
            counts.append(MessageCount(name=name, count=len(starts), rate_hz=rate_hz))
    return tuple(sorted(counts, key=lambda count: count.name))
