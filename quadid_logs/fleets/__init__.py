"""Many logs of many vehicles: analyze them on one machine or many, and see how each vehicle ages.

::

    log_files  ->  work (in processes of the workers)  ->  store  ->  history  ->  changes  ->  page
                     ^ engine hands them out                  sql asks anything else

Needs ``quadid-logs[fleet]``; nothing else of the package does.
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
    """Analyze many logs, one row per log, flight and axis, on this machine's cores or on a cluster.

    Parameters
    ----------
    logs : str, Path, FlightLog or Result, or a sequence of these
        Files, folders, patterns, URLs; a log or a result stands for the file that it was read from. An empty
        sequence opens a store that exists.
    store : str or Path
        Folder of the store.
    structure : str
        Of all models: others do not compare.
    band : (low, high), optional
        Fit every log from low to high [Hz]; without it each log decides.
    vehicle : str or Path
        Vehicle file with mass, arms and thrust of all vehicles, "" without.
    workers : int
        Local processes; 0 takes one per core.
    scheduler : str
        Address of a Dask scheduler, "" for local processes.
    resume : bool
        Go on with a store that exists: skip what it holds, try lost logs again.

    Returns
    -------
    StoredFleet
        What the store holds.

    Raises
    ------
    OutputError, SettingsError
        If the store cannot be written, or was made otherwise; if the scheduler does not answer or a library
        is missing; if a log or a table was read from no file.

    Notes
    -----
    Local workers import the script that calls this, as those of `multiprocessing` do: in a script, call it
    below ``if __name__ == "__main__":``, or each worker runs all of the script again.

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

    # A table is one log, and iterates over its columns.
    several = isinstance(logs, Iterable) and not isinstance(logs, str) and not hasattr(logs, "keys")
    places = [_place(each) for each in (logs if several else [logs])]  # type: ignore[union-attr]
    if places:
        options, files = _options(structure, band, vehicle), find_logs(places)
        run_fleet(files, Path(store), options, Cluster(scheduler=scheduler, workers=workers), resume=resume)
    return StoredFleet(Path(store))


def _place(log: object) -> str:
    """Return what names a log: its workers, which may be on other machines, read it by themselves."""
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
    """Return what holds for every log; what makes no sense is refused before the work."""
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
