"""The stages of the analysis in order, from a log file to its result."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from quadid_logs.align import check_part, cut
from quadid_logs.align.pool import copies, pool
from quadid_logs.align.repeats import with_common_commands
from quadid_logs.autopilots import named
from quadid_logs.control.closed_loop import LoopPart, close_loop
from quadid_logs.control.findings import find_in_loop
from quadid_logs.control.outer_findings import find_in_outer
from quadid_logs.control.outer_loops import outer_loops
from quadid_logs.control.replay import replay, thinned_from
from quadid_logs.data.closed_loop import ClosedLoop
from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.data.flight import FlightData, flown_parameters
from quadid_logs.data.health import Health
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.outer_loops import OuterLoops
from quadid_logs.data.result import PooledLog, Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose import diagnose, with_findings
from quadid_logs.health import health_of
from quadid_logs.identify import identify
from quadid_logs.identify.select import most_excited
from quadid_logs.identify.structures import STRUCTURES, Structure
from quadid_logs.identify.two_vehicles import with_lost_thrust
from quadid_logs.load import prepare, read_log

Progress = Callable[[str], None]


def analyze(
    logs: str | Path | FlightLog | Sequence[str | Path | FlightLog],
    settings: Settings | None = None,
    *,
    vehicle: Vehicle | None = None,
    structure: Structure | None = None,
    published: bool = True,
    progress: Progress | None = None,
) -> Result:
    """Run every stage; `quadid_logs.analyze` and `quadid_logs.analyze_pooled` wrap this function.

    Parameters
    ----------
    logs : str, Path, FlightLog or sequence of these
        A file, or a log in memory; of several of one vehicle, one model is identified. Tables are not
        accepted here.
    settings : Settings, optional
        ``start_s`` and ``end_s`` apply to the clock of each log.
    vehicle : Vehicle, optional
        Known properties of the vehicle. They take precedence over the logs' parameters.
    structure : Structure, optional
        An own structure, fitted in addition to those of the package, and recommended.
    published : bool
        Whether to fit the published structures too. No verdict depends on them.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Result
        A plain result without the methods of an `Analysis`.

    Raises
    ------
    LogError
        If one of the files cannot be read as a flight log at all.
    SettingsError
        If the selected part holds no flight, the structure is unknown, or the logs' torques are not the same
        quantity.
    """
    paths = [logs] if isinstance(logs, str | Path | FlightLog) else logs
    settings = settings or Settings()
    tell = progress or (lambda _stage: None)
    clock = _Clock()
    tell("read")
    read = [
        path if isinstance(path, FlightLog) else read_log(path, system=settings.system, number=settings.log)
        for path in paths
    ]
    clock.lap("read")
    tell("align")
    prepared = [prepare(log, vehicle) for log in read]
    check_part(prepared, settings.align)
    flights = [cut(each, settings.align) for each in prepared]
    # Where their rates differ, all at the slowest of them.
    slowest_s = max((each.sample_period_s for each in flights if each.segments), default=float("nan"))
    slowest = replace(settings.align, sample_rate_hz=1.0 / slowest_s) if slowest_s > 0.0 else settings.align
    flights = [
        cut(log, slowest) if each.segments and each.sample_period_s != slowest_s else each
        for log, each in zip(prepared, flights, strict=True)
    ]
    same = copies(flights)
    flights = [replace(each, segments=()) if place in same else each for place, each in enumerate(flights)]
    flights = with_common_commands(flights)
    data = flights[0] if len(flights) == 1 or not any(each.segments for each in flights) else pool(flights)
    # Data that are not pooled (sources, airframe, texts) come from the first log with a flight.
    flown = (number for number, each in enumerate(flights) if each.segments)
    first = next(flown, 0)
    log = prepared[first].log
    clock.lap("align")
    health = health_of(prepared[first], flights[first])
    clock.lap("health")
    # All sources of all signals are as large as the log, and only the aligned data are needed from here on.
    del prepared
    tell("identify")
    pooled = tuple(
        PooledLog(path=one.path, used_s=each.used_s, same_as=read[same[place]].path if place in same else "")
        for place, (one, each) in enumerate(zip(read, flights, strict=True))
    )
    pooled = pooled if len(paths) > 1 else ()
    return judge(
        log,
        data,
        settings,
        vehicle=vehicle,
        structure=structure,
        published=published,
        pooled=pooled,
        health=health,
        timings_s=clock.timings_s,
    )


def judge(
    log: FlightLog,
    data: FlightData,
    settings: Settings,
    *,
    vehicle: Vehicle | None,
    structure: Structure | None = None,
    published: bool = True,
    pooled: tuple[PooledLog, ...] = (),
    health: Health | None = None,
    timings_s: Mapping[str, float],
    loop: LoopPart = "whole",
) -> Result:
    """Identify and diagnose aligned data: the last stages of every analysis.

    Parameters
    ----------
    log : FlightLog
        The log, or the first log with a flight of several.
    data : FlightData
        Aligned data.
    settings : Settings
    vehicle : Vehicle or None
        Known properties of the vehicle.
    structure : Structure, optional
        An own structure, fitted in addition to those of the package, and recommended.
    published : bool
        Whether to fit the published structures too. No verdict depends on them; only a page or a file with
        all models needs them.
    pooled : tuple of PooledLog
        The logs of a pooled analysis.
    health : Health, optional
        Checks of the flight.
    timings_s : mapping of str to float
        Times of the earlier stages [s].
    loop : {"whole", "verdict"}
        With "verdict", the result has no margins and no findings about them.

    Returns
    -------
    Result
    """
    began = time.perf_counter()
    wanted = (
        one for one in STRUCTURES if published or one.actuated or one.name == settings.identify.structure
    )
    structures = (*wanted, *(() if structure is None else (structure,)))
    identification = identify(
        data, settings.identify, structures, recommended=structure.name if structure else ""
    )
    # The rotors may differ between logs; only those of the first log are known.
    rotors = None if health is None or pooled else health.rotors
    identification = with_lost_thrust(identification, rotors)
    diagnosis = diagnose(log, data, identification, pooled, vehicle, rotors)
    identified = time.perf_counter()
    # Several logs may have different controllers.
    closed_loop = None if pooled else _closed_loop(log, data, identification, diagnosis, settings, loop)
    if closed_loop is not None:
        outer = find_in_outer(closed_loop.outer, log.position_control)
        later = [*find_in_loop(closed_loop), *outer]
        diagnosis = with_findings(diagnosis, later, log.autopilot, log.version)
    timings = {**timings_s, "identify": identified - began, "control": time.perf_counter() - identified}
    return Result(
        log=log,
        data=data,
        identification=identification,
        diagnosis=diagnosis,
        closed_loop=closed_loop,
        health=health,
        settings=settings,
        vehicle=vehicle,
        pooled=pooled,
        timings_s={**timings, "total": sum(timings.values())},
    )


def _closed_loop(
    log: FlightLog,
    data: FlightData,
    identification: Identification,
    diagnosis: Diagnosis,
    settings: Settings,
    wanted: LoopPart = "whole",
) -> ClosedLoop | None:
    """Close the loop of the identified model; None without a known controller or a model."""
    model = identification.recommended
    autopilot = named(log.autopilot)
    controllers = None if model is None else autopilot.controllers(log, flown_parameters(log, data))
    if model is None or controllers is None:
        return None
    # The rows to replay are on the log's own clock, which is the clock of the flights unless it was reset.
    rows = {} if data.clock_resets else autopilot.replay_inputs(log, controllers, data.flight_segments)
    replays = replay(controllers, rows, log.parameter_changes)
    period_s = thinned_from(replays)
    if period_s is not None:
        controllers = (
            autopilot.controllers(log, flown_parameters(log, data), period_s=period_s) or controllers
        )
    trusted = [axis for axis, verdict in diagnosis.axes.items() if verdict.verdict != "refused"]
    fitted = most_excited(data, settings.identify.most_samples)
    low_hz = model.band.low_hz[0] if model.band is not None else settings.identify.high_pass_hz
    closed = close_loop(
        fitted, model, controllers, replays, trusted=trusted, low_hz=float(low_hz), wanted=wanted
    )
    return closed if wanted == "verdict" else replace(closed, outer=_outer_loops(log, data, closed))


def _outer_loops(log: FlightLog, data: FlightData, closed: ClosedLoop) -> OuterLoops | None:
    """Replay and close the loops around the rate loops; None if their controllers are not known."""
    autopilot, parameters = named(log.autopilot), flown_parameters(log, data)
    controllers = autopilot.outer_controllers(parameters)
    if controllers is None or data.clock_resets:
        return None
    flights = data.flight_segments
    return outer_loops(
        controllers,
        closed,
        autopilot.attitude_rows(log, parameters, flights),
        autopilot.shaper_rows(log, parameters, flights),
        log.position_control,
        flights,
    )


class _Clock:
    """Time by stage [s]."""

    def __init__(self) -> None:
        self.timings_s: dict[str, float] = {}
        self._mark = time.perf_counter()

    def lap(self, stage: str) -> None:
        """End a stage."""
        now = time.perf_counter()
        self.timings_s[stage] = now - self._mark
        self._mark = now
