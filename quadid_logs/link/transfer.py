"""Put a file together from chunks that arrive late, twice, or never."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, BinaryIO, NamedTuple, Protocol

from quadid_logs.errors import LinkError
from quadid_logs.link.vehicle import Vehicle

#: Chunks that wait for an earlier one; firmwares send bursts of at most 120 kB.
_MOST_AHEAD = 1 << 20
#: Requests under way at once; firmwares queue five.
_MOST_HOLES = 5


class Chunk(NamedTuple):
    """Bytes from an offset of the file; `last` where the vehicle ends what was requested."""

    offset: int
    data: bytes
    last: bool


class Source(Protocol):
    """One log on the vehicle: how its bytes are requested and recognised."""

    def stream(self, offset: int) -> None:
        """Ask for all that follows `offset`."""

    def again(self, holes: list[tuple[int, int]]) -> None:
        """Ask again for ranges (begin, end) that got lost."""

    def chunk(self, message: Any) -> Chunk | None:
        """Return the bytes in a message, None if it holds none of this log."""


def receive(
    vehicle: Vehicle, source: Source, file: BinaryIO, size: int, tell: Callable[[int], None] = lambda _: None
) -> None:
    """Append the missing bytes of a log to a file, which is whole from its beginning at any time.

    Parameters
    ----------
    file : binary file
        At its end: the bytes that are there already.
    size : int
        Of the log [bytes].
    tell : callable
        Called with the bytes in the file.

    Raises
    ------
    LinkError
        If nothing comes any more.
    """
    position, idle = file.tell(), 0
    ahead: dict[int, bytes] = {}
    while position < size:
        before = position
        ahead = {start: data for start, data in ahead.items() if start > position}
        # The first ranges that are missing before what is there already.
        holes, end = [], position
        for begin in sorted(ahead):
            if begin > end:
                holes.append((end, begin))
            end = max(end, begin + len(ahead[begin]))
        holes = holes[:_MOST_HOLES]
        if holes:
            source.again(holes)
        else:
            source.stream(position)
        answered_at = holes[-1][1] if holes else size
        until_s = time.monotonic() + vehicle.patience.answer_s
        while position < answered_at and (message := vehicle.next(until_s)) is not None:
            chunk = source.chunk(message)
            if chunk is None:
                continue
            start, data = max(chunk.offset, position), chunk.data[max(position - chunk.offset, 0) :]
            if data and start - position <= _MOST_AHEAD:
                ahead.setdefault(start, data[: size - start])
                until_s = time.monotonic() + vehicle.patience.answer_s
            while position in ahead:
                data = ahead.pop(position)
                file.write(data)
                position += len(data)
            tell(position)
            # A repeated end of an earlier burst does not end this one.
            if chunk.last and not holes and chunk.offset >= before:
                break
        idle = 0 if position > before else idle + 1
        if idle >= vehicle.patience.tries:
            raise LinkError(
                f"The vehicle stopped sending after {position} of {size} bytes.",
                hint="Run the same command again: it continues where it stopped.",
            )
