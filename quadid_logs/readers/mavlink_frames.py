"""Where the packets of a MAVLink log are: a packet is only taken if its checksum is right.

Framing of MAVLink 1 and 2: https://mavlink.io/en/guide/serialization.html. A
telemetry log puts 8 bytes of host time before each packet.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import AnyArray, BoolArray, FloatArray, IntArray
from quadid_logs.data.log import LostStretch
from quadid_logs.readers.content import Bytes, little_endian, merge_stretches, rows_at
from quadid_logs.readers.mavlink_dialect import Dialect

MAGIC_1: Final = 0xFE
MAGIC_2: Final = 0xFD
STAMP_SIZE: Final = 8
_HEADER_1: Final = 6
_HEADER_2: Final = 10
_CHECKSUM: Final = 2
_SIGNATURE: Final = 13
_SIGNED: Final = 1
_BLOCK: Final = 1 << 20


class Packets(NamedTuple):
    """Packets with a right checksum, in file order; every array has one entry per packet.

    ``start`` is the byte offset of the magic byte (int64), ``header`` the size
    before the payload, ``length`` that of the (zero-truncated) payload (uint8),
    ``size`` that of the whole packet without host stamp (uint16).
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


class Framing(NamedTuple):
    """The packets of a file and what is between them.

    `stamped` is False for a bare MAVLink stream without host times;
    `n_unknown` counts packets of unknown type, `n_bad` those whose checksum is wrong.
    """

    packets: Packets
    stamped: bool
    lost: tuple[LostStretch, ...]
    n_unknown: int
    n_bad: int


def frame(data: Bytes, dialect: Dialect) -> Framing:
    """Find every packet of a telemetry log.

    Parameters
    ----------
    data : ndarray of uint8
        The whole file.
    dialect : Dialect

    Returns
    -------
    Framing
        Bytes that belong to no packet are in `lost`, except packets of unknown
        type, whose checksum cannot be known, where they fill a gap exactly.
    """
    blocks = [_candidates(data, begin, dialect) for begin in range(0, max(1, len(data)), _BLOCK)]
    packets = Packets(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))
    del blocks  # as large as the packets themselves
    keep = _without_overlap(packets)
    packets = packets if keep.all() else packets.where(keep)
    before = packets.start[1:] - packets.end[:-1]
    stamped = not len(before) or bool((before >= STAMP_SIZE).mean() > 0.5)
    lost, n_unknown, n_bad = _between(data, packets, dialect, STAMP_SIZE if stamped else 0)
    return Framing(packets, stamped, lost, n_unknown, n_bad)


def host_time_s(data: Bytes, packets: Packets) -> FloatArray:
    """Return the host's stamps before the packets [s since 1970]; NaN where none is possible.

    Big-endian microseconds. The host's clock can run wrong by factors.
    """
    time_s = np.full(len(packets.start), np.nan)
    has_stamp = packets.start >= STAMP_SIZE
    place = packets.start[has_stamp] - STAMP_SIZE
    seconds = np.zeros(len(place))
    for k in range(STAMP_SIZE):
        seconds = seconds * 256.0 + data[place + k]
    time_s[has_stamp] = seconds * 1e-6
    return time_s


def _candidates(data: Bytes, begin: int, dialect: Dialect) -> Packets:
    """Find the packets with a right checksum that begin in one block, also where they end behind it."""
    block = data[begin : begin + _BLOCK]
    versions = [
        _headers(data, np.flatnonzero(block == magic) + begin, header, dialect)
        for magic, header in ((MAGIC_1, _HEADER_1), (MAGIC_2, _HEADER_2))
    ]
    packets = Packets(*(np.concatenate(parts) for parts in zip(*versions, strict=True)))
    packets = packets.where(_has_right_checksum(data, packets, dialect))
    return packets.where(np.argsort(packets.start, kind="stable"))


def _headers(data: Bytes, start: IntArray, header: int, dialect: Dialect) -> Packets:
    """Read the headers of one version, and keep those that can be of a known message inside the file."""
    start = start[start + header + _CHECKSUM <= len(data)]
    head = rows_at(data, start, np.dtype((np.void, header))).view(np.uint8).reshape(len(start), header)
    length = head[:, 1]
    size = length.astype(np.uint16) + np.uint16(header + _CHECKSUM)
    if header == _HEADER_1:
        msg_id = head[:, 5].astype(np.int32)
        # The payload of version 1 never exceeds the known layout; version 2 may bring new extensions.
        possible = length <= dialect.longest[msg_id]
    else:
        msg_id = (
            head[:, 7].astype(np.int32) | head[:, 8].astype(np.int32) << 8 | head[:, 9].astype(np.int32) << 16
        )
        possible = (msg_id < len(dialect.extra)) & (head[:, 2] <= _SIGNED)
        msg_id[~possible] = 0
        size[head[:, 2] == _SIGNED] += np.uint16(_SIGNATURE)
    possible &= (dialect.extra[msg_id] >= 0) & (start + size <= len(data))
    sender = header - 3 if header == _HEADER_1 else header - 5
    system, component = head[:, sender], head[:, sender + 1]
    before_payload = np.full(len(start), header, np.uint8)
    return Packets(start, before_payload, length, size, msg_id, system, component).where(possible)


def _has_right_checksum(data: Bytes, packets: Packets, dialect: Dialect) -> BoolArray:
    """Compare every packet's CRC-16/MCRF4XX, over all but the magic byte plus the extra byte.

    Packets of equal size are done together, two bytes a step.
    """
    right = np.zeros(len(packets.start), bool)
    if not len(right):
        return right
    covered = packets.header.astype(np.uint16) + packets.length - np.uint16(1)
    order = np.argsort(covered, kind="stable")  # radix sort
    cuts = np.flatnonzero(np.diff(covered[order])) + 1
    one_byte, two_bytes = crc_tables()
    extra = dialect.extra[packets.msg_id].astype(np.uint8)
    checksum = packets.payload + packets.length
    for group in np.split(order, cuts):
        n_bytes = int(covered[group[0]])
        row = np.dtype((np.void, n_bytes))
        body = np.empty((len(group), n_bytes + 1), np.uint8)
        body[:, :n_bytes] = (
            rows_at(data, packets.start[group] + 1, row).view(np.uint8).reshape(len(group), n_bytes)
        )
        body[:, n_bytes] = extra[group]
        right[group] = _crc(body, one_byte, two_bytes) == little_endian(data, checksum[group], 2)
    return right


def crc_tables() -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return what one and what two zero bytes make of a CRC-16/MCRF4XX state.

    Polynomial 0x1021 reflected (0x8408). Because the step is linear, a byte or
    a little-endian pair of bytes is first combined with the state by exclusive or.
    """
    state = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        state = np.where(state & 1, (state >> 1) ^ np.uint16(0x8408), state >> 1).astype(np.uint16)
    pair = np.arange(1 << 16, dtype=np.uint16)
    for _ in range(2):
        pair = (pair >> 8) ^ state[pair & 0xFF]
    return state, pair


def _crc(body: Bytes, one_byte: NDArray[np.uint16], two_bytes: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return the checksum of each row."""
    n_pairs = body.shape[1] // 2
    pairs = np.ascontiguousarray(np.ascontiguousarray(body[:, : 2 * n_pairs]).view("<u2").T)
    crc = np.full(len(body), 0xFFFF, np.uint16)
    for words in pairs:
        crc = two_bytes[crc ^ words]
    if body.shape[1] % 2:
        crc = (crc >> 8) ^ one_byte[(crc ^ body[:, -1]) & 0xFF]
    return crc


def _without_overlap(found: Packets) -> BoolArray:
    """Mark the packets that do not begin inside an earlier one: a checksum can be right by chance."""
    keep = np.ones(len(found.start), bool)
    ends = found.end
    inside = np.flatnonzero(found.start[1:] < np.maximum.accumulate(ends)[:-1]) + 1
    last, end = -1, 0
    for k in inside.tolist():
        if k - 1 != last:
            end = int(ends[k - 1])  # the one before begins inside none: it is kept
        keep[k] = int(found.start[k]) >= end
        last, end = k, int(ends[k]) if keep[k] else end
    return keep


def _between(
    data: Bytes, packets: Packets, dialect: Dialect, stamp: int
) -> tuple[tuple[LostStretch, ...], int, int]:
    """Explain the bytes between the packets: lost stretches, unknown packets, wrong checksums."""
    begins = np.concatenate([[0], packets.end])
    ends = np.concatenate([packets.start - stamp, [len(data)]])
    lost: list[LostStretch] = []
    n_unknown = n_bad = 0
    for k in np.flatnonzero(ends > begins).tolist():
        begin, end = int(begins[k]), int(ends[k])
        bad = _explain_gap(data, begin, end, dialect, stamp)
        if bad is None:
            at_end = end == len(data)
            reason = "cut off or unreadable up to the end" if at_end else "no packet with a right checksum"
            lost.append(LostStretch(offset=begin, n_bytes=end - begin, reason=reason))
            continue
        unknown, wrong = bad
        n_unknown, n_bad = n_unknown + unknown, n_bad + len(wrong)
        lost += [LostStretch(offset=a, n_bytes=b - a, reason="wrong checksum") for a, b in wrong]
    return merge_stretches(lost), n_unknown, n_bad


def _explain_gap(
    data: Bytes, begin: int, end: int, dialect: Dialect, stamp: int
) -> tuple[int, list[tuple[int, int]]] | None:
    """Count unknown packets and list those with wrong checksum; None if they do not fill the gap."""
    n_unknown, wrong = 0, []
    while begin < end:
        head = data[begin + stamp : begin + stamp + _HEADER_2].tobytes()
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
