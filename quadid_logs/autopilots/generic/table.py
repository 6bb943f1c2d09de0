"""Tables with canonical column names, as CSV or Parquet.

The names are those of `vocabulary.SIGNALS` (``time_s``, ``p_rad_s``, ...);
signals with one column per motor are numbered (``motor_thrust_1``, ...).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.containers import table
from quadid_logs.containers.content import mean_rate_hz
from quadid_logs.counting import counted
from quadid_logs.data.log import FlightLog, MessageCount, Rows, Signal
from quadid_logs.errors import EmptyLogError, ShapeError, UnknownFormatError
from quadid_logs.vocabulary import MULTIROTOR, SIGNALS

_TIME: Final = "time_s"
_FIXED: Final = frozenset(column for spec in SIGNALS.values() for column in spec.columns) | {_TIME}
#: Names that public data sets have for the same columns, on the same axes.
_SYNONYMS: Final = {
    "roll_setpoint_rad": "phi_setpoint_rad",
    "pitch_setpoint_rad": "theta_setpoint_rad",
    "yaw_setpoint_rad": "psi_setpoint_rad",
    "vx_m_s": "v_north_m_s",
    "vy_m_s": "v_east_m_s",
    "vz_m_s": "v_down_m_s",
}
_NUMBERED: Final = re.compile(
    f"^({'|'.join(name for name, spec in SIGNALS.items() if not spec.columns)})_\\d{{1,2}}$"
)


def is_mine(head: bytes) -> bool:
    """Tell whether a file beginning with `head` is Parquet, or text with a canonical column name on top."""
    if table.is_parquet(head):
        return True
    known = _canonical_names(table.header_names(head))
    return _TIME in known or len(known) > 1


def read(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a table into canonical signals.

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
    cells = table.read_cells(path, lambda names: _check_names(path, names))
    return _log(str(path), cells, Path(path).stat().st_size, _remarks(cells, system))


def from_columns(columns: Mapping[str, object], name: str) -> FlightLog:
    """Make a log of arrays that are in memory already.

    Parameters
    ----------
    columns : mapping of str to array_like, each of shape (n_samples,)
        By canonical name; others are not used.
    name : str
        Stands where a file's path would.

    Raises
    ------
    UnknownFormatError
        If there is no column ``time_s``, or if the body rates are incomplete.
    EmptyLogError
        If there is no row.
    ShapeError
        If the columns are not numbers, of one length.
    """
    wanted = _check_names(name, [str(each) for each in columns])
    arrays = {each: _numbers_of(each, columns[each]) for each in wanted}
    if len({array.shape for array in arrays.values()}) > 1:
        lengths = ", ".join(f"{each} {array.shape}" for each, array in arrays.items())
        raise ShapeError(f"The columns of {name} differ in length: {lengths}.")
    cells = table.Cells(arrays, name, tuple(map(str, columns)))
    return _log(name, cells, sum(array.nbytes for array in arrays.values()), _remarks(cells, 0))


def _numbers_of(name: str, values: object) -> FloatArray:
    """Return a column as floating-point numbers."""
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"The column {name} does not hold numbers: {error}.") from error
    if found.ndim != 1:
        raise ShapeError(f"The column {name} has the shape {found.shape}, not (n_samples,).")
    return found


def _log(path: str, cells: table.Cells, n_bytes: int, remarks: Sequence[str]) -> FlightLog:
    """Make a log of columns."""
    time_s = cells.columns[_TIME]
    if not len(time_s):
        raise EmptyLogError(f"{path} has a header but no rows.", hint="Export the table again.")
    # Build every signal whose columns are complete, and remark on the others.
    signals: dict[str, tuple[Signal, ...]] = {}
    incomplete = []
    synonyms = {
        name: other for name, other in _synonyms([*cells.columns]).items() if name not in cells.columns
    }
    columns = {**cells.columns, **{name: cells.columns[other] for name, other in synonyms.items()}}
    rows = Rows(columns[_TIME], np.arange(len(columns[_TIME]), dtype=np.int64))
    for name, spec in SIGNALS.items():
        # Without columns of its own ``name_1``, ``name_2``, ... as far as the table has them.
        numbers = (int(each[len(name) + 1 :]) for each in columns if re.match(f"^{name}_\\d+$", each))
        wanted = list(spec.columns) or [f"{name}_{number}" for number in sorted(numbers)]
        missing = [column for column in wanted if column not in columns]
        if missing and len(missing) < len(wanted):
            incomplete.append(f"{name} is left out: there is no column {', '.join(missing)}.")
        if wanted and not missing:
            signal = Signal(
                name=name,
                rows=rows,
                values=np.column_stack([columns[column] for column in wanted]),
                source=f"{cells.kind} columns {', '.join(synonyms.get(name, name) for name in wanted)}",
                reason="the table's own column names",
            )
            signals[name] = (signal,)
    return FlightLog(
        path=path,
        format="table",
        autopilot="other",
        n_bytes=n_bytes,
        signals=signals,
        vehicle_type=MULTIROTOR,
        counts=(MessageCount(name="rows", count=len(time_s), rate_hz=mean_rate_hz(len(time_s), time_s)),),
        remarks=("A table does not say what flew, so a multirotor is assumed.", *incomplete, *remarks),
    )


def _canonical_names(names: Sequence[str]) -> list[str]:
    """Return the names that the vocabulary knows, each once, in the order of the table."""
    known = [name for name in dict.fromkeys(names) if name in _FIXED or _NUMBERED.match(name)]
    return known + [other for name, other in _synonyms(names).items() if name not in known]


def _synonyms(names: Sequence[str]) -> dict[str, str]:
    """Return canonical names that a table has under other ones, with those."""
    return {_SYNONYMS[name]: name for name in names if name in _SYNONYMS}


def _check_names(path: str | Path, names: Sequence[str]) -> list[str]:
    """Return the canonical names among `names`, or say what is missing."""
    present = ", ".join(names[:40]) or "none"
    if _TIME not in names:
        raise UnknownFormatError(
            f"{path} is a table without a column {_TIME}. Its columns are: {present}.",
            hint="Name the columns time_s, p_rad_s, q_rad_s, r_rad_s and so on, in SI units.",
        )
    rates = SIGNALS["body_rate"].columns
    missing = [name for name in rates if name not in names]
    if missing and len(missing) < len(rates):
        raise UnknownFormatError(
            f"{path} is a table without {', '.join(missing)}. Its columns are: {present}.",
            hint="All three body rates are needed.",
        )
    return _canonical_names(names)


def _remarks(cells: table.Cells, system: int) -> list[str]:
    """Say what was left out."""
    others = [name for name in cells.names if name not in cells.columns]
    said = {
        counted(cells.n_not_numeric, "cell is no number and counts", "cells are no numbers and count")
        + " as missing.": cells.n_not_numeric,
        counted(cells.n_broken_rows, "row has", "rows have")
        + " too few or too many cells.": cells.n_broken_rows,
        f"Columns with an unknown name are not used: {', '.join(others[:20])}.": len(others),
        "A table holds one vehicle, so --system has no effect.": system,
    }
    return [words for words, how_many in said.items() if how_many]
