"""Logs in, store out: the whole run of ``quadid-log fleet``."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from quadid_logs.extra import load
from quadid_logs.fleets.engine import Cluster, Events, run
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import ANALYZED, LOST, UNREADABLE
from quadid_logs.fleets.store import Store
from quadid_logs.fleets.tasks import Outcome, Task

KNOWN = "known"


@dataclass(slots=True, kw_only=True)
class Tally:
    """How far a run is; counts are by `ANALYZED`, `UNREADABLE`, `LOST` and `KNOWN`."""

    n_logs: int
    began_s: float = field(default_factory=time.monotonic)
    counts: Counter[str] = field(default_factory=Counter)
    dashboard: str = ""

    @property
    def n_done(self) -> int:
        """Logs that need nothing more in this run."""
        return self.counts.total()

    @property
    def elapsed_s(self) -> float:
        """Seconds since the workers were there."""
        return time.monotonic() - self.began_s

    @property
    def rate_hz(self) -> float:
        """Logs per second, those not counted whose content was known."""
        worked = self.n_done - self.counts[KNOWN]
        return worked / self.elapsed_s if self.elapsed_s > 0.0 else 0.0

    @property
    def left_s(self) -> float:
        """Time left if the rest goes like what is done [s]; infinite before the first."""
        return (self.n_logs - self.n_done) * self.elapsed_s / self.n_done if self.n_done else float("inf")


def run_fleet(
    files: Sequence[LogFile],
    folder: Path,
    options: Options,
    cluster: Cluster,
    *,
    resume: bool = False,
    progress: Callable[[Tally], None] = lambda _tally: None,
    notice: Callable[[str], None] = lambda _text: None,
) -> Tally:
    """Analyze every log that the store does not hold yet.

    Parameters
    ----------
    resume : bool
        Add to a store that exists.
    progress : callable
        Called with the tally after every log.
    notice : callable
        Called with what happened to scheduler and workers.

    Raises
    ------
    OutputError, SettingsError
        If the store cannot be written, or was made otherwise; if the scheduler does not answer.
    """
    for library in ("distributed", "fsspec", "pebble", "pyarrow"):
        load(library, "fleet")
    store = Store(folder, options, resume=resume)
    tally = Tally(n_logs=len(files))

    def began(dashboard: str) -> None:
        tally.dashboard, tally.began_s = dashboard, time.monotonic()
        progress(tally)

    def take(outcome: Outcome) -> bool:
        if not store.take(outcome):
            return False
        tally.counts[KNOWN if outcome.is_known else outcome.status] += 1
        progress(tally)
        return True

    with store:
        tasks = [Task(file=file, options=options, known=store.known(file)) for file in files]
        if tasks:
            run(tasks, cluster, Events(take=take, began=began, notice=notice))
    return tally


__all__ = ["ANALYZED", "KNOWN", "LOST", "UNREADABLE", "Tally", "run_fleet"]
