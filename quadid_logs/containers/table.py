"""CSV and Parquet files: columns of numbers by name, and how many cells were none."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.containers.content import text_content
from quadid_logs.errors import SettingsError, UnknownFormatError
from quadid_logs.extra import load

_PARQUET: Final = b"PAR1"
_BOM: Final = b"\xef\xbb\xbf"
_DELIMITERS: Final = ",;\t"
_LONGEST_HEADER: Final = 1 << 16
#: A Parquet file of some kilobytes can unfold to any number of cells: so many are always fine (32 MB), and
#: one more for every byte of the file, for numbers that were measured need more than a byte each.
_MOST_CELLS: Final = 4_000_000
_MOST_BYTES: Final = 8 * _MOST_CELLS
_TRUTH: Final = {"true": 1.0, "false": 0.0}
#: What spreadsheets and programs write where there is no value.
_MISSING: Final = frozenset(
    ("", "NULL", "null", "NA", "N/A", "n/a", "#NA", "#N/A", "1.#IND", "-1.#IND", "1.#QNAN", "-1.#QNAN")
)
#: A cell takes some sixty bytes until it is a number.
_LINES_AT_ONCE: Final = 20_000

Choose = Callable[[Sequence[str]], Sequence[str]]
"""Returns which of a table's columns are wanted, or raises."""


class _Header(NamedTuple):
    """Column names of a CSV file, how it is written, and how many bytes come before its first row."""

    names: list[str]
    delimiter: str
    n_bytes: int


class Cells(NamedTuple):
    """What was read of a table.

    Attributes
    ----------
    columns : mapping of str to ndarray, each of shape (n_rows,)
        The wanted ones; NaN where a cell holds no number.
    kind : str
        "CSV" or "Parquet".
    names : tuple of str
        Of all columns of the file.
    n_not_numeric : int
        How many cells hold something else than a number.
    n_broken_rows : int
        How many rows could not be split into cells.
    """

    columns: Mapping[str, FloatArray]
    kind: str
    names: tuple[str, ...]
    n_not_numeric: int = 0
    n_broken_rows: int = 0


def is_parquet(head: bytes) -> bool:
    """Tell whether a file beginning with `head` is Parquet."""
    return head.startswith(_PARQUET)


def header_names(head: bytes) -> list[str]:
    """Return the column names of a CSV file beginning with `head`; none where it is no table."""
    header = _header(head)
    return header.names if header else []


def read_cells(path: str | Path, choose: Choose) -> Cells:
    """Read columns of a CSV or Parquet file.

    Parameters
    ----------
    choose : callable
        Given the names of the file's columns, returns those to read.

    Raises
    ------
    UnknownFormatError
        If the file is damaged, or `choose` refuses it.
    """
    with Path(path).open("rb") as file:
        is_mine = is_parquet(file.read(len(_PARQUET)))
    return _read_parquet(path, choose) if is_mine else _read_csv(path, choose)


def _header(head: bytes) -> _Header | None:
    """Return the names in the first line that is neither empty nor a comment; None where it is no table."""
    offset = len(_BOM) if head.startswith(_BOM) else 0
    for line in head[offset:_LONGEST_HEADER].splitlines(keepends=True):
        offset += len(line)
        text = line.decode("utf-8", errors="replace").strip()
        if text and not text.startswith("#"):
            delimiter = max(_DELIMITERS, key=text.count)
            names = [
                name.strip()
                for name in next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])
            ]
            return _Header(names, delimiter, offset)
    return None


def _read_csv(path: str | Path, choose: Choose) -> Cells:
    """Read the chosen columns of a CSV file."""
    content = text_content(path)
    header = _header(content[:_LONGEST_HEADER])
    wanted = choose(header.names if header else [])
    if header is None:
        return Cells({}, "CSV", ())
    body = _as_utf8(content[header.n_bytes :])
    places = [header.names.index(name) for name in wanted]
    is_comma = header.delimiter == ";" and b"," in body[:_LONGEST_HEADER].split(b"\n")[0]
    parts: list[list[FloatArray]] = [[np.zeros(0)] for _ in places]
    n_not_numeric = n_broken = 0
    # Some thousand lines after the other: the cells of all at once would fill the memory.
    text = io.TextIOWrapper(io.BytesIO(body), encoding="utf-8", newline=None)
    while lines := list(islice(text, _LINES_AT_ONCE)):
        rows = [row for line in lines if (row := _split(line, header.delimiter)) is not None]
        whole = [row for row in rows if len(row) == len(header.names)]
        n_broken += len(rows) - len(whole)
        for part, place in zip(parts, places, strict=True):
            cells = [row[place].replace(",", ".") if is_comma else row[place] for row in whole]
            values, count = _floats(cells)
            part.append(values)
            n_not_numeric += count
    columns = {name: np.concatenate(part) for name, part in zip(wanted, parts, strict=True)}
    return Cells(columns, "CSV", tuple(header.names), n_not_numeric, n_broken)


def _split(line: str, delimiter: str) -> list[str] | None:
    """Return the cells of a line, None of an empty one; a quotation does not go on in the next line."""
    line = line.rstrip("\n")
    if not line:
        return None
    if '"' not in line:
        return line.split(delimiter)
    try:
        return next(csv.reader([line], delimiter=delimiter))
    except csv.Error:
        return []


def _floats(cells: list[str]) -> tuple[FloatArray, int]:
    """Return cells as numbers, and how many are none; what only stands for a missing value does not count."""
    try:
        return np.fromiter(map(float, cells), np.float64, len(cells)), 0
    except ValueError:
        different = list(dict.fromkeys(cells))
    values, is_no_number = _convert(["" if cell.strip() in _MISSING else cell for cell in different])
    place = {cell: k for k, cell in enumerate(different)}
    places = np.fromiter((place[cell] for cell in cells), np.int64, len(cells))
    return values[places], int(np.count_nonzero(is_no_number[places]))


def _as_utf8(content: bytes) -> bytes:
    """Return the text as UTF-8: old spreadsheets write Latin-1 in columns that we do not even use."""
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1").encode("utf-8")
    return content


def _read_parquet(path: str | Path, choose: Choose) -> Cells:
    """Read the chosen columns of a Parquet file."""
    try:
        pa, parquet = load("pyarrow", "parquet"), load("pyarrow.parquet", "parquet")
    except SettingsError as missing:
        raise UnknownFormatError(f"{path} is a Parquet file: {missing}", hint=missing.hint) from missing
    try:
        file = parquet.ParquetFile(path)
        names = [str(name) for name in file.schema_arrow.names]
        wanted = list(choose(names))
        _check_unfolded(path, file, wanted)
        texts = [name for name in wanted if _is_text(file.schema_arrow.field(name).type)]
        # A text that stands in a million cells is kept once.
        table = parquet.ParquetFile(path, read_dictionary=texts).read(columns=wanted)
    except (pa.ArrowException, OSError) as error:
        raise UnknownFormatError(
            f"{path} is a damaged Parquet file: {error}.", hint="Export it again."
        ) from error

    found, n_not_numeric = {}, 0
    for name in wanted:
        found[name], count = _parquet_column(table.column(name))
        n_not_numeric += count
    return Cells(found, "Parquet", tuple(names), n_not_numeric)


def _check_unfolded(path: str | Path, file: Any, wanted: Sequence[str]) -> None:
    """Refuse a table that unfolds to far more than its file holds."""
    import pyarrow as pa

    types = {name: file.schema_arrow.field(name).type for name in wanted}
    nested = [name for name, kind in types.items() if pa.types.is_nested(kind)]
    if nested:
        raise UnknownFormatError(
            f"{path}: column {nested[0]} holds lists instead of numbers.", hint="Unnest it."
        )
    about, n_bytes = file.metadata, Path(path).stat().st_size
    # Of whole row groups: Arrow ends the process where it is asked about a column with damaged statistics.
    n_unfolded = sum(about.row_group(group).total_byte_size for group in range(about.num_row_groups))
    if about.num_rows * len(types) > _MOST_CELLS + n_bytes or n_unfolded > _MOST_BYTES + 8 * n_bytes:
        raise UnknownFormatError(
            f"{path} unpacks from {n_bytes / 1000000.0:.1f} MB to {about.num_rows} rows and "
            f"{n_unfolded / 1000000.0:.0f} MB, which is too large.",
            hint="Split the table.",
        )


def _is_text(kind: Any) -> bool:
    """Tell whether a type is text or bytes, which Arrow can keep as a dictionary."""
    from pyarrow import types

    return bool(types.is_string(kind) or types.is_binary(kind) or types.is_large_string(kind))


def _parquet_column(column: Any) -> tuple[FloatArray, int]:
    """Return a column as numbers, and how many of its cells are none."""
    import pyarrow as pa

    if pa.types.is_dictionary(column.type):
        return _convert_column(column)
    try:
        # An Arrow column as float64, missing values as NaN.
        return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64), 0
    except pa.ArrowException:
        return _convert_column(column.cast(pa.string()))


def _convert_column(column: Any) -> tuple[FloatArray, int]:
    """Convert a column chunk by chunk, every different text once: cells as objects would fill the memory."""
    import pyarrow as pa

    parts, n_not_numeric = [np.zeros(0)], 0
    for chunk in column.chunks:
        encoded = chunk if pa.types.is_dictionary(chunk.type) else chunk.dictionary_encode()
        values, is_no_number = _convert(encoded.dictionary.to_pylist())
        # What is missing refers to a further value.
        places = encoded.indices.fill_null(len(values)).to_numpy(zero_copy_only=False)
        parts.append(np.append(values, np.nan)[places])
        n_not_numeric += int(np.count_nonzero(np.append(is_no_number, False)[places]))
    return np.concatenate(parts), n_not_numeric


def _convert(cells: list[Any]) -> tuple[FloatArray, BoolArray]:
    """Convert cell by cell; what is no number becomes NaN and is marked, an empty cell only becomes NaN."""
    values, is_no_number = np.full(len(cells), np.nan), np.zeros(len(cells), np.bool_)
    for k, cell in enumerate(cells):
        text = (
            cell.decode("utf-8", errors="replace") if isinstance(cell, bytes) else str(cell or "")
        ).strip()
        try:
            values[k] = _TRUTH[text.lower()] if text.lower() in _TRUTH else float(text or "nan")
        except ValueError:
            is_no_number[k] = True
    return values, is_no_number
