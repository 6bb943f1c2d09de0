"""One clock, one period, gaps kept as gaps, flights found.

`clean` comes before the torque is rebuilt, `assemble` and `cut` after it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from quadid_logs.align.clock import Clock, find_clock
from quadid_logs.align.commands import AngleGains, StickGains, with_commands
from quadid_logs.align.flights import find_flights
from quadid_logs.align.gyro import check_gyro
from quadid_logs.align.series import (
    GAP_PERIODS,
    WRITTEN_LATE,
    Cleaner,
    CleanLog,
    CleanSeries,
    Interval,
    TorqueSeries,
)
from quadid_logs.align.sources import choose_sources, describe
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import LEAST_FLIGHT_S, FlightData, InputDescription, Overview, Segment
from quadid_logs.data.log import NO_GYRO_FILTER, FlightLog
from quadid_logs.data.settings import AlignSettings
from quadid_logs.data.torque import Calibration
from quadid_logs.errors import SettingsError
from quadid_logs.maths.grid import step_of
from quadid_logs.maths.resampling import fill_gaps, resample, resample_held
from quadid_logs.maths.rotations import quaternion_from_euler, rotation_matrix, unwrapped
from quadid_logs.vocabulary import NOT_A_MULTIROTOR, SIGNALS

__all__ = ["Prepared", "assemble", "check_part", "clean", "cut"]

#: The rigid body's content ends far below; loop rates above only add noise and time [Hz].
_MOST_RATE_HZ = 400.0
#: Shorter segments hold no full cycle of the slowest motion that the model must explain [s].
_SHORTEST_SEGMENT_S = 2.0
#: A logger that writes in blocks loses some tens of milliseconds at a time. Rate and torque of a motion of up
#: to 10 Hz are known there from what is on either side, to a second order in both alike [s]; of the flight so
#: much may be missing.
_BRIDGED_S = 0.05
_MOST_BRIDGED = 0.1
#: No rate loop of a multirotor runs slower than this [Hz]; a log that is as
#: fast holds every output.
_LOOP_RATE_HZ = 200.0
#: The next slower log holds half the steps of the loop; jittery stamps are far from making that of it.
_EVERY_STEP = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """A log on one clock with its torque, not yet resampled.

    Attributes
    ----------
    log : FlightLog
    clean : CleanLog
    candidates, series : mapping of str
        By signal the sources, rebuilt ones among them, and the one that was chosen.
    torque : TorqueSeries or None
        What was chosen as L, M, N.
    loop_rate_hz : float
        Of the autopilot's rate loop, 0 where that is not known.
    angle_gains : mapping of str to (roll, pitch, yaw)
        Of the flight modes in which set-points follow from the sticks [1/s].
    stick_gains : mapping of str to (roll, pitch)
        Of the flight modes in which the signal ``stick`` asks for angles [rad/s].
    """

    log: FlightLog
    clean: CleanLog
    candidates: Mapping[str, Sequence[CleanSeries]]
    series: Mapping[str, CleanSeries]
    torque: TorqueSeries | None
    loop_rate_hz: float = 0.0
    angle_gains: AngleGains = field(default_factory=dict)
    stick_gains: StickGains = field(default_factory=dict)

    @property
    def flights(self) -> tuple[Interval, ...]:
        """From take-off to landing (start_s, end_s)."""
        return self.clean.flights


def clean(log: FlightLog) -> CleanLog:
    """Bring a log's signals onto one clock, each once, and find its flights.

    Parameters
    ----------
    log : FlightLog
        As a reader returns it.

    Returns
    -------
    CleanLog
        Without signals where nothing tells the log's time.
    """
    # Batches of samples are written long after they were taken.
    timed = [name for name in log.signals if name not in WRITTEN_LATE] if _tells_time(log) else []
    clock = find_clock([signal for name in timed for signal in log.signals[name]])
    cleaner = Cleaner(clock)
    candidates = {
        name: tuple(cleaner.clean(signal) for signal in log.candidates(name))
        for name in (log.signals if _tells_time(log) else ())
    }
    flights = find_flights(choose_sources(candidates), _span(clock))
    # Why there is no flight; of what has no rotors nothing is said that speaks of them.
    return CleanLog(
        log=log,
        clock=clock,
        candidates=candidates,
        flights=flights.intervals,
        on_ground_reason=NOT_A_MULTIROTOR if flights.reason and not log.may_be_multirotor else flights.reason,
        hops=flights.hops,
    )


def assemble(
    log: FlightLog,
    cleaned: CleanLog,
    torques: Sequence[TorqueSeries],
    loop_rate_hz: float = 0.0,
    angle_gains: AngleGains | None = None,
    stick_gains: StickGains | None = None,
) -> Prepared:
    """Choose the source of every signal.

    Parameters
    ----------
    log : FlightLog
        With what is known of the torque.
    cleaned : CleanLog
    torques : sequence of TorqueSeries
        All sources of torque, rebuilt or as logged, the preferred one of a kind first.
    loop_rate_hz : float
        Of the autopilot's rate loop, 0 where that is not known.
    angle_gains : mapping of str to (roll, pitch, yaw), optional
    stick_gains : mapping of str to (roll, pitch), optional
        As of `Prepared`.

    Returns
    -------
    Prepared
    """
    candidates: dict[str, Sequence[CleanSeries]] = dict(cleaned.candidates)
    for name in ("torque_command", "torque_n_m"):
        candidates[name] = [one.series for one in torques if one.series.name == name]
    series = choose_sources(candidates)
    chosen = series.get("torque_n_m") or series.get("torque_command")
    torque = next((one for one in torques if one.series is chosen), None)
    if torque is not None and torque.saturated is not None and torque.saturated.n_samples:
        series["torque_saturation"] = torque.saturated
        candidates["torque_saturation"] = [torque.saturated]
    return Prepared(
        log=log,
        clean=cleaned,
        candidates=candidates,
        series=series,
        torque=torque,
        loop_rate_hz=loop_rate_hz,
        angle_gains=angle_gains or {},
        stick_gains=stick_gains or {},
    )


def cut(prepared: Prepared, settings: AlignSettings) -> FlightData:
    """Resample the part of a log that the settings choose.

    Parameters
    ----------
    prepared : Prepared
    settings : AlignSettings

    Returns
    -------
    FlightData
        Without segments where the log lacks time, torque, rates or flight;
        what was found is described all the same.
    """
    log, series, torque = prepared.log, prepared.series, prepared.torque
    clock = prepared.clean.clock
    span = _span(clock)
    intervals = _clip(prepared.flights, settings)
    period_s = _period_s(torque, settings)
    # Of any other vehicle nothing is cut out to identify: the model would not fit it.
    is_identifiable = log.may_be_multirotor and log.has_time
    segments = _segments(series, torque, intervals, period_s) if is_identifiable else ()
    modes = tuple(replace(mode, time_s=clock.time_at(mode.time_s, mode.position)) for mode in log.modes)
    if "reference_rate" in series:
        segments = tuple(replace(each, command=each.reference, planned=True) for each in segments)
    else:
        sticks = series.get("stick")
        segments = with_commands(
            segments,
            modes,
            prepared.angle_gains,
            stick_gains=prepared.stick_gains,
            sticks=() if sticks is None else [_resampled(sticks, each.time_s) for each in segments],
        )
    return FlightData(
        sample_period_s=period_s,
        segments=segments,
        flights=intervals,
        sources={
            name: describe(chosen, prepared.candidates[name], intervals) for name, chosen in series.items()
        },
        input=_input(prepared, segments),
        start_s=span[0],
        duration_s=span[1] - span[0],
        gyro_filter=series["body_rate"].gyro_filter if "body_rate" in series else NO_GYRO_FILTER,
        clock_resets=clock.n_resets,
        on_ground_reason=prepared.clean.on_ground_reason
        or ("" if intervals else "the chosen part of the log holds no flight"),
        gyro_check=check_gyro(series.get("body_rate"), series.get("attitude"), intervals),
        overview={name: _overview(series[name]) for name in series if SIGNALS[name].columns},
        modes=modes,
        texts=tuple(replace(text, time_s=clock.time_at(text.time_s, text.position)) for text in log.texts),
    )


def check_part(logs: Sequence[Prepared], settings: AlignSettings) -> None:
    """Refuse a choice of start and end that holds too little flight of logs that have enough.

    Parameters
    ----------
    logs : sequence of Prepared
    settings : AlignSettings

    Raises
    ------
    SettingsError
        With the range of the first log: it is the choice that is wrong, not the log.
    """
    timed = [each for each in logs if each.log.has_time]
    ends = (("from", settings.start_s), ("to", settings.end_s))
    chosen = " ".join(f"{word} {time_s:g} s" for word, time_s in ends if math.isfinite(time_s))
    if not (chosen and timed):
        return
    flights = [each.flights or (_span(each.clean.clock),) for each in timed]
    in_part_s = sum(_length_s(_clip(each, settings)) for each in flights)
    if in_part_s >= min(LEAST_FLIGHT_S, sum(map(_length_s, flights))) > 0.0:
        return
    first = timed[0]
    held = (
        f"{in_part_s:.1f} s of flight, less than the {LEAST_FLIGHT_S:g} s that are needed"
        if in_part_s
        else "no flight"
    )
    start_s, end_s = _span(first.clean.clock)
    flown = ", ".join(f"{a:.1f} to {b:.1f} s" for a, b in first.flights[:6])
    raise SettingsError(
        f"The part {chosen} holds {held}: the log runs from {start_s:.1f} to {end_s:.1f} s"
        f"{f', flown {flown}' if flown else ''}.",
        hint="Give --start-s and --end-s on the log's clock: `quadid-log info LOG` shows it.",
    )


def _length_s(intervals: Iterable[Interval]) -> float:
    """Return how long the intervals are together [s]."""
    return sum(end - start for start, end in intervals)


def _tells_time(log: FlightLog) -> bool:
    return log.has_time or log.is_nominal_time


def _span(clock: Clock) -> Interval:
    return float(clock.first_s[0] + clock.shift_s[0]), float(clock.last_s[-1] + clock.shift_s[-1])


def _clip(intervals: Iterable[Interval], settings: AlignSettings) -> tuple[Interval, ...]:
    """Keep what lies inside the part of the log that the user chose."""
    clipped = [(max(a, settings.start_s), min(b, settings.end_s)) for a, b in intervals]
    return tuple((a, b) for a, b in clipped if b > a)


def _period_s(torque: TorqueSeries | None, settings: AlignSettings) -> float:
    """Return the period to resample to: as set, or that of the torque series, within bounds."""
    if settings.sample_rate_hz:
        return 1.0 / settings.sample_rate_hz
    if torque is None or not torque.series.period_s > 0.0:
        return math.nan
    return max(torque.series.period_s, 1.0 / _MOST_RATE_HZ)


def _segments(
    series: Mapping[str, CleanSeries],
    torque: TorqueSeries | None,
    intervals: tuple[Interval, ...],
    period_s: float,
) -> tuple[Segment, ...]:
    """Resample the needed signals on every gap-free part of every flight."""
    rate = series.get("body_rate")
    if torque is None or rate is None or not np.isfinite(period_s):
        return ()
    found = []
    for flight, interval in enumerate(intervals):
        for logged in _without_gaps(rate, interval, period_s):
            for start_s, end_s in _without_gaps(torque.series, logged, period_s):
                if end_s - start_s >= _SHORTEST_SEGMENT_S:
                    n_samples = int((end_s - start_s) / period_s + 1e-6) + 1
                    grid = start_s + period_s * np.arange(n_samples, dtype=np.float64)
                    found.append(replace(_segment(series, torque, grid), flight=flight))
    return tuple(found)


def _without_gaps(series: CleanSeries, interval: Interval, period_s: float) -> list[Interval]:
    """Return the parts of the interval between samples that follow each other without a gap.

    Faster logging than the grid needs may pause for as long as the grid's own period allows.
    """
    time_s = series.time_s[series.within(*interval)]
    if time_s.size < 2:
        return []
    # A microsecond of slack: stamps are rounded to it.
    longest_s = GAP_PERIODS * max(series.period_s, period_s) + 1e-6
    steps = np.diff(time_s)
    bridged_s = _BRIDGED_S + max(series.period_s, period_s) + 1e-6
    missing_s = float(np.sum(steps[(steps > longest_s) & (steps <= bridged_s)]))
    if missing_s <= _MOST_BRIDGED * (time_s[-1] - time_s[0]):
        longest_s = max(longest_s, bridged_s)
    breaks = np.flatnonzero(steps > longest_s)
    first = np.concatenate([[0], breaks + 1])
    last = np.concatenate([breaks, [time_s.size - 1]])
    return [(float(time_s[a]), float(time_s[b])) for a, b in zip(first, last, strict=True) if b > a]


def _segment(series: Mapping[str, CleanSeries], torque: TorqueSeries, grid: FloatArray) -> Segment:
    rate, attitude, throttle = series["body_rate"], series.get("attitude"), series.get("throttle")
    thrust, by_expo = torque.rotor_thrust, torque.thrust_by_expo
    # Mark grid points with a saturated sample, of any axis, at most one period away.
    marks = series.get("torque_saturation")
    if marks is None:
        saturated = np.zeros(grid.shape, dtype=bool)
    else:
        step = float(grid[1] - grid[0]) if grid.size > 1 else 0.0
        near = marks.within(float(grid[0]) - step, float(grid[-1]) + step)
        count = np.concatenate([[0], np.cumsum((marks.stored[near] > 0.5).any(axis=1))])
        first, after = (np.searchsorted(marks.time_s[near], grid + shift) for shift in (-step, step))
        saturated = count[after] > count[first]
    return Segment(
        time_s=grid,
        body_rate_rad_s=_resampled(rate, grid),
        torque=_on_grid(torque.series, torque.series.stored, grid),
        attitude_rad=None if attitude is None else _covering(attitude, grid),
        throttle=None if throttle is None else _resampled(throttle, grid)[:, 0],
        saturated=saturated,
        reference=_reference(series, grid),
        velocity_m_s=_body_velocity(series.get("velocity"), attitude, grid),
        # What comes out of a low-pass may fall a hair below zero.
        rotor_thrust=None if thrust is None else np.clip(_on_grid(torque.series, thrust, grid), 0.0, None),
        thrust_by_expo=None if by_expo is None else _on_grid(torque.series, by_expo, grid),
    )


def _resampled(series: CleanSeries, grid: FloatArray) -> FloatArray:
    """Return a series on the grid, shape (n_grid, n_columns)."""
    return resample(series.time_s, series.stored, grid, series.period_s)


def _on_grid(torque: CleanSeries, values: FloatArray, grid: FloatArray) -> FloatArray:
    """Return torque or thrust on the grid: held between the outputs of a loop, interpolated if logged slower.

    The motors obey an output until the next one comes, so where every output is
    logged, and comes at irregular times, holding is exact and interpolating is not.
    """
    if torque.rate_hz < _EVERY_STEP * _LOOP_RATE_HZ:
        return resample(torque.time_s, values, grid, torque.period_s)
    near = torque.within(float(grid[0]) - _BRIDGED_S, float(grid[-1]) + _BRIDGED_S)
    bridged = fill_gaps(torque.time_s[near], values[near], torque.period_s, GAP_PERIODS * torque.period_s)
    return resample_held(*bridged, grid, torque.period_s)


def _reference(series: Mapping[str, CleanSeries], grid: FloatArray) -> FloatArray | None:
    """Return the rate setpoints, and the chirp of a system-ID mode if the log has one, on the grid.

    Set-points of position and attitude loops answer the motion too; those of a trajectory do not. Where only
    angles were logged as they were commanded, it is their change.
    """
    setpoint = series.get("reference_rate") or series.get("body_rate_setpoint")
    angles = series.get("attitude_setpoint") if setpoint is None else None
    chirp = series.get("sysid_chirp")
    logged = setpoint or angles
    if logged is None or _n_within(logged, grid) < 2:
        return None
    wanted = _resampled(logged, grid)
    if angles is not None:
        commanded = resample(angles.time_s, unwrapped(angles.values), grid, angles.period_s)
        wanted = np.gradient(commanded, grid, axis=0)
    if chirp is None:
        return wanted
    injected = np.zeros((grid.size, 1))
    if _n_within(chirp, grid) >= 2:
        running = (grid >= chirp.time_s[0]) & (grid <= chirp.time_s[-1])
        injected[running] = _resampled(chirp, grid)[running]
    return np.column_stack([wanted, injected])


def _n_within(series: CleanSeries, grid: FloatArray) -> int:
    """Return how many samples lie between the ends of the grid."""
    near = series.within(float(grid[0]), float(grid[-1]))
    return int(near.stop - near.start)


def _covering(series: CleanSeries, grid: FloatArray) -> FloatArray | None:
    """Return a slow series on the grid, None where it does not reach from end to end.

    Angles are unwrapped, so that no interpolation crosses a jump of 2 pi.
    """
    near = series.within(float(grid[0]) - 1.0, float(grid[-1]) + 1.0)
    time_s, values = series.time_s[near], series.of_rows(near)
    if time_s.size < 2 or time_s[0] > grid[0] + series.period_s or time_s[-1] < grid[-1] - series.period_s:
        return None
    return resample(time_s, unwrapped(values) if series.name == "attitude" else values, grid)


def _body_velocity(
    velocity: CleanSeries | None, attitude: CleanSeries | None, grid: FloatArray
) -> FloatArray | None:
    """Return the velocity along the body axes on the grid, None where one of the two does not cover it."""
    if velocity is None or attitude is None:
        return None
    angles, earth = (_covering(each, grid) for each in (attitude, velocity))
    if angles is None or earth is None:
        return None
    to_earth = rotation_matrix(quaternion_from_euler(angles))
    return np.asarray(np.einsum("kij,ki->kj", to_earth, earth), dtype=np.float64)


def _input(prepared: Prepared, segments: tuple[Segment, ...]) -> InputDescription | None:
    """Say what L, M, N are in the segments."""
    if prepared.torque is None:
        return None
    series, model = prepared.torque.series, prepared.log.torque
    n_samples = sum(segment.n_samples for segment in segments)
    n_saturated = sum(int(np.count_nonzero(segment.saturated)) for segment in segments)
    loop_hz = prepared.loop_rate_hz
    # The fraction of logged rows inside the segments in which each axis got less than was wanted.
    marks = prepared.series.get("torque_saturation")
    if marks is None or not segments:
        limited_fraction = 0.0, 0.0, 0.0
    else:
        rows = [marks.stored[marks.within(*each.time_s[[0, -1]].tolist())] > 0.5 for each in segments]
        limited = np.concatenate(rows)
        roll, pitch, yaw = limited.mean(axis=0).tolist() if limited.size else (0.0, 0.0, 0.0)
        limited_fraction = roll, pitch, yaw
    return InputDescription(
        kind=series.name,
        unit="N m" if series.name == "torque_n_m" else "1",
        source=series.source,
        saturated_fraction=n_saturated / n_samples if n_samples else 0.0,
        limited_fraction=limited_fraction,
        achieved=series.achieved,
        calibration=Calibration() if model is None else model.calibration,
        torque_per_thrust=prepared.torque.torque_per_thrust,
        expo=prepared.torque.expo,
        every_step=loop_hz > 0.0 and 1.0 / series.period_s >= _EVERY_STEP * loop_hz,
        grid=(step_of(series.values[:, 0]), step_of(series.values[:, 1]), step_of(series.values[:, 2])),
    )


def _overview(series: CleanSeries) -> Overview:
    return Overview(
        signal=series.name, columns=SIGNALS[series.name].columns, time_s=series.time_s, stored=series.stored
    )
