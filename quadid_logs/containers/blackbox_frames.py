"""Where the frames of a Blackbox log are, and which bytes are none.

A frame is its letter, then its fields. A frame counts where the byte behind it begins another one. Most
frames only say what has changed, so behind a fault the log goes on with the next complete frame that
continues its loops and time, and what stands between is lost.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import IntArray
from quadid_logs.containers.blackbox_encodings import (
    PADDING,
    Block,
    Group,
    frame_ends,
    frame_values,
    groups_of,
)
from quadid_logs.containers.blackbox_header import Header
from quadid_logs.containers.content import FileParts
from quadid_logs.data.log import LostBytes

#: As much of a log stays in the processor's cache while its frames are decoded.
BLOCK_BYTES: Final = 1 << 19
_I, _P, _E = b"IPE"
#: Numbers of variable length behind the type of an event (``blackbox.h``, FlightLogEvent): beep, logging
#: resumed, disarmed, flight mode.
_EVENT_NUMBERS: Final = {0: 1, 14: 2, 15: 1, 30: 2}
_ADJUSTMENT: Final = 13
_LOG_END: Final = b"\xffEnd of log\0"
_LONGEST_EVENT: Final = 32
_LONGEST_VB: Final = 5
_NOWHERE: Final = -1


class Event(NamedTuple):
    """An event: where its letter stands, its type, and its numbers as unsigned."""

    position: int
    kind: int
    numbers: tuple[int, ...]


class Frames(NamedTuple):
    """The frames of a log: by letter the byte offset of each in the file, events, and what was lost.

    ``duration_s`` is the time between the first and the last complete frame.
    """

    starts: dict[str, IntArray]
    events: list[Event]
    lost: list[LostBytes]
    duration_s: float


class _Letters(NamedTuple):
    """All bytes of a block that are letters of frames.

    Attributes
    ----------
    place, letter : list of int
        Where, and which one.
    follows : list of int
        Number in these lists of the letter behind the frame; that of none where it is the end of the log, and
        -1 where no frame begins behind it.
    clock : dict of int to (int, int)
        Loop and time [us] of those that are complete frames, by their numbers, rising.
    """

    place: list[int]
    letter: list[int]
    follows: list[int]
    clock: dict[int, tuple[int, int]]


def find_frames(file: FileParts, header: Header) -> Frames:
    """Walk through the frames of a log."""
    groups = {ord(letter): groups_of(layout) for letter, layout in header.layouts.items()}
    walk = _Walk(header)
    for start, block, n_bytes in blocks_of(file, header.body, header.stop):
        if walk.at < start + BLOCK_BYTES and not walk.ended:
            _BlockWalk(walk, start, block, n_bytes, _letters(block, header, groups, n_bytes)).run()
    walk.close()
    empty = np.zeros(0, np.int64)
    starts = {letter: np.concatenate([empty, *walk.starts.get(ord(letter), [])]) for letter in header.layouts}
    return Frames(starts, walk.events, walk.lost, walk.duration_us / 1e6)


def blocks_of(
    file: FileParts, start: int, stop: int, position: IntArray | None = None
) -> Iterator[tuple[int, Block, int]]:
    """Yield a log in blocks that overlap by more than a frame.

    Parameters
    ----------
    start, stop : int
        [bytes].
    position : ndarray of int64, shape (n,), optional
        Only blocks in which one of these bytes is, rising; all by default.

    Yields
    ------
    start : int
        Where the block begins in the file.
    block : Block
    n_bytes : int
        Of the log in it, those of the overlap included.
    """
    for first in range(start, stop, BLOCK_BYTES):
        if position is not None and not np.diff(np.searchsorted(position, [first, first + BLOCK_BYTES]))[0]:
            continue
        part = file.part(first, min(stop, first + BLOCK_BYTES + PADDING))
        yield first, Block(np.concatenate([part, np.zeros(PADDING, np.uint8)])), len(part)


def _letters(block: Block, header: Header, groups: dict[int, tuple[Group, ...]], n_bytes: int) -> _Letters:
    """Find where a frame would end from every byte that is a letter."""
    is_letter = np.zeros(256, np.bool_)
    is_letter[[*groups, _E]] = True
    place = np.flatnonzero(is_letter[block.bytes[:n_bytes]])
    letter = block.bytes[place]
    end = np.full(len(place), len(block.bytes))
    for kind, layout in groups.items():
        here = np.flatnonzero(letter == kind)
        end[here] = frame_ends(block, place[here] + 1, layout)
    number = np.full(len(block.bytes) + 1, _NOWHERE, np.int32)
    number[place] = np.arange(len(place))
    number[n_bytes] = len(place)
    follows = number[end]
    complete = np.flatnonzero((letter == _I) & (follows >= 0))
    values, valid = frame_values(block, place[complete] + 1, header.layouts["I"], groups[_I])
    iteration, time_us = values[:2].view(np.uint32).astype(np.int64)
    valid &= iteration % header.sampling.complete == 0
    clock = zip(iteration[valid].tolist(), time_us[valid].tolist(), strict=True)
    return _Letters(place.tolist(), letter.tolist(), follows.tolist(),
                    dict(zip(complete[valid].tolist(), clock, strict=True)))  # fmt: skip


class _Walk:
    """What is known on the way through a log."""

    def __init__(self, header: Header) -> None:
        self.header = header
        self.at = header.body
        self.starts: dict[int, list[IntArray]] = {}
        self.events: list[Event] = []
        self.lost: list[LostBytes] = []
        self.ended = False
        #: Where the bytes begin that are no frames, -1 while in step.
        self.fault_at = _NOWHERE
        #: Loop and time of the last complete frame; none before the first, nor behind a fault.
        self.clock: tuple[int, int] | None = None
        self.last_iteration = -1
        self.duration_us, self._last_us = 0, -1

    def tick(self, clock: tuple[int, int]) -> None:
        """Take loop and time of a complete frame; the clock of 32 bits turns over."""
        self.duration_us += (clock[1] - self._last_us) % (1 << 32) if self._last_us >= 0 else 0
        self.clock, self.last_iteration, self._last_us = clock, clock[0], clock[1]

    def lose(self, until: int, reason: str) -> None:
        """Count the bytes since the fault as lost."""
        if self.fault_at >= 0 and until > self.fault_at:
            self.lost.append(LostBytes(offset=self.fault_at, n_bytes=until - self.fault_at, reason=reason))
        self.fault_at = _NOWHERE

    def close(self) -> None:
        """Count what stands behind the last frame as lost."""
        if self.fault_at < 0:
            self.fault_at = self.at
        self.lose(self.header.stop, "after the log's end" if self.ended else "no frame")


class _BlockWalk:
    """The walk through one block."""

    def __init__(self, walk: _Walk, start: int, block: Block, n_bytes: int, found: _Letters) -> None:
        self.walk, self.start, self.found = walk, start, found
        self.content = block.bytes
        self.n_bytes = n_bytes
        self.stop = min(BLOCK_BYTES, n_bytes)
        self.firsts = list(found.clock)

    def run(self) -> None:
        """Follow the frames up to the first one that begins in the next block."""
        walk, (place, letter, follows, _) = self.walk, self.found
        taken: list[int] = []
        now = bisect_left(place, walk.at - self.start)
        if walk.fault_at < 0 and (now == len(place) or place[now] != walk.at - self.start):
            walk.fault_at = walk.at
        while now < len(place) and place[now] < self.stop and not walk.ended:
            if walk.fault_at >= 0:
                now = self._next_complete(now)
                continue
            after = self._after(now) if letter[now] != _P else follows[now] if walk.clock else _NOWHERE
            if after < 0:
                walk.fault_at, walk.clock = self.start + place[now], None
                now += 1
                continue
            taken.append(now)
            now = after
        reached = place[now] if now < len(place) else self.n_bytes
        walk.at = self.start + (reached if walk.fault_at < 0 else max(reached, self.stop))
        taken_at = np.array(place, dtype=np.int64)[np.array(taken, dtype=np.int64)]
        kinds = self.content[taken_at]
        for kind in map(ord, walk.header.layouts):
            walk.starts.setdefault(kind, []).append(taken_at[kinds == kind] + self.start)

    def _after(self, now: int) -> int:
        """Return the number of the letter behind a frame that is not one of differences; -1 for none."""
        if self.found.letter[now] == _E:
            return self._event(now)
        if self.found.letter[now] == _I:
            clock = self.found.clock.get(now)
            if clock is None or clock[0] <= self.walk.last_iteration:
                return _NOWHERE
            self.walk.tick(clock)
        return self.found.follows[now]

    def _next_complete(self, now: int) -> int:
        """Return the next complete frame to go on with; behind the last letter where there is none."""
        walk = self.walk
        for number in self.firsts[bisect_left(self.firsts, now) :]:
            if self.found.place[number] >= self.stop:
                break
            if self.found.clock[number][0] > walk.last_iteration and self._is_confirmed(number):
                walk.lose(
                    self.start + self.found.place[number], "no frame, or frames that continue a lost one"
                )
                return number
        return len(self.found.place)

    def _is_confirmed(self, number: int) -> bool:
        """Return whether the next complete frame, a whole interval later, is reached through frames."""
        found = self.found
        now = found.follows[number]
        while 0 <= now < len(found.place) and found.letter[now] != _I:
            now = self._event(now, keep=False) if found.letter[now] == _E else found.follows[now]
        if now < 0 or now >= len(found.place):
            return now >= 0
        expected = found.clock[number][0] + self.walk.header.sampling.complete
        return now in found.clock and found.clock[now][0] == expected

    def _event(self, now: int, *, keep: bool = True) -> int:
        """Return the number of the letter behind an event, and keep the event; -1 where it is none."""
        at = self.found.place[now]
        content = self.content[at + 1 : at + _LONGEST_EVENT].tobytes()
        if content.startswith(_LOG_END):
            self.walk.ended |= keep
            end, event = at + 1 + len(_LOG_END), Event(self.start + at, _LOG_END[0], ())
            # Whatever stands there, the log has ended.
            after = bisect_left(self.found.place, end)
            if keep:
                self.walk.at = self.start + end
        else:
            end, event = _parse_event(content, self.start + at)
            after = bisect_left(self.found.place, at + 1 + end) if end else _NOWHERE
            place = self.found.place[after] if 0 <= after < len(self.found.place) else self.n_bytes
            if not end or place != at + 1 + end:
                return _NOWHERE
        if keep:
            self.walk.events.append(event)
        return after


def _parse_event(content: bytes, position: int) -> tuple[int, Event]:
    """Return the length of an event that begins with its type, 0 where it is of no known type."""
    kind = content[0] if content else -1
    if kind == _ADJUSTMENT and len(content) > 1:
        # The highest bit says that four bytes of a fraction follow.
        value, end = (0, 6) if content[1] & 128 else _number(content, 2)
        return end, Event(position, kind, (content[1] & 127, value))
    end, numbers = 1, []
    for _ in range(_EVENT_NUMBERS.get(kind, 0)):
        value, end = _number(content, end)
        numbers.append(value)
        if not end:
            break
    return (end if kind in _EVENT_NUMBERS else 0), Event(position, kind, tuple(numbers))


def _number(content: bytes, at: int) -> tuple[int, int]:
    """Return an unsigned number of variable length and where it ends, 0 where it does not."""
    value = 0
    for k, byte in enumerate(content[at : at + _LONGEST_VB]):
        value |= (byte & 127) << 7 * k
        if byte < 128:
            return value, at + k + 1
    return 0, 0
