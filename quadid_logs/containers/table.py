"""Tables with canonical column names, as CSV or Parquet.

The names are those of `vocabulary.SIGNALS` (``time_s``, ``p_rad_s``, ...);
signals with one column per motor are numbered (``motor_thrust_1``, ...).
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import FlightLog, MessageCount, Rows, Signal
from quadid_logs.errors import EmptyLogError, UnknownFormatError
from quadid_logs.vocabulary import MULTIROTOR, SIGNALS

_TIME: Final = "time_s"
_PARQUET: Final = b"PAR1"
_BOM: Final = b"\xef\xbb\xbf"
_DELIMITERS: Final = ",;\t"
_LONGEST_HEADER: Final = 1 << 16
_MOST_CELLS: Final = 200_000_000
"""A Parquet file of some kilobytes can claim any number of rows; this is 1.6 GB of numbers."""
_TRUTH: Final = {"true": 1.0, "false": 0.0}


class _Header(NamedTuple):
    """Column names of a CSV file, how it is written, and how many bytes come before its first row."""

    names: list[str]
    delimiter: str
    n_bytes: int


class _Cells(NamedTuple):
    """Columns by name, how many cells were no number, and how many rows could not be split into cells."""

    columns: Mapping[str, FloatArray]
    n_not_numeric: int
    n_broken_rows: int


def is_mine(head: bytes) -> bool:
    """Tell whether a file beginning with `head` is Parquet, or text with a canonical column name on top."""
    if head.startswith(_PARQUET):
        return True
    header = _header(head)
    known = _canonical_names(header.names) if header else []
    return _TIME in known or len(known) > 1


def read(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a table into canonical signals.

    Parameters
    ----------
    path : str or Path
    system : int
        Has no effect: a table holds one vehicle.

    Returns
    -------
    FlightLog
        A table does not say what it is from: a multirotor is assumed.

    Raises
    ------
    UnknownFormatError
        If there is no column ``time_s``, if the body rates are incomplete, or
        if the file is damaged.
    EmptyLogError
        If there is no row.
    """
    with Path(path).open("rb") as file:
        is_parquet = file.read(len(_PARQUET)) == _PARQUET
    cells, names = _read_parquet(path) if is_parquet else _read_csv(path)
    time_s = cells.columns[_TIME]
    if not len(time_s):
        raise EmptyLogError(f"{path} has a header but no rows.", hint="Export the table again.")
    kind = "Parquet" if is_parquet else "CSV"
    signals, remarks = _signals(cells.columns, kind)
    remarks += [f"{cells.n_not_numeric} cells are no numbers and count as missing."] * (
        cells.n_not_numeric > 0
    )
    remarks += [f"{cells.n_broken_rows} rows have too few or too many cells."] * (cells.n_broken_rows > 0)
    others = [name for name in names if name not in cells.columns]
    remarks += [f"Columns without a canonical name are not used: {', '.join(others[:20])}."] * bool(others)
    remarks += ["A table holds one vehicle: the chosen system was not needed."] * bool(system)
    return FlightLog(
        path=str(path),
        format="table",
        autopilot="other",
        n_bytes=Path(path).stat().st_size,
        signals=signals,
        vehicle_type=MULTIROTOR,
        counts=(MessageCount(name="rows", count=len(time_s), rate_hz=_mean_rate_hz(time_s)),),
        remarks=("A table does not say what flew: a multirotor is assumed.", *remarks),
    )


def _canonical_names(names: list[str]) -> list[str]:
    """Return the names that the vocabulary has, each once, in the order of the table."""
    columns = {column for spec in SIGNALS.values() for column in spec.columns}
    numbered = re.compile(
        f"^({'|'.join(name for name, spec in SIGNALS.items() if not spec.columns)})_\\d{{1,2}}$"
    )
    return [name for name in dict.fromkeys(names) if name == _TIME or name in columns or numbered.match(name)]


def _check_names(path: str | Path, names: list[str]) -> list[str]:
    """Return the canonical names among `names`, or say what is missing."""
    present = ", ".join(names[:40]) or "none"
    if _TIME not in names:
        raise UnknownFormatError(
            f"{path} is a table without a column {_TIME}; its columns are: {present}.",
            hint="Name the columns time_s, p_rad_s, q_rad_s, r_rad_s and so on, in SI units.",
        )
    rates = SIGNALS["body_rate"].columns
    missing = [name for name in rates if name not in names]
    if missing and len(missing) < len(rates):
        raise UnknownFormatError(
            f"{path} is a table without {', '.join(missing)}; its columns are: {present}.",
            hint="All three body rates are needed.",
        )
    return _canonical_names(names)


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


def _read_csv(path: str | Path) -> tuple[_Cells, list[str]]:
    """Read the canonical columns of a CSV file."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    content = Path(path).read_bytes()
    header = _header(content[:_LONGEST_HEADER])
    wanted = _check_names(path, header.names if header else [])
    assert header is not None  # noqa: S101
    body = _as_utf8(content[header.n_bytes :])
    if not body.strip():
        return _Cells({name: np.zeros(0) for name in wanted}, 0, 0), header.names
    columns = {name: f"f{header.names.index(name)}" for name in wanted}
    n_broken = [0]

    def skip_row(row: Any) -> str:  # noqa: ARG001
        n_broken[0] += 1
        return "skip"

    first_rows = body[:_LONGEST_HEADER].split(b"\n")[0]
    options = {
        "include_columns": list(columns.values()),
        "decimal_point": "," if header.delimiter == ";" and b"," in first_rows else ".",
        "strings_can_be_null": True,
    }

    def load(kind: Any) -> Any:
        n_broken[0] = 0
        return arrow_csv.read_csv(
            pa.BufferReader(body),
            read_options=arrow_csv.ReadOptions(column_names=[f"f{k}" for k in range(len(header.names))]),
            parse_options=arrow_csv.ParseOptions(delimiter=header.delimiter, invalid_row_handler=skip_row),
            convert_options=arrow_csv.ConvertOptions(
                column_types=dict.fromkeys(columns.values(), kind), **options
            ),
        )

    cells = _numbers(lambda: load(pa.float64()), lambda: load(pa.binary()), columns, path)
    return cells._replace(n_broken_rows=n_broken[0]), header.names


def _as_utf8(content: bytes) -> bytes:
    """Return the text as UTF-8: old spreadsheets write Latin-1 in columns that we do not even use."""
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1").encode("utf-8")
    return content


def _read_parquet(path: str | Path) -> tuple[_Cells, list[str]]:
    """Read the canonical columns of a Parquet file."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path)
        names = [str(name) for name in file.schema_arrow.names]
        wanted = _check_names(path, names)
        if file.metadata.num_rows * len(wanted) > _MOST_CELLS:
            raise UnknownFormatError(f"{path} claims {file.metadata.num_rows} rows.", hint="Split the table.")
        table = file.read(columns=wanted)
    except (pa.ArrowException, OSError) as error:
        raise UnknownFormatError(
            f"{path} is a damaged Parquet file: {error}.", hint="Export it again."
        ) from error

    def cast(kind: Any) -> Any:
        return pa.table({name: table.column(name).cast(kind, safe=False) for name in wanted})

    cells = _numbers(
        lambda: cast(pa.float64()), lambda: cast(pa.string()), dict(zip(wanted, wanted, strict=True)), path
    )
    return cells, names


def _numbers(
    load_numbers: Callable[[], Any], load_text: Callable[[], Any], columns: dict[str, str], path: str | Path
) -> _Cells:
    """Load the columns as numbers; where a cell is none, as text that is converted cell by cell."""
    import pyarrow as pa

    try:
        table = load_numbers()
        found = {name: _as_float(table.column(column)) for name, column in columns.items()}
        return _Cells(found, 0, 0)
    except pa.ArrowException:
        pass
    try:
        table = load_text()
    except pa.ArrowException as error:
        raise UnknownFormatError(
            f"{path} cannot be read as a table: {error}.", hint="Export it again."
        ) from error
    found, n_not_numeric = {}, 0
    for name, column in columns.items():
        found[name], count = _convert(table.column(column).to_pylist())
        n_not_numeric += count
    return _Cells(found, n_not_numeric, 0)


def _as_float(column: Any) -> FloatArray:
    """Return an Arrow column as float64, missing values as NaN."""
    return np.asarray(column.to_numpy(), dtype=np.float64)


def _convert(cells: list[Any]) -> tuple[FloatArray, int]:
    """Convert cell by cell; what is no number becomes NaN and is counted, an empty cell only becomes NaN."""
    values, n_not_numeric = np.full(len(cells), np.nan), 0
    for k, cell in enumerate(cells):
        text = (
            cell.decode("utf-8", errors="replace") if isinstance(cell, bytes) else str(cell or "")
        ).strip()
        try:
            values[k] = _TRUTH[text.lower()] if text.lower() in _TRUTH else float(text or "nan")
        except ValueError:
            n_not_numeric += 1
    return values, n_not_numeric


def _signals(columns: Mapping[str, FloatArray], kind: str) -> tuple[dict[str, tuple[Signal, ...]], list[str]]:
    """Build every signal whose columns are complete, and remark on the others."""
    signals: dict[str, tuple[Signal, ...]] = {}
    remarks = []
    position = np.arange(len(columns[_TIME]), dtype=np.int64)
    for name, spec in SIGNALS.items():
        wanted = list(spec.columns) or _numbered(name, columns)
        missing = [column for column in wanted if column not in columns]
        if missing and len(missing) < len(wanted):
            remarks.append(f"{name} is left out: there is no column {', '.join(missing)}.")
        if wanted and not missing:
            signal = Signal(
                name=name,
                rows=Rows(columns[_TIME], position),
                values=np.column_stack([columns[column] for column in wanted]),
                source=f"{kind} columns {', '.join(wanted)}",
                reason="the table's own column names",
            )
            signals[name] = (signal,)
    return signals, remarks


def _numbered(name: str, columns: Mapping[str, FloatArray]) -> list[str]:
    """Return ``name_1``, ``name_2``, ... as far as the table has them, in the order of their numbers."""
    numbers = [int(column[len(name) + 1 :]) for column in columns if re.match(f"^{name}_\\d+$", column)]
    return [f"{name}_{number}" for number in sorted(numbers)]


def _mean_rate_hz(time_s: FloatArray) -> float:
    """Return rows per second between the first and the last row, NaN where that cannot be told."""
    duration_s = float(time_s[-1] - time_s[0])
    return (len(time_s) - 1) / duration_s if duration_s > 0.0 else float("nan")
