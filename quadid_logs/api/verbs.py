"""The verbs for Python. Each takes a path, a log or a table in memory, or a result of `analyze`."""

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
    """Recommend the gains of the next flight, or give the reasons for refusing.

    Parameters
    ----------
    log : str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        A flight with the current gains, in any form that `analyze` accepts.
    limits : Limits
        Smallest margins. Each promised margin meets its limit with 97.5 % confidence.
    apart : bool
        True changes P, I, D and the angle gain separately where that rejects gusts better. False changes P, I
        and D by one common factor.
    filters : bool
        Experimental: change filters and notches with the gains if that reduces gust response or noise. Has no
        effect without ``apart``.
    ranges : Ranges
        Factors on mass, air density and propeller diameter. The limits are met over these ranges too, as far
        as the flown gains meet them or any gains can.
    earlier : sequence of str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        Earlier flights of the same vehicle, with any gains. They narrow the intervals.
    settings : Settings, optional
    vehicle : Vehicle, optional
        Known properties of the vehicle. They take precedence over the log's parameters.
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
        If the selected part of the log holds no flight, or settings are given with a result. Also if a range
        does not contain 1, or an earlier log is of another vehicle.

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
    """Test whether control effectiveness, damping, lag or delay changed between two flights.

    Parameters
    ----------
    before, after : str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        Two flights, in any form that `analyze` accepts.
    settings : Settings, optional
        Settings for the flights that are not yet analyzed.
    vehicle : Vehicle, optional
        Known properties of the vehicle, for the same flights.

    Returns
    -------
    Comparison
        `quadid_logs.comparison.compare` describes the test.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log at all.
    SettingsError
        If the selected part of a log holds no flight.

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
    """Test whether several flights of one vehicle agree, and find outliers.

    Parameters
    ----------
    logs : sequence
        Two or more flights, in any form that `analyze` accepts. A flight that is given twice counts once.
    settings : Settings, optional
        Settings for the flights that are not yet analyzed.
    vehicle : Vehicle, optional
        Known properties of the vehicle, for the same flights.

    Returns
    -------
    Repeatability
        `quadid_logs.repetition.repeat` describes the tests.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log at all.
    SettingsError
        If there are fewer than two flights, or their torques are not the same quantity.

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
    """Check a flight against the margins that `tune` promised: keep the gains, continue, or go back.

    Parameters
    ----------
    log : str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        The flight with the recommended gains, in any form that `analyze` accepts.
    promised : Promise, str, Path or any flight
        The promise, the path of a ``promise.json`` or of its folder; or the previous flight, which is then
        tuned with the default limits.
    settings : Settings, optional
        Settings for the flights that are not yet analyzed.
    vehicle : Vehicle, optional
        Known properties of the vehicle, for the same flights.

    Returns
    -------
    Check
        ``outcome`` says whether the promise was kept, ``decision`` what to do with the gains.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log at all.
    PromiseFileError
        If the promise cannot be read.
    SettingsError
        If the previous flight gives no promise because all its axes are refused.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.check("next.bin", "quadid-tune/flight").outcome.value  # doctest: +SKIP
    'kept'
    >>> quadid_logs.check("sample_logs/damaged.bin", "sample_logs/default-logging.bin")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    quadid_logs.errors.SettingsError: The earlier flight has no promise to check. ...
    """
    # A promise, that of a file, or what a flight promises of the next one.
    if isinstance(promised, Promise):
        held = promised
    elif isinstance(promised, str | Path) and (
        Path(promised).is_dir() or Path(promised).suffix.lower() == ".json"
    ):
        held = read_promise(Path(promised))
    else:
        before = _analyzed(promised, settings, vehicle)
        found = promise.promise_of(
            before, tuning.tuning_of(before), provenance_of(before.log.path).log_sha256
        )
        if found is None:
            raise SettingsError(
                "The earlier flight has no promise to check.", hint="See what tune(...) says about it."
            )
        held = found
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
    """Plan a flight that identifies the model: the parameters to set and the manoeuvres to fly.

    Parameters
    ----------
    autopilot : str, Path, FlightLog, Simulation or Result
        The autopilot's name, or a flight of the vehicle. For a flight the plan keeps what the vehicle logs
        already, and designs the excitation for its firmware, model, loop and air.
    axes : sequence of str
        Axes to excite: roll, pitch, yaw. Empty means all.
    firmware : str
        Firmware version, such as "4.5". "" takes that of the flight, or a recent version.
    propeller_inch : float
        Propeller diameter [inch], if no flight is given. It sets the size of the vehicle.
    air : str
        "calm", "breeze" or "wind". "" takes the air of the flight, or a breeze.
    wanted : float
        Half width of the 95 % interval of the control effectiveness that the plan is designed for, as a
        fraction of the effectiveness.
    settings : Settings, optional
        Settings for a flight that is not yet analyzed.
    vehicle : Vehicle, optional
        Known properties of the vehicle, for values that no flight provides.

    Returns
    -------
    Plan
        `Plan.steps` lists what to fly, `Plan.predict` flies the plan in the simulator.

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all.
    SettingsError
        If the autopilot or an axis is unknown, or the version is not valid.

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
        Two or more flights with one sample period.
    steps : sequence of int
        Prediction horizons in samples.
    sets : sequence of str, optional
        Name of the set that each flight belongs to, for cross-validation. Put flights that repeat one
        trajectory into one set. The default is one set for each flight.
    memory_s : float
        Length of the past before the start of a horizon that the predictor uses [s].
    settings : Settings, optional
    vehicle : Vehicle, optional
        Known properties of the vehicle. They take precedence over the logs' parameters.

    Returns
    -------
    RatePredictor
        ``predict`` takes the ``data`` of another flight.

    Raises
    ------
    LogError
        If a file cannot be read as a flight log, or holds too little flight.
    SettingsError
        If there are fewer than two sets, or the sample periods differ.

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
    """Return whether a text names an autopilot: it has no file ending, and no such file exists."""
    path = Path(text)
    return text.lower() in {each.name for each in known()} or not (path.suffix or path.exists())


def _analyzed(log: LogLike | Result, settings: Settings | None, vehicle: Vehicle | None) -> Result:
    """Return a result unchanged; analyze anything else."""
    return log if isinstance(log, Result) else analyze(log, settings, vehicle=vehicle)
