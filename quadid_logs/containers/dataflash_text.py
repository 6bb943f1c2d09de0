"""ArduPilot's DataFlash log as text (.log): comma-separated lines, defined by their FMT lines."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import AnyArray, IntArray
from quadid_logs.containers.content import decode_text, merge_lost, text_content
from quadid_logs.containers.dataflash_index import (
    DEFINING,
    FORMAT_CHARACTERS,
    MessageDefinition,
    by_version,
)
from quadid_logs.containers.message_table import MessageTable, join_tables
from quadid_logs.data.log import LostBytes
from quadid_logs.errors import EmptyLogError, LogNotFoundError, UnknownFormatError

#: Printed as they are; all other numbers are printed with a decimal point, already scaled.
_INTEGERS: Final = frozenset("bBhHiIqQ")
_TEXTS: Final = frozenset("nNZaM")
#: Old firmware prints a handful of short lines (log number, version, memory, board) before the first FMT.
_PREAMBLE_LINES: Final = 20
_LONGEST_LINE: Final = 200


class TextLog:
    """A DataFlash text log: its lines sorted by message type.

    Attributes
    ----------
    preamble : tuple of str
        The lines before the first FMT: firmware and board of old logs.
    """

    def __init__(self, path: str, content: bytes) -> None:
        self.path = path
        self.n_bytes = len(content)
        self._lines = content.split(b"\n")
        lengths = np.fromiter(map(len, self._lines), np.int64, len(self._lines))
        self._offsets: IntArray = np.concatenate([[0], np.cumsum(lengths + 1)])
        # Group the numbers of the lines by what stands before their first comma.
        by_name: dict[str, list[int]] = {}
        for number, line in enumerate(self._lines):
            name, comma, _ = line.partition(b",")
            if comma:
                by_name.setdefault(name.decode("latin-1"), []).append(number)
        self._by_name = by_name
        # Parse the FMT lines; a definition that changes holds from its line on.
        definitions: dict[str, list[MessageDefinition]] = {}
        for number in self._by_name.get("FMT", ()):
            definition = parse_definition_line(self._lines[number], number)
            if definition is None:
                continue
            versions = definitions.setdefault(definition.name, [])
            if not versions or versions[-1].columns != definition.columns:
                versions.append(definition)
        self._definitions = definitions
        first = self._by_name["FMT"][0] if self._definitions else len(self._lines)
        self.preamble = tuple(
            filter(
                None, (_decode(line[:_LONGEST_LINE]) for line in self._lines[: min(first, _PREAMBLE_LINES)])
            )
        )
        # Find the lines that belong to no definition or have too few fields.
        bad: dict[int, str] = {}
        for kind, lines in self._by_name.items():
            if kind not in self._definitions:
                bad.update({line: "no definition (FMT) of this line" for line in lines if line >= first})
                continue
            needed = min(len(version.columns) for version in self._definitions[kind])
            if kind != "FMT":
                bad.update(
                    {line: "too few fields" for line in lines if self._lines[line].count(b",") < needed}
                )
        for number in range(first, len(self._lines)):
            if self._lines[number].strip() and b"," not in self._lines[number]:
                bad[number] = "no message"
        self._bad = bad

    @classmethod
    def open(cls, path: str | Path) -> TextLog:
        """Read a file.

        Raises
        ------
        LogNotFoundError
            If there is no readable regular file.
        """
        try:
            return cls(str(path), text_content(path))
        except OSError as error:
            raise LogNotFoundError(f"Cannot read {path}: {error.strerror}.") from error

    @property
    def counts(self) -> dict[str, int]:
        """Rows per message name; only names that occur."""
        return {
            name: readable
            for name in self._definitions
            if (readable := sum(line not in self._bad for line in self._by_name.get(name, ())))
        }

    @property
    def definitions(self) -> tuple[MessageDefinition, ...]:
        """Every definition in the file."""
        return tuple(version for versions in self._definitions.values() for version in versions)

    @property
    def lost(self) -> tuple[LostBytes, ...]:
        """Lines that could not be read; those with a malformed value once their type was read."""
        return merge_lost(
            [
                LostBytes(
                    offset=int(self._offsets[line]),
                    n_bytes=int(min(self._offsets[line + 1], self.n_bytes) - self._offsets[line]),
                    reason=reason,
                )
                for line, reason in self._bad.items()
            ]
        )

    def read_messages(
        self, types: Collection[str] | None = None, labels: Collection[str] | None = None
    ) -> dict[str, MessageTable]:
        """Read some columns of some message types, all where None.

        Only types that occur. Values are as printed, that is already scaled.
        """
        names = [name for name in self._definitions if types is None or name in types]
        return self._parse({name: self._by_name.get(name, []) for name in names if name != "FMT"}, labels)

    def first_and_last(self) -> dict[str, MessageTable]:
        """Read the first and the last row of every type."""
        ends = {
            name: list(dict.fromkeys([rows[0], rows[-1]])) for name, rows in self._by_name.items() if rows
        }
        return self._parse({name: ends[name] for name in self._definitions if name in ends and name != "FMT"})

    def _parse(
        self, lines_of: dict[str, list[int]], labels: Collection[str] | None = None
    ) -> dict[str, MessageTable]:
        """Parse the given lines of each message type."""
        tables = {}
        for name, numbers in lines_of.items():
            versions = self._definitions[name]
            lines = np.array([number for number in numbers if number not in self._bad], dtype=np.int64)
            parts = [self._parse_lines(*part).only(labels) for part in by_version(versions, lines)]
            filled = [part for part in parts if part.n_rows]
            if filled:
                tables[name] = join_tables(filled)
        return tables

    def _parse_lines(self, definition: MessageDefinition, numbers: IntArray) -> MessageTable:
        """Parse lines of one definition column by column; lines with a malformed value are noted as bad."""
        kinds = definition.format[: len(definition.columns)]
        parsers = [_parser(kind) for kind in kinds]
        n_splits = len(kinds) if kinds.endswith("Z") else -1
        rows = [self._lines[number].rstrip().split(b",", n_splits)[1:] for number in numbers.tolist()]
        try:
            columns = _parse_columns(rows, parsers)
        except (ValueError, OverflowError):
            good = [_row_is_readable(row, parsers) for row in rows]
            self._bad.update(
                {n: "malformed value" for n, ok in zip(numbers.tolist(), good, strict=True) if not ok}
            )
            numbers = numbers[np.array(good, np.bool_)]
            columns = _parse_columns([row for row, ok in zip(rows, good, strict=True) if ok], parsers)
        return MessageTable(
            name=definition.name,
            columns=dict(zip(definition.columns, columns, strict=False)),
            position=self._offsets[numbers],
        )


def parse_definition_line(line: bytes, number: int = 0) -> MessageDefinition | None:
    """Parse ``FMT, id, length, name, format, columns``; None where it is malformed.

    The columns of FMT itself, and blanks after commas, are missing in some logs.
    """
    parts = [part.strip() for part in line.split(b",", 5)]
    if len(parts) < 5 or parts[0] != b"FMT" or not (parts[1].isdigit() and parts[2].isdigit()):
        return None
    name, format_, labels = _decode(parts[3]), _decode(parts[4]), _decode(parts[5]) if len(parts) > 5 else ""
    if not name or any(character not in FORMAT_CHARACTERS for character in format_):
        return None
    return MessageDefinition(
        type_id=int(parts[1]) & 0xFF,
        length=min(int(parts[2]), 255),
        name=name,
        format=format_,
        columns=tuple(label.strip() for label in labels.split(",") if label.strip()),
        offset=number,
    )


def is_mine(head: bytes) -> bool:
    """Say whether a file that begins with these (up to 64 kB) bytes is a DataFlash text log."""
    if not head.startswith(b"FMT,") and b"\nFMT," not in head:
        return False
    complete_lines = head.split(b"\n")[: None if head.endswith(b"\n") else -1] or [head]
    return any(parse_definition_line(line) for line in complete_lines if line.startswith(b"FMT,"))


def check_not_empty(log: TextLog) -> None:
    """Refuse a file without definitions or without lines besides them.

    Raises
    ------
    EmptyLogError
        If there is no line of data.
    UnknownFormatError
        If there is not even a definition.
    """
    if not log.definitions:
        raise UnknownFormatError(
            f"{log.path} is not a DataFlash text log: it holds no message definition (FMT).",
            hint="Give the original .log or .bin file of the autopilot.",
        )
    if not set(log.counts) - DEFINING:
        raise EmptyLogError(
            f"{log.path} holds message definitions (FMT), but not one line of data.",
            hint="Fetch the complete log from the vehicle.",
        )


def _parser(kind: str) -> Callable[[bytes], Any]:
    """Return what turns a printed field of this format character into a value."""
    if kind in _TEXTS:
        return _decode
    return _parse_integer if kind in _INTEGERS else float


def _parse_integer(field: bytes) -> int:
    """Parse an integer that fits into 64 bits."""
    value = int(field)
    if not -(1 << 63) <= value < 1 << 64:
        raise ValueError(f"{value} needs more than 64 bits.")
    return value


def _decode(field: bytes) -> str:
    return decode_text(field.strip())


def _parse_columns(rows: list[list[bytes]], parsers: list[Callable[[bytes], Any]]) -> list[AnyArray]:
    """Parse rows of fields into one array per column."""
    if any(len(row) < len(parsers) for row in rows):
        raise ValueError("too few fields")
    columns: list[AnyArray] = []
    for number, parse in enumerate(parsers):
        values = [parse(row[number]) for row in rows]
        dtype: type = np.float64 if parse is float else np.str_
        if parse is _parse_integer:
            dtype = np.uint64 if values and max(values) >= 1 << 63 and min(values) >= 0 else np.int64
        columns.append(np.array(values, dtype=dtype))
    return columns


def _row_is_readable(row: list[bytes], parsers: list[Callable[[bytes], Any]]) -> bool:
    """Say whether every field of a row parses."""
    try:
        _parse_columns([row], parsers)
    except (ValueError, OverflowError):
        return False
    return True
