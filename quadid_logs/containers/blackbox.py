"""Betaflight's Blackbox: frames as columns, settings, events, and what was lost."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, IntArray
from quadid_logs.containers.blackbox_encodings import frame_values, groups_of
from quadid_logs.containers.blackbox_frames import BLOCK_BYTES, Event, Frames, blocks_of, find_frames
from quadid_logs.containers.blackbox_header import MAGIC, Accept, Header, find_logs, read_header
from quadid_logs.containers.blackbox_predictors import add_constants, add_differences, add_places
from quadid_logs.containers.content import FileParts, merge_lost
from quadid_logs.data.log import LostBytes
from quadid_logs.errors import EmptyLogError, SettingsError, SeveralLogsError, UnknownFormatError

#: Blackbox Explorer's limit [us]: between two frames of differences no log pauses.
_LONGEST_PAUSE_US: Final = 10_000_000
#: All fields of so many frames are decoded at once, before those that nobody wants are let go.
_CHUNK_FRAMES: Final = 1 << 15
#: 16 bits hold values from minus this up to it, without it.
_HALF: Final = 1 << 15

Column: TypeAlias = NDArray[np.int16] | NDArray[np.int32]
Wanted: TypeAlias = Callable[[tuple[str, ...]], Collection[str]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameTable:
    """The frames of one kind, in file order.

    Attributes
    ----------
    columns : dict of str to ndarray of int16 or int32, shape (n_frames,)
        By field, modulo 2^32; 16 bits where they hold all of it.
    signed : mapping of str to bool
        Whether a field is below zero where its highest bit is set.
    position : ndarray of int64, shape (n_frames,)
        Byte offset of each frame in the file.
    """

    columns: dict[str, Column]
    signed: Mapping[str, bool]
    position: IntArray

    @property
    def names(self) -> tuple[str, ...]:
        """The fields that are there."""
        return tuple(self.columns)

    def let_go(self, field: str) -> None:
        """Forget a field, or all numbers of one that stands in brackets behind its name."""
        for name in self.names:
            if name == field or name.startswith(f"{field}["):
                del self.columns[name]

    def column(self, field: str) -> Column | NDArray[np.uint32] | None:
        """Return a field of every frame, None where there is none."""
        column = self.columns.get(field)
        if column is None or self.signed[field] or column.min(initial=0) >= 0:
            return column
        return column.astype(np.int32).view(np.uint32)

    @property
    def values(self) -> NDArray[np.int32]:
        """All fields side by side, modulo 2^32; shape (n_frames, n_fields)."""
        return np.stack([column.astype(np.int32) for column in self.columns.values()], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlackboxContent:
    """One log of a Blackbox file.

    Attributes
    ----------
    header : Header
    tables : mapping of str to FrameTable
        By letter: I for complete frames and those of differences in between, S, G and H.
    events : tuple of Event
    lost : tuple of LostBytes
        Of this log.
    starts : tuple of int
        Where each log of the file begins.
    number : int
        Of this log in the file, from 1.
    n_bytes : int
        Of the file.
    """

    header: Header
    tables: Mapping[str, FrameTable]
    events: tuple[Event, ...]
    lost: tuple[LostBytes, ...]
    starts: tuple[int, ...]
    number: int
    n_bytes: int


def is_mine(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a Blackbox file."""
    return head.lstrip(b"\r\n\0\xff")[: len(MAGIC)] == MAGIC


def read_content(
    path: str | Path,
    wanted: Wanted | None = None,
    *,
    number: int = 0,
    accept: Accept | None = None,
) -> BlackboxContent:
    """Read one log of a Blackbox file.

    Parameters
    ----------
    wanted : callable, optional
        Is given the fields of the main frames, and returns those to keep; all by default. Loop and time are
        always kept.
    number : int
        Which of the logs in the file, from 1; 0 takes the only one that holds frames.
    accept : callable, optional
        Is given a header's lines by name, and raises for a log of another writer.

    Raises
    ------
    OSError
        If the file cannot be opened.
    UnknownFormatError
        If the header does not say how frames are written.
    EmptyLogError
        If the file holds no log.
    SettingsError
        If there is no log of that number.
    SeveralLogsError
        If several logs hold frames and `number` is 0.
    """
    with closing(FileParts.open(path)) as file:
        starts = find_logs(file)
        if not starts:
            raise EmptyLogError(f"{path} holds no Blackbox log.", hint="Download it again.")
        if number == 0:
            number = _only_one(file, starts, accept)
        if not 1 <= number <= len(starts):
            raise SettingsError(
                f"There is no log {number} in {path}.",
                hint=f"The file holds {len(starts)} logs, counted from 1.",
            )
        header = _header(file, starts, number, accept)
        frames = find_frames(file, header)
        lost = list(frames.lost)
        main = _main_table(file, header, frames, wanted, lost)
        tables = {"I": main} | _other_tables(file, header, frames, main)
        return BlackboxContent(
            header=header,
            tables=tables,
            events=tuple(frames.events),
            lost=merge_lost(lost),
            starts=tuple(starts),
            number=number,
            n_bytes=file.n_bytes,
        )


def _header(file: FileParts, starts: Sequence[int], number: int, accept: Accept | None) -> Header:
    """Read the header of one of the logs, counted from 1."""
    stop = [*starts[1:], file.n_bytes][number - 1]
    return read_header(file, starts[number - 1], stop, accept)


def _only_one(file: FileParts, starts: Sequence[int], accept: Accept | None) -> int:
    """Return the number of the only log that holds frames, 1 where none does."""
    if len(starts) == 1:
        return 1
    found, durations_s = {}, {}
    for number in range(1, len(starts) + 1):
        try:
            frames = find_frames(file, _header(file, starts, number, accept))
        except UnknownFormatError:
            continue
        if len(frames.starts["I"]):
            n_frames = len(frames.starts["I"]) + len(frames.starts["P"])
            found[number] = f"log {number}: {frames.duration_s:.1f} s, {n_frames} frames"
            durations_s[number] = frames.duration_s
    if len(found) < 2:
        return next(iter(found), 1)
    n_empty = len(starts) - len(found)
    raise SeveralLogsError(
        f"{file.path} holds {len(found)} logs" + (f" and {n_empty} empty ones." if n_empty else "."),
        hint="Choose one with --log N: "
        + ", ".join(f"{number} ({length_s:.1f} s)" for number, length_s in durations_s.items())
        + ".",
        logs=tuple(found.values()),
        durations_s=durations_s,
    )


def _main_table(
    file: FileParts,
    header: Header,
    frames: Frames,
    wanted: Wanted | None,
    lost: list[LostBytes],
) -> FrameTable:
    """Decode complete frames and those of differences, without those that cannot be true."""
    layout = header.layouts["I"]
    some = layout.names if wanted is None else frozenset(wanted(layout.names))
    kept = [number for number, name in enumerate(layout.names) if number < 2 or name in some]
    position = np.concatenate([frames.starts["I"], frames.starts["P"]])
    order = np.argsort(position, kind="stable")
    position, is_complete = position[order], (order < len(frames.starts["I"]))
    del order
    columns: list[Column] = [np.empty(len(position), np.int16) for _ in kept]
    good = np.empty(len(position), np.bool_)
    for rows in _chunks(is_complete):
        stop = int(position[rows.stop]) if rows.stop < len(position) else header.stop
        values, good[rows] = _decoded(file, header, position[rows], is_complete[rows], stop)
        for number, field in enumerate(kept):
            found = values[:, field]
            fits = not found.size or bool(found.min() >= -_HALF and found.max() < _HALF)
            # 32 bits from the first value on that needs them.
            if not fits and columns[number].dtype == np.int16:
                columns[number] = columns[number].astype(np.int32)
            columns[number][rows] = found
    ends = np.append(position[1:], position[-1:] + 1)
    lost += [
        LostBytes(offset=at, n_bytes=end - at, reason="frames that jump in time")
        for at, end in zip(position[~good].tolist(), ends[~good].tolist(), strict=True)
    ]
    if not good.all():
        position, columns = position[good], [column[good] for column in columns]
    return FrameTable(
        columns=dict(zip([layout.names[number] for number in kept], columns, strict=True)),
        signed=dict(zip(layout.names, layout.signed, strict=True)),
        position=position,
    )


def _chunks(is_complete: BoolArray) -> Iterator[slice]:
    """Yield rows in chunks that begin with a complete frame, so that each is decoded by itself."""
    begins = np.flatnonzero(is_complete)
    first = 0
    while first < len(is_complete):
        after = np.searchsorted(begins, first + _CHUNK_FRAMES)
        stop = int(begins[after]) if after < len(begins) else len(is_complete)
        yield slice(first, stop)
        first = stop


def _decoded(
    file: FileParts, header: Header, position: IntArray, is_complete: BoolArray, stop: int
) -> tuple[NDArray[np.int32], BoolArray]:
    """Return all fields of frames (n_frames, n_fields) up to a place in the file, and which are true."""
    values = np.empty((len(position), len(header.layouts["I"])), np.int32)
    valid = np.empty(len(position), np.bool_)
    kinds = (("I", np.flatnonzero(is_complete)), ("P", np.flatnonzero(~is_complete)))
    _fill(file, header, kinds, position, values, valid, (int(position[0]), stop))
    add_differences(values, is_complete, header)
    # Mark frames up to the first fault behind each complete one: there all later ones are wrong too.
    step_us = np.diff(values[:, 1].view(np.uint32), prepend=values[:1, 1].view(np.uint32))
    wrong = ~valid | (~is_complete & ((step_us == 0) | (step_us > _LONGEST_PAUSE_US)))
    n_wrong = np.cumsum(wrong)
    before = np.where(is_complete, n_wrong - wrong, 0)
    good: BoolArray = n_wrong == np.maximum.accumulate(before)
    return values, good


def _fill(
    file: FileParts,
    header: Header,
    kinds: Sequence[tuple[str, IntArray]],
    position: IntArray,
    values: NDArray[np.int32],
    valid: BoolArray,
    part: tuple[int, int],
) -> None:
    """Decode frames of a part of the file block by block; of each kind its letter and the rows of it."""
    groups = {letter: groups_of(header.layouts[letter]) for letter, _ in kinds}
    for start, block, _ in blocks_of(file, *part, position):
        for letter, rows in kinds:
            at, layout = position[rows], header.layouts[letter]
            found = slice(*np.searchsorted(at, [start, start + BLOCK_BYTES]).tolist())
            decoded, valid[rows[found]] = frame_values(block, at[found] - start + 1, layout, groups[letter])
            add_constants(decoded, layout, header)
            values[rows[found]] = decoded.T


def _other_tables(file: FileParts, header: Header, frames: Frames, main: FrameTable) -> dict[str, FrameTable]:
    """Decode the slow frames and those of the receiver."""
    tables: dict[str, FrameTable] = {}
    for letter in ("S", "H", "G"):
        if letter not in header.layouts:
            continue
        layout, position = header.layouts[letter], frames.starts[letter]
        values = np.empty((len(position), len(layout)), np.int32)
        valid = np.empty(len(position), np.bool_)
        whole = (header.body, header.stop)
        _fill(file, header, [(letter, np.arange(len(position)))], position, values, valid, whole)
        if letter == "G":
            home = np.zeros((2, len(position)), np.int32)
            if "H" in tables and len(tables["H"].names) > 1:
                home = np.stack([_last(tables["H"], number, position) for number in range(2)])
            add_places(values.T, layout, home, _last(main, 1, position))
        tables[letter] = FrameTable(
            columns=dict(zip(layout.names, values[valid].T, strict=True)),
            signed=dict(zip(layout.names, layout.signed, strict=True)),
            position=position[valid],
        )
    return tables


def _last(table: FrameTable, column: int, position: IntArray) -> NDArray[np.int32]:
    """Return a column's last value before places in the file; 0 before the first."""
    before = np.searchsorted(table.position, position) - 1
    if not len(table.position):
        return np.zeros(len(position), np.int32)
    return np.where(before >= 0, table.columns[table.names[column]][np.maximum(before, 0)], 0).astype(
        np.int32
    )
