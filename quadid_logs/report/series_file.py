"""The aligned series as one table, for other programs."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.errors import EmptyLogError, OutputError, SettingsError
from quadid_logs.extra import load
from quadid_logs.output import beside_prefix, check_free, new_folder, remove_unfinished
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import SIGNALS

TABLE_FORMATS = (".csv", ".parquet", ".mat")
#: Python's own numbers take ten times the memory of an array.
_ROWS_AT_ONCE = 20_000


def check_table_path(path: Path, *, force: bool = False) -> None:
    """Refuse early what `write_table` would refuse after the work.

    Parameters
    ----------
    path : Path
    force : bool
        Whether the file may be replaced.

    Raises
    ------
    SettingsError
        If the ending is not one of `TABLE_FORMATS`.
    OutputError
        If the file exists and `force` is not set, or the path is a folder.
    """
    if path.suffix.lower() not in TABLE_FORMATS:
        raise SettingsError(
            f"The name {printable(path.name, 80)!r} does not show the format.",
            hint=f"Let it end in {', '.join(TABLE_FORMATS)}.",
        )
    check_free(path, force=force)


def aligned_table(data: FlightData) -> dict[str, AnyArray]:
    """Return the aligned series by column name, all segments one after the other.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    dict of str to ndarray, shape (n_samples,)
        ``time_s`` [s], rates [rad/s], attitude [rad], torque (in the unit that
        its column name says), throttle, rate set-points [rad/s] and the injected chirp
        where they were logged, ``saturated`` (0 or 1), ``segment`` and
        ``flight`` (numbers from 0). NaN where a segment lacks a signal.

    Raises
    ------
    EmptyLogError
        If there is no segment.
    """
    if not data.segments or data.input is None:
        reason = printable(data.on_ground_reason) or "No signal of this log can be aligned."
        raise EmptyLogError(
            f"There is no aligned series to export. {reason}", hint="See `quadid-log info LOG`."
        )
    blocks: dict[str, AnyArray] = {"time_s": np.concatenate([segment.time_s for segment in data.segments])}
    for name, values in (
        ("body_rate", [segment.body_rate_rad_s for segment in data.segments]),
        ("attitude", [_or_nan(segment.attitude_rad, segment, 3) for segment in data.segments]),
        (data.input.kind, [segment.torque for segment in data.segments]),
        ("throttle", [_or_nan(segment.throttle, segment, 1) for segment in data.segments]),
        *_references(data),
    ):
        joined = np.concatenate(values)
        columns = joined.reshape(joined.shape[0], -1).T
        blocks |= dict(zip(SIGNALS[name].columns, columns, strict=True))
    counts = [segment.n_samples for segment in data.segments]
    blocks["saturated"] = np.concatenate([segment.saturated for segment in data.segments]).astype(np.int8)
    blocks["segment"] = _numbers(range(len(counts)), counts)
    blocks["flight"] = _numbers((segment.flight for segment in data.segments), counts)
    return blocks


def _references(data: FlightData) -> Iterator[tuple[str, list[FloatArray]]]:
    """Yield the rate set-points, and the injected chirp, where any segment has them."""
    width = max(0 if each.reference is None else each.reference.shape[1] for each in data.segments)
    for name, columns in (("body_rate_setpoint", slice(0, 3)), ("sysid_chirp", slice(3, 4))):
        if width < columns.stop:
            return
        yield (
            name,
            [
                _or_nan(
                    None
                    if each.reference is None or each.reference.shape[1] < columns.stop
                    else each.reference[:, columns],
                    each,
                    columns.stop - columns.start,
                )
                for each in data.segments
            ],
        )


def _or_nan(values: FloatArray | None, segment: Segment, n_columns: int) -> FloatArray:
    """Return the values, or NaN in their place."""
    return (
        np.full((segment.n_samples, n_columns), np.nan) if values is None else values.reshape(-1, n_columns)
    )


def _numbers(numbers: Iterable[int], counts: list[int]) -> AnyArray:
    """Return each number as often as its segment has samples."""
    return np.repeat(np.array(list(numbers), dtype=np.int32), counts)


def write_table(data: FlightData, path: Path, *, force: bool = False) -> int:
    """Write the aligned series to CSV, Parquet or MAT, as the ending says.

    The file is written beside and renamed, so it is whole or not there.

    Parameters
    ----------
    data : FlightData
    path : Path
    force : bool
        Replace the file if it exists.

    Returns
    -------
    int
        Number of rows.

    Raises
    ------
    EmptyLogError
        If there is no segment.
    SettingsError, OutputError
        See `check_table_path`; also if the file cannot be written.
    """
    check_table_path(path, force=force)
    table = aligned_table(data)
    try:
        remove_unfinished(path.parent)
        with (
            new_folder(path.parent),
            tempfile.TemporaryDirectory(
                prefix=beside_prefix(), dir=path.parent, ignore_cleanup_errors=True
            ) as beside,
        ):
            written = Path(beside) / f"table{path.suffix.lower()}"
            _write(table, written)
            written.replace(path)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise OutputError(f"Cannot write {printable(path)}: {reason}.") from error
    return int(table["time_s"].shape[0])


def _write(table: dict[str, AnyArray], path: Path) -> None:
    """Write the table in the format of the ending."""
    if path.suffix == ".mat":
        from scipy.io import savemat

        savemat(path, {name: values[:, np.newaxis] for name, values in table.items()}, do_compression=True)
        return
    if path.suffix == ".csv":
        # Write the table with as many digits as bring every number back, block by block.
        n_rows = len(next(iter(table.values())))
        with path.open("w", encoding="utf-8", newline="\n") as file:
            file.write(",".join(f'"{name}"' for name in table) + "\n")
            for start in range(0, n_rows, _ROWS_AT_ONCE):
                columns = [values[start : start + _ROWS_AT_ONCE].tolist() for values in table.values()]
                file.writelines(",".join(map(repr, row)) + "\n" for row in zip(*columns, strict=True))
        return
    pyarrow, parquet = load("pyarrow", "parquet"), load("pyarrow.parquet", "parquet")
    parquet.write_table(pyarrow.table(table), path)
