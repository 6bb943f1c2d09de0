"""The stages in order: a log file in, everything found out about it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from quadid_logs.align import align
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose import diagnose
from quadid_logs.identify import identify
from quadid_logs.readers import read_log
from quadid_logs.vehicle import reconstruct

Progress = Callable[[str], None]


def analyze(
    path: str | Path,
    settings: Settings | None = None,
    *,
    vehicle: Vehicle | None = None,
    progress: Progress | None = None,
) -> Result:
    """Read, rebuild the torque, align, identify and judge one log.

    Parameters
    ----------
    path : str or Path
        The log, of any supported format.
    settings : Settings, optional
    vehicle : Vehicle, optional
        What the user knows about the vehicle.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Result

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all.
    """
    settings = settings or Settings()
    tell = progress or (lambda _stage: None)
    timings: dict[str, float] = {}
    began = time.perf_counter()

    def clocked(stage: str, since: float) -> float:
        now = time.perf_counter()
        timings[stage] = now - since
        return now

    tell("read")
    log = read_log(path, system=settings.system)
    mark = clocked("read", began)
    tell("torque")
    log = reconstruct(log, vehicle)
    mark = clocked("torque", mark)
    tell("align")
    data = align(log, settings)
    mark = clocked("align", mark)
    tell("identify")
    identification = identify(data, settings)
    diagnosis = diagnose(log, data, identification, settings)
    clocked("identify", mark)
    clocked("total", began)
    return Result(
        log=log,
        data=data,
        identification=identification,
        diagnosis=diagnosis,
        settings=settings,
        vehicle=vehicle,
        timings_s=timings,
    )
