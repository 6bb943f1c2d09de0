"""Where the packets of a MAVLink log are: a packet is only taken if its checksum is right.

Framing of MAVLink 1 and 2: https://mavlink.io/en/guide/serialization.html. A
telemetry log puts 8 bytes of host time before each packet.
"""

from __future__ import annotations

import binascii
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import AnyArray, BoolArray, FloatArray, IntArray
from quadid_logs.containers.content import Bytes, FileParts, merge_lost, rows_at, rows_of_types
from quadid_logs.containers.mavlink_dialect import Dialect
from quadid_logs.data.log import LostBytes

MAGIC_1: Final = 0xFE
MAGIC_2: Final = 0xFD
STAMP_SIZE: Final = 8
_HEADER_1: Final = 6
_HEADER_2: Final = 10
#: The parts of a header that are needed. The number of version 2 has the upper three bytes of `id`.
_LAYOUT_1: Final = np.dtype(
    {
        "names": ["length", "system", "component", "id"],
        "formats": ["u1"] * 4,
        "offsets": [1, 3, 4, 5],
        "itemsize": _HEADER_1,
    }
)
_LAYOUT_2: Final = np.dtype(
    {
        "names": ["length", "flags", "system", "component", "id"],
        "formats": ["u1"] * 4 + ["<u4"],
        "offsets": [1, 2, 5, 6, 6],
        "itemsize": _HEADER_2,
    }
)
_STAMP_LAYOUT: Final = np.dtype([("us", ">u8")])
_CHECKSUM: Final = 2
_CHECKSUM_LAYOUT: Final = np.dtype((np.void, _CHECKSUM))
_SIGNATURE: Final = 13
_SIGNED: Final = 1
LONGEST: Final = _HEADER_2 + 255 + _CHECKSUM + _SIGNATURE
#: Of a megabyte, a small file's arrays of candidates would weigh as much as the file.
_BLOCK: Final = 1 << 19
#: So few packets of one size in a block, mostly by chance, are faster one by one than as an array.
_RARE: Final = 16
_MIRRORED: Final = bytes(int(f"{value:08b}"[::-1], 2) for value in range(256))


class Packets(NamedTuple):
    """Packets with a right checksum, in file order; every array has one entry per packet.

    ``start`` is the byte offset of the magic byte (int64), ``header`` the size
    before the payload, ``length`` that of the (zero-truncated) payload (uint8),
    ``size`` that of the whole packet without host stamp (uint16), ``msg_id`` its
    type (uint16), ``system`` and ``component`` the sender (uint8).
    """

    start: AnyArray
    header: AnyArray
    length: AnyArray
    size: AnyArray
    msg_id: AnyArray
    system: AnyArray
    component: AnyArray

    @property
    def payload(self) -> IntArray:
        """Byte offsets of the payloads."""
        return self.start + self.header

    @property
    def end(self) -> IntArray:
        """Byte offsets behind the packets."""
        return self.start + self.size

    def where(self, chosen: BoolArray | IntArray | slice) -> Packets:
        """Return the packets that `chosen` marks or lists."""
        return Packets(*(part[chosen] for part in self))

    def in_place_for(self, capacity: int, count: int) -> Packets:
        """Return the first `count` packets in arrays with place for `capacity`."""
        wider = Packets(*(np.empty(capacity, part.dtype) for part in self))
        for field, part in zip(wider, self, strict=True):
            field[:count] = part[:count]
        return wider


_NO_PACKETS: Final = Packets(
    np.zeros(0, np.int64), *(np.zeros(0, kind) for kind in ("u1", "u1", "u2", "u2", "u1", "u1"))
)


class Framing(NamedTuple):
    """The packets of a file and what is between them; `n_unknown` counts packets of unknown type."""

    packets: Packets
    lost: tuple[LostBytes, ...]
    n_unknown: int


def frame(file: FileParts, dialect: Dialect) -> Framing:
    """Find every packet of a telemetry log.

    Bytes that belong to no packet are in `lost`, except packets of unknown type, whose checksum cannot be
    known, where they fill a gap exactly.
    """
    # To hold all blocks' packets until they are joined would take twice the memory.
    whole, count = _NO_PACKETS, 0
    for begin, block in file.blocks(_BLOCK, LONGEST):
        # What begins in the first `_BLOCK` bytes, places counted from 0; first packets of version 1. Both
        # magic bytes in one pass: they follow each other, and smaller values wrap around.
        found = np.flatnonzero(block[:_BLOCK] - np.uint8(MAGIC_2) <= MAGIC_1 - MAGIC_2)
        is_1 = block[found] == MAGIC_1
        versions = [
            _headers(block, found[is_1], _LAYOUT_1, dialect),
            _headers(block, found[~is_1], _LAYOUT_2, dialect),
        ]
        packets = Packets(*(np.concatenate(parts) for parts in zip(*versions, strict=True)))
        packets = packets.where(_has_right_checksum(block, packets, dialect))
        more = packets.where(np.argsort(packets.start, kind="stable"))
        after = count + len(more.start)
        if after > len(whole.start):
            expected = int(1.1 * after * file.n_bytes / (begin + _BLOCK))
            whole = whole.in_place_for(max(after, expected, 3 * count // 2), count)
        for field, part in zip(whole, more, strict=True):
            field[count:after] = part
        whole.start[count:after] += begin
        count = after
    packets = whole.where(slice(count))
    # Mark the packets that do not begin inside an earlier one: a checksum can be right by chance.
    keep = np.ones(len(packets.start), bool)
    ends = packets.end
    inside = np.flatnonzero(packets.start[1:] < np.maximum.accumulate(ends)[:-1]) + 1
    last, end = -1, 0
    for k in inside.tolist():
        if k - 1 != last:
            end = int(ends[k - 1])  # the one before begins inside none: it is kept
        keep[k] = int(packets.start[k]) >= end
        last, end = k, int(ends[k]) if keep[k] else end
    packets = packets if keep.all() else packets.where(keep)
    before = packets.start[1:] - packets.end[:-1]
    # A bare MAVLink stream has no host times.
    stamped = not len(before) or bool((before >= STAMP_SIZE).mean() > 0.5)
    lost, n_unknown = _between(file, packets, dialect, STAMP_SIZE if stamped else 0)
    return Framing(packets, lost, n_unknown)


def host_time_s(file: FileParts, packets: Packets) -> FloatArray:
    """Return the host's stamps before the packets [s since 1970]; NaN where none is possible.

    Big-endian microseconds. The host's clock can run wrong by factors.

    Returns
    -------
    ndarray, shape (n_packets,)
    """
    time_s = np.full(len(packets.start), np.nan)
    has_stamp = packets.start >= STAMP_SIZE
    (stamps,) = rows_of_types(file, [(packets.start[has_stamp] - STAMP_SIZE, _STAMP_LAYOUT)])
    time_s[has_stamp] = stamps["us"] * 1e-6
    return time_s


def _headers(block: Bytes, start: IntArray, layout: np.dtype[np.void], dialect: Dialect) -> Packets:
    """Read the headers of one version, and keep those that can be of a known message inside the block."""
    start = start[: np.searchsorted(start, len(block) - layout.itemsize - _CHECKSUM, side="right")]
    head = rows_at(block, start, layout)
    length = head["length"]
    size = length.astype(np.uint16) + np.uint16(layout.itemsize + _CHECKSUM)
    if layout is _LAYOUT_1:
        msg_id = head["id"]
        # The payload of version 1 never exceeds the known layout; version 2 may bring new extensions.
        possible = length <= dialect.longest[msg_id]
    else:
        msg_id = np.minimum(head["id"] >> 8, len(dialect.extra) - 1)  # the last one is nobody's
        size += (head["flags"] == _SIGNED) * np.uint16(_SIGNATURE)
        possible = head["flags"] <= _SIGNED
    possible &= (dialect.extra[msg_id] >= 0) & (start + size <= len(block))
    before_payload = np.full(len(start), layout.itemsize, np.uint8)
    sender = head["system"], head["component"]
    found = Packets(start, before_payload, length, size, msg_id.astype(np.uint16), *sender)
    return found.where(np.flatnonzero(possible))


def _has_right_checksum(block: Bytes, packets: Packets, dialect: Dialect) -> BoolArray:
    """Compare every packet's CRC-16/MCRF4XX, over all but the magic byte plus the extra byte."""
    right = np.zeros(len(packets.start), bool)
    covered = packets.header + packets.length.astype(np.uint16)
    is_rare = (np.bincount(covered, minlength=1) < _RARE)[covered]
    for k in np.flatnonzero(is_rare).tolist():
        begin, end = int(packets.start[k]) + 1, int(packets.start[k]) + int(covered[k])
        extra = int(dialect.extra[packets.msg_id[k]])
        right[k] = is_right(block[begin:end].tobytes(), extra, block[end : end + _CHECKSUM].tobytes())
    # Long ones apart: a table of all would be as wide as the longest one.
    is_long = covered > 2.0 * covered.mean() if len(covered) else is_rare
    for chosen in (np.flatnonzero(~is_rare & ~is_long), np.flatnonzero(~is_rare & is_long)):
        if len(chosen):
            order = chosen[np.argsort(covered[chosen], kind="stable")]  # radix sort
            checksum = rows_at(block, packets.start[order] + covered[order], _CHECKSUM_LAYOUT)
            right[order] = _checksums(block, packets.where(order), dialect) == checksum.view("<u2")
    return right


def is_right(covered: bytes, extra: int, checksum: bytes) -> bool:
    """Tell whether a single packet's checksum is right, by the standard library's CRC.

    That has the same polynomial but begins with each byte's highest bit, so
    all bytes are mirrored; the checksum behind what it covers makes zero.
    """
    whole = covered + bytes([extra]) + checksum
    return binascii.crc_hqx(whole.translate(_MIRRORED), 0xFFFF) == 0


def _checksums(block: Bytes, packets: Packets, dialect: Dialect) -> NDArray[np.uint16]:
    """Compute the checksums of at least one packet, sorted by size, all at once and two bytes a step.

    They are aligned at their ends: zeros in front do not change a state of zero.
    """
    sizes, first = np.unique(packets.header + packets.length.astype(np.uint16), return_index=True)
    n_steps, n_packets = (int(sizes[-1]) + 1) // 2, len(packets.start)
    words = np.empty((n_steps, n_packets), "<u2")
    extra = dialect.extra[packets.msg_id].astype(np.uint8)
    for size, lo, hi in zip(sizes.tolist(), first, [*first[1:], n_packets], strict=True):
        # The initial ones of the register are combined with the first two bytes; an odd size has a zero in
        # front.
        start = packets.start[lo:hi]
        odd = size % 2
        row = rows_at(block, start + (1 - odd), np.dtype((np.void, size + odd)))
        body = row.view(np.uint8).reshape(len(start), size + odd)
        body[:, :odd] = 0
        body[:, odd : odd + 2] ^= 0xFF
        body[:, -1] = extra[lo:hi]
        covered = body.view("<u2")
        words[n_steps - covered.shape[1] :, lo:hi] = covered.T
    # The packets that have begun at each step: the longest ones, which stand last.
    begun = first[np.searchsorted(sizes, 2 * np.arange(n_steps, 0, -1) - 1)]
    return crc_of_columns(words, begun)


def crc_of_columns(words: NDArray[np.uint16], begun: IntArray) -> NDArray[np.uint16]:
    """Return the CRC-16/MCRF4XX of each column, beginning with a state of zero.

    Polynomial x^16 + x^12 + x^5 + 1 in reflected order: two bytes multiply the
    state by x^16. What overflows comes back shifted by 5 and 12, again and
    again; y sums these rounds up.

    Parameters
    ----------
    words : ndarray of uint16, shape (n_steps, n_columns)
        Little-endian pairs of bytes.
    begun : ndarray of int, shape (n_steps,)
        Columns before it are still zero at that step and are left out.
    """
    crc = np.zeros(words.shape[1], np.uint16)
    for row, first in zip(words, begun.tolist(), strict=True):
        state = crc[first:] ^ row[first:]
        y = state ^ state << 4
        y ^= y << 8
        y ^= state << 11
        crc[first:] = y ^ y >> 5 ^ y >> 12
    return crc


def _between(
    file: FileParts, packets: Packets, dialect: Dialect, stamp: int
) -> tuple[tuple[LostBytes, ...], int]:
    """Explain the bytes between the packets: lost bytes, and how many packets of unknown type."""
    begins = np.concatenate([[0], packets.end])
    ends = np.concatenate([packets.start - stamp, [file.n_bytes]])
    lost: list[LostBytes] = []
    n_unknown = 0
    for k in np.flatnonzero(ends > begins).tolist():
        begin, end = int(begins[k]), int(ends[k])
        bad = _explain_gap(file, begin, end, dialect, stamp)
        if bad is None:
            at_end = end == file.n_bytes
            reason = "cut off or unreadable up to the end" if at_end else "no packet with a right checksum"
            lost.append(LostBytes(offset=begin, n_bytes=end - begin, reason=reason))
            continue
        unknown, wrong = bad
        n_unknown += unknown
        lost += [LostBytes(offset=a, n_bytes=b - a, reason="wrong checksum") for a, b in wrong]
    return merge_lost(lost), n_unknown


def _explain_gap(
    file: FileParts, begin: int, end: int, dialect: Dialect, stamp: int
) -> tuple[int, list[tuple[int, int]]] | None:
    """Count unknown packets and list those with wrong checksum; None if they do not fill the gap."""
    n_unknown, wrong = 0, []
    while begin < end:
        head = file.part(begin + stamp, begin + stamp + _HEADER_2).tobytes()
        if len(head) < _HEADER_1 or head[0] not in (MAGIC_1, MAGIC_2):
            return None
        if head[0] == MAGIC_1:
            msg_id, size = head[5], _HEADER_1 + head[1] + _CHECKSUM
        elif len(head) == _HEADER_2:
            msg_id = int.from_bytes(head[7:10], "little")
            size = _HEADER_2 + head[1] + _CHECKSUM + (_SIGNATURE if head[2] & _SIGNED else 0)
        else:
            return None
        after = begin + stamp + size
        if msg_id < len(dialect.extra) and dialect.extra[msg_id] >= 0:
            wrong.append((begin, after))
        else:
            n_unknown += 1
        begin = after
    return (n_unknown, wrong) if begin == end else None
