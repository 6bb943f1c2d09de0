"""Put the rows of many logs into one file per vehicle, so that a query need not open a file per log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from quadid_logs.errors import OutputError
from quadid_logs.fleet.files import (
    LOST_PREFIX,
    TOGETHER,
    by_vehicle,
    check_store,
    outdated_logs,
    own_files,
    read_rows,
    together_files,
    write_whole,
)
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    import pyarrow as pa

#: Fewer own files of a vehicle are left alone, so that a day with one log more does not write all the
#: vehicle's life again.
_WORTH: Final = 16


def compact(folder: Path) -> None:
    """Put together what lies in a file per log; the rows stay the same.

    It may be killed at any moment: rows are written before the files that they
    come from are removed, and until then those count (see `files`). Lost logs
    keep their own files, because the next run replaces them.

    Parameters
    ----------
    folder : Path
        The store; no run may write into it meanwhile.

    Raises
    ------
    OutputError
        If it cannot be written.
    SettingsError
        If it is no store.
    """
    check_store(folder)
    try:
        _compact(folder)
    except OSError as error:
        raise OutputError(f"{printable(folder)} cannot be written: {error.strerror or error}.") from error


def _compact(folder: Path) -> None:
    """Write all files of many logs, then remove the own files that are in them."""
    own, together = own_files(folder), together_files(folder)
    outdated = outdated_logs(own, together)
    chosen = _worth_while(own)
    # An outdated log must be gone from all vehicles before its own file goes: it may have been another's.
    for vehicle in sorted({*chosen, *(path.parent for path in outdated)}):
        path = vehicle / TOGETHER
        here = [path] if path in together else []
        kept = read_rows(here, without=outdated.get(path, ()))
        _replace(path, [kept, read_rows(chosen.get(vehicle, ()))])
    for files in chosen.values():
        for path in files:
            path.unlink(missing_ok=True)


def _replace(path: Path, tables: Sequence[pa.Table]) -> None:
    """Write the rows; no file where there are none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = pa.concat_tables(tables)
    if not len(rows):
        path.unlink(missing_ok=True)
        return
    buffer = pa.BufferOutputStream()
    pq.write_table(rows, buffer, compression="zstd")
    write_whole(path, buffer.getvalue())


def _worth_while(own: list[Path]) -> dict[Path, list[Path]]:
    """Return the own files to put together, by vehicle."""
    seen = by_vehicle(path for path in own if not path.name.startswith(LOST_PREFIX))
    return {vehicle: files for vehicle, files in seen.items() if len(files) >= _WORTH}
