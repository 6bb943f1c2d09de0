"""Logs by MAVLink's older messages (LOG_REQUEST_LIST and _DATA), for vehicles without file transfer."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, BinaryIO, Final

from quadid_logs.link.transfer import Chunk, receive
from quadid_logs.link.vehicle import Vehicle

#: Requested at a time: as much as arrives before a loss is noticed late [bytes].
_RANGE: Final = 512 * 90
_MOST_DATA: Final = 90


def requested_logs(vehicle: Vehicle) -> dict[int, tuple[int, int]]:
    """Return size [bytes] and time (UTC) [s], 0 where unknown, of each log by its number.

    Raises
    ------
    LinkError
    """
    logs: dict[int, tuple[int, int]] = {}
    count = 1
    for _ in range(vehicle.patience.tries):
        vehicle.send("log_request_list", *vehicle.target, 0, 0xFFFF)
        until_s = time.monotonic() + vehicle.patience.answer_s
        while len(logs) < count and (message := vehicle.next(until_s)) is not None:
            if message.get_type() != "LOG_ENTRY":
                continue
            count = message.num_logs
            if count:
                logs[message.id] = (message.size, message.time_utc)
            until_s = time.monotonic() + vehicle.patience.answer_s
        if len(logs) >= count:
            break
    return {number: log for number, log in sorted(logs.items()) if log[0] > 0}


class RequestedLog:
    """One of these logs."""

    def __init__(self, vehicle: Vehicle, number: int, size: int) -> None:
        self._vehicle, self._number, self._size = vehicle, number, size
        self._end = 0

    def read(self, file: BinaryIO, tell: Callable[[int], None] = lambda _: None) -> None:
        """Append the missing bytes to a file.

        Raises
        ------
        LinkError
        """
        try:
            receive(self._vehicle, self, file, self._size, tell)
        finally:
            self._vehicle.send("log_request_end", *self._vehicle.target)

    def stream(self, offset: int) -> None:
        """Ask for what follows: the source of a transfer."""
        self._end = min(offset + _RANGE, self._size)
        self._ask(offset, self._end)

    def again(self, holes: list[tuple[int, int]]) -> None:
        """Ask for the first range: a vehicle sends one at a time."""
        self._ask(*holes[0])
        del holes[1:]

    def chunk(self, message: Any) -> Chunk | None:
        """Return the bytes in a message; they name no receiver, but their log and place."""
        if message.get_type() != "LOG_DATA" or message.id != self._number:
            return None
        data = bytes(message.data)[: min(message.count, _MOST_DATA)]
        return Chunk(message.ofs, data, message.ofs + len(data) >= self._end or not data)

    def _ask(self, begin: int, end: int) -> None:
        self._vehicle.send("log_request_data", *self._vehicle.target, self._number, begin, end - begin)
