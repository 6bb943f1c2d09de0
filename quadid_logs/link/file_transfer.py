"""MAVLink's file transfer protocol, reading only (mavlink.io, services/ftp)."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import BinaryIO, Final, NamedTuple

from quadid_logs.errors import LinkError
from quadid_logs.link.transfer import Chunk, receive
from quadid_logs.link.vehicle import Vehicle

_HEAD: Final = struct.Struct(
    "<HBBBBBxI"
)  # sequence, session, opcode, size, requested opcode, burst end, offset
_MOST_DATA: Final = 239
_LENGTH: Final = 251
_TERMINATE, _LIST, _OPEN, _READ, _CHECKSUM, _BURST, _ACK, _NACK = 1, 3, 4, 5, 14, 15, 128, 129
_NO_SESSION_LEFT, _END_OF_FILE = 5, 6
#: A burst's packets count on from its request; none has as many.
_WINDOW: Final = 1 << 15
#: Offsets have 32 bits [bytes].
_LARGEST: Final = (1 << 32) - 1
#: A folder with more is none of logs; it also ends a listing that never ends.
_MOST_ENTRIES: Final = 20_000
#: Flash of a card read and summed by the vehicle, at the slowest [bytes/s].
_SUM_RATE: Final = 300_000


class Answer(NamedTuple):
    """An answer: the session, where its data belong, whether they end a burst; `error` 0 where it worked."""

    session: int
    request: int
    offset: int
    data: bytes
    last: bool
    error: int


class Entry(NamedTuple):
    """A line of a listing."""

    name: str
    folder: bool
    size: int


class FileTransfer:
    """Files on the vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._sequence = 0
        self._base = 0
        self._session = 0
        #: Nothing answered a listing: the vehicle has no file transfer.
        self.silent = False

    def listing(self, folder: str) -> list[Entry] | None:
        """Return what is in a folder, None where there is none, or no file transfer.

        Raises
        ------
        LinkError
            If the list breaks off.
        """
        entries: list[Entry] = []
        listed = 0
        while listed < _MOST_ENTRIES:
            answer = self._ask(_LIST, folder.encode(), offset=listed)
            if answer is None and listed:
                raise LinkError(
                    f"The vehicle stopped while it listed {folder}.", hint="Run the same command again."
                )
            if answer is None:
                self.silent = True
                return None
            if answer.error:
                return entries if listed or answer.error == _END_OF_FILE else None
            lines = [line for line in answer.data.split(b"\0") if line]
            if not lines:
                break
            listed += len(lines)
            entries += [entry for line in lines if (entry := _entry(line)) is not None]
        return entries

    def read(
        self, path: str, file: BinaryIO, size: int, tell: Callable[[int], None] = lambda _: None
    ) -> None:
        """Append the missing bytes of a file on the vehicle to one of ours.

        Parameters
        ----------
        size : int
            As listed; what the vehicle sends beyond is left out.
        tell : callable
            Called with the bytes that are there.

        Raises
        ------
        LinkError
        """
        # What is still under way of an earlier file is told by its sequence.
        self._sequence += _WINDOW // 2
        answer = self._open(path)
        self._session, self._base = answer.session, self._sequence
        try:
            receive(self._vehicle, self, file, size, tell)
        finally:
            self._send(_TERMINATE)

    def size(self, path: str) -> int | None:
        """Return the present size of a file [bytes], None where the vehicle does not say."""
        answer = self._open(path)
        self._session = answer.session
        self._send(_TERMINATE)
        return struct.unpack("<I", answer.data[:4])[0] if len(answer.data) >= 4 else None

    def checksum(self, path: str, size: int) -> int | None:
        """Return the CRC-32 of a file (start 0, no final inversion), None where the vehicle cannot tell.

        Parameters
        ----------
        size : int
            Says how long the vehicle may take [bytes].
        """
        answer = self._ask(
            _CHECKSUM, path.encode(), wait_s=size / _SUM_RATE + self._vehicle.patience.answer_s
        )
        if answer is None or answer.error or len(answer.data) < 4:
            return None
        return int(struct.unpack("<I", answer.data[:4])[0])

    def stream(self, offset: int) -> None:
        """Ask for a burst: the source of a transfer."""
        self._send(_BURST, offset=offset, size=_MOST_DATA)

    def again(self, holes: list[tuple[int, int]]) -> None:
        """Ask for the first bytes of each range: the source of a transfer."""
        for begin, end in holes:
            self._send(_READ, offset=begin, size=min(_MOST_DATA, end - begin))

    def chunk(self, message: object) -> Chunk | None:
        """Return the bytes in a message: the source of a transfer."""
        answer = self._answer(message)
        if answer is None or answer.session != self._session or answer.request not in {_BURST, _READ}:
            return None
        if answer.error:
            return Chunk(_LARGEST + 1, b"", last=True)
        return Chunk(answer.offset, answer.data, answer.last)

    def _open(self, path: str) -> Answer:
        """Open a file, after waiting for a session where another program holds the only one."""
        for _ in range(self._vehicle.patience.tries):
            answer = self._ask(_OPEN, path.encode())
            if answer is None:
                break
            if not answer.error:
                return answer
            if answer.error != _NO_SESSION_LEFT:
                raise LinkError(
                    f"The vehicle does not open {path}: its file transfer reports error {answer.error}.",
                    hint="Run the command with --list: the log may have been erased.",
                )
            time.sleep(self._vehicle.patience.answer_s)
        raise LinkError(
            f"The vehicle opens no session to read {path}.",
            hint="Another program may hold it: close it, wait ten seconds, and run the command again.",
        )

    def _ask(self, opcode: int, data: bytes, *, offset: int = 0, wait_s: float = 0.0) -> Answer | None:
        """Send a request until its own answer arrives; None if none does."""
        patience = self._vehicle.patience
        self._sequence += 1
        for _ in range(patience.tries if not wait_s else 2):
            self._send(opcode, data, offset=offset, count=False)
            until_s = time.monotonic() + (wait_s or patience.answer_s)
            while (message := self._vehicle.next(until_s)) is not None:
                answer = self._answer(message, opcode)
                if answer is not None:
                    return answer
        return None

    def _send(
        self, opcode: int, data: bytes = b"", *, offset: int = 0, size: int = 0, count: bool = True
    ) -> None:
        self._sequence += count
        # A long file's packets pass any number: what counts as late moves on with them.
        self._base = max(self._base, self._sequence - _WINDOW // 4)
        head = _HEAD.pack(self._sequence & 0xFFFF, self._session, opcode, len(data) or size, 0, 0, offset)
        payload = (head + data[:_MOST_DATA]).ljust(_LENGTH, b"\0")
        self._vehicle.send("file_transfer_protocol", 0, *self._vehicle.target, payload)

    def _answer(self, message: object, opcode: int | None = None) -> Answer | None:
        """Return what an answer says: to the last request if `opcode` names it, else to any of this file."""
        if getattr(message, "get_type", str)() != "FILE_TRANSFER_PROTOCOL":
            return None
        raw = bytes(getattr(message, "payload", b""))[:_LENGTH].ljust(_HEAD.size, b"\0")
        sequence, session, kind, size, request, last, offset = _HEAD.unpack_from(raw)
        data = raw[_HEAD.size : _HEAD.size + size]
        if kind not in {_ACK, _NACK}:
            return None
        if opcode is not None and (request != opcode or sequence != (self._sequence + 1) & 0xFFFF):
            return None
        if opcode is None:
            if (sequence - self._base) & 0xFFFF > _WINDOW:
                return None
            # The next request counts on from what the vehicle has counted to.
            if 0 < (ahead := (sequence - self._sequence) & 0xFFFF) < _WINDOW:
                self._sequence += ahead
        error = (data[0] if data else 1) or 1
        return Answer(session, request, offset, data, bool(last), error if kind == _NACK else 0)


def _entry(line: bytes) -> Entry | None:
    """Return a line of a listing; None for what is neither file nor folder or whose name leads elsewhere."""
    name, _, size = line[1:].decode("utf-8", "replace").partition("\t")
    if line[:1] not in b"FD" or not name or name in {".", ".."} or "/" in name or "\\" in name:
        return None
    digits = size.split("\t")[0]
    known = digits.isascii() and digits.isdigit() and len(digits) < 12
    length = int(digits) if known else 0
    return Entry(name, line[:1] == b"D", length if length <= _LARGEST else 0)
