"""One file -> one `Result` per flight: a vehicle's history is counted in flights, not in files."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path

from quadid_logs.align import cut
from quadid_logs.control.closed_loop import LoopPart
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import SeveralLogsError
from quadid_logs.health import faults_of
from quadid_logs.load import load
from quadid_logs.pipeline import judge

#: A battery lasts for one flight, and a day some twenty; more in one file is damage
#: or hops on the ground, which together are one model.
MOST_FLIGHTS = 32


def analyze_flights(
    path: Path,
    settings: Settings,
    vehicle: Vehicle | None,
    loop: LoopPart = "whole",
    *,
    published: bool = True,
) -> Iterator[Result]:
    """Read each log of a file once and analyze each of its flights alone.

    Parameters
    ----------
    settings : Settings
        Its start and end are replaced by those of each flight.
    vehicle : Vehicle or None
        What is known of mass, arms and thrust.
    loop : {"whole", "verdict"}
    published : bool
        As of `judge`.

    Yields
    ------
    Result
        One per flight, or one for a whole log where it holds none, or more
        than `MOST_FLIGHTS`; in the order of the file. ``settings.log`` tells the
        logs of a file apart.

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all.
    """
    began = time.perf_counter()
    try:
        prepared = load(path, settings, vehicle)
    except SeveralLogsError as several:
        for number in several.durations_s:
            one = dataclasses.replace(settings, log=number)
            yield from analyze_flights(path, one, vehicle, loop, published=published)
        return
    read_s = time.perf_counter() - began
    flights = prepared.flights
    parts = [settings]
    if 2 <= len(flights) <= MOST_FLIGHTS:
        parts = [
            dataclasses.replace(
                settings, align=dataclasses.replace(settings.align, start_s=start_s, end_s=end_s)
            )
            for start_s, end_s in flights
        ]
    for part in parts:
        began = time.perf_counter()
        data = cut(prepared, part.align)
        timings_s = {"read": read_s / len(parts), "align": time.perf_counter() - began}
        health = faults_of(prepared, data)
        yield judge(
            prepared.log,
            data,
            part,
            vehicle=vehicle,
            published=published,
            health=health,
            timings_s=timings_s,
            loop=loop,
        )
