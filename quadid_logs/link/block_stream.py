"""A DataFlash log put together from remote log blocks (mavlink.io: REMOTE_LOG_DATA_BLOCK).

A block has its place in the file, and stays with the vehicle until it is acknowledged, so that one that is
missing can be requested again. What never comes leaves zeros, and the messages that reach into them are
zeroed too: messages of this format have no checksum, and half a message would be read as a whole one.
"""

from __future__ import annotations

from typing import BinaryIO, Final

from quadid_logs.containers.dataflash_index import FMT_ID, FMT_LENGTH, HEADER
from quadid_logs.link.losses import Losses

BLOCK: Final = 200
#: Vehicles keep some ten to some hundred blocks until they are acknowledged [blocks].
MOST_AHEAD: Final = 4096
#: Networks change the order within milliseconds; then a block is requested, and again, and given up [s].
_ASK_AFTER_S, _ASK_EVERY_S, _GIVE_UP_S = 0.1, 0.3, 5.0
_MOST_ASKED: Final = 20
#: Messages that follow each other where the log is taken up again after a hole: a header by chance stands
#: once in 64 kB.
_CHAIN: Final = 3
_HEAD: Final = len(HEADER) + 1
_LONGEST: Final = 255


class BlockStream:
    """Blocks into a file at their places.

    Parameters
    ----------
    file : binary file
        Empty, and can be written at any place.
    losses : Losses
        Counts what is missing.
    """

    def __init__(self, file: BinaryIO, losses: Losses) -> None:
        self._file, self._losses = file, losses
        self._first_missing = 0
        self._ahead: dict[int, bytes] = {}
        self._missing: dict[int, tuple[float, float]] = {}
        self._lengths = {FMT_ID: FMT_LENGTH}
        self._unread = bytearray()
        self._after_hole = False
        self._progress_s = 0.0
        #: Bytes from the beginning that will not change any more: all of them whole messages.
        self.n_bytes = 0

    @property
    def n_blocks(self) -> int:
        """Blocks from the beginning that are there, or were given up."""
        return self._first_missing

    def take(self, number: int, data: bytes, now_s: float) -> bool:
        """Take a block; return whether to acknowledge it.

        Parameters
        ----------
        number : int
            From 0.
        now_s : float
            On a monotonic clock.
        """
        if number >= self._first_missing + MOST_AHEAD or len(data) != BLOCK:
            self._losses.senseless += 1
            return False
        if number < self._first_missing or number in self._ahead:
            self._losses.repeated += 1
            return True
        self._file.seek(number * BLOCK)
        self._file.write(data)
        _, asked_s = self._missing.pop(number, (0.0, 0.0))
        self._losses.late += asked_s > 0.0
        self._losses.arrived += 1
        for hole in range(max(self._ahead) + 1 if self._ahead else self._first_missing, number):
            self._missing[hole] = now_s, 0.0
        self._ahead[number] = data
        self._advance(now_s)
        return True

    def wanted(self, now_s: float) -> list[int]:
        """Return the blocks to request again; those that were requested in vain are given up."""
        wanted = []
        for number, (since_s, asked_s) in sorted(self._missing.items()):
            if now_s - since_s > _GIVE_UP_S:
                continue
            if now_s - since_s > _ASK_AFTER_S and now_s - asked_s > _ASK_EVERY_S:
                wanted.append(number)
        wanted = wanted[:_MOST_ASKED]
        for number in wanted:
            self._missing[number] = self._missing[number][0], now_s
        while self._ahead and now_s - self._missing.get(self._first_missing, (now_s, 0.0))[0] > _GIVE_UP_S:
            self._give_up(now_s)
        return wanted

    @property
    def is_whole(self) -> bool:
        """Whether no block is missing before the last one that arrived."""
        return not self._ahead

    def close(self, now_s: float) -> None:
        """Give up what is missing; a begun message at the end is left out."""
        while self._ahead:
            self._give_up(now_s)
        if self._after_hole:
            self._take_up(at_end=True)
        self._read()
        self._file.truncate(self.n_bytes)

    def _advance(self, now_s: float) -> None:
        """Go through the blocks that follow each other."""
        while self._first_missing in self._ahead:
            self._unread += self._ahead.pop(self._first_missing)
            self._first_missing += 1
            self._progress_s = now_s
        if self._after_hole:
            self._take_up(at_end=False)
        self._read()

    def _give_up(self, now_s: float) -> None:
        """Leave a hole of zeros from the begun message on, up to the next block that is there."""
        following = min(self._ahead)
        noticed_s, _ = self._missing[self._first_missing]
        for number in range(self._first_missing, following):
            del self._missing[number]
        self._losses.frames += following - self._first_missing
        self._losses.gaps += 1
        self._losses.longest_s = max(self._losses.longest_s, noticed_s - self._progress_s)
        self._blank(len(self._unread))
        self.n_bytes = following * BLOCK
        self._first_missing = following
        self._after_hole = True
        self._advance(now_s)

    def _blank(self, size: int) -> None:
        """Write zeros over the next bytes, and go on behind them."""
        self._file.seek(self.n_bytes)
        self._file.write(bytes(size))
        del self._unread[:size]
        self.n_bytes += size

    def _take_up(self, *, at_end: bool) -> None:
        """Find the first message behind a hole, once enough has come to be sure of it."""
        if not at_end and len(self._unread) < (_CHAIN + 1) * _LONGEST:
            return
        begin = self._unread.find(HEADER)
        while begin >= 0 and not self._is_chain(begin):
            begin = self._unread.find(HEADER, begin + 1)
        if begin < 0 and not at_end and len(self._unread) < 1 << 16:
            return
        self._blank(begin if begin >= 0 else len(self._unread))
        self._after_hole = False

    def _is_chain(self, begin: int) -> bool:
        """Say whether messages follow each other from here, as far as there are any."""
        for _ in range(_CHAIN):
            head = self._unread[begin : begin + _HEAD]
            if len(head) < _HEAD:
                return True
            if not head.startswith(HEADER) or head[2] not in self._lengths:
                return False
            begin += self._lengths[head[2]]
        return True

    def _read(self) -> None:
        """Go over the whole messages that have come, and learn from them how long others are."""
        if self._after_hole:
            return
        at, unread = 0, self._unread
        while at + _HEAD <= len(unread):
            length = self._lengths.get(unread[at + 2], 0) if unread.startswith(HEADER, at) else 0
            if not length:
                # What the vehicle sent stays as it is: readers find the next message likewise.
                following = unread.find(HEADER, at + 1)
                at = following if following >= 0 else max(at + 1, len(unread) - 1)
                continue
            if at + length > len(unread):
                break
            if unread[at + 2] == FMT_ID and unread[at + _HEAD + 1] >= _HEAD:
                self._lengths[unread[at + _HEAD]] = unread[at + _HEAD + 1]
            at += length
        at = min(at, len(unread))
        self.n_bytes += at
        del unread[:at]
