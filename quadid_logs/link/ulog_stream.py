"""A ULog put together from the frames of MAVLink's log stream (mavlink.io: LOGGING_DATA)."""

from __future__ import annotations

from typing import BinaryIO, Final

from quadid_logs.containers.ulog_header import HEADER_MAGIC, HEADER_SIZE
from quadid_logs.link.losses import Losses

#: Before each message: its size (16 bits) without these three bytes, and its type.
_HEAD: Final = 3
#: Frames carry at most so many bytes; `first` of a frame in which no message begins.
MOST_DATA: Final = 249
_NONE_BEGINS: Final = 255
_NUMBERS: Final = 1 << 16
#: Networks change the order within milliseconds, links with retransmission within some tenths of a second.
_WAIT_S, _MOST_WAITING = 0.3, 64
#: A frame that is older than this many numbers is none of an outage.
_LATE: Final = 1024
_LONGEST_MARK_MS: Final = 0xFFFF


def begins_log(data: bytes, first: int) -> bool:
    """Return whether a frame is the first one of a log.

    Parameters
    ----------
    first : int
        Where in it the first message begins.
    """
    return first == 0 and data.startswith(HEADER_MAGIC)


class ULogStream:
    """Whole messages into a file, and a dropout message where some are missing.

    Parameters
    ----------
    file : binary file
        Empty.
    losses : Losses
        Counts what is missing.
    """

    def __init__(self, file: BinaryIO, losses: Losses) -> None:
        self._file, self._losses = file, losses
        self._next: int | None = None
        self._waiting: dict[int, tuple[bytes, int, float]] = {}
        self._begun = bytearray()
        self._in_header = True
        self._broken = False
        self._last_s = self._lost_s = 0.0
        #: Bytes in the file: all of them whole messages.
        self.n_bytes = 0

    def take(self, number: int, data: bytes, first: int, now_s: float) -> None:
        """Take a frame, in whatever order; before the first one of a log, frames are of no use.

        Parameters
        ----------
        number : int
            Counts frames; after 65535 comes 0.
        first : int
            Where in it the first message begins.
        now_s : float
            On a monotonic clock.
        """
        if self._next is None:
            if not begins_log(data, first):
                return
            self._next, self._last_s = number, now_s
        if (number - self._next) % _NUMBERS >= _NUMBERS - _LATE:
            self._losses.repeated += 1
            return
        self._waiting.setdefault(number, (data[:MOST_DATA], first, now_s))
        self._append_next()
        self.expire(now_s)

    def expire(self, now_s: float) -> None:
        """Give up frames that others have waited for too long."""
        if self._next is None:
            return
        while self._waiting:
            oldest_s = min(arrived_s for _, _, arrived_s in self._waiting.values())
            # A frame with a number from nowhere waits in vain for as long as others follow each other.
            if now_s - max(oldest_s, self._last_s) < _WAIT_S and len(self._waiting) < _MOST_WAITING:
                return
            following = min((number - self._next) % _NUMBERS for number in self._waiting)
            self._next = (self._next + following) % _NUMBERS
            self._lost_s = max(self._waiting[self._next][2] - self._last_s, 0.0)
            self._losses.frames += following
            self._losses.gaps += 1
            self._losses.longest_s = max(self._losses.longest_s, self._lost_s)
            self._broken = True
            self._begun.clear()
            self._append_next()

    def close(self, now_s: float) -> None:
        """Write what waited in vain for earlier frames; a begun message is left out."""
        self.expire(max(now_s, self._last_s) + _WAIT_S)

    def _append_next(self) -> None:
        """Append the frames that follow each other."""
        while self._next in self._waiting:
            data, first, self._last_s = self._waiting.pop(self._next)
            self._next = (self._next + 1) % _NUMBERS
            self._append(data, first)

    def _append(self, data: bytes, first: int) -> None:
        """Append a frame's bytes; after a loss from the first message on that begins in it."""
        self._losses.arrived += 1
        if self._broken:
            if first == _NONE_BEGINS or first >= len(data):
                return
            data = data[first:]
            self._broken = False
            if not self._in_header:
                # The message that says that some milliseconds are missing.
                self._write(
                    b"\x02\x00O"
                    + min(max(round(1e3 * self._lost_s), 1), _LONGEST_MARK_MS).to_bytes(2, "little")
                )
        self._begun += data
        self._write_whole()

    def _write_whole(self) -> None:
        """Write the whole messages of what has begun."""
        end = HEADER_SIZE if self._in_header and len(self._begun) >= HEADER_SIZE else 0
        self._in_header = self._in_header and not end
        if self._in_header:
            return
        while end + _HEAD <= len(self._begun):
            after = end + _HEAD + int.from_bytes(self._begun[end : end + 2], "little")
            if after > len(self._begun):
                break
            end = after
        self._write(bytes(self._begun[:end]))
        del self._begun[:end]

    def _write(self, content: bytes) -> None:
        self._file.write(content)
        self.n_bytes += len(content)
