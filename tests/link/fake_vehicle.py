"""A vehicle on a loopback socket: heartbeats, file transfer or log requests, and what links do to them."""

from __future__ import annotations

import os
import random
import socket
import struct
import threading
import time
import zlib
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

os.environ.setdefault("MAVLINK20", "1")
from pymavlink.dialects.v20 import common as dialect

HEAD = struct.Struct("<HBBBBBxI")
BURST = 40


@dataclass
class FakeVehicle:
    """Serves `files`; every fault is off unless it is asked for."""

    files: dict[str, bytes]
    armed: bool = False
    armed_after: int = 10**9  # chunks
    ftp: bool = True
    loss: float = 0.0
    reorder: float = 0.0
    duplicate: float = 0.0
    silent_after: int = 10**9  # chunks
    listed_sizes: dict[str, int] = field(default_factory=dict)
    raw_lines: list[bytes] = field(default_factory=list)
    wrong_checksum: bool = False
    no_session: int = 0
    noise: bytes = b""
    other_client: bool = False
    chunks: int = 0
    first_offset: int | None = None

    def __enter__(self) -> FakeVehicle:
        self._random = random.Random(1)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.02)
        self.address = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"
        self._mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self._mav.robust_parsing = True
        self._client: Any = None
        self._held: list[bytes] = []
        self._open = b""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        beat_s = 0.0
        while not self._stop.is_set():
            if self._client and time.monotonic() - beat_s > 0.1:
                beat_s = time.monotonic()
                armed = 128 if self.armed or self.chunks >= self.armed_after else 0
                self._put(self._mav.heartbeat_encode(2, 3, armed, 0, 4))
            try:
                data, self._client = self._socket.recvfrom(2048)
            except TimeoutError:
                continue
            for message in self._mav.parse_buffer(data) or ():
                self._serve(message)

    def _put(self, message: Any, *, lossy: bool = False) -> None:
        packet = message.pack(self._mav)
        if lossy and self._random.random() < self.loss:
            return
        if lossy and self._random.random() < self.reorder:
            self._held.append(packet)
            return
        copies = 2 if lossy and self._random.random() < self.duplicate else 1
        for each in [packet] * copies + self._held:
            self._socket.sendto(each + self.noise, self._client)
        self._held.clear()

    def _serve(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "FILE_TRANSFER_PROTOCOL" and self.ftp:
            self._serve_file(bytes(message.payload), message.get_srcSystem(), message.get_srcComponent())
        elif kind == "LOG_REQUEST_LIST":
            for number, data in enumerate(self.files.values(), 1):
                entry = self._mav.log_entry_encode(
                    number, len(self.files), len(self.files), 1_700_000_000, len(data)
                )
                self._put(entry, lossy=True)
        elif kind == "LOG_REQUEST_DATA":
            data = list(self.files.values())[message.id - 1]
            end = min(message.ofs + message.count, len(data))
            for offset in range(message.ofs, end, 90):
                chunk = data[offset : min(offset + 90, end)]
                self._chunk(self._mav.log_data_encode(message.id, offset, len(chunk), chunk.ljust(90, b"\0")))

    def _chunk(self, message: Any) -> None:
        self.chunks += 1
        if self.chunks <= self.silent_after:
            self._put(message, lossy=True)
        if self.chunks % 20 == 0:
            time.sleep(0.001)

    def _serve_file(self, raw: bytes, system: int, component: int) -> None:
        sequence, _, opcode, size, _, _, offset = HEAD.unpack_from(raw)
        name = raw[HEAD.size : HEAD.size + size].decode()

        def reply(
            data: bytes,
            at: int = 0,
            *,
            kind: int = 128,
            last: int = 0,
            count: int = 1,
            to: tuple[int, int] | None = None,
        ) -> Any:
            head = HEAD.pack((sequence + count) & 0xFFFF, 1, kind, len(data), opcode, last, at)
            receiver = to or (system, component)
            return self._mav.file_transfer_protocol_encode(0, *receiver, (head + data).ljust(251, b"\0"))

        if opcode == 3:
            lines = self._listing(name)
            if not lines[offset:]:
                error = b"\x06" if lines else b"\x0a"
                self._put(reply(error, kind=129), lossy=True)
            else:
                self._put(reply(b"".join(line + b"\0" for line in lines[offset : offset + 3])), lossy=True)
        elif opcode == 4 and self.no_session:
            self.no_session -= 1
            self._put(reply(b"\x05", kind=129))
        elif opcode == 4:
            self._open = self.files[name]
            self._put(reply(struct.pack("<I", self.listed_sizes.get(name, len(self._open)))), lossy=True)
        elif opcode == 14:
            crc = zlib.crc32(self.files[name], 0xFFFFFFFF) ^ 0xFFFFFFFF
            self._put(reply(struct.pack("<I", crc ^ self.wrong_checksum)), lossy=True)
        elif opcode == 5:
            self._chunk(reply(self._open[offset : offset + size], offset))
        elif opcode == 15:
            self.first_offset = offset if self.first_offset is None else self.first_offset
            if offset >= len(self._open):
                self._put(reply(b"\x06", kind=129), lossy=True)
            starts = range(offset, min(offset + BURST * 239, len(self._open)), 239)
            for count, start in enumerate(starts, 1):
                if self.other_client:
                    self._put(reply(b"\xff" * 239, start, count=count, to=(255, 190)))
                chunk = self._open[start : start + 239]
                self._chunk(reply(chunk, start, last=int(count == len(starts)), count=count))

    def _listing(self, folder: str) -> list[bytes]:
        """Return the lines of a folder, of files right in it and folders one below."""
        lines, folders = [], set()
        for path, data in self.files.items():
            if not path.startswith(f"{folder}/"):
                continue
            first, _, rest = path[len(folder) + 1 :].partition("/")
            if rest:
                folders.add(first)
            else:
                lines.append(b"F%s\t%d" % (first.encode(), self.listed_sizes.get(path, len(data))))
        lines += [b"D%s" % each.encode() for each in sorted(folders)]
        return lines + self.raw_lines if lines else []
