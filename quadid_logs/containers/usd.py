"""Crazyflie micro-SD logs: a header that defines events, events, a checksum.

Layout, little-endian: 0xBC; version and number of kinds of events (2 bytes each); for each kind its number
(2 bytes), its name and a zero, the number of its fields (2 bytes), and each field's name, type letter in
brackets and a zero; then the events: the kind's number, the time (version 1: 4 bytes, ms; version 2: 8 bytes,
us), the fields without gaps. The last 4 bytes are the CRC-32 of all before them.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from bisect import bisect_left
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray, IntArray
from quadid_logs.containers.content import Bytes, merge_lost, rows_at
from quadid_logs.data.log import LostBytes
from quadid_logs.errors import EmptyLogError, LogError, UnknownFormatError

_MAGIC: Final = 0xBC
_CHECKSUM: Final = 4
#: Names of fields are printable.
_TIME: Final = "\n"
#: Types of log variables by the letter that the firmware writes, as numpy names them.
_TYPES: Final = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "e": "<f2", "q": "<i8", "Q": "<u8", "d": "<f8",
}  # fmt: skip
#: The firmware takes 20 kinds of 20 variables; builds for research more.
_MOST_KINDS, _MOST_FIELDS, _LONGEST_NAME = 1000, 1000, 200
#: Read as a whole; a day at 1 kHz with 20 numbers is less.
_MOST_BYTES: Final = 1 << 33
#: What follows an event comes at most so much later [s]: a full buffer or a slow card costs seconds at most.
#: Events of several tasks may stand in the file a little out of order.
_LATER_S, _EARLIER_S = 10.0, 1.0
#: So many events must follow each other to be believed where none is known before them.
_CHAIN: Final = 4
#: So many events of one time are an empty part of the card: there are fewer kinds.
_MOST_ALIKE: Final = 64
#: Bytes of the first part that is searched for the next event, rows of the first run.
_SEARCH, _RUN = 512, 64
_LONGEST_SEARCH, _LONGEST_RUN = 1 << 20, 1 << 18


class _Clock(NamedTuple):
    """How events of a version begin: their packed head, the type of the time, and its unit [s]."""

    head: struct.Struct
    stamp: str
    unit_s: float


_CLOCKS: Final = {1: _Clock(struct.Struct("<HI"), "<u4", 1e-3), 2: _Clock(struct.Struct("<HQ"), "<u8", 1e-6)}


class _Kind(NamedTuple):
    """A kind of event: its number and name, its fields as numpy types in their order, bytes of one event."""

    number: int
    name: str
    fields: Mapping[str, tuple[str, int]]
    size: int


class _Header(NamedTuple):
    """What the file defines, and where its events begin."""

    version: int
    kinds: tuple[_Kind, ...]
    end: int


class _DamagedError(Exception):
    """The header cannot be read; True if it only ends too early."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EventTable:
    """All events of one kind, in file order.

    Attributes
    ----------
    name : str
        As the header calls them.
    fields : tuple of str
        Names of the fields, in the order of the log.
    time_s : ndarray, shape (n_rows,)
        [s].
    position : ndarray of int64, shape (n_rows,)
        Byte offset of each event in the file.
    """

    name: str
    fields: tuple[str, ...]
    time_s: FloatArray
    position: IntArray
    rows: AnyArray

    def column(self, field: str) -> AnyArray | None:
        """Return a field of every event as it was logged; None where there is none."""
        return self.rows[field] if field in self.fields else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UsdContent:
    """What a file holds.

    Attributes
    ----------
    version : int
    n_bytes : int
    tables : mapping of str to EventTable
        By the name of the event; kinds without events are left out.
    lost : tuple of LostBytes
    checksum_wrong : bool
        Four bytes that end the file are not the checksum of those before them.
    """

    version: int
    n_bytes: int
    tables: Mapping[str, EventTable]
    lost: tuple[LostBytes, ...]
    checksum_wrong: bool


def is_mine(head: bytes) -> bool:
    """Say whether a file that begins with these (up to 64 kB) bytes is a Crazyflie micro-SD log."""
    if len(head) < 8 or head[0] != _MAGIC:
        return False
    try:
        return bool(_header(head).kinds)
    except _DamagedError as damage:
        return bool(damage.args[0])


def read_usd(path: str | Path) -> UsdContent:
    """Read a micro-SD log.

    Raises
    ------
    UnknownFormatError
        If the header is damaged or cut off: without it no event can be read.
    EmptyLogError
        If no event is in the file.
    LogError
        If the file is larger than any flight.
    OSError
        If it cannot be read.
    """
    n_bytes = Path(path).stat().st_size
    if n_bytes > _MOST_BYTES:
        raise LogError(
            f"{path} holds {n_bytes / 1000000000.0:.1f} GB, more than the {_MOST_BYTES / 1000000000.0:.1f} "
            "GB that can be read.",
            hint="Copy the log from the card again.",
        )
    content = Path(path).read_bytes()
    try:
        header = _header(content)
    except _DamagedError as damage:
        raise UnknownFormatError(
            f"{path} is a Crazyflie micro-SD log with a damaged header, so its content cannot be read.",
            hint="Copy the log from the card again.",
        ) from damage
    stop = max(len(content) - _CHECKSUM, header.end)
    if content[stop:] != struct.pack("<I", zlib.crc32(content[:stop])):
        stop = len(content)
    walk = _Walk(content, header, stop)
    walk.run()
    tables = {table.name: table for table in _tables(content, header, walk.offsets)}
    if not tables:
        raise EmptyLogError(
            f"{path} holds no event: nothing was logged.",
            hint="Switch logging on with the parameter usd.logging before take-off, and off after landing.",
        )
    return UsdContent(
        version=header.version,
        n_bytes=len(content),
        tables=tables,
        lost=merge_lost(walk.lost),
        checksum_wrong=walk.checksum_wrong,
    )


def _header(content: bytes) -> _Header:
    """Parse the definitions.

    Raises
    ------
    _DamagedError
        With True if they are sound as far as the content goes.
    """
    try:
        magic, version, n_kinds = struct.unpack_from("<BHH", content)
    except struct.error as error:
        raise _DamagedError(True) from error
    if magic != _MAGIC or version not in _CLOCKS or not 0 < n_kinds <= _MOST_KINDS:
        raise _DamagedError(False)
    at, kinds = 5, []
    for _ in range(n_kinds):
        number, at = _number(content, at)
        name, at = _name(content, at)
        n_fields, at = _number(content, at)
        if n_fields > _MOST_FIELDS:
            raise _DamagedError(False)
        fields: dict[str, tuple[str, int]] = {}
        size = _CLOCKS[version].head.size
        for _ in range(n_fields):
            text, at = _name(content, at)
            if len(text) < 4 or text[-3] != "(" or text[-1] != ")" or text[-2] not in _TYPES:
                raise _DamagedError(False)
            fields.setdefault(text[:-3], (_TYPES[text[-2]], size))
            size += np.dtype(_TYPES[text[-2]]).itemsize
        kinds.append(_Kind(number, name, fields, size))
    return _Header(version, tuple(kinds), at)


def _number(content: bytes, at: int) -> tuple[int, int]:
    """Return two bytes as a number, and where they end."""
    if at + 2 > len(content):
        raise _DamagedError(True)
    return content[at] | content[at + 1] << 8, at + 2


def _name(content: bytes, at: int) -> tuple[str, int]:
    """Return a text that a zero ends, and where what follows begins."""
    end = content.find(0, at, at + _LONGEST_NAME)
    raw = content[at : end if end >= 0 else at + _LONGEST_NAME]
    if not raw.isascii() or not raw.decode("ascii").isprintable():
        raise _DamagedError(False)
    if end < 0 or end == at:
        raise _DamagedError(end < 0 and len(content) < at + _LONGEST_NAME)
    return raw.decode("ascii"), end + 1


class _Walk:
    """The way from event to event: each tells by its kind where the next one begins.

    Parameters
    ----------
    content : bytes
    header : _Header
    stop : int
        Where the events end.

    Attributes
    ----------
    offsets : dict of int to array
        By the number of the kind, where its events begin.
    lost : list of LostBytes
    checksum_wrong : bool
    """

    def __init__(self, content: bytes, header: _Header, stop: int) -> None:
        self.offsets: dict[int, array[int]] = {}
        self.lost: list[LostBytes] = []
        self.checksum_wrong = False
        self._content, self._stop, self._start = content, stop, header.end
        self._bytes: Bytes = np.frombuffer(content, np.uint8)
        self._clock = _CLOCKS[header.version]
        self._later, self._earlier = (round(each / self._clock.unit_s) for each in (_LATER_S, _EARLIER_S))
        # Of a number that is defined twice the firmware writes the first.
        self._sizes = {kind.number: kind.size for kind in reversed(header.kinds)}
        self._head = np.dtype([("number", "<u2"), ("time", self._clock.stamp)])
        # Where events could begin, up to where that was looked for, and how far it is looked for next.
        self._likely: list[int] = []
        self._searched, self._length = 0, _SEARCH
        self._size_of = np.zeros(1 << 16, np.int64)
        for number, size in self._sizes.items():
            self._size_of[number] = size

    def run(self) -> None:
        """Go through the file."""
        at, before, run = self._start, -1, _RUN
        last: int | None = None
        unpack, sizes, stop = self._clock.head.unpack_from, self._sizes, self._stop
        last_head = stop - self._clock.head.size
        while at < stop:
            number, time = unpack(self._content, at) if at <= last_head else (-1, 0)
            size = sizes.get(number, 0)
            whole = size and at + size <= stop
            likely = whole and last is not None and -self._earlier <= time - last <= self._later
            if not likely and not (whole and self._is_chain(at)):
                at, before = self._resume(at), -1
                continue
            if number == before and run > 1:
                # How many events of one kind follow each other, at most so many.
                n_events = min(run, (self._stop - at) // size)
                heads = np.ndarray(n_events, self._head, self._content, at, size)
                step = np.diff(heads["time"].astype(np.int64))
                sound = (heads["number"][1:] == number) & (step >= -self._earlier) & (step <= self._later)
                n_sound = n_events if sound.all() else 1 + int(np.argmin(sound))
                n_events, last = n_sound, int(heads["time"][n_sound - 1]) if n_sound > 1 else time
                # Where kinds take turns, looking ahead costs more than it saves.
                run = min(4 * run, _LONGEST_RUN) if n_events == run else _RUN if n_events >= _CHAIN else 1
            else:
                n_events, last = 1, time
                run = run if number == before else _RUN if self._same_ahead(at, size, number) else 1
            found = self.offsets.setdefault(number, array("q"))
            if n_events == 1:
                found.append(at)
            else:
                found.frombytes(np.arange(at, at + n_events * size, size, dtype=np.int64).tobytes())
            at, before = at + n_events * size, number

    def _same_ahead(self, at: int, size: int, number: int) -> bool:
        """Say whether the next events are of one kind."""
        head = number.to_bytes(2, "little")
        return all(self._content.startswith(head, at + k * size) for k in range(1, _CHAIN))

    def _is_chain(self, at: int) -> bool:
        """Say whether events with plausible times follow each other from here on, or to the end.

        One event alone is believed where the first one has to be.
        """
        times: list[int] = []
        from_start = at == self._start
        while len(times) < _MOST_ALIKE and at + self._clock.head.size <= self._stop:
            number, time = self._clock.head.unpack_from(self._content, at)
            size = self._sizes.get(number, 0)
            if at + size > self._stop:
                break
            if not size or (times and not -self._earlier <= time - times[-1] <= self._later):
                return False
            times.append(time)
            at += size
            if len(times) >= _CHAIN and time > times[0]:
                return True
        else:
            from_start &= len(times) < _MOST_ALIKE
        return bool(times) and (from_start or times[-1] > times[0])

    def _resume(self, at: int) -> int:
        """Return where the next event begins, and note what lies before it as lost."""
        if at == self._stop - _CHECKSUM and at > self._start:
            self.checksum_wrong = True
            return self._stop
        begin, found = at + 1, self._stop
        while begin < self._stop:
            if begin >= self._searched:
                # Each part is twice as long as the one before: a log that is damaged all over takes few.
                self._searched = min(begin + self._length, self._stop)
                self._length = min(2 * self._length, _LONGEST_SEARCH)
                self._likely = self._candidates(begin, self._searched)
            ahead = range(bisect_left(self._likely, begin), len(self._likely))
            found = next((self._likely[k] for k in ahead if self._is_chain(self._likely[k])), self._stop)
            if found < self._stop:
                break
            begin = self._searched
        reason = "an event that the header does not define"
        if found == self._stop:
            reason = "the file ends inside an event"
        self.lost.append(LostBytes(offset=at, n_bytes=found - at, reason=reason))
        return found

    def _candidates(self, begin: int, end: int) -> list[int]:
        """Return where events could begin by their own number and time and those of the next one."""
        end = min(end, self._stop - self._clock.head.size + 1)
        if end <= begin:
            return []
        number = (
            self._bytes[begin:end].astype(np.int64) | self._bytes[begin + 1 : end + 1].astype(np.int64) << 8
        )
        size = self._size_of[number]
        at = np.arange(begin, end, dtype=np.int64)
        follows = at + size
        keep = (size > 0) & (follows <= self._stop)
        at, follows = at[keep], follows[keep]
        is_last = follows > self._stop - self._head.itemsize
        time = self._times(at)
        after = self._times(np.where(is_last, at, follows))
        step = after["time"].astype(np.int64) - time["time"].astype(np.int64)
        likely = (self._size_of[after["number"]] > 0) & (step > 0) & (step <= self._later)
        return [int(each) for each in at[likely | is_last]]

    def _times(self, at: IntArray) -> AnyArray:
        """Return number and time at places in the file."""
        return rows_at(self._bytes, at, self._head)


def _tables(content: bytes, header: _Header, offsets: Mapping[int, array[int]]) -> Iterator[EventTable]:
    """Yield the events kind by kind; of a number or a name that is defined twice, the first."""
    clock = _CLOCKS[header.version]
    seen: set[int | str] = set()
    data: Bytes = np.frombuffer(content, np.uint8)
    for kind in header.kinds:
        if kind.number not in offsets or kind.number in seen or kind.name in seen:
            continue
        seen |= {kind.number, kind.name}
        position = np.frombuffer(offsets[kind.number], np.int64)
        layout = np.dtype(
            {
                "names": [_TIME, *kind.fields],
                "formats": [clock.stamp, *(form for form, _ in kind.fields.values())],
                "offsets": [2, *(place for _, place in kind.fields.values())],
                "itemsize": kind.size,
            }
        )
        rows = rows_at(data, position, layout)
        yield EventTable(
            name=kind.name,
            fields=tuple(kind.fields),
            time_s=rows[_TIME] * clock.unit_s,
            position=position,
            rows=rows,
        )
