"""The verbs for Python: each takes a path, a log or a table in memory, or a result of `analyze`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from quadid_logs import comparison, planning, promise, repetition, tuning
from quadid_logs.align import cut
from quadid_logs.api.analysis import LogLike, analyze, as_log
from quadid_logs.autopilots import known
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.off_nominal import OFF_NOMINAL, Ranges, checked
from quadid_logs.data.promise import Check, Promise
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.tuning import GOOD, Limits, Tuning
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.earlier import with_earlier
from quadid_logs.errors import SettingsError
from quadid_logs.identify.horizons import MEMORY_S, STEPS, RatePredictor, fit_predictor
from quadid_logs.load import prepare, read_log
from quadid_logs.pipeline import Progress
from quadid_logs.report.promise_file import read_promise
from quadid_logs.report.provenance import provenance_of


def tune(
    log: LogLike | Result,
    limits: Limits = GOOD,
    *,
    apart: bool = True,
    filters: bool = False,
    ranges: Ranges = OFF_NOMINAL,
    earlier: Sequence[LogLike | Result] = (),
    settings: Settings | None = None,
    vehicle: Vehicle | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Recommend the gains of the next flight, or say why not.

    Parameters
    ----------
    log : str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        A flight with the gains that are set now, as `analyze` takes it.
    limits : Limits
        Every promised margin keeps these with 97.5 % confidence.
    apart : bool
        P, I, D and the angle gain each by itself where that rejects gusts better, not by one factor on P, I
        and D alone.
    filters : bool
        Experimental: filters and notches are changed with the gains, where that leaves less of gusts or less
        noise; not without ``apart``.
    ranges : Ranges
        Factors on mass, air density and propeller over which the limits are kept as well, as far as the flown
        gains do or any gains can.
    earlier : sequence of str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        Flights of the same vehicle with other gains, or the same: they narrow what is known of it.
    settings : Settings, optional
    vehicle : Vehicle, optional
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Tuning

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all.
    SettingsError
        If the part of the log that was chosen holds no flight, settings are given with a result, a range
        does not hold what flew, or an earlier log is of another vehicle.

    Examples
    --------
    >>> from quadid_logs import tune
    >>> tune("sample_logs/default-logging.bin")
    <Tuning: gain margin 6 dB, phase margin 45 deg
      roll   refused  QL615 QL613
      pitch  refused  QL615 QL613
      yaw    refused  QL613>
    """
    result: Result = analyze(log, settings, vehicle=vehicle, progress=progress)
    if earlier:
        result = with_earlier(result, [analyze(one, vehicle=vehicle, progress=progress) for one in earlier])
    if progress is not None:
        progress("tune")
    if limits == GOOD and apart and not filters and checked(ranges) == OFF_NOMINAL:
        return tuning.tuning_of(result)
    return tuning.recommend(result, limits, apart=apart, filters=filters, ranges=ranges)


def compare(
    before: LogLike | Result,
    after: LogLike | Result,
    settings: Settings | None = None,
    *,
    vehicle: Vehicle | None = None,
) -> comparison.Comparison:
    """Tell whether B, A or the lag changed by more than the two flights leave open.

    Parameters
    ----------
    before, after : str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        Two flights, each as `analyze` takes it.
    settings : Settings, optional
        Of the flights that are not results yet.
    vehicle : Vehicle, optional
        Of the same flights.

    Returns
    -------
    Comparison
        `quadid_logs.comparison.compare` says how it decides.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log at all.
    SettingsError
        If the part of a log that was chosen holds no flight.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.compare("sample_logs/sysid-quad-x.bin", "sample_logs/sysid-quad-x.bin").verdict
    'same'
    """
    first, second = (_analyzed(log, settings, vehicle) for log in (before, after))
    return comparison.compare(first, second)


def repeat(
    logs: Sequence[LogLike | Result],
    settings: Settings | None = None,
    *,
    vehicle: Vehicle | None = None,
) -> repetition.Repeatability:
    """Tell whether several flights of one vehicle agree, and which is the outlier.

    Parameters
    ----------
    logs : sequence
        Two or more, each as `analyze` takes it, or a result. A flight that is given twice counts once.
    settings : Settings, optional
        Of the flights that are not results yet.
    vehicle : Vehicle, optional
        Of the same flights.

    Returns
    -------
    Repeatability
        `quadid_logs.repetition.repeat` says how it decides.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log at all.
    SettingsError
        If there are fewer than two flights, or their torque is not the same quantity.

    Examples
    --------
    >>> import quadid_logs
    >>> r = quadid_logs.analyze("sample_logs/sysid-quad-x.bin")
    >>> quadid_logs.repeat([r, r]).verdict
    'not comparable'
    """
    return repetition.repeat([_analyzed(log, settings, vehicle) for log in logs])


def check(
    log: LogLike | Result,
    promised: Promise | LogLike | Result,
    settings: Settings | None = None,
    *,
    vehicle: Vehicle | None = None,
) -> Check:
    """Tell whether a flight kept what `tune` promised of it: keep the gains, go on, or go back.

    Parameters
    ----------
    log : str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        The flight with the recommended gains, as `analyze` takes it.
    promised : Promise, str, Path or any flight
        Path of a ``promise.json`` or of the folder that holds it; or the flight before, which is tuned with
        the default limits.
    settings : Settings, optional
        Of the flights that are not results yet.
    vehicle : Vehicle, optional
        Of the same flights.

    Returns
    -------
    Check
        Its ``outcome`` says whether the promise was kept, its ``decision`` what to do.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log at all.
    PromiseFileError
        If the promise cannot be read.
    SettingsError
        If the flight before promises nothing, as every axis of it is refused.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.check("next.bin", "quadid-tune/flight").outcome.value  # doctest: +SKIP
    'kept'
    >>> quadid_logs.check("sample_logs/damaged.bin", "sample_logs/default-logging.bin")
    Traceback (most recent call last):
        ...
    quadid_logs.errors.SettingsError: The flight before promises nothing. See what tune(...) says of it.
    """
    held = _promise(promised, settings, vehicle)
    after = _analyzed(log, settings, vehicle)
    return promise.check(held, after, provenance_of(after.log.path).log_sha256)


def plan(
    autopilot: LogLike | Result,
    axes: Sequence[str] = (),
    *,
    firmware: str = "",
    propeller_inch: float = planning.PROPELLER_INCH,
    air: str = "",
    wanted: float = planning.WANTED,
    settings: Settings | None = None,
    vehicle: Vehicle | None = None,
) -> planning.Plan:
    """Plan a flight that will give an answer: what to set, and what to fly.

    Parameters
    ----------
    autopilot : str, Path, FlightLog, Simulation or Result
        The autopilot's name; or a flight of the vehicle: then what it logs already is kept, for its
        firmware, and excitation is made for its model, its loop and its air.
    axes : sequence of str
        Of roll, pitch, yaw; empty means all.
    firmware : str
        Its version, as "4.5"; "" for that of the flight, or a recent one.
    propeller_inch : float
        How large the vehicle is, where no flight tells.
    air : str
        "calm", "breeze" or "wind"; "" for that of the flight, or a breeze.
    wanted : float
        Half the 95 % interval of the control effectiveness, over the effectiveness.
    settings : Settings, optional
        Of a flight that is not a result yet.
    vehicle : Vehicle, optional
        What is known of it, which the plan is made for where no flight tells.

    Returns
    -------
    Plan
        Its `Plan.steps` say what to fly, its `Plan.predict` flies it in the simulator.

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all.
    SettingsError
        If there is no such autopilot or axis, or the version is none.

    Examples
    --------
    >>> import quadid_logs
    >>> planned = quadid_logs.plan("sample_logs/sysid-quad-x.bin", ["roll"])
    >>> planned.axes
    ('roll',)
    """
    version = planning.parse_version(firmware) if firmware else None
    if isinstance(autopilot, str) and _is_name(autopilot):
        return planning.make_plan(
            autopilot.lower(),
            axes,
            version,
            vehicle=vehicle,
            propeller_inch=propeller_inch,
            air=air,
            wanted=wanted,
        )
    known = _analyzed(autopilot, settings, vehicle)
    log = known.log
    return planning.make_plan(
        log.autopilot,
        axes,
        version or log.version,
        log.parameters,
        known=known,
        vehicle=vehicle,
        propeller_inch=propeller_inch,
        air=air,
        wanted=wanted,
    )


def predictor(
    flights: Sequence[LogLike | Result],
    steps: Sequence[int] = STEPS,
    *,
    sets: Sequence[str] | None = None,
    memory_s: float = MEMORY_S,
    settings: Settings | None = None,
    vehicle: Vehicle | None = None,
) -> RatePredictor:
    """Fit a predictor of the body rates some steps ahead to flights of one vehicle.

    Parameters
    ----------
    flights : sequence of str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        Two or more, on one period.
    steps : sequence of int
        Horizons in samples.
    sets : sequence of str, optional
        The set that each flight is of; flights that repeat one trajectory belong into one. Without it each
        flight is its own.
    memory_s : float
        How much before a horizon it is told of [s].
    settings : Settings, optional
    vehicle : Vehicle, optional

    Returns
    -------
    RatePredictor
        Its ``predict`` takes the ``data`` of another flight.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log, or holds too little flight.
    SettingsError
        If there are fewer than two sets, or the flights are on different clocks.

    Examples
    --------
    >>> import quadid_logs
    >>> logs = ["sample_logs/sysid-quad-x.bin", "sample_logs/damaged.bin"]
    >>> ahead = quadid_logs.predictor(logs, steps=(10,))
    >>> (held,) = ahead.predict(quadid_logs.analyze("sample_logs/sysid-quad-x.bin").data)
    >>> held.error_rad_s < held.kept_error_rad_s
    True
    """
    return fit_predictor(
        [_data_of(each, settings, vehicle) for each in flights], steps, sets, memory_s=memory_s
    )


def _data_of(log: LogLike | Result, settings: Settings | None, vehicle: Vehicle | None) -> FlightData:
    """Return the aligned series of a log, without analyzing it."""
    if isinstance(log, Result):
        return log.data
    wanted = settings or Settings()
    found = as_log(log)
    if not isinstance(found, FlightLog):
        found = read_log(found, system=wanted.system, number=wanted.log)
    return cut(prepare(found, vehicle), wanted.align)


def _is_name(text: str) -> bool:
    """Return whether a text names an autopilot; the name of a log has an ending, or there is such a file."""
    path = Path(text)
    return text.lower() in {each.name for each in known()} or not (path.suffix or path.exists())


def _analyzed(log: LogLike | Result, settings: Settings | None, vehicle: Vehicle | None) -> Result:
    """Return a result as it is, and anything else analyzed."""
    return log if isinstance(log, Result) else analyze(log, settings, vehicle=vehicle)


def _promise(
    promised: Promise | LogLike | Result, settings: Settings | None, vehicle: Vehicle | None
) -> Promise:
    """Return a promise, that of a file, or what a flight promises of the next one."""
    if isinstance(promised, Promise):
        return promised
    if isinstance(promised, str | Path) and (
        Path(promised).is_dir() or Path(promised).suffix.lower() == ".json"
    ):
        return read_promise(Path(promised))
    before = _analyzed(promised, settings, vehicle)
    found = promise.promise_of(before, tuning.tuning_of(before), provenance_of(before.log.path).log_sha256)
    if found is None:
        raise SettingsError(
            "The earlier flight has no promise to check.", hint="See what tune(...) says about it."
        )
    return found
