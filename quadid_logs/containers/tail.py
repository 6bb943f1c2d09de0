"""The last seconds of a log that grows: rows that came since, with what must be known to read them.

A reader needs definitions, parameters and the state at the beginning (armed, flight mode), which stand
anywhere in the file. They are kept, and of each other message the last row before the tail.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

from quadid_logs.containers.dataflash_index import DEFINING, FMT_ID, FMT_LENGTH, HEADER
from quadid_logs.containers.ulog_header import HEADER_MAGIC, HEADER_SIZE

#: Messages of DataFlash that are no samples: what is set, what was said, and what began.
_STATES: Final = DEFINING | {"PARM", "MSG", "VER", "ARM", "EV", "MODE", "ERR"}
#: Of these, and of what a hostile log calls so, at most so much is kept [bytes].
_MOST_KEPT: Final = 4 << 20
_HEAD: Final = 3
_DATA: Final = ord("D")
_STAMP: Final = struct.Struct("<Q")


class _Row(NamedTuple):
    """A message: when [s], of what, and its bytes."""

    time_s: float
    key: int
    content: bytes


class LogTail:
    """A log of which the end is kept.

    Parameters
    ----------
    span_s : float
        Length of what is kept, on the log's clock.

    Attributes
    ----------
    end_s : float
        Time of the last row, on the log's clock [s]; NaN before the first one.
    """

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._unread = bytearray()
        self._is_ulog: bool | None = None
        self._known = bytearray()
        self._before: dict[int, bytes] = {}
        self._rows: deque[_Row] = deque()
        self._formats: dict[int, tuple[int, str, bool]] = {FMT_ID: (FMT_LENGTH, "FMT", False)}
        self.end_s = float("nan")

    def append(self, content: bytes) -> None:
        """Take the next bytes of the file: messages, the last one perhaps not whole."""
        self._unread += content
        if self._is_ulog is None:
            if len(self._unread) < HEADER_SIZE:
                return
            self._is_ulog = self._unread.startswith(HEADER_MAGIC)
            if self._is_ulog:
                self._known += self._unread[:HEADER_SIZE]
                del self._unread[:HEADER_SIZE]
        for row in self._ulog_rows() if self._is_ulog else self._dataflash_rows():
            # A clock that jumps back begins a new tail; one that jumps ahead ends the old one.
            if row.time_s < self.end_s - self._span_s:
                self._rows.clear()
            self.end_s = row.time_s
            self._rows.append(row)
        while self._rows and self._rows[0].time_s < self.end_s - self._span_s:
            row = self._rows.popleft()
            self._before[row.key] = row.content

    def content(self) -> bytes:
        """Return the tail as a log of its own."""
        return b"".join([bytes(self._known), *self._before.values(), *(row.content for row in self._rows)])

    def _keep(self, content: bytes) -> None:
        if len(self._known) + len(content) <= _MOST_KEPT:
            self._known += content

    def _ulog_rows(self) -> Iterator[_Row]:
        """Yield the data messages that have come, and keep the others."""
        at, unread = 0, self._unread
        while at + _HEAD <= len(unread):
            after = at + _HEAD + unread[at] + 256 * unread[at + 1]
            if after > len(unread):
                break
            content = bytes(unread[at:after])
            if content[2] == _DATA and len(content) >= 13:
                (stamp,) = _STAMP.unpack_from(content, 5)
                yield _Row(1e-6 * stamp, content[3] + 256 * content[4], content)
            else:
                self._keep(content)
            at = after
        del unread[:at]

    def _dataflash_rows(self) -> Iterator[_Row]:
        """Yield the rows that have come, and keep what is none; what is no message is passed over."""
        at, unread = 0, self._unread
        while at + _HEAD <= len(unread):
            found = self._formats.get(unread[at + 2]) if unread.startswith(HEADER, at) else None
            if found is None:
                following = unread.find(HEADER, at + 1)
                at = following if following >= 0 else max(at + 1, len(unread) - 2)
                continue
            length, name, is_stamped = found
            if at + length > len(unread):
                break
            content = bytes(unread[at : at + length])
            at += length
            if name == "FMT":
                # Learn from a format message how long another is, and whether it begins with a time.
                number, long, characters = content[3], content[4], content[9:25]
                if long >= _HEAD:
                    called = content[5:9].rstrip(b"\0").decode("ascii", "replace")
                    self._formats[number] = long, called, characters.startswith(b"Q") and long >= _HEAD + 8
            if name in _STATES:
                self._keep(content)
            elif is_stamped:
                (stamp,) = _STAMP.unpack_from(content, _HEAD)
                yield _Row(1e-6 * stamp, content[2], content)
        del unread[: min(at, len(unread))]
