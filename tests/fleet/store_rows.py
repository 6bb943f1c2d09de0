"""What several tests of the fleet need."""

from __future__ import annotations

from quadid_logs.fleet.rows import RUN_COLUMNS
from quadid_logs.fleet.store import dataset


def rows_of(store, *, without=()):
    """Return the rows of a store in a fixed order, but for what differs between runs."""
    table = dataset(store).to_table().drop_columns([*RUN_COLUMNS, *without])
    rows = table.to_pylist()
    return sorted(rows, key=lambda row: (row["sha256"] or row["url"], row["flight"] or 0, row["axis"] or ""))
