"""The store of a fleet for Python: counts, rows, SQL."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from quadid_logs.fleets.store import read_rows

if TYPE_CHECKING:
    import pandas as pd


class StoredFleet(NamedTuple):
    """The store of a fleet.

    Attributes
    ----------
    folder : Path
        Folder of the store.
    """

    folder: Path

    @property
    def counts(self) -> dict[str, int]:
        """Number of logs that were analyzed, unreadable or lost."""
        rows = read_rows(self.folder, ("status", "sha256", "url"))
        logs = {row["sha256"] or row["url"]: row["status"] for row in rows}
        return dict(Counter(logs.values()))

    def to_pandas(self) -> pd.DataFrame:
        """Return all rows: one for each log, flight and axis.

        Raises
        ------
        SettingsError
            If the folder is not a store, or pandas is not installed.
        """
        from quadid_logs.extra import load
        from quadid_logs.fleets.store import read_table

        load("pandas")
        frame: pd.DataFrame = read_table(self.folder).to_pandas()
        return frame

    def query(self, sql: str) -> list[dict[str, object]]:
        """Return the rows of one SQL statement on the table ``fleet``.

        Raises
        ------
        SettingsError
            If the folder is not a store, or the statement fails.
        """
        from quadid_logs.fleets.sql import ask

        answer = ask(self.folder, sql)
        return [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]
