"""The files of a store: where each lies, how it is written, and which of their rows count.

::

    STORE/fleet.json                              how it was made
    STORE/vehicle=quad-07/<sha256>-<version>.parquet
    STORE/vehicle=quad-07/all.parquet             what `compact` put together
    STORE/reports/<sha256>-<flight>.html

A file appears by being renamed, whole, so that a run can be killed at any
moment. A log's own file counts instead of whatever an ``all.parquet`` of any
vehicle says about the log. So a log is analyzed again by writing its own file,
and logs are put together by writing ``all.parquet`` first and removing their
own files after it: at every moment each row counts once.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from quadid_logs.errors import SettingsError
from quadid_logs.fleet.rows import schema
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.dataset as pads

DESCRIPTION, REPORTS, TOGETHER = "fleet.json", "reports", "all.parquet"
PART = ".part"
#: Begins the name of a file about a log whose content was never seen.
LOST_PREFIX = "lost-"
#: Longest name of a folder [bytes]: file systems allow 255.
_LONGEST: Final = 120


def partition(vehicle: str) -> str:
    r"""Return the folder of a vehicle; a hostile name leads nowhere else.

    >>> partition("../../etc\x00/x")
    'vehicle=%2E%2E%2F%2E%2E%2Fetc%00%2Fx'
    """
    return f"vehicle={partition_safe(vehicle)}"


def partition_safe(name: str) -> str:
    """Escape all but letters, digits, ``_``, ``-`` and single inner dots; a hash ends what is too long."""
    escaped = re.sub(
        rb"[^A-Za-z0-9_.-]|\.(?=\.)|^\.|(?<=\.)\.|\.$",
        lambda match: b"".join(b"%%%02X" % byte for byte in match[0]),
        name.encode("utf-8", "replace"),
    ).decode()
    if len(escaped) <= _LONGEST:
        return escaped or "%"
    return f"{escaped[: _LONGEST - 17]}-{hashlib.sha256(name.encode('utf-8', 'replace')).hexdigest()[:16]}"


def write_whole(path: Path, content: bytes) -> None:
    """Write a file beside its place, through to the disk, and rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}{PART}")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def check_store(folder: Path) -> None:
    """Refuse what is no store.

    Raises
    ------
    SettingsError
    """
    if not (folder / DESCRIPTION).is_file():
        raise SettingsError(
            f"{printable(folder)} is no store of a fleet.",
            hint="Make one with: quadid-log fleet LOGS -o STORE",
        )


def _files(folder: Path) -> tuple[list[Path], list[Path], dict[Path, set[str]]]:
    """Return the files of single logs, those put together, and what of the latter counts no more."""
    check_store(folder)
    own, together = own_files(folder), together_files(folder)
    return own, together, outdated_logs(own, together)


@contextmanager
def _unchanged(folder: Path) -> Iterator[None]:
    """Tell why a file of the store is gone: a run that ends meanwhile puts files together."""
    try:
        yield
    except FileNotFoundError as error:
        raise SettingsError(
            f"{printable(folder)} was changed while it was read.",
            hint="Ask again when the run that writes it has ended.",
        ) from error


def dataset(folder: Path) -> pads.Dataset:
    """Return the rows of a store, not yet read.

    Raises
    ------
    SettingsError
        If the folder is no store, or is changed meanwhile.
    """
    import pyarrow.dataset as pads

    with _unchanged(folder):
        own, together, outdated = _files(folder)
        whole = [path for path in together if path not in outdated]
        # Only where a run was killed, or analyzed again what older ones had: these rows are read at once.
        rest = [pads.dataset(read_rows([path], without=logs)) for path, logs in outdated.items()]
        return pads.dataset([_on_disk([*own, *whole]), *rest])


def rows_by_vehicle(folder: Path, columns: Iterable[str]) -> Iterator[list[dict[str, Any]]]:
    """Yield some columns of the rows of one vehicle after the other.

    Raises
    ------
    SettingsError
        If the folder is no store, or is changed meanwhile.
    """
    names = list(columns)
    with _unchanged(folder):
        own, together, outdated = _files(folder)
    owned = by_vehicle(own)
    for vehicle in sorted({*owned, *(path.parent for path in together)}):
        path = vehicle / TOGETHER
        with _unchanged(folder):
            rows = read_rows(owned.get(vehicle, ()), columns=names).to_pylist()
            if path in together:
                rows += read_rows([path], without=outdated.get(path, ()), columns=names).to_pylist()
        yield rows


def by_vehicle(paths: Iterable[Path]) -> dict[Path, list[Path]]:
    """Return files by the folder of their vehicle."""
    found: dict[Path, list[Path]] = {}
    for path in paths:
        found.setdefault(path.parent, []).append(path)
    return found


def own_files(folder: Path) -> list[Path]:
    """Return the files about one log each."""
    found = folder.glob("vehicle=*/*.parquet")
    return sorted(path for path in found if path.name != TOGETHER and not path.name.startswith("."))


def key_of(path: Path) -> str:
    """Return which log an own file is about: its SHA-256, or the name of one that was never seen.

    >>> key_of(Path("0f3a-0.1.0.parquet")), key_of(Path("lost-77-0.1.0.parquet"))
    ('0f3a', 'lost-77')
    """
    found = re.match(rf"({LOST_PREFIX})?[^-]*", path.name)
    return found[0] if found else ""


def together_files(folder: Path) -> list[Path]:
    """Return the files about many logs."""
    return sorted(folder.glob(f"vehicle=*/{TOGETHER}"))


def outdated_logs(own: Iterable[Path], together: Iterable[Path]) -> dict[Path, set[str]]:
    """Return by file of many logs those (SHA-256) that have a file of their own, where there are any."""
    newer = {key_of(path) for path in own}
    if not newer:
        return {}
    found = {path: newer.intersection(_logs_in(path)) for path in together}
    return {path: logs for path, logs in found.items() if logs}


def read_rows(
    files: Iterable[Path], *, without: Iterable[str] = (), columns: list[str] | None = None
) -> pa.Table:
    """Read files into memory, but for some logs (SHA-256)."""
    import pyarrow as pa
    import pyarrow.dataset as pads

    wanted = ~pads.field("sha256").isin(pa.array(without, pa.string()))
    return _on_disk(files).to_table(columns=columns, filter=wanted)


def _logs_in(path: Path) -> set[str]:
    """Return which logs a file of many is about."""
    return set(read_rows([path], columns=["sha256"])["sha256"].to_pylist())


def _on_disk(files: Iterable[Path]) -> pads.Dataset:
    import pyarrow.dataset as pads

    return pads.dataset([str(path) for path in files], schema=schema(), format="parquet")
