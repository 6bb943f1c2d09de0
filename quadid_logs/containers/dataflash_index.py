"""Where every message of a DataFlash file starts: the format table, definitions, the chain of lengths.

A DataFlash file is a string of messages ``A3 95 id payload``. Messages carry
neither a length nor a checksum: the length comes from the ``FMT`` message that
defines the id (libraries/AP_Logger/LogStructure.h in ArduPilot). A message is
therefore believed only if another header, or the end of the file, stands where
its length says.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import AnyArray, BoolArray, IntArray
from quadid_logs.containers.content import FileParts, merge_lost
from quadid_logs.data.log import LostBytes

ByteArray = NDArray[np.uint8]

HEADER: Final = b"\xa3\x95"
FMT_ID: Final = 0x80
FMT_LENGTH: Final = 89
#: Messages that say what the others are.
DEFINING: Final = frozenset({"FMT", "FMTU", "UNIT", "MULT"})

#: Bytes scanned at once: the comparison's result stays in the processor's cache.
_SCAN_BYTES: Final = 1 << 19
#: Headers whose successors are worked out at once (three int64 arrays of this length).
_CHAIN_HEADERS: Final = 1 << 18
#: Headers among which the next credible one is sought at once.
_SEARCH_HEADERS: Final = 1 << 14
#: Rows whose ends are looked at to choose between two lengths.
_VOTES: Final = 1000
#: Definitions of one id that are put to the vote; where even more say something else, each stands as it is.
_MOST_VOTED: Final = 16
#: More headers than this inside one payload, and that densely, are a flood of headers, no data.
_FLOOD_HEADERS: Final = 3
_FLOOD_SPACING: Final = 8


class FormatCharacter(NamedTuple):
    """How one character of a format string is stored."""

    dtype: str
    divisor: float = 1.0
    is_text: bool = False


#: ArduPilot libraries/AP_Logger/README.md and LogStructure.h, "Format characters".
FORMAT_CHARACTERS: Final[dict[str, FormatCharacter]] = {
    "a": FormatCharacter("(32,)<i2"), "b": FormatCharacter("i1"), "B": FormatCharacter("u1"),
    "h": FormatCharacter("<i2"), "H": FormatCharacter("<u2"), "i": FormatCharacter("<i4"),
    "I": FormatCharacter("<u4"), "f": FormatCharacter("<f4"), "d": FormatCharacter("<f8"),
    "g": FormatCharacter("<f2"), "n": FormatCharacter("S4", is_text=True),
    "N": FormatCharacter("S16", is_text=True), "Z": FormatCharacter("S64", is_text=True),
    "c": FormatCharacter("<i2", 100.0), "C": FormatCharacter("<u2", 100.0),
    "e": FormatCharacter("<i4", 100.0), "E": FormatCharacter("<u4", 100.0),
    "L": FormatCharacter("<i4", 1e7), "M": FormatCharacter("i1"), "q": FormatCharacter("<i8"),
    "Q": FormatCharacter("<u8"),
}  # fmt: skip


_SIZES: Final = {character: np.dtype(kind.dtype).itemsize for character, kind in FORMAT_CHARACTERS.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageDefinition:
    """What an ``FMT`` message says about a message id, from `offset` in the file on."""

    type_id: int
    length: int
    name: str
    format: str
    columns: tuple[str, ...]
    offset: int

    @property
    def payload_length(self) -> int:
        """Bytes that the format characters take, without the header."""
        return sum(_SIZES[character] for character in self.format)

    def fields(self) -> dict[str, tuple[FormatCharacter, int]]:
        """Return for each column its format character and its offset in the message [bytes].

        A field that does not fit into the stated length is left out.
        """
        found: dict[str, tuple[FormatCharacter, int]] = {}
        offset = 3
        for character, label in zip(self.format, self.columns, strict=False):
            kind = FORMAT_CHARACTERS[character]
            size = _SIZES[character]
            if offset + size > self.length:
                break
            found[label] = (kind, offset)
            offset += size
        return found


Definitions = dict[int, list[MessageDefinition]]


class Headers(NamedTuple):
    """Every ``A3 95 id`` in the file, real or not, in file order."""

    position: AnyArray
    type_id: ByteArray


class MessageIndex(NamedTuple):
    """The messages of a file: where each starts, its id, and what lies between them.

    `n_headers` counts every ``A3 95``, real or not.
    """

    position: AnyArray
    type_id: ByteArray
    definitions: Definitions
    lost: tuple[LostBytes, ...]
    n_headers: int


def index_messages(content: FileParts) -> MessageIndex:
    """Find all messages of a DataFlash file.

    The messages in file order. Bytes outside them are in `lost`. Work and memory grow linearly with the file,
    whatever is in it.
    """
    headers = find_headers(content)
    definitions = read_definitions(content, headers)
    keep, lost = _follow_chain(content, headers, definitions)
    return MessageIndex(
        headers.position[keep], headers.type_id[keep], definitions, lost, len(headers.position)
    )


def find_headers(content: FileParts) -> Headers:
    """Find every ``A3 95`` that is followed by an id byte."""
    n_bytes = content.n_bytes
    offset_type = np.uint32 if n_bytes < 1 << 32 else np.int64
    positions: list[AnyArray] = [np.zeros(0, offset_type)]
    type_ids: list[ByteArray] = [np.zeros(0, np.uint8)]
    # New memory for every block would cost more than the scan.
    is_first, is_second = np.empty((2, _SCAN_BYTES), np.bool_)
    for start, block in content.blocks(_SCAN_BYTES, 2):
        n_places = max(0, len(block) - 2)
        first, second = is_first[:n_places], is_second[:n_places]
        np.equal(block[:-2], HEADER[0], out=first)
        np.equal(block[1:-1], HEADER[1], out=second)
        found = np.flatnonzero(np.logical_and(first, second, out=first))
        type_ids.append(block[found + 2])
        positions.append((found + start).astype(offset_type))
    return Headers(np.concatenate(positions), np.concatenate(type_ids))


def read_definitions(content: FileParts, headers: Headers) -> Definitions:
    """Read all credible ``FMT`` messages.

    The first definition of an id also holds for messages before it (an
    autopilot that drops messages may log rows first); a later one that says
    something else holds from its offset on. Repetitions are skipped.
    """
    definitions: Definitions = {}
    starts_of: dict[int, IntArray] = {}
    candidates = headers.position[headers.type_id == FMT_ID].astype(np.int64)
    previous: dict[int, bytes] = {}
    for position in candidates[candidates + FMT_LENGTH <= content.n_bytes].tolist():
        record = content.part(position, position + FMT_LENGTH).tobytes()
        type_id = record[3]
        if previous.get(type_id) == record:
            continue
        definition = parse_definition(record, position)
        if definition is None:
            continue
        previous[type_id] = record
        versions = definitions.setdefault(type_id, [])
        contradicts = definition.payload_length + 3 not in (definition.length, 3)
        if contradicts and len(versions) < _MOST_VOTED:
            if type_id not in starts_of:
                starts_of[type_id] = headers.position[headers.type_id == type_id].astype(np.int64)
            starts = starts_of[type_id][:: len(starts_of[type_id]) // _VOTES + 1]
            # Of a length and a format that contradict each other, take the one after which more headers
            # stand.
            from_format = definition.payload_length + 3
            if from_format <= 255:
                nowhere = np.full(len(starts), -1, np.int64)
                votes = [
                    int(np.count_nonzero(_find_successors(content, headers, nowhere, starts + length) >= 0))
                    for length in (definition.length, from_format)
                ]
                if votes[1] > votes[0]:
                    definition = replace(definition, length=from_format)
        versions.append(definition)
    if FMT_ID not in definitions and definitions:
        definitions[FMT_ID] = [_FMT_DEFINITION]
    return definitions


def parse_definition(record: bytes, offset: int = 0) -> MessageDefinition | None:
    """Parse one ``FMT`` message of 89 bytes; None where its content is not credible."""
    name, format_, labels = (
        part.split(b"\0", 1)[0] for part in (record[5:9], record[9:25], record[25:FMT_LENGTH])
    )
    type_id, length = record[3], record[4]
    credible = (
        record[:3] == HEADER + bytes([FMT_ID])
        and length >= 3
        and (name == b"FMT") == (type_id == FMT_ID)
        and name.replace(b"_", b"").isalnum()
        and (not labels or (labels.isascii() and labels.decode("ascii").isprintable()))
        and all(chr(character) in FORMAT_CHARACTERS for character in format_)
    )
    if not credible or (type_id == FMT_ID and length != FMT_LENGTH):
        return None
    return MessageDefinition(
        type_id=type_id,
        length=length,
        name=name.decode("ascii"),
        format=format_.decode("ascii"),
        columns=tuple(labels.decode("ascii").split(",")) if labels else (),
        offset=offset,
    )


_FMT_DEFINITION: Final = MessageDefinition(
    type_id=FMT_ID,
    length=FMT_LENGTH,
    name="FMT",
    format="BBnNZ",
    columns=("Type", "Length", "Name", "Format", "Columns"),
    offset=0,
)


def definition_at(definitions: list[MessageDefinition], positions: AnyArray) -> IntArray:
    """Return for each position the number of the definition in force there.

    Parameters
    ----------
    definitions : list of MessageDefinition
        Of one message id, in file order.
    positions : ndarray of integers, shape (n_rows,)

    Returns
    -------
    ndarray of int64, shape (n_rows,)
    """
    offsets = np.array([definition.offset for definition in definitions[1:]], dtype=np.int64)
    return np.searchsorted(offsets, positions, side="right")


def by_version(
    versions: list[MessageDefinition], positions: AnyArray
) -> list[tuple[MessageDefinition, AnyArray]]:
    """Split the positions of one id's rows by the definition in force; only definitions with rows.

    Parameters
    ----------
    versions : list of MessageDefinition
        As of `definition_at`.
    positions : ndarray of integers, shape (n_rows,)
        Rising.
    """
    if len(versions) == 1:
        return [(versions[0], positions)] if len(positions) else []
    bounds = np.searchsorted(definition_at(versions, positions), np.arange(len(versions) + 1)).tolist()
    return [
        (version, positions[bounds[number] : bounds[number + 1]])
        for number, version in enumerate(versions)
        if bounds[number + 1] > bounds[number]
    ]


class _Lengths(NamedTuple):
    """Length of the messages of every id, 0 without definition; where it changes, from which offset on."""

    first: IntArray
    changing: dict[int, tuple[IntArray, IntArray]]


def _lengths(definitions: Definitions) -> _Lengths:
    """Collect the lengths once: every block of headers needs them."""
    first, changing = np.zeros(256, np.int64), {}
    for type_id, versions in definitions.items():
        first[type_id] = versions[0].length
        lengths = np.array([version.length for version in versions], dtype=np.int64)
        if (lengths != lengths[0]).any():
            changing[type_id] = (np.array([each.offset for each in versions[1:]], dtype=np.int64), lengths)
    return _Lengths(first, changing)


def _message_lengths(headers: Headers, part: slice, lengths: _Lengths) -> IntArray:
    """Return the length of the message at each header, 0 for an id without definition."""
    type_ids = headers.type_id[part]
    found: IntArray = lengths.first[type_ids]
    for type_id, (offsets, of_version) in lengths.changing.items():
        rows = np.flatnonzero(type_ids == type_id)
        if len(rows):
            positions = headers.position[part][rows]
            found[rows] = of_version[np.searchsorted(offsets, positions, side="right")]
    return found


class _Chain(NamedTuple):
    """Where the chain of lengths leads on, and where it does not."""

    leads_on: BoolArray
    """For every header, whether a credible one, or the end of the file, stands at its end."""
    break_header: IntArray
    """Headers not directly followed by the next of the list, as far as a chain can reach them."""
    successor: IntArray
    """For each break the number of the header that follows it; -1 where nothing credible does."""


def _find_chain(content: FileParts, headers: Headers, lengths: _Lengths) -> _Chain:
    """Find for every header whether, and where, the chain of lengths goes on.

    Of headers that lead nowhere only those right behind a chain are listed: a
    flood of headers then costs no more memory than the headers themselves.
    """
    n_headers = len(headers.position)
    leads_on = np.zeros(n_headers, np.bool_)
    listed: list[tuple[IntArray, IntArray]] = []
    behind_chain = False
    for start in range(0, n_headers, _CHAIN_HEADERS):
        part = slice(start, min(start + _CHAIN_HEADERS, n_headers))
        length = _message_lengths(headers, part, lengths)
        end = headers.position[part] + length
        following = headers.position[start + 1 : part.stop + 1]
        linked = np.zeros(len(end), np.bool_)
        linked[: len(following)] = (end[: len(following)] == following) & (length[: len(following)] > 0)
        local = np.flatnonzero(~linked)
        successor = _find_successors(content, headers, local + start, end[local])
        # A block filled with copies of one header otherwise looks like a chain. Real payloads hold ``A3 95``
        # by chance only: once in 1300 messages of 50 bytes.
        inside = successor - (local + start) - 1
        flood: BoolArray = (inside >= _FLOOD_HEADERS) & ((inside + 1) * _FLOOD_SPACING >= length[local])
        successor[(length[local] == 0) | flood] = -1
        reached = np.concatenate([[behind_chain], linked[:-1]])[local]
        behind_chain = bool(linked[-1])
        linked[local] = successor >= 0
        leads_on[part] = linked
        wanted = reached | (successor >= 0)
        listed.append((local[wanted] + start, successor[wanted]))
    return _Chain(leads_on, *(np.concatenate(column) for column in zip(*listed, strict=True)))


def _find_successors(content: FileParts, headers: Headers, header: IntArray, end: IntArray) -> IntArray:
    """Find the header that stands at `end`; the number of headers stands for the file's end, -1 for none."""
    n_headers = len(headers.position)
    # Casting the few sought values, not the many headers, keeps the search free of copies.
    sought = np.minimum(end, content.n_bytes).astype(headers.position.dtype)
    successor = np.searchsorted(headers.position, sought).astype(np.int64)
    here = headers.position[np.minimum(successor, n_headers - 1)].astype(np.int64)
    at_header = (successor < n_headers) & (here == end) & (successor > header)
    at_end = end > content.n_bytes - 3
    # Say where a header, the beginning of one cut off, or exactly the end of the file stands.
    positions = end[at_end]
    found = [
        position <= content.n_bytes and HEADER.startswith(content.part(position, position + 2).tobytes())
        for position in positions.tolist()
    ]
    at_end[at_end] = np.array(found, np.bool_)  # a read for each: only where it matters
    return np.where(at_header, successor, np.where(at_end, n_headers, -1))


def _follow_chain(
    content: FileParts, headers: Headers, definitions: Definitions
) -> tuple[BoolArray, tuple[LostBytes, ...]]:
    """Keep the headers that form chains; return the mask and what lies between the chains."""
    n_headers, n_bytes = len(headers.position), content.n_bytes
    if n_headers == 0 or not definitions:
        nothing = LostBytes(offset=0, n_bytes=n_bytes, reason="no message header")
        return np.zeros(n_headers, np.bool_), merge_lost([nothing])
    lengths = _lengths(definitions)
    starts, stops, gaps = _walk(_find_chain(content, headers, lengths))
    step = np.zeros(n_headers + 1, np.int8)
    step[np.array(starts, np.int64)] += 1
    step[np.array(stops, np.int64)] -= 1
    keep = np.cumsum(step[:-1], dtype=np.int8).view(np.bool_)
    # What was lost between the first header that leads nowhere and the one where the chain resumes.
    first, resumed = np.array(gaps, np.int64).reshape(-1, 2).T
    type_ids = headers.type_id[first]
    start = headers.position[first].astype(np.int64)
    ends = np.append(headers.position, headers.position.dtype.type(content.n_bytes))[resumed].astype(np.int64)
    length = _message_lengths(Headers(headers.position[first], type_ids), slice(None), lengths)
    lost = []
    for offset, end, type_id, size in zip(
        start.tolist(), ends.tolist(), type_ids.tolist(), length.tolist(), strict=True
    ):
        if size == 0:
            reason = f"message id {type_id} has no definition"
        elif offset + size > content.n_bytes:
            reason = "cut off by the end of the file"
        else:
            reason = "no message follows where the length says"
        lost.append(LostBytes(offset=offset, n_bytes=end - offset, reason=reason))
    lost.append(LostBytes(offset=0, n_bytes=int(headers.position[0]), reason="no message header"))
    lost += _cut_tail(content, headers, keep, lengths)
    return keep, merge_lost(lost)


def _walk(chain: _Chain) -> tuple[list[int], list[int], list[tuple[int, int]]]:
    """Follow the chain from break to break; one step per break that a chain really passes.

    Returns the beginnings and ends of the accepted runs and, for every
    interruption, the header that could not be followed and the one that could again.
    """
    n_headers = len(chain.leads_on)
    starts: list[int] = []
    stops: list[int] = []
    gaps: list[tuple[int, int]] = []
    here, number = 0, 0
    target = np.searchsorted(chain.break_header, np.maximum(chain.successor, 0))
    while here < n_headers:
        if not chain.leads_on[here]:
            resumed = _next_credible(chain.leads_on, here)
            gaps.append((here, resumed))
            here = resumed
            number = int(np.searchsorted(chain.break_header, here))
            continue
        header, successor = int(chain.break_header[number]), int(chain.successor[number])
        starts.append(here)
        if successor >= 0:
            stops.append(header + 1)
            here, number = successor, int(target[number])
        else:
            stops.append(header)
            here = header
    return starts, stops, gaps


def _next_credible(leads_on: BoolArray, here: int) -> int:
    """Return the next header that leads on, the number of headers where none does."""
    for start in range(here, len(leads_on), _SEARCH_HEADERS):
        part = leads_on[start : start + _SEARCH_HEADERS]
        found = int(part.argmax())
        if part[found]:
            return start + found
    return len(leads_on)


def _cut_tail(content: FileParts, headers: Headers, keep: BoolArray, lengths: _Lengths) -> list[LostBytes]:
    """Report one or two bytes of a header that the end of the file cut off."""
    last = np.flatnonzero(keep[-1:]) + len(keep) - 1
    if not len(last):
        return []
    part = slice(int(last[0]), int(last[0]) + 1)
    end = int(headers.position[part][0]) + int(_message_lengths(headers, part, lengths)[0])
    if end >= content.n_bytes:
        return []
    return [LostBytes(offset=end, n_bytes=content.n_bytes - end, reason="cut off by the end of the file")]


def looks_like_dataflash(head: bytes, known: Callable[[list[MessageDefinition]], bool]) -> bool:
    """Judge the first bytes of a file by the definitions in them.

    Without any credible definition, only a density of headers far beyond
    chance (one per 64 kB) speaks for a DataFlash file that lost its beginning.
    """
    content = FileParts(io.BytesIO(head))
    headers = find_headers(content)
    definitions = [
        version for versions in read_definitions(content, headers).values() for version in versions
    ]
    if definitions:
        return known(definitions)
    return known([]) and len(headers.position) >= max(16, len(head) // 512)
