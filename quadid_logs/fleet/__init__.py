"""Many logs of many vehicles: analyze them on one machine or many, and see how each vehicle ages.

::

    log_files  ->  work (in processes of the workers)  ->  store  ->  history  ->  changes  ->  page
                     ^ engine hands them out                  sql asks anything else

Needs ``quadid-logs[fleet]``; nothing else of the package does.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from quadid_logs.callable_module import call_as

if TYPE_CHECKING:
    from quadid_logs.fleet.options import Options
    from quadid_logs.fleet.stored import StoredFleet


def fleet(
    logs: Sequence[str | Path],
    store: str | Path,
    *,
    structure: str = "damped",
    vehicle: str | Path = "",
    workers: int = 0,
    scheduler: str = "",
    resume: bool = False,
) -> StoredFleet:
    """Analyze many logs, one row per log, flight and axis, on this machine's cores or on a cluster.

    Parameters
    ----------
    logs : sequence of str or Path
        Files, folders, patterns, URLs; none to open a store that exists.
    store : str or Path
        Folder of the store.
    structure : str
        Of all models: others do not compare.
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

    Raises
    ------
    OutputError, SettingsError
        If the store cannot be written, or was made otherwise; if the scheduler does not answer or a library
        is missing.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.fleet(["flights"], "store").counts  # doctest: +SKIP
    {'analyzed': 12, 'unreadable': 1}
    >>> store = quadid_logs.fleet([], "store")  # one that exists
    """
    from quadid_logs.fleet.engine import Cluster
    from quadid_logs.fleet.log_files import find_logs
    from quadid_logs.fleet.run import run_fleet
    from quadid_logs.fleet.stored import StoredFleet

    if logs:
        options, files = _options(structure, vehicle), find_logs([str(place) for place in logs])
        run_fleet(files, Path(store), options, Cluster(scheduler=scheduler, workers=workers), resume=resume)
    return StoredFleet(Path(store))


def _options(structure: str, vehicle: str | Path) -> Options:
    """Return what holds for every log; a structure that there is none of is refused before the work."""
    from quadid_logs.fleet.options import Options
    from quadid_logs.vehicle_file import read_vehicle

    described = Path(vehicle) if vehicle else None
    options = Options(
        structure=structure,
        vehicle=read_vehicle(described) if described else None,
        vehicle_file=described.read_text(encoding="utf-8") if described else "",
    )
    _ = options.settings
    return options


call_as(__name__, fleet)
