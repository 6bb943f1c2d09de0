"""Where the messages of a ULog file are: the length chain followed in numpy, with resynchronisation.

A data message is known by five bytes (size, 'D', id) that must fit a subscribed
topic, so its image hardly ever occurs by chance. All images of a block are
found at once; the chain of lengths is followed from image to image by runs, and
only what stands between the runs (some messages per second) is handled one by
one. Where the chain breaks, the next image is where the damage ends.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import IntArray
from quadid_logs.containers.content import Bytes, FileParts, merge_lost, rows_at
from quadid_logs.containers.ulog_definitions import MESSAGE_TYPES, NO_SIZE, Definitions
from quadid_logs.containers.ulog_formats import BrokenMessageError
from quadid_logs.containers.ulog_header import HEADER_MAGIC, HEADER_SIZE
from quadid_logs.data.log import LostBytes

_DATA: Final = ord("D")
#: The begin of a data message: size of what follows the first three bytes, and id.
_HEAD: Final = np.dtype(
    {"names": ["size", "id"], "formats": ["<u2", "<u2"], "offsets": [0, 3], "itemsize": 5}
)
#: Neither data nor the announcement of a topic.
_BEFORE_TOPICS: Final = MESSAGE_TYPES - frozenset(b"DA")
_BLOCK: Final = 1 << 20
_LONGEST: Final = 3 + 0xFFFF
#: Longest message of a type other than data that is believed without looking into it.
_LONGEST_OTHER: Final = 4096
#: Bytes that are searched at first for a message other than data after damage; then twice as many.
_FIRST_SEARCH: Final = 4096
#: Looks at a block again because a topic was announced in it, beside one a block.
_SECOND_LOOKS: Final = 64
#: How many unknown messages in a row are believed before a known one must follow.
_CHAIN: Final = 8


class Frames(NamedTuple):
    """What stands where in a ULog file.

    ``starts[i]`` holds the byte offsets of the data messages of
    ``definitions.subscriptions[i]``; `n_unknown` counts data messages without a
    subscription and messages of unknown type.
    """

    definitions: Definitions
    starts: tuple[IntArray, ...]
    lost: tuple[LostBytes, ...]
    n_unknown: int
    n_joined: int


class _Images(NamedTuple):
    """Images of data messages in a block: where, to where, whose, and where a run of them ends."""

    starts: IntArray
    ends: IntArray
    topics: NDArray[np.int32]
    breaks: IntArray


def _no_images() -> _Images:
    """Return the images of a block without any."""
    nothing = np.zeros(0, np.int64)
    return _Images(nothing, nothing, np.zeros(0, np.int32), nothing)


@dataclass(slots=True, kw_only=True, eq=False)
class _Walk:
    """The state of one pass through a file.

    `block` holds the bytes from `begin` to `covered`, and `images` is complete
    for them, apart from those of topics subscribed since it was made (`stale`).
    `end` is that of the file or of the section before appended data, `stop` where
    the next block takes over. `room` and `is_data` are used for every block: fresh
    memory would cost as much as the search in it. Where no `looks_left`, rows of topics
    that the block announces are taken one by one: thousands of announcements, each a
    reason to search the block again, would cost the square of their number.
    """

    file: FileParts
    end: int = 0
    stop: int = 0
    begin: int = 0
    covered: int = 0
    block: Bytes = field(default_factory=lambda: np.zeros(0, np.uint8))
    known: Definitions = field(default_factory=Definitions)
    least: NDArray[np.int32] = field(default_factory=lambda: np.full(1 << 16, NO_SIZE, np.int32))
    most: NDArray[np.int32] = field(default_factory=lambda: np.zeros(1 << 16, np.int32))
    topic: NDArray[np.int32] = field(default_factory=lambda: np.zeros(1 << 16, np.int32))
    images: _Images = field(default_factory=_no_images)
    room: Bytes = field(default_factory=lambda: np.empty(_BLOCK + _LONGEST, np.uint8))
    is_data: NDArray[np.bool_] = field(default_factory=lambda: np.empty(_BLOCK + _LONGEST, bool))
    stale: bool = False
    looks_left: int = _SECOND_LOOKS
    accepted: list[tuple[IntArray, NDArray[np.int32]]] = field(default_factory=list)
    starts: dict[int, list[IntArray]] = field(default_factory=dict)
    lost: list[LostBytes] = field(default_factory=list)
    n_unknown: int = 0
    n_joined: int = 0

    def bytes_at(self, start: int, stop: int) -> bytes:
        """Return some bytes of the block, or where it does not have them all, of the file."""
        first, last = start - self.begin, stop - self.begin
        if first >= 0 and last <= len(self.block):
            return self.block[first:last].tobytes()
        return self.file.part(start, stop).tobytes()


def frame(file: FileParts) -> Frames:
    """Find every message of a ULog file.

    Parameters
    ----------
    file : FileParts
        Beginning with the ULog header.

    Returns
    -------
    Frames
        With everything that could not be read in `lost`. A message is only
        taken where its size fits its type; the last one before a break in the
        chain is dropped if another message begins inside it.
    """
    walk = _Walk(file=file)
    position = _enter_file(walk, 0)
    while position < file.n_bytes:
        walk.end = min([offset for offset in walk.known.appended_at if offset > position] + [file.n_bytes])
        position = _walk_block(walk, position)
    nothing = [np.zeros(0, np.int64)]
    starts = tuple(np.concatenate(walk.starts.get(k, nothing)) for k in range(len(walk.known.subscriptions)))
    return Frames(walk.known, starts, merge_lost(walk.lost), walk.n_unknown, walk.n_joined)


def _enter_file(walk: _Walk, position: int) -> int:
    """Read the header of the file, or of a further one joined to it; return where its messages begin.

    The topics known so far stay until the further file announces its own: what
    looks like its header can be a copy of the first one's.
    """
    if position:
        walk.n_joined += 1
        walk.known.has_data_section = False
    return position + HEADER_SIZE


def _lose(walk: _Walk, begin: int, end: int, reason: str) -> None:
    walk.lost.append(LostBytes(offset=begin, n_bytes=end - begin, reason=reason))


def _walk_block(walk: _Walk, position: int) -> int:
    """Follow the chain through about `_BLOCK` bytes; return where it goes on."""
    walk.stop = min(position + _BLOCK, walk.end)
    walk.begin, walk.covered = position, min(walk.stop + _LONGEST, walk.end)
    walk.block = walk.file.fill(walk.room[: walk.covered - position], position)
    if not walk.known.subscriptions:
        position = _take_definitions(walk, position)
    walk.images = _find_images(walk, position)
    walk.stale = False
    while position < walk.stop:
        after = _follow_run(walk, position)
        if after == position:
            after = _take_other(walk, position)
        if after == position:
            # New topics have new images: look again from here.
            walk.looks_left -= 1
            break
        position = after
    else:
        walk.looks_left += 1
    _sort_by_topic(walk)
    return position


def _take_definitions(walk: _Walk, position: int) -> int:
    """Take the messages before the first topic; return where something else stands.

    Some thousand parameters and formats, and no data yet that could follow one of them.
    """
    # A view, because a copy of the whole block would cost more than those of some messages.
    block = walk.block.data[: walk.stop - position]
    at = 0
    while at + len(HEADER_MAGIC) <= len(block):
        kind, after = block[at + 2], at + 3 + block[at] + 256 * block[at + 1]
        if kind not in _BEFORE_TOPICS or after > len(block):
            break
        try:
            walk.known.take(kind, block[at + 3 : after].tobytes(), position + at)
        except BrokenMessageError:
            break
        at = after
    return position + at


def _sort_by_topic(walk: _Walk) -> None:
    """Sort the data messages that the block has given by topic, in file order within each.

    By blocks, because the memory for the whole file's at once costs more than the sorting.
    """
    runs = [run for run in walk.accepted if len(run[0])]  # a message cut short leaves an empty one
    walk.accepted.clear()
    if not runs:
        return
    starts, topics = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    # Integers of up to 16 bits are sorted by radix.
    order = topics.astype(np.min_scalar_type(len(walk.known.subscriptions))).argsort(kind="stable")
    topics = topics.take(order)
    firsts = np.flatnonzero(topics[1:] != topics[:-1]) + 1
    by_topic = np.split(starts.take(order), firsts)
    for topic, found in zip(topics[[0, *firsts]].tolist(), by_topic, strict=True):
        walk.starts.setdefault(topic, []).append(found)


def _find_images(walk: _Walk, begin: int) -> _Images:
    """Find what looks exactly like a data message of a subscribed topic."""
    block = walk.block[begin - walk.begin :]
    types = block[2:-2]
    starts = np.flatnonzero(np.equal(types, _DATA, out=walk.is_data[: len(types)]))
    head = rows_at(block, starts, _HEAD)
    starts += begin
    # Cut out of rows of five bytes they lie unaligned, and every look-up would copy them first.
    msg_id, row_size = head["id"].astype(np.intp), head["size"].astype(np.int64) - 2
    ends = starts + row_size + 5
    # "clip" spares the check of numbers that cannot be wrong: an id has 16 bits.
    least, most = walk.least.take(msg_id, mode="clip"), walk.most.take(msg_id, mode="clip")
    kept = np.flatnonzero((row_size >= least) & (row_size <= most) & (ends <= walk.end))
    starts, ends = starts.take(kept, mode="clip"), ends.take(kept, mode="clip")
    topics = walk.topic.take(msg_id.take(kept, mode="clip"), mode="clip")
    broken = np.ones(len(starts), bool)
    broken[:-1] = starts[1:] != ends[:-1]
    return _Images(starts, ends, topics, np.flatnonzero(broken))


def _follow_run(walk: _Walk, position: int) -> int:
    """Take the data messages that follow each other from `position` on; return where they end."""
    images = walk.images
    first = int(images.starts.searchsorted(position))
    if first == len(images.starts) or images.starts[first] != position:
        return position
    last = int(images.breaks[images.breaks.searchsorted(first)])
    # What stands behind the last message of the block is the next block's business.
    last = min(last, int(images.starts.searchsorted(walk.stop)) - 1)
    after = int(images.ends[last])
    if not _ends_well(walk, after):
        # Bytes are missing in the last message, or what follows is damaged: its end cannot be trusted.
        after = min(_next_image(walk, int(images.starts[last]) + 1), after)
        _lose(walk, int(images.starts[last]), after, "a message was cut short")
        last -= 1
    walk.accepted.append((images.starts[first : last + 1], images.topics[first : last + 1]))
    return after


def _ends_well(walk: _Walk, position: int) -> bool:
    """Tell whether what stands at `position` speaks for the message before it being whole.

    Damage rarely begins exactly between two messages, so it takes a message
    that can be decoded, or at least the head of a known topic with a wrong size.
    """
    if _is_image(walk, position) or walk.end - position < len(HEADER_MAGIC):
        return position <= walk.end
    head = walk.bytes_at(position, position + 5)
    if head[2] == _DATA and walk.least[head[3] + 256 * head[4]] < NO_SIZE:
        return True
    if head[2] in MESSAGE_TYPES and head[2] != _DATA:
        return _makes_sense(walk, position)
    return _continues(walk, position)


def _continues(walk: _Walk, position: int, further: int = _CHAIN) -> bool:
    """Tell whether a message, also one cut off by the end of the section, stands at `position`."""
    if walk.end - position < len(HEADER_MAGIC) or _is_image(walk, position):
        return position <= walk.end
    head = walk.bytes_at(position, position + 7)
    kind, after = head[2], position + 3 + head[0] + 256 * head[1]
    if kind in MESSAGE_TYPES and kind != _DATA:
        return after - position < _LONGEST_OTHER
    if head == HEADER_MAGIC:
        return _is_header(walk, position)
    size, msg_id = after - position - 5, head[3] + 256 * head[4]
    if kind == _DATA and walk.least[msg_id] < NO_SIZE:
        return after > walk.end and bool(walk.least[msg_id] <= size <= walk.most[msg_id])
    # A topic that was never announced, or a type of the future: believe it if a message follows.
    is_letter = ord("A") <= kind <= ord("z")
    fits = position + 3 < after <= min(walk.end, _next_image(walk, position))
    return is_letter and fits and further > 0 and _continues(walk, after, further - 1)


def _is_image(walk: _Walk, position: int) -> bool:
    images = walk.images
    found = int(images.starts.searchsorted(position))
    return found < len(images.starts) and int(images.starts[found]) == position


def _next_image(walk: _Walk, position: int) -> int:
    """Return where the next data message begins, or a place behind the file."""
    images = walk.images
    found = int(images.starts.searchsorted(position))
    return int(images.starts[found]) if found < len(images.starts) else walk.file.n_bytes + 1


def _take_other(walk: _Walk, position: int) -> int:
    """Take the message at `position`, which is no subscribed data message; return where it ends."""
    end = walk.end
    head = walk.bytes_at(position, position + 7)
    if head == HEADER_MAGIC and _is_header(walk, position):
        return _enter_file(walk, position)
    if position + 3 > end:
        _lose(walk, position, end, "cut off at the end of the file")
        return end
    kind, after = head[2], position + 3 + head[0] + 256 * head[1]
    if after > end or _next_image(walk, position) < after:
        return _resynchronise(walk, position)
    if kind == _DATA and _take_single(walk, position, after):
        return after
    body = walk.bytes_at(position + 3, after)
    if kind == _DATA or kind not in MESSAGE_TYPES:
        if _looks_again(walk) or end - position < len(HEADER_MAGIC) or not _continues(walk, position):
            return _resynchronise(walk, position)
        walk.n_unknown += 1
        return after
    try:
        # Decode a message other than data, and learn the sizes of a new topic.
        known = walk.known
        n_topics = len(known.subscriptions)
        known.take(kind, body, position)
        if len(known.subscriptions) > n_topics:
            topic = known.subscriptions[-1]
            if walk.least[topic.msg_id] < NO_SIZE:
                # Ids have a new meaning from here on: the images found before are void.
                walk.images = _no_images()
                walk.stale = True
            walk.least[topic.msg_id] = topic.dtype.itemsize
            walk.most[topic.msg_id] = topic.max_size
            walk.topic[topic.msg_id] = n_topics
            walk.stale = True
    except BrokenMessageError:
        if not _continues(walk, after):
            return _resynchronise(walk, position)
        _lose(walk, position, after, "a message that makes no sense")
    return after


def _looks_again(walk: _Walk) -> bool:
    """Tell whether the block is to be searched again for the rows of topics announced in it."""
    return walk.stale and walk.looks_left > 0


def _take_single(walk: _Walk, position: int, after: int) -> bool:
    """Take one row of a topic whose images are not known; tell whether it is one."""
    if not walk.stale or walk.looks_left > 0:
        return False
    head = walk.bytes_at(position, position + 5)
    msg_id, size = head[3] + 256 * head[4], after - position - 5
    if not walk.least[msg_id] <= size <= walk.most[msg_id] or not _ends_well(walk, after):
        return False
    walk.accepted.append((np.array([position]), walk.topic[msg_id : msg_id + 1].copy()))
    return True


def _resynchronise(walk: _Walk, position: int) -> int:
    """Find where the messages go on after `position`, and note what was lost."""
    if _looks_again(walk):
        return position
    end = walk.end
    stop = min(_next_image(walk, position + 1), end, max(walk.covered - 4, position + 1))
    restart = _next_other(walk, position + 1, stop)
    if restart == stop and stop == end:
        _lose(walk, position, end, "cut off or unreadable up to the end")
    else:
        _lose(walk, position, restart, "damaged")
    return restart


def _next_other(walk: _Walk, begin: int, stop: int) -> int:
    """Return the first place before `stop` where a message other than data makes sense, else `stop`."""
    span = _FIRST_SEARCH
    while begin < stop:
        end = min(begin + span, stop)
        # Where the head of a message other than data, or of a file, can stand.
        text = walk.bytes_at(begin, end + len(HEADER_MAGIC) - 1)
        window = np.frombuffer(text, np.uint8)
        other_heads = np.zeros(0, np.int64)
        if len(window) >= 3:
            is_type = np.zeros(256, bool)
            is_type[list(MESSAGE_TYPES - {_DATA})] = True
            places = np.flatnonzero(is_type[window[2:]] & (window[1:-1] < _LONGEST_OTHER // 256))
            header = text.find(HEADER_MAGIC)
            other_heads = np.sort(np.append(places, header)) if header >= 0 else places
        for place in other_heads.tolist():
            if begin + place < end and _makes_sense(walk, begin + place):
                return int(begin + place)
        begin, span = end, 2 * span
    return stop


def _is_header(walk: _Walk, position: int) -> bool:
    """Tell whether a message that can be decoded follows what looks like the header of a file."""
    return _decodes(walk, position + HEADER_SIZE)


def _makes_sense(walk: _Walk, position: int) -> bool:
    """Tell whether the message (or header) at `position` can be decoded and another one follows it."""
    head = walk.bytes_at(position, position + 7)
    if head == HEADER_MAGIC:
        return _is_header(walk, position)
    return _decodes(walk, position) and _continues(walk, position + 3 + head[0] + 256 * head[1])


def _decodes(walk: _Walk, position: int) -> bool:
    """Tell whether a message other than data stands at `position` and can be decoded."""
    head = walk.bytes_at(position, position + 3)
    if len(head) < 3 or head[2] not in MESSAGE_TYPES or head[2] == _DATA:
        return False
    after = position + 3 + head[0] + 256 * head[1]
    if after > walk.file.n_bytes:
        return False
    trial = Definitions(formats=walk.known.formats)
    try:
        trial.take(head[2], walk.bytes_at(position + 3, after), position)
    except BrokenMessageError:
        return False
    return True
