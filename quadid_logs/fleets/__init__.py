"""Analysis of many logs of many vehicles, on one machine or many, with the history of each vehicle.

::

    log_files  ->  work (in processes of the workers)  ->  store  ->  history  ->  changes  ->  page
                     ^ distributed by engine                  sql for other queries

Only this package needs ``quadid-logs[fleet]``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from quadid_logs.data.log import FlightLog
from quadid_logs.data.result import Result
from quadid_logs.errors import SettingsError

if TYPE_CHECKING:
    from quadid_logs.fleets.options import Options
    from quadid_logs.fleets.stored import StoredFleet


def fleet(
    logs: str | Path | FlightLog | Result | Sequence[str | Path | FlightLog | Result],
    store: str | Path,
    *,
    structure: str = "damped",
    band: tuple[float, float] | None = None,
    vehicle: str | Path = "",
    workers: int = 0,
    scheduler: str = "",
    resume: bool = False,
) -> StoredFleet:
    """Analyze many logs on the cores of this machine or on a cluster: one row for each log, flight and axis.

    Parameters
    ----------
    logs : str, Path, FlightLog or Result, or a sequence of these
        Files, folders, patterns or URLs. A log or a result stands for the file that it was read from. An
        empty sequence opens an existing store.
    store : str or Path
        Folder of the store.
    structure : str
        Structure of all models; models of different structures cannot be compared.
    band : (low, high), optional
        Frequency band of the fit for all logs [Hz]. By default it is selected for each log.
    vehicle : str or Path
        Vehicle file with mass, arms and thrust for all vehicles; "" for none.
    workers : int
        Number of local processes; 0 takes one for each core.
    scheduler : str
        Address of a Dask scheduler; "" for local processes.
    resume : bool
        Whether to continue an existing store: logs in it are skipped, lost logs are tried again.

    Returns
    -------
    StoredFleet
        The store with all rows.

    Raises
    ------
    OutputError
        If the store cannot be written.
    SettingsError
        If the store was made with other options, the scheduler does not answer, or a library is missing.
        Also if a log or a table was not read from a file.

    Notes
    -----
    Local workers import the calling script, like those of `multiprocessing`. In a script, call this function
    below ``if __name__ == "__main__":``; otherwise each worker runs the whole script again.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.fleet(["flights"], "store").counts  # doctest: +SKIP
    {'analyzed': 12, 'unreadable': 1}
    >>> store = quadid_logs.fleet([], "store")  # one that exists
    """
    from quadid_logs.fleets.engine import Cluster
    from quadid_logs.fleets.log_files import find_logs
    from quadid_logs.fleets.run import run_fleet
    from quadid_logs.fleets.stored import StoredFleet

    # A table is one log, although it iterates over its columns.
    several = isinstance(logs, Iterable) and not isinstance(logs, str) and not hasattr(logs, "keys")
    places = [_place(each) for each in (logs if several else [logs])]  # type: ignore[union-attr]
    if places:
        options, files = _options(structure, band, vehicle), find_logs(places)
        run_fleet(files, Path(store), options, Cluster(scheduler=scheduler, workers=workers), resume=resume)
    return StoredFleet(Path(store))


def _place(log: object) -> str:
    """Return the path or URL of a log. Workers read the log themselves, possibly on other machines."""
    if isinstance(log, str | Path):
        return str(log)
    path = getattr(log.log if isinstance(log, Result) else log, "path", "")
    if not Path(path).is_file():
        raise SettingsError(
            "A fleet needs files, and this log was not read from one.",
            hint=(
                "Write it to a file first: a DataFrame with to_csv, a simulated flight with `quadid-log "
                "simulate`."
            ),
        )
    return path


def _options(structure: str, band: tuple[float, float] | None, vehicle: str | Path) -> Options:
    """Return the options for all logs; invalid options are refused before the work begins."""
    from quadid_logs.fleets.options import Options
    from quadid_logs.vehicle_file import read_vehicle

    described = Path(vehicle) if vehicle else None
    options = Options(
        structure=structure,
        band_hz=band,
        vehicle=read_vehicle(described) if described else None,
        vehicle_file=described.read_text(encoding="utf-8") if described else "",
    )
    _ = options.settings
    return options
