"""A vehicle that streams a log, in both protocols, on a clock of its own; and what links do to the frames.

It stands in for `link.vehicle.Vehicle`: no socket, no thread, so that minutes of flight take moments.
"""

from __future__ import annotations

import bisect
import os
import random
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

os.environ.setdefault("MAVLINK20", "1")
from pymavlink.dialects.v20 import ardupilotmega as dialect

FRAMES, BLOCKS = 12, 3
US, OTHER = (255, 191), (255, 190)
STEP_S = 0.004
ULOG_HEADER_FRAMES = 40


@dataclass
class FakeLogger:
    """Streams `log`; every fault is off unless it is asked for. `restarts_with`: the log after a restart."""

    log: bytes
    autopilot: int
    armed: bool = False
    flies: bool = True
    loss: float = 0.0
    reorder: float = 0.0
    duplicate: float = 0.0
    outage_s: float = 0.0
    outage_every_s: float = 0.9
    first_number: int = 0
    lost_answers: int = 0
    lost_stops: int = 0
    left_on: bool = False
    other_client: bool = False
    refuses: bool = False
    backend: float | None = None
    restarts_with: bytes = b""
    restarts_after: int = 10**9  # frames
    hostile: list[bytes] = field(default_factory=list)
    never_again: frozenset[int] = frozenset()
    now_s: float = 100.0
    heard_s: float = 100.0
    target: tuple[int, int] = (1, 1)
    step_s: float = STEP_S
    starts: int = 0
    stops: int = 0

    def __post_init__(self) -> None:
        self._random = random.Random(3)
        self._mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._out: deque[Any] = deque()
        self._held: list[Any] = []
        self._number = self._first = self.first_number
        self._at = 0
        self._on = self.left_on
        self._header_left = 0 if self.left_on else ULOG_HEADER_FRAMES
        self._begun_s, self._sent, self._acked = 0.0, 0, -1
        self._kept: dict[int, bytes] = {}
        self._silent_until_s = 0.0
        self._flew = False
        self._boundaries: list[int] = []
        if self.autopilot == FRAMES:
            self._boundaries = list(ulog_messages(self.log))
            if self.left_on:
                self._at = self._boundaries[len(self._boundaries) // 3] + 5

    def monotonic(self) -> float:
        """Return the time of this clock."""
        return self.now_s

    def close(self) -> None:
        """Close nothing."""

    def send(self, name: str, *fields: Any) -> None:
        """Take what a client says."""
        if name == "command_long":
            self._take_command(fields[2])
        elif name == "logging_ack":
            self._acked = fields[2]
        elif name == "param_request_read" and self.backend is not None:
            self._out.append(self._mav.param_value_encode(b"LOG_BACKEND_TYPE", self.backend, 9, 1, 0))
        elif name == "remote_log_block_status":
            self._take_status(fields[2], fields[3])

    def next(self, until_s: float) -> Any | None:
        """Return the next message, None where none came until then."""
        while not self._out:
            if self.now_s >= until_s:
                return None
            self.now_s += self.step_s
            self._step()
        return self._arrived(self._out.popleft())

    def _arrived(self, message: Any) -> Any:
        packet = message if isinstance(message, bytes) else message.pack(self._mav)
        found = self._parser.parse_buffer(packet) or [None]
        return None if found[0] is None or found[0].get_type() == "BAD_DATA" else found[0]

    def _take_command(self, number: int) -> None:
        result = 0
        if number == 2510:
            self.starts += 1
            if self.refuses:
                result = 4
            elif self._on:
                result = 1
            else:
                self._on, self._header_left, self._acked = True, ULOG_HEADER_FRAMES, -1
                self._at = 0
        else:
            self.stops += 1
            if self.lost_stops:
                self.lost_stops -= 1
                return
            self._on = False
        if self.lost_answers:
            self.lost_answers -= 1
        else:
            self._out.append(self._mav.command_ack_encode(number, result))

    def _take_status(self, number: int, status: int) -> None:
        if number == 2147483646:
            self.starts += 1
            if not self._on:
                self._on, self._at, self._number, self._kept = True, 0, 0, {}
        elif number == 2147483645:
            self.stops += 1
            self._on = False
        elif status == 1:
            self._kept.pop(number, None)
        elif number in self._kept:
            self._put(self._block(number, self._kept[number]))

    def _step(self) -> None:
        """Let a moment pass: a frame each."""
        if self.hostile:
            self._out.append(self.hostile.pop())
        if self.now_s < self._silent_until_s:
            return
        self.heard_s = self.now_s
        if not self._on:
            return
        if self._sent >= self.restarts_after:
            self._restart()
            return
        if self.autopilot == FRAMES:
            self._step_frames()
        else:
            self._step_blocks()
        done = self._at >= len(self.log)
        if done and not self._kept and not (self.restarts_with and self.restarts_after < 10**9):
            self.armed = False
        elif self.flies and self._sent > ULOG_HEADER_FRAMES and not self.restarts_with:
            self.armed = True

    def _restart(self) -> None:
        self.log, self.restarts_with, self.restarts_after = self.restarts_with, b"", 10**9
        self._on, self._at, self._number, self._kept, self.armed = False, 0, 0, {}, False
        self._silent_until_s = self.now_s + 8.0
        self._boundaries = list(ulog_messages(self.log)) if self.autopilot == FRAMES else []

    def _step_frames(self) -> None:
        if self._header_left and self._acked != self._number and self._sent and self._waits:
            if self._sent % 12 == 0:
                self._put(self._last)
            self._sent += 1
            return
        if self._at >= len(self.log):
            return
        data = self.log[self._at : self._at + 249]
        first = next((b - self._at for b in self._from(self._at) if b < self._at + len(data)), 255)
        acked = self._header_left > 0
        self._number = (self._first + self._count()) % 65536
        make = self._mav.logging_data_acked_encode if acked else self._mav.logging_data_encode
        if self.other_client:
            self._put(make(*OTHER, self._number, len(data), first, data.ljust(249, b"\0")))
        self._last = make(*US, self._number, len(data), first, data.ljust(249, b"\0"))
        self._waits = acked
        self._header_left -= acked
        self._at += len(data)
        self._sent += 1
        self._put(self._last)

    _waits = False
    _last: Any = None

    def _count(self) -> int:
        """Return how many frames came before the one at `_at`."""
        return self._at // 249

    def _from(self, at: int) -> Iterator[int]:
        yield from self._boundaries[bisect.bisect_left(self._boundaries, at) :][:1]

    def _step_blocks(self) -> None:
        if self._sent % 25 == 0 and self._kept and self._at >= len(self.log):
            for number, data in list(self._kept.items()):
                self._put(self._block(number, data))
        self._sent += 1
        if self._at + 200 > len(self.log):
            self._at = len(self.log)
            return
        if len(self._kept) >= 500:
            self._put(self._block(*next(iter(self._kept.items()))))
            return
        data = self.log[self._at : self._at + 200]
        self._at += 200
        if self._number not in self.never_again:
            self._kept[self._number] = data
            if self.other_client:
                self._put(dialect.MAVLink_remote_log_data_block_message(*OTHER, self._number, data))
            self._put(self._block(self._number, data))
        self._number += 1

    def _block(self, number: int, data: bytes) -> Any:
        return self._mav.remote_log_data_block_encode(*US, number, data)

    def _put(self, message: Any) -> None:
        packet = message.pack(self._mav)
        if self._random.random() < self.loss:
            return
        if self.outage_s and self.now_s % self.outage_every_s < self.outage_s:
            return
        if self._random.random() < self.reorder:
            self._held.append(packet)
            return
        copies = 2 if self._random.random() < self.duplicate else 1
        self._out.extend([packet] * copies)
        self._out.extend(self._held)
        self._held.clear()


class SocketLogger:
    """The same vehicle on a loopback socket, a thread of its own; a context manager with an `address`."""

    def __init__(self, vehicle: FakeLogger, *, frames_per_s: float = 4000.0) -> None:
        self._vehicle, self._pause_s = vehicle, 8.0 / frames_per_s
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.address = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> SocketLogger:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        vehicle, client, beat_s = self._vehicle, None, 0.0
        parser, mav = dialect.MAVLink(None), dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        while not self._done.wait(self._pause_s):
            with suppress(BlockingIOError):
                while True:
                    data, client = self._socket.recvfrom(2048)
                    for message in parser.parse_buffer(data) or ():
                        name = message.get_type().lower()
                        vehicle.send(name, *(getattr(message, field) for field in message.fieldnames))
            if client is None:
                continue
            if time.monotonic() - beat_s > 0.1:
                beat_s = time.monotonic()
                armed = 128 if vehicle.armed else 0
                beat = mav.heartbeat_encode(2, vehicle.autopilot, armed, 0, 4)
                self._socket.sendto(beat.pack(mav), client)
            for _ in range(8):
                vehicle.now_s += vehicle.step_s
                vehicle._step()
            while vehicle._out:
                message = vehicle._out.popleft()
                packet = message if isinstance(message, bytes) else message.pack(vehicle._mav)
                with suppress(OSError):
                    self._socket.sendto(packet, client)


def ulog_messages(log: bytes) -> Iterator[int]:
    """Yield where the header and each message begins."""
    at = 0
    yield at
    at = 16
    while at + 3 <= len(log):
        yield at
        at += 3 + int.from_bytes(log[at : at + 2], "little")


def whole_messages(log: bytes, autopilot: int) -> bytes:
    """Return a log up to the last message that its stream holds whole."""
    if autopilot == FRAMES:
        *_, last = (at for at in [*ulog_messages(log)])
        end = last + 3 + int.from_bytes(log[last : last + 2], "little")
        return log if end <= len(log) else log[:last]
    log = log[: len(log) // 200 * 200]
    lengths, at = {128: 89}, 0
    while at + 3 <= len(log) and at + lengths[log[at + 2]] <= len(log):
        if log[at + 2] == 128:
            lengths[log[at + 3]] = log[at + 4]
        at += lengths[log[at + 2]]
    return log[:at]
