"""The rows of a store, to compare one run with another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from quadid_logs.errors import SettingsError
from quadid_logs.fleets.rows import COLUMNS, RUN_COLUMNS
from quadid_logs.fleets.store import read_rows


def n_logs_of(store: Path) -> int:
    """Return how many logs a store holds, 0 before it is there; a run may write into it meanwhile."""
    try:
        return len({tuple(row.values()) for row in read_rows(store, ["sha256", "url"])})
    except SettingsError:
        return 0


def rows_of(store: Path, *, without: Sequence[str] = (), with_times: bool = False) -> list[dict[str, Any]]:
    """Return the rows in a fixed order, unless `with_times` but for what differs between runs."""
    left_out = (*without, *(() if with_times else RUN_COLUMNS))
    columns = [name for name in COLUMNS if name not in left_out]
    return sorted(
        read_rows(store, columns),
        key=lambda row: (row["sha256"] or row["url"], row["flight"] or 0, row["axis"] or ""),
    )
