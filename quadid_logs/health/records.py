"""Gap-free segments of a log's flights, row by row, no more of them than say what they can say."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align.series import GAP_PERIODS, CleanSeries, Interval
from quadid_logs.arrays import FloatArray
from quadid_logs.maths.moving_mean import moving_mean

#: A quarter of an hour at 100 Hz, two minutes at 1 kHz: more of a flight changes no figure that is shown.
MOST_SAMPLES: Final = 120_000
#: Of a longer flight, segments of this length are taken, spread evenly, and never fewer than these [s].
_SEGMENT_S: Final = 16.0
_FEWEST_SEGMENTS: Final = 3
#: Shorter segments hold no window of a spectrum.
_SHORTEST_S: Final = 2.0


#: A log is regular if nine of ten steps are whole periods, to a quarter: then its own rows are the samples.
_REGULAR, _WHOLE = 0.9, 0.25
#: Stamps drift by what the clock of a log's period is off; over so many rows jitter averages out.
_DRIFT_ROWS: Final = 65
#: A part in which they drift by more has another rate, and lines at other frequencies.
_MOST_DRIFT: Final = 0.01


class Record(NamedTuple):
    """A segment: ``time_s`` (n_samples,) even but for drift, ``values`` (n_samples, n_columns)."""

    time_s: FloatArray
    values: FloatArray


def records(
    several: Sequence[CleanSeries],
    intervals: Sequence[Interval],
    most: int = MOST_SAMPLES,
    *,
    shortest_s: float = _SHORTEST_S,
) -> tuple[list[Record], float]:
    """Put series side by side at the times of the slowest's rows, where none of them pauses.

    Between two rows values are interpolated, which takes three decibels and more from the upper half of a
    spectrum. So the grid follows the rows where these come evenly, and takes out their jitter only.

    Parameters
    ----------
    several : sequence of CleanSeries
        At least one.
    most : int
        Samples in all.
    shortest_s : float
        Shorter segments are left out [s].

    Returns
    -------
    found : list of Record
        Columns of all series in their order.
    period_s : float
        Of the grid; NaN where a series has fewer than two samples.
    """
    if not all(one.period_s > 0.0 for one in several):
        return [], float("nan")
    slowest = max(several, key=lambda one: one.period_s)
    spans = list(intervals)
    for series in several:
        spans = [part for span in spans for part in _without_pauses(series, span)]
    spans = [span for span in spans if span[1] - span[0] >= shortest_s]
    period_s = _row_period_s(slowest, spans)
    found = []
    for start_s, end_s in _spread(spans, most * period_s, shortest_s):
        grid = _grid(slowest, start_s, end_s, period_s)
        columns = [one for series in several for one in _on_grid(series, grid)]
        found.append(Record(grid, np.asarray(np.column_stack(columns), dtype=np.float64)))
    return found, period_s


def _without_pauses(series: CleanSeries, interval: Interval) -> Iterator[Interval]:
    time_s = series.time_s[series.within(*interval)]
    if time_s.size < 2:
        return
    breaks = np.flatnonzero(np.diff(time_s) > GAP_PERIODS * series.period_s + 1e-6)
    first, last = np.append(0, breaks + 1), np.append(breaks, time_s.size - 1)
    yield from zip(time_s[first].tolist(), time_s[last].tolist(), strict=True)


def _spread(spans: Sequence[Interval], longest_s: float, shortest_s: float) -> list[Interval]:
    """Keep segments spread evenly over the spans, as many as make ``longest_s`` together.

    Of spans that are short themselves every n-th one.
    """
    whole_s = sum(end_s - start_s for start_s, end_s in spans)
    if not whole_s > longest_s:
        return list(spans)
    segment_s = min(_SEGMENT_S, longest_s / _FEWEST_SEGMENTS)
    if max(end_s - start_s for start_s, end_s in spans) < segment_s:
        return list(spans[:: math.ceil(whole_s / longest_s)])
    step_s = segment_s * whole_s / longest_s
    kept = []
    for start_s, end_s in spans:
        begins = start_s + step_s * np.arange(int((end_s - start_s) / step_s) + 1)
        kept += [(float(begin), min(float(begin) + segment_s, end_s)) for begin in begins]
    return [(start_s, end_s) for start_s, end_s in kept if end_s - start_s >= shortest_s]


def _row_period_s(series: CleanSeries, spans: Sequence[Interval]) -> float:
    """Return the time between rows that come evenly, lost ones counted; else the typical period."""
    parts = [series.time_s[series.within(*span)] for span in spans]
    steps = np.concatenate([np.zeros(0), *(np.diff(one) for one in parts)])
    if not steps.size:
        return series.period_s
    whole = _whole(steps / np.median(steps))
    return series.period_s if whole is None else float(steps.sum() / whole.sum())


def _whole(steps: FloatArray) -> FloatArray | None:
    """Return how many periods each step takes; None where they are no whole ones."""
    whole = np.maximum(np.round(steps), 1.0)
    return whole if np.mean(np.abs(steps - whole) <= _WHOLE) >= _REGULAR else None


def _grid(series: CleanSeries, start_s: float, end_s: float, period_s: float) -> FloatArray:
    """Return times a period apart: those of the rows without their jitter, if these come evenly."""
    time_s = series.time_s[series.within(start_s, end_s)]
    whole = _whole(np.diff(time_s) / period_s) if time_s.size > _DRIFT_ROWS else None
    span_s = end_s - start_s
    if whole is None or abs(whole.sum() * period_s - span_s) > _MOST_DRIFT * span_s:
        return np.asarray(start_s + period_s * np.arange(int(span_s / period_s + 1e-6) + 1, dtype=np.float64))
    row = np.append(0.0, np.cumsum(whole))
    number = np.arange(row[-1] + 1.0)
    drift_s = np.interp(number, row, time_s - period_s * row)
    return np.asarray(period_s * number + moving_mean(drift_s, _DRIFT_ROWS, beyond="edge"))


def _on_grid(series: CleanSeries, grid: FloatArray) -> Iterator[FloatArray]:
    """Yield the columns on the grid; averages over its period where the series is much faster."""
    margin_s = float(grid[1] - grid[0]) if grid.size > 1 else 0.0
    near = series.within(float(grid[0]) - margin_s, float(grid[-1]) + margin_s)
    time_s, values = series.time_s[near], series.of_rows(near)
    ratio = margin_s / series.period_s
    for column in values.T:
        if ratio > 1.5:
            sums = np.concatenate([[0.0], np.cumsum(column)])
            first = np.searchsorted(time_s, grid - 0.5 * margin_s)
            after = np.maximum(np.searchsorted(time_s, grid + 0.5 * margin_s), first + 1)
            after = np.minimum(after, column.size)
            first = np.minimum(first, after - 1)
            yield (sums[after] - sums[first]) / (after - first)
        else:
            yield np.interp(grid, time_s, column)


def in_flight(series: CleanSeries, intervals: Sequence[Interval], most: int = MOST_SAMPLES) -> Record:
    """Return the samples of a series that lie in the intervals, every n-th of very many, not resampled.

    Its times are not uniform.
    """
    slices = [series.within(*interval) for interval in intervals]
    step = max(1, -(-sum(one.stop - one.start for one in slices) // most))
    slices = [slice(one.start, one.stop, step) for one in slices]
    if not slices:
        return Record(np.zeros(0), np.zeros((0, series.n_columns)))
    return Record(
        np.concatenate([series.time_s[one] for one in slices]),
        np.concatenate([series.of_rows(one) for one in slices]),
    )


def averaged(record: Record, most: int = 600) -> Record:
    """Return averages over short times, at most ``most`` of them, of a record that may have pauses."""
    n_samples = record.time_s.size
    if n_samples <= most:
        return record
    width = -(-n_samples // most)
    starts = np.arange(0, n_samples, width)
    counts = np.diff(np.append(starts, n_samples))
    means = np.add.reduceat(np.nan_to_num(record.values), starts, axis=0) / counts[:, np.newaxis]
    return Record(np.add.reduceat(record.time_s, starts) / counts, means)
