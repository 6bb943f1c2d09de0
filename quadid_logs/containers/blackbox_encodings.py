"""Fields of Blackbox frames, decoded for many frames at once.

Source: the writers in Betaflight's ``blackbox_encoding.c``. Frames have no length: where one ends follows
from its bytes. A number of variable length (VB: seven bits per byte, lowest first) ends at the first byte
below 128, so the end of the n-th one behind any place is looked up among those bytes, not walked to.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, IntArray
from quadid_logs.containers.blackbox_header import Layout
from quadid_logs.containers.content import Bytes

Words = NDArray[np.uint32]

SIGNED_VB, UNSIGNED_VB, NEGATED_14_BIT = 0, 1, 3
TAG8_8SVB, TAG2_3S32, TAG8_4S16, NULL, TAG2_3SVARIABLE = 6, 7, 8, 9, 10
#: Fields that are written together.
_TOGETHER: Final = {TAG8_8SVB: 8, TAG2_3S32: 3, TAG8_4S16: 4, TAG2_3SVARIABLE: 3}
#: Zeros behind the bytes of a `Block`: more than the longest frame, a group of 14 bytes per field.
PADDING: Final = 1 << 12
#: No group of fields is longer.
_LONGEST_GROUP: Final = 64
#: A number of 32 bits is five bytes of seven.
_LONGEST_VB: Final = 5

_BITS_SET: Final = np.array([bin(byte).count("1") for byte in range(256)], dtype=np.int64)
_BYTES: Final = np.arange(256)
#: Half bytes of each of four fields by selector of TAG8_4S16, and where each begins.
_NIBBLES: Final = np.array([0, 1, 2, 4])[(_BYTES[:, None] >> np.arange(0, 8, 2)) & 3]
_NIBBLE_AT: Final = np.cumsum(_NIBBLES, axis=1) - _NIBBLES
_TAG8_4S16_BYTES: Final = 1 + (_NIBBLES.sum(axis=1) + 1) // 2
#: Bytes of each of three fields where TAG2_3S32 counts them, and of the whole.
_COUNTED: Final = ((_BYTES[:, None] >> np.arange(0, 6, 2)) & 3) + 1
_TAG2_3_BYTES: Final = np.where(_BYTES < 192, 1 + _BYTES // 64, 1 + _COUNTED.sum(axis=1))
#: Bits of the three fields by selector, up to which the first bytes hold them themselves.
_TAG2_3S32_BITS: Final = ((2, 2, 2), (4, 4, 4), (6, 6, 6))
_TAG2_3SVARIABLE_BITS: Final = ((2, 2, 2), (5, 5, 4), (8, 7, 7))


class Group(NamedTuple):
    """Consecutive fields that are written together; `encoding` SIGNED_VB also stands for runs of all VBs."""

    encoding: int
    first: int
    n_fields: int


class Block:
    """Some bytes of a log, and where each number of variable length in it ends.

    Parameters
    ----------
    content : ndarray of uint8
        With `PADDING` zeros at its end.
    """

    def __init__(self, content: Bytes) -> None:
        self.bytes = content
        is_last = content < 128
        self._last = np.flatnonzero(is_last)
        # Ends before a place are those before its word of 64 bytes and those in it: less to write than all.
        bits = np.packbits(is_last, bitorder="little")
        self._words = np.append(bits, np.zeros(-len(bits) % 8, np.uint8)).view("<u8")
        self._before_word = np.cumsum(np.bitwise_count(self._words), dtype=np.int64)
        self._before_word -= np.bitwise_count(self._words)

    def safe(self, at: IntArray) -> IntArray:
        """Return places, those behind the end moved to where any group can still be read."""
        return np.minimum(at, len(self.bytes) - _LONGEST_GROUP)

    def _before(self, at: IntArray) -> IntArray:
        """Return how many numbers end before places."""
        word = at >> 6
        in_word = self._words[word] & ((np.uint64(1) << (at & 63).astype(np.uint64)) - np.uint64(1))
        before: IntArray = self._before_word[word] + np.bitwise_count(in_word)
        return before

    def vb_end(self, at: IntArray, count: IntArray | int) -> IntArray:
        """Return where the `count`-th number of variable length from `at` on ends; 1 is the first."""
        number = self._before(at) + (count - 1)
        found: IntArray = self._last[np.minimum(number, len(self._last) - 1)] + 1
        return found

    def vb_ends(self, at: IntArray, count: int) -> Iterator[IntArray]:
        """Yield where the first, second, ... of `count` numbers of variable length from `at` on end."""
        number = np.minimum(self._before(at), len(self._last) - count)
        for k in range(count):
            yield self._last[number + k] + 1

    def vb(self, start: IntArray, end: IntArray) -> Words:
        """Return the numbers from `start` to `end`."""
        value = (self.bytes[start] & 127).astype(np.uint32)
        length = end - start
        for k in range(1, _LONGEST_VB):
            longer = np.flatnonzero(length > k)
            if not len(longer):
                break
            value[longer] |= (self.bytes[start[longer] + k] & 127).astype(np.uint32) << np.uint32(7 * k)
        return value


def groups_of(layout: Layout) -> tuple[Group, ...]:
    """Return the groups in which the fields are written.

    A single field of TAG8_8SVB has no tag: it is a number like those beside it.
    """
    groups: list[Group] = []
    at = 0
    while at < len(layout):
        encoding = layout.encoding[at]
        most = _TOGETHER.get(encoding, 1)
        count = 1
        while count < most and layout.encoding[at + count : at + count + 1] == (encoding,):
            count += 1
        if encoding in (SIGNED_VB, UNSIGNED_VB, NEGATED_14_BIT) or (encoding == TAG8_8SVB and count == 1):
            if groups and groups[-1].encoding == SIGNED_VB:
                groups[-1] = groups[-1]._replace(n_fields=groups[-1].n_fields + 1)
            else:
                groups.append(Group(SIGNED_VB, at, 1))
        else:
            groups.append(Group(encoding, at, count))
        at += count
    return tuple(groups)


def frame_ends(block: Block, start: IntArray, groups: tuple[Group, ...]) -> IntArray:
    """Return where frames end.

    Parameters
    ----------
    start : ndarray of int64, shape (n,)
        Of the frames' first field.

    Returns
    -------
    ndarray of int64, shape (n,)
    """
    at = block.safe(start)
    for group in groups:
        at = block.safe(_group_end(block, at, group))
    return at


def _group_end(block: Block, at: IntArray, group: Group) -> IntArray:
    """Return where a group that begins at `at` ends."""
    if group.encoding == SIGNED_VB:
        return block.vb_end(at, group.n_fields)
    if group.encoding == TAG8_8SVB:
        present = _BITS_SET[block.bytes[at] & ((1 << group.n_fields) - 1)]
        return np.where(present > 0, block.vb_end(at + 1, present), at + 1)
    if group.encoding == NULL:
        return at
    length = _TAG8_4S16_BYTES if group.encoding == TAG8_4S16 else _TAG2_3_BYTES
    end: IntArray = at + length[block.bytes[at]]
    return end


def frame_values(
    block: Block, start: IntArray, layout: Layout, groups: tuple[Group, ...]
) -> tuple[NDArray[np.int32], BoolArray]:
    """Return what stands in the fields of frames, before anything is predicted.

    Parameters
    ----------
    start : ndarray of int64, shape (n,)
        As in `frame_ends`.

    Returns
    -------
    values : ndarray of int32, shape (n_fields, n)
        Modulo 2^32.
    valid : ndarray of bool, shape (n,)
        False where a number is longer than one of 32 bits can be.
    """
    values = np.zeros((len(layout), len(start)), np.uint32)
    valid = np.ones(len(start), np.bool_)
    at = block.safe(start)
    for group in groups:
        out = values[group.first : group.first + group.n_fields]
        if group.encoding == SIGNED_VB:
            at = _run_of_vbs(block, at, layout.encoding[group.first :], out, valid)
            continue
        if group.encoding == TAG8_8SVB:
            # Fill in the fields that bits of the first byte say are not zero.
            tag = block.bytes[at]
            behind = at + 1
            for k in range(len(out)):
                here = np.flatnonzero(tag & (1 << k))
                begin = behind[here]
                end = block.safe(block.vb_end(begin, 1))
                out[k, here] = _zigzag(block.vb(begin, end))
                valid[here] &= end - begin <= _LONGEST_VB
                behind[here] = end
        elif group.encoding == TAG8_4S16:
            # Fill in four fields of 0, 4, 8 or 16 bits, as the first byte says; half bytes follow, high
            # first.
            tag = block.bytes[at]
            for k in range(len(out)):
                count, offset = _NIBBLES[tag, k], _NIBBLE_AT[tag, k]
                here = np.flatnonzero(count)
                count, offset = count[here], offset[here]
                first = at[here] + 1 + offset // 2
                window = _big_endian(block.bytes, first, 3)
                out[k, here] = _extended(
                    window >> (24 - 4 * (offset % 2 + count)).astype(np.uint32), 4 * count
                )
        elif group.encoding == TAG2_3S32:
            _tag2_3(block, at, out, _TAG2_3S32_BITS, contiguous=False)
        elif group.encoding == TAG2_3SVARIABLE:
            _tag2_3(block, at, out, _TAG2_3SVARIABLE_BITS, contiguous=True)
        at = block.safe(_group_end(block, at, group))
    return values.view(np.int32), valid


def _zigzag(value: Words) -> Words:
    """Return signed numbers, modulo 2^32, of those with the sign in the lowest bit."""
    return (value >> np.uint32(1)) ^ (np.uint32(0) - (value & np.uint32(1)))


def _extended(value: Words, bits: IntArray | int) -> Words:
    """Extend the sign of numbers of so many bits to 32."""
    half = (np.ones_like(value) << np.asarray(bits, dtype=np.uint32)) >> np.uint32(1)
    low = value & ((half << np.uint32(1)) - np.uint32(1))
    extended: Words = (low ^ half) - half
    return extended


def _run_of_vbs(
    block: Block, at: IntArray, encoding: tuple[int, ...], out: Words, valid: BoolArray
) -> IntArray:
    """Fill in numbers of variable length that follow each other; return where the last one ends."""
    start = at
    ends = block.vb_ends(at, len(out))
    for k in range(len(out)):
        end = next(ends)
        value = block.vb(start, end)
        valid &= end - start <= _LONGEST_VB
        if encoding[k] == UNSIGNED_VB:
            out[k] = value
        elif encoding[k] == NEGATED_14_BIT:
            out[k] = np.uint32(0) - _extended(value, 14)
        else:
            out[k] = _zigzag(value)
        start = end
    return block.safe(start)


def _tag2_3(
    block: Block, at: IntArray, out: Words, bits: tuple[tuple[int, ...], ...], *, contiguous: bool
) -> None:
    """Fill in three fields whose size the two highest bits of the first byte say."""
    selector = block.bytes[at] >> 6
    for size, widths in enumerate(bits):
        here = np.flatnonzero(selector == size)
        window = _big_endian(block.bytes, at[here], size + 1)
        low = 8 * (size + 1)
        for k in range(len(out)):
            # Six bits stand in a byte each; all others follow each other up to the last bit.
            low_bit = 8 * (2 - k) if size == 2 and not contiguous else sum(widths[k + 1 :])
            out[k, here] = _extended(window >> np.uint32(min(low_bit, low)), widths[k])
    here = np.flatnonzero(selector == 3)
    start = at[here] + 1
    counts = _COUNTED[block.bytes[at[here]]]
    for k in range(len(out)):
        word = _big_endian(block.bytes, start + 3, 4, step=-1)
        # Extend the sign of the lowest 1 to 4 bytes to 32 bits.
        count = counts[:, k]
        shift = (32 - 8 * count).astype(np.uint32)
        out[k, here] = ((word << shift).view(np.int32) >> shift.view(np.int32)).view(np.uint32)
        start = start + counts[:, k]


def _big_endian(content: Bytes, at: IntArray, count: int, step: int = 1) -> Words:
    """Return `count` bytes from `at` on, the first one highest."""
    word = np.zeros(len(at), np.uint32)
    for k in range(count):
        word = (word << np.uint32(8)) | content[at + step * k]
    return word
