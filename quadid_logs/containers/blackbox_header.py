"""The header of a Blackbox log: which fields its frames have, how they are written, and the settings.

Source: Betaflight's ``blackbox.c`` and ``blackbox_fielddefs.h``. A file holds one log after another, each
with a header of lines ``H name:value``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

from quadid_logs.arrays import BoolArray, IntArray
from quadid_logs.containers.content import FileParts, decode_text
from quadid_logs.errors import UnknownFormatError

MAGIC: Final = b"H Product:Blackbox flight data recorder"
#: What follows is a list of names or numbers, one per field.
_FIELD_LINE: Final = re.compile(r"Field ([A-Z]) (name|signed|predictor|encoding)")
_LINE: Final = re.compile(rb"H ([\x20-\x39\x3b-\x7e]{1,60}):([^\n]*)\n")
#: A header has some 250 lines; none of any version comes near to this.
_HEADER_BYTES: Final = 1 << 17
_BLOCK_BYTES: Final = 1 << 22
#: Betaflight has some 60 fields in a frame; the most that still decode in little memory.
_MOST_FIELDS: Final = 256
_ENCODINGS: Final = frozenset((0, 1, 3, 6, 7, 8, 9, 10))
_PREDICTORS: Final = frozenset(range(12))
#: Iterations between complete frames are a 16 bit number in the firmware.
_LONGEST_INTERVAL: Final = 1 << 15


Accept: TypeAlias = Callable[[Mapping[str, str]], None]


@dataclass(frozen=True, slots=True)
class Layout:
    """The fields of one kind of frame: names, predictors and encodings by number, as in the header."""

    names: tuple[str, ...]
    signed: tuple[bool, ...]
    predictor: tuple[int, ...]
    encoding: tuple[int, ...]

    def __len__(self) -> int:
        """Return the number of fields."""
        return len(self.names)


class Sampling(NamedTuple):
    """Which loops are logged: every `complete`-th as a complete frame, and `kept` of `of` in between."""

    complete: int
    kept: int
    of: int

    def is_logged(self, iteration: IntArray) -> BoolArray:
        """Tell for loops whether they have a frame (`blackboxShouldLogPFrame`)."""
        logged: BoolArray = (iteration % self.complete + self.kept - 1) % self.of < self.kept
        return logged


@dataclass(frozen=True, slots=True)
class Header:
    """What stands before the frames of one log.

    `start` is the first byte of the log, `body` that of its frames, `stop` the byte behind the log; `texts`
    are all lines by name, the last one of a name.
    """

    start: int
    body: int
    stop: int
    texts: dict[str, str]
    layouts: dict[str, Layout]
    sampling: Sampling

    def number(self, name: str, otherwise: int = 0) -> int:
        """Return a whole number of the header, the first one of a list; `otherwise` where there is none."""
        match = re.match(r"\s*(-?\d{1,10})\b", self.texts.get(name, ""))
        return int(match[1]) if match else otherwise


def find_logs(file: FileParts) -> list[int]:
    """Return where each log of a file begins.

    Byte offsets, rising.
    """
    found = []
    for start, block in file.blocks(_BLOCK_BYTES, len(MAGIC) - 1):
        content = block.tobytes()
        at = content.find(MAGIC)
        while at >= 0:
            found.append(start + at)
            at = content.find(MAGIC, at + 1)
    return found


def read_header(file: FileParts, start: int, stop: int, accept: Accept | None = None) -> Header:
    """Read the lines before the frames.

    Parameters
    ----------
    start, stop : int
        Of the log in the file [bytes].
    accept : callable, optional
        Is given all lines by name before any is understood, and raises for a log of another writer.

    Raises
    ------
    UnknownFormatError
        If the lines that say how frames are written are missing, contradict each other or are not known.
    """
    content = file.part(start, min(stop, start + _HEADER_BYTES)).tobytes()
    texts: dict[str, str] = {}
    at = 0
    while match := _LINE.match(content, at):
        texts[match[1].decode("ascii")] = decode_text(match[2]).rstrip("\r")
        at = match.end()
    if accept is not None:
        accept(texts)
    if texts.get("Data version", "2").strip() != "2":
        raise _unreadable(
            file, f"its data version is {texts['Data version'][:20]!r}, but only version 2 is known"
        )
    # Layout of each kind of frame by its letter; P has the names of I.
    rows: dict[tuple[str, str], list[str]] = {
        (field[1], field[2]): text.split(",")
        for name, text in texts.items()
        if (field := _FIELD_LINE.fullmatch(name))
    }
    for about in ("name", "signed"):
        if ("I", about) in rows:
            rows["P", about] = rows["I", about]
    layouts = {letter: _layout(file, letter, rows) for letter in "IPSGH" if (letter, "name") in rows}
    if not {"I", "P"} <= layouts.keys() or layouts["I"].names[:2] != ("loopIteration", "time"):
        raise _unreadable(file, "it does not say which fields its frames have")
    # The intervals of I and P frames, written as "4" or "1/4".
    whole = re.match(r"\s*(\d{1,5})\b", texts.get("I interval", "32"))
    between = re.match(r"\s*(\d{1,5})(?:/(\d{1,5}))?\b", texts.get("P interval", "1/1"))
    if not whole or not between or not 1 <= int(whole[1]) <= _LONGEST_INTERVAL:
        raise _unreadable(file, "it does not say how often a complete frame is logged")
    kept, of = (int(between[1]), int(between[2])) if between[2] else (1, int(between[1]))
    # A P interval of 0 in the header means complete frames only.
    sampling = Sampling(int(whole[1]), min(max(kept, 1), max(of, 1)), of or int(whole[1]))
    return Header(start, start + at, stop, texts, layouts, sampling)


def _unreadable(file: FileParts, why: str) -> UnknownFormatError:
    return UnknownFormatError(
        f"The Blackbox log in {file.path} cannot be read: {why}.",
        hint="The header is damaged or of an unknown version. Download the log again.",
    )


def _layout(file: FileParts, letter: str, rows: dict[tuple[str, str], list[str]]) -> Layout:
    """Check the lines of one kind of frame against each other."""
    names = rows[letter, "name"]
    try:
        signed, predictor, encoding = (
            [int(text) for text in rows.get((letter, about), ())]
            for about in ("signed", "predictor", "encoding")
        )
    except ValueError:
        raise _unreadable(
            file, f"its field list of {letter} frames holds something that is not a number"
        ) from None
    if not len(names) == len(signed) == len(predictor) == len(encoding) <= _MOST_FIELDS:
        raise _unreadable(file, f"its field lists of {letter} frames differ in length")
    if not (_ENCODINGS.issuperset(encoding) and _PREDICTORS.issuperset(predictor)):
        raise _unreadable(file, f"its {letter} frames use an encoding or predictor that is not known")
    return Layout(tuple(names), tuple(map(bool, signed)), tuple(predictor), tuple(encoding))
