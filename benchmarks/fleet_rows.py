"""The rows of a store, to compare one run with another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from quadid_logs.fleet.files import dataset
from quadid_logs.fleet.rows import RUN_COLUMNS


def rows_of(store: Path, *, without: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return the rows in a fixed order, but for what differs between runs."""
    rows: list[dict[str, Any]] = dataset(store).to_table().drop_columns([*RUN_COLUMNS, *without]).to_pylist()
    return sorted(rows, key=lambda row: (row["sha256"] or row["url"], row["flight"] or 0, row["axis"] or ""))
