"""One log -> one `Result` per flight: a vehicle's life is counted in flights, not in files."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path

from quadid_logs.align import align
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose import diagnose
from quadid_logs.identify import identify
from quadid_logs.readers import read_log
from quadid_logs.vehicle import reconstruct

#: A battery lasts for one flight, and a day of flying holds some twenty; more in one file is damage
#: or hops on the ground, which together are one model.
MOST_FLIGHTS = 32


def analyze_flights(path: Path, settings: Settings, vehicle: Vehicle | None) -> Iterator[Result]:
    """Read a log once and analyze each of its flights alone.

    Yields
    ------
    Result
        One per flight, or one for the whole log where it holds none, or more
        than `MOST_FLIGHTS`.

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all.
    """
    began = time.perf_counter()
    log = reconstruct(read_log(path), vehicle)
    whole = align(log, settings)
    read_s = time.perf_counter() - began
    if not 2 <= len(whole.flights) <= MOST_FLIGHTS:
        yield _judged(log, whole, settings, vehicle, read_s)
        return
    for start_s, end_s in whole.flights:
        here = dataclasses.replace(settings, start_s=start_s, end_s=end_s)
        yield _judged(log, align(log, here), here, vehicle, read_s / len(whole.flights))


def _judged(
    log: FlightLog, data: FlightData, settings: Settings, vehicle: Vehicle | None, read_s: float
) -> Result:
    """Identify and diagnose."""
    began = time.perf_counter()
    identification = identify(data, settings)
    diagnosis = diagnose(log, data, identification, settings)
    identify_s = time.perf_counter() - began
    return Result(
        log=log,
        data=data,
        identification=identification,
        diagnosis=diagnosis,
        settings=settings,
        vehicle=vehicle,
        timings_s={"read": read_s, "identify": identify_s, "total": read_s + identify_s},
    )
