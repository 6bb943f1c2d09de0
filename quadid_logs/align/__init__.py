"""FlightLog -> FlightData: one clock, one period, gaps kept as gaps, flights found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from quadid_logs.align.clock import Clock, find_clock
from quadid_logs.align.flights import Flights, Interval, find_flights
from quadid_logs.align.gyro import check_gyro
from quadid_logs.align.series import Cleaner, CleanSeries
from quadid_logs.align.sources import choose_sources, describe
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import FlightData, InputDescription, Overview, Segment
from quadid_logs.data.log import NO_GYRO_FILTER, FlightLog, LogText, ModeChange, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.data.torque import Calibration
from quadid_logs.maths.resampling import resample, resample_held
from quadid_logs.maths.rotations import unwrapped
from quadid_logs.vocabulary import MULTIROTOR, SIGNALS

__all__ = ["Prepared", "align", "cut", "prepare"]

#: No rate loop of a multirotor runs slower than this [Hz]; a log that is as
#: fast holds every output.
_LOOP_RATE_HZ = 200.0
#: The next slower log holds half the steps of the loop; uneven stamps are far from making that of it.
_EVERY_STEP = 0.9


class Prepared(NamedTuple):
    """A log on one clock, not yet resampled: by signal the cleaned sources and the chosen one."""

    log: FlightLog
    clock: Clock
    candidates: Mapping[str, Sequence[CleanSeries]]
    series: Mapping[str, CleanSeries]
    torque: CleanSeries | None
    flights: Flights


def align(log: FlightLog, settings: AlignSettings) -> FlightData:
    """Bring the log's signals onto one clock and a fixed period.

    Parameters
    ----------
    log : FlightLog
        As a reader returns it.
    settings : AlignSettings
        ``sample_rate_hz``, ``start_s``, ``end_s`` and the thresholds on gaps and clocks.

    Returns
    -------
    FlightData
        Without segments where the log lacks time, torque, rates or flight;
        what was found is described all the same.
    """
    return cut(prepare(log, settings), settings)


def prepare(log: FlightLog, settings: AlignSettings) -> Prepared:
    """Bring the log's signals onto one clock and find its flights: the same for every part of the log.

    Parameters
    ----------
    log : FlightLog
    settings : AlignSettings
        The thresholds on clocks and stamps.
    """
    clock = find_clock(_signals_with_time(log), settings)
    cleaner = Cleaner(clock, settings)
    candidates = {
        name: [cleaner.clean(signal) for signal in log.candidates(name)]
        for name in (log.signals if log.has_time else ())
    }
    series = choose_sources(candidates)
    torque = series.get("torque_n_m") or series.get("torque_command")
    _take_saturation(series, candidates, torque)
    return Prepared(log, clock, candidates, series, torque, find_flights(series, _span(clock)))


def cut(prepared: Prepared, settings: AlignSettings) -> FlightData:
    """Resample what the settings ask for: ``start_s``, ``end_s``, ``sample_rate_hz``.

    Parameters
    ----------
    prepared : Prepared
        From `prepare`, with the same thresholds.
    settings : AlignSettings

    Returns
    -------
    FlightData
        As of `align`.
    """
    log, clock, candidates, series, torque, flights = prepared
    span = _span(clock)
    intervals = _clip(flights.intervals, settings)
    period_s = _period_s(torque, settings)
    segments = _segments(series, torque, intervals, period_s, settings) if _may_be_multirotor(log) else ()
    described = _input(log, torque, segments)
    segments, described = _with_rotor_thrust(log, segments, described)
    return FlightData(
        sample_period_s=period_s,
        segments=segments,
        flights=intervals,
        sources={
            name: describe(chosen, candidates[name], intervals, settings) for name, chosen in series.items()
        },
        input=described,
        start_s=span[0],
        duration_s=span[1] - span[0],
        gyro_filter=series["body_rate"].signal.gyro_filter if "body_rate" in series else NO_GYRO_FILTER,
        clock_resets=clock.n_resets,
        on_ground_reason=flights.reason
        or ("" if intervals else "the chosen part of the log holds no flight"),
        gyro_check=check_gyro(series.get("body_rate"), series.get("attitude"), intervals, settings),
        overview={name: _overview(series[name]) for name in series if SIGNALS[name].columns},
        modes=_on_clock(log.modes, clock),
        texts=_on_clock_texts(log.texts, clock),
    )


def _take_saturation(
    series: dict[str, CleanSeries],
    candidates: Mapping[str, Sequence[CleanSeries]],
    torque: CleanSeries | None,
) -> None:
    """Replace the chosen saturation by that of the torque's own source; drop it where there is none."""
    series.pop("torque_saturation", None)
    source = None if torque is None else torque.signal.source
    own = (one for one in candidates.get("torque_saturation", ()) if one.signal.source == source)
    found = next(own, None)
    if found is not None and found.time_s.size:
        series["torque_saturation"] = found


def _may_be_multirotor(log: FlightLog) -> bool:
    """Of any other vehicle nothing is cut out to identify: the model would not fit it."""
    return log.vehicle_type in (MULTIROTOR, "unknown")


def _signals_with_time(log: FlightLog) -> Iterable[Signal]:
    if not log.has_time:
        return ()
    return [signal for sources in log.signals.values() for signal in sources]


def _span(clock: Clock) -> Interval:
    return float(clock.first_s[0] + clock.shift_s[0]), float(clock.last_s[-1] + clock.shift_s[-1])


def _clip(intervals: Iterable[Interval], settings: AlignSettings) -> tuple[Interval, ...]:
    """Keep what lies inside the part of the log that the user asked for."""
    clipped = [(max(a, settings.start_s), min(b, settings.end_s)) for a, b in intervals]
    return tuple((a, b) for a, b in clipped if b > a)


def _period_s(torque: CleanSeries | None, settings: AlignSettings) -> float:
    """Return the period to resample to: as asked, or that of the torque series, within bounds."""
    if settings.sample_rate_hz:
        return 1.0 / settings.sample_rate_hz
    if torque is None or not torque.period_s > 0.0:
        return float("nan")
    return max(torque.period_s, 1.0 / settings.max_sample_rate_hz)


def _segments(
    series: Mapping[str, CleanSeries],
    torque: CleanSeries | None,
    intervals: tuple[Interval, ...],
    period_s: float,
    settings: AlignSettings,
) -> tuple[Segment, ...]:
    """Resample the needed signals on every gap-free stretch of every flight."""
    rate = series.get("body_rate")
    if torque is None or rate is None or not np.isfinite(period_s):
        return ()
    found = []
    for flight, interval in enumerate(intervals):
        for stretch in _without_gaps(rate, interval, period_s, settings):
            for start_s, end_s in _without_gaps(torque, stretch, period_s, settings):
                if end_s - start_s >= settings.min_segment_s:
                    n_samples = int((end_s - start_s) / period_s + 1e-6) + 1
                    grid = start_s + period_s * np.arange(n_samples, dtype=np.float64)
                    found.append(_segment(series, torque, rate, grid, flight))
    return tuple(found)


def _without_gaps(
    series: CleanSeries, interval: Interval, period_s: float, settings: AlignSettings
) -> list[Interval]:
    """Return the stretches of the interval between samples that follow each other without a gap.

    Faster logging than the grid needs may pause for as long as the grid's own period allows.
    """
    time_s = series.time_s[series.within(*interval)]
    if time_s.size < 2:
        return []
    # A microsecond of slack: stamps are rounded to it.
    longest_s = settings.gap_periods * max(series.period_s, period_s) + 1e-6
    breaks = np.flatnonzero(np.diff(time_s) > longest_s)
    first = np.concatenate([[0], breaks + 1])
    last = np.concatenate([breaks, [time_s.size - 1]])
    return [(float(time_s[a]), float(time_s[b])) for a, b in zip(first, last, strict=True) if b > a]


def _segment(
    series: Mapping[str, CleanSeries], torque: CleanSeries, rate: CleanSeries, grid: FloatArray, flight: int
) -> Segment:
    attitude = series.get("attitude")
    throttle = series.get("throttle")
    return Segment(
        time_s=grid,
        body_rate_rad_s=resample(rate.time_s, rate.values, grid),
        torque=_torque(torque, grid),
        attitude_rad=None if attitude is None else _attitude(attitude, grid),
        throttle=None if throttle is None else resample(throttle.time_s, throttle.values, grid)[:, 0],
        saturated=_saturated(series.get("torque_saturation"), grid),
        reference=_reference(series, grid),
        flight=flight,
    )


def _torque(torque: CleanSeries, grid: FloatArray) -> FloatArray:
    """Return the torque on the grid: held between the outputs of a loop, interpolated if logged slower.

    The motors obey an output until the next one comes, so where every output is
    logged, and comes at uneven times, holding is exact and interpolating is not.
    """
    if torque.rate_hz < _LOOP_RATE_HZ:
        return resample(torque.time_s, torque.values, grid)
    return resample_held(torque.time_s, torque.values, grid)


def _saturated(marks: CleanSeries | None, grid: FloatArray) -> BoolArray:
    """Mark grid points with a saturated sample, of any axis, at most one period away."""
    if marks is None:
        return np.zeros(grid.shape, dtype=bool)
    step = float(grid[1] - grid[0]) if grid.size > 1 else 0.0
    count = np.concatenate([[0], np.cumsum((marks.values > 0.5).any(axis=1))])
    first, after = (np.searchsorted(marks.time_s, grid + shift) for shift in (-step, step))
    return np.asarray(count[after] > count[first], dtype=np.bool_)


def _reference(series: Mapping[str, CleanSeries], grid: FloatArray) -> FloatArray | None:
    """Return the rate setpoints, and the chirp of a system-ID mode if the log has one, on the grid."""
    setpoint, chirp = series.get("body_rate_setpoint"), series.get("sysid_chirp")
    if setpoint is None or _n_within(setpoint, grid) < 2:
        return None
    wanted = resample(setpoint.time_s, setpoint.values, grid)
    if chirp is None:
        return wanted
    injected = np.zeros((grid.size, 1))
    if _n_within(chirp, grid) >= 2:
        running = (grid >= chirp.time_s[0]) & (grid <= chirp.time_s[-1])
        injected[running] = resample(chirp.time_s, chirp.values, grid)[running]
    return np.column_stack([wanted, injected])


def _n_within(series: CleanSeries, grid: FloatArray) -> int:
    """Return how many samples lie between the ends of the grid."""
    near = series.within(float(grid[0]), float(grid[-1]))
    return int(near.stop - near.start)


def _attitude(attitude: CleanSeries, grid: FloatArray) -> FloatArray | None:
    """Return the angles on the grid, unwrapped so that no interpolation crosses a jump of 2 pi."""
    near = attitude.within(float(grid[0]) - 1.0, float(grid[-1]) + 1.0)
    time_s, values = attitude.time_s[near], attitude.values[near]
    if (
        time_s.size < 2
        or time_s[0] > grid[0] + attitude.period_s
        or time_s[-1] < grid[-1] - attitude.period_s
    ):
        return None
    return resample(time_s, unwrapped(values), grid)


def _input(
    log: FlightLog, torque: CleanSeries | None, segments: tuple[Segment, ...]
) -> InputDescription | None:
    if torque is None:
        return None
    name = torque.signal.name
    n_samples = sum(segment.n_samples for segment in segments)
    n_saturated = sum(int(np.count_nonzero(segment.saturated)) for segment in segments)
    return InputDescription(
        kind=name,
        unit="N m" if name == "torque_n_m" else "1",
        source=torque.signal.source,
        saturated_fraction=n_saturated / n_samples if n_samples else 0.0,
        achieved=torque.signal.achieved,
        calibration=log.torque.calibration if log.torque is not None else Calibration(),
        every_step=_logs_every_step(log, torque),
    )


def _with_rotor_thrust(
    log: FlightLog, segments: tuple[Segment, ...], described: InputDescription | None
) -> tuple[tuple[Segment, ...], InputDescription | None]:
    """Add the thrust that each rotor needs for torque and throttle, where the allocation is known."""
    if described is None or log.torque is None or not log.torque.n_rotors:
        return segments, described
    allocation = log.torque.allocation
    unit = np.ones(3) if described.unit == "1" else np.array(described.calibration.n_m_per_command)
    if (
        not (np.isfinite(allocation).all() and np.isfinite(unit).all())
        or int(np.linalg.matrix_rank(allocation)) < allocation.shape[1]
        or any(segment.throttle is None for segment in segments)
    ):
        return segments, described
    found = []
    for segment in segments:
        command = np.column_stack([segment.torque / unit, np.asarray(segment.throttle)])
        found.append(replace(segment, rotor_thrust=np.clip(command @ allocation.T, 0.0, None)))
    per_thrust = unit[:, np.newaxis] * np.linalg.pinv(allocation)[:3]
    return tuple(found), replace(described, torque_per_thrust=per_thrust)


def _logs_every_step(log: FlightLog, torque: CleanSeries) -> bool:
    """Say whether the log holds the torque of each step of the control loop.

    The loop's rate is ArduPilot's SCHED_LOOP_RATE or PX4's IMU_GYRO_RATEMAX (0: as fast as the gyro).
    """
    loop_hz = max(log.parameters.get(name, 0.0) for name in ("SCHED_LOOP_RATE", "IMU_GYRO_RATEMAX"))
    return bool(loop_hz > 0.0 and 1.0 / torque.period_s >= _EVERY_STEP * loop_hz)


def _overview(series: CleanSeries) -> Overview:
    name = series.signal.name
    return Overview(signal=name, columns=SIGNALS[name].columns, time_s=series.time_s, values=series.values)


def _on_clock(modes: Iterable[ModeChange], clock: Clock) -> tuple[ModeChange, ...]:
    return tuple(
        ModeChange(time_s=clock.time_at(mode.time_s, mode.position), position=mode.position, name=mode.name)
        for mode in modes
    )


def _on_clock_texts(texts: Iterable[LogText], clock: Clock) -> tuple[LogText, ...]:
    return tuple(
        LogText(time_s=clock.time_at(text.time_s, text.position), position=text.position, text=text.text)
        for text in texts
    )
