"""DataFlash as bytes (.bin): messages as columns."""

from __future__ import annotations

import io
from collections.abc import Collection
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np

from quadid_logs.arrays import AnyArray
from quadid_logs.containers.content import FileParts, decode_text
from quadid_logs.containers.dataflash_index import (
    DEFINING,
    ByteArray,
    FormatCharacter,
    MessageDefinition,
    MessageIndex,
    by_version,
    index_messages,
    looks_like_dataflash,
)
from quadid_logs.containers.message_table import MessageTable, Unit, join_tables
from quadid_logs.containers.sdlog2 import is_sdlog2
from quadid_logs.data.log import LostBytes
from quadid_logs.errors import EmptyLogError, LogNotFoundError, UnknownFormatError

#: Rows gathered at once: they stay in the processor's cache until their columns are copied out.
_GATHER_ROWS: Final = 10_000
_UNIT_LABELS: Final = frozenset({"FmtType", "UnitIds", "MultIds", "Id", "Label", "Mult"})
#: Rows in which the first and last of each id are sought at once.
_SEARCH_ROWS: Final = 1 << 20
#: Rows are gathered from parts of the file of this size.
_GATHER_BYTES: Final = 1 << 22
_LONGEST_MESSAGE: Final = 255


class DataFlashFile:
    """An open DataFlash binary file and an index of its messages.

    Examples
    --------
    >>> with DataFlashFile.open("flight.bin") as file:  # doctest: +SKIP
    ...     rate = file.read_messages({"RATE"})["RATE"]
    ...     rate.columns["R"]  # [deg/s]
    """

    def __init__(self, path: str, content: FileParts) -> None:
        self.path = path
        self.n_bytes = content.n_bytes
        self._content = content
        self._index = index_messages(content)
        self._rows_per_id = np.bincount(self._index.type_id, minlength=256)
        self._units: dict[int, dict[str, Unit]] | None = None

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open and index a file.

        Raises
        ------
        LogNotFoundError
            If there is no readable regular file.
        EmptyLogError
            If the file has no content.
        LogError
            If the file becomes shorter meanwhile.
        """
        try:
            content = FileParts.open(path)
        except OSError as error:
            raise LogNotFoundError(f"Cannot read {path}: {error.strerror}.") from error
        try:
            if not content.n_bytes:
                raise EmptyLogError(f"{path} is empty.", hint="Copy the log from the vehicle again.")
            return cls(str(path), content)
        except BaseException:
            content.close()
            raise

    @classmethod
    def from_bytes(cls, content: bytes, path: str = "") -> Self:
        """Index the content of a file that is already in memory."""
        return cls(path, FileParts(io.BytesIO(content), path))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; the tables read so far stay valid."""
        self._content.close()

    @property
    def lost(self) -> tuple[LostBytes, ...]:
        """What could not be read as messages, in file order."""
        return self._index.lost

    @property
    def counts(self) -> dict[str, int]:
        """Rows per message name, in the order of their definition; only names that occur."""
        counts: dict[str, int] = {}
        for type_id, versions in self._index.definitions.items():
            if len(versions) == 1:
                groups = [(versions[0], int(self._rows_per_id[type_id]))]
            else:
                rows = self._index.position[self._index.type_id == type_id]
                groups = [(version, len(positions)) for version, positions in by_version(versions, rows)]
            for definition, count in groups:
                if count:
                    counts[definition.name] = counts.get(definition.name, 0) + count
        return counts

    @property
    def definitions(self) -> tuple[MessageDefinition, ...]:
        """Every definition in the file."""
        return tuple(version for versions in self._index.definitions.values() for version in versions)

    @property
    def has_headers(self) -> bool:
        """Say whether message headers are far denser than chance, one in 64 kB, makes them."""
        return self._index.n_headers >= max(16, self.n_bytes // 512)

    def read_messages(
        self, types: Collection[str] | None = None, labels: Collection[str] | None = None
    ) -> dict[str, MessageTable]:
        """Decode some columns of some message types, all where None.

        Only types that occur. Values are scaled by their format character (``c C e E`` by 1/100, ``L`` by
        1e-7) and otherwise as logged.
        """
        # Each definition of the named types with the positions of its rows.
        index = self._index
        wanted = {
            type_id: versions
            for type_id, versions in index.definitions.items()
            if types is None or any(version.name in types for version in versions)
        }
        is_wanted = np.zeros(256, np.bool_)
        is_wanted[list(wanted)] = True
        rows = np.flatnonzero(is_wanted[index.type_id])
        type_ids = index.type_id[rows]
        # Stable, so rows stay in file order; a radix sort for one byte.
        positions = index.position[rows][np.argsort(type_ids, kind="stable")]
        bounds = np.concatenate([[0], np.cumsum(np.bincount(type_ids, minlength=256))]).tolist()
        return self._decode(
            [
                group
                for type_id, versions in wanted.items()
                for group in by_version(versions, positions[bounds[type_id] : bounds[type_id + 1]])
                if types is None or group[0].name in types
            ],
            labels,
        )

    def first_and_last(self) -> dict[str, MessageTable]:
        """Decode the first and the last row of every message type."""
        # First and the last row of each id, -1 for ids that do not occur.
        first, last = np.full(256, -1, np.int64), np.full(256, -1, np.int64)
        for start in range(0, len(self._index.type_id), _SEARCH_ROWS):
            part = self._index.type_id[start : start + _SEARCH_ROWS]
            numbers = np.arange(start, start + len(part))
            last[part] = numbers  # of repeated indices, the last value stays
            new = np.full(256, -1, np.int64)
            new[part[::-1]] = numbers[::-1]
            first = np.where(first < 0, new, first)
        ends: dict[str, list[tuple[MessageDefinition, AnyArray]]] = {}
        for type_id, versions in self._index.definitions.items():
            if first[type_id] >= 0:
                rows = np.unique([first[type_id], last[type_id]])
                for group in by_version(versions, self._index.position[rows]):
                    ends.setdefault(group[0].name, []).append(group)
        outermost = []
        for groups in ends.values():
            # Of the ends of all ids with one name those that hold the first and the last row.
            first_group = min(groups, key=lambda group: int(group[1][0]))
            last_group = max(groups, key=lambda group: int(group[1][-1]))
            outermost += [first_group] if first_group is last_group else [first_group, last_group]
        return self._decode(outermost)

    def _decode(
        self, groups: list[tuple[MessageDefinition, AnyArray]], labels: Collection[str] | None = None
    ) -> dict[str, MessageTable]:
        """Decode the rows of each group and join groups of one name."""
        # Read FMTU, UNIT and MULT once.
        if self._units is None:
            self._units = {}  # the tables that hold the units have none themselves
            self._units = _read_units(self, self._index)
        units = self._units
        tables: dict[str, list[MessageTable]] = {}
        for definition, columns in _gather(self._content, groups, labels):
            table = MessageTable(
                name=definition.name,
                columns=columns,
                position=columns.pop(_POSITION).astype(np.int64),
                units=units.get(definition.type_id, {}),
            )
            tables.setdefault(definition.name, []).append(table)
        return {name: join_tables(parts) for name, parts in tables.items()}


def read_messages(path: str | Path, types: Collection[str] | None = None) -> dict[str, MessageTable]:
    """Decode the rows of some message types of a DataFlash binary file, of all where None.

    Raises
    ------
    LogNotFoundError, EmptyLogError
        As `DataFlashFile.open`.
    """
    with DataFlashFile.open(path) as file:
        return file.read_messages(types)


def is_mine(head: bytes) -> bool:
    """Say whether a file that begins with these (up to 64 kB) bytes is an ArduPilot DataFlash log."""
    return looks_like_dataflash(head, lambda definitions: not is_sdlog2(definitions))


def check_not_empty(file: DataFlashFile) -> None:
    """Refuse a file without definitions or without rows besides them.

    Raises
    ------
    EmptyLogError
        If rows or definitions are missing.
    UnknownFormatError
        If both are.
    """
    if not file.definitions and not file.has_headers:
        raise UnknownFormatError(
            f"{file.path} is not a DataFlash log: it holds no message definition (FMT).",
            hint="Give the original .bin log of the autopilot.",
        )
    if not file.definitions:
        raise EmptyLogError(
            f"{file.path} holds no message definition (FMT): its beginning is missing.",
            hint="Download the whole log again: without definitions no row can be read.",
        )
    if not set(file.counts) - DEFINING:
        raise EmptyLogError(
            f"{file.path} holds {len(file.definitions)} message definitions, but not one row of data.",
            hint="The log ended before anything was written. Fetch the complete file from the vehicle.",
        )


_POSITION: Final = "\0position"


def _gather(
    content: FileParts,
    groups: list[tuple[MessageDefinition, AnyArray]],
    labels: Collection[str] | None,
) -> list[tuple[MessageDefinition, dict[str, AnyArray]]]:
    """Copy the rows of each group into columns, part of the file by part of the file."""
    fields = [
        {label: field for label, field in definition.fields().items() if labels is None or label in labels}
        for definition, _ in groups
    ]
    columns: list[dict[str, AnyArray]] = []
    for of, (_, positions) in zip(fields, groups, strict=True):
        # Of the stored type, or float where a scale applies.
        dtypes = {
            label: np.dtype(kind.dtype if kind.divisor == 1.0 else "<f8") for label, (kind, _) in of.items()
        }
        columns.append(
            {label: np.empty((len(positions), *each.shape), each.base) for label, each in dtypes.items()}
        )
    # There can be thousands of groups: for every block those between whose first and last row it lies.
    groups_of: list[list[int]] = [[] for _ in range(content.n_bytes // _GATHER_BYTES + 1)]
    for place, (_, own) in enumerate(groups):
        for block in range(int(own[0]) // _GATHER_BYTES, int(own[-1]) // _GATHER_BYTES + 1):
            groups_of[block].append(place)
    for start, part in content.blocks(_GATHER_BYTES, _LONGEST_MESSAGE):
        stop = min(start + _GATHER_BYTES, content.n_bytes)
        for number in groups_of[start // _GATHER_BYTES]:
            (definition, positions), of, into = groups[number], fields[number], columns[number]
            first, last = np.searchsorted(positions, np.array([start, stop], positions.dtype))
            here = slice(int(first), int(last))
            _gather_rows(
                part,
                definition.length,
                of,
                positions[here] - start,
                {label: column[here] for label, column in into.items()},
            )
    result = []
    for (definition, positions), of, into in zip(groups, fields, columns, strict=True):
        finished = {label: _finish(values, of[label][0]) for label, values in into.items()}
        result.append((definition, {**finished, _POSITION: positions}))
    return result


def _gather_rows(
    data: ByteArray,
    length: int,
    fields: dict[str, tuple[FormatCharacter, int]],
    positions: AnyArray,
    into: dict[str, AnyArray],
) -> None:
    """Copy some rows, whole message by whole message, then field by field while they are in the cache."""
    if not fields or not len(positions):
        return
    whole = np.ndarray((len(data) - length + 1,), f"V{length}", data, 0, (1,))
    dtype = np.dtype(
        {
            "names": list(fields),
            "formats": [kind.dtype for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": length,
        }
    )
    for start in range(0, len(positions), _GATHER_ROWS):
        part = slice(start, start + _GATHER_ROWS)
        messages = whole[positions[part]].view(dtype)
        for label, (kind, _) in fields.items():
            if kind.divisor == 1.0:
                into[label][part] = messages[label]
            else:
                np.divide(messages[label], kind.divisor, out=into[label][part])


def _finish(values: AnyArray, kind: FormatCharacter) -> AnyArray:
    """Turn stored text into strings; numbers pass."""
    if not kind.is_text:
        return values
    decoded = {raw: decode_text(raw.split(b"\0", 1)[0]) for raw in set(values.tolist())}
    return np.array([decoded[raw] for raw in values.tolist()], dtype=np.str_)


def _read_units(file: DataFlashFile, index: MessageIndex) -> dict[int, dict[str, Unit]]:
    """Combine FMTU (which unit has which field), UNIT (names) and MULT (factors)."""
    tables = file.read_messages({"FMTU", "UNIT", "MULT"}, _UNIT_LABELS)
    if not {"FMTU", "UNIT"} <= set(tables):
        return {}
    if not (tables["FMTU"].has_numbers("FmtType") and tables["FMTU"].has_text("UnitIds", "MultIds")):
        return {}
    labels = _lookup(tables.get("UNIT"), "Label")
    factors = _lookup(tables.get("MULT"), "Mult")
    columns = tables["FMTU"].columns
    ids = zip(columns["UnitIds"].tolist(), columns["MultIds"].tolist(), strict=True)
    # The last that was said of an id holds, for the last of its definitions.
    ids_of = dict(zip(tables["FMTU"].integers("FmtType").tolist(), ids, strict=True))
    return {
        type_id: _units_of(index.definitions[type_id][-1], unit_ids, factor_ids, labels, factors)
        for type_id, (unit_ids, factor_ids) in ids_of.items()
        if type_id in index.definitions
    }


def _lookup(table: MessageTable | None, column: str) -> dict[str, object]:
    """Map the character of UNIT.Id or MULT.Id to its meaning."""
    if table is None or not table.has_numbers("Id") or not table.has(column):
        return {}
    pairs = zip(table.integers("Id").tolist(), table.columns[column].tolist(), strict=True)
    return {chr(number): value for number, value in pairs if 0 < number < 256}


def _units_of(
    definition: MessageDefinition,
    unit_ids: str,
    factor_ids: str,
    labels: dict[str, object],
    factors: dict[str, object],
) -> dict[str, Unit]:
    """Return the unit of every column of one message type that has one."""
    units = {}
    for number, (label, (kind, _)) in enumerate(definition.fields().items()):
        name = str(labels.get(unit_ids[number : number + 1], ""))
        if not name:
            continue
        factor = factors.get(factor_ids[number : number + 1])
        # A format character with a scale of its own has been applied; "no factor" is logged as 0.
        applied = kind.divisor != 1.0 or not isinstance(factor, float) or factor == 0.0
        # The factors are single-precision values written as doubles: 0.00999999977648258.
        units[label] = Unit(name, 1.0 if applied else float(f"{factor:.7g}"))
    return units
