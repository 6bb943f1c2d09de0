"""Which of several sources of a signal to take, and how it was really sampled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from quadid_logs.align.series import GAP_PERIODS, CleanSeries, Interval
from quadid_logs.data.flight import SourceChoice
from quadid_logs.maths.resampling import typical_period

#: A preferred source may be this much slower than the fastest one before its
#: other merits (same clock as the torque, less processing) no longer pay.
_FAST_ENOUGH = 0.8
#: No signal but the torque and the rates is needed faster than this [Hz].
_ATTITUDE_RATE_HZ = 50.0


def choose_sources(candidates: Mapping[str, Sequence[CleanSeries]]) -> dict[str, CleanSeries]:
    """Take for each signal the most preferred source that is fast enough.

    Body rates need not be faster than the torque they are compared with, so
    there the source with the torque's rows mostly wins.

    Parameters
    ----------
    candidates : mapping of str to sequence of CleanSeries
        By canonical name, in the reader's order of preference.

    Returns
    -------
    dict of str to CleanSeries
        Only signals with at least two samples.
    """
    chosen = {}
    torque_rate_hz = float("inf")
    for name in ("torque_n_m", "torque_command"):
        best = _first_fast_enough(candidates.get(name, ()), float("inf"))
        if best is not None:
            chosen[name] = best
            torque_rate_hz = min(torque_rate_hz, best.rate_hz)
    for name, sources in candidates.items():
        if name in chosen:
            continue
        best = _first_fast_enough(sources, torque_rate_hz if name == "body_rate" else _ATTITUDE_RATE_HZ)
        if best is not None:
            chosen[name] = best
    return chosen


def _first_fast_enough(sources: Sequence[CleanSeries], needed_hz: float) -> CleanSeries | None:
    """Return the first source of at least the needed rate, or about as fast as the fastest."""
    usable = [source for source in sources if source.time_s.size >= 2]
    if not usable:
        # Events such as arming may well be logged once.
        return next((source for source in sources if source.time_s.size), None)
    fastest_hz = max(source.rate_hz for source in usable)
    needed_hz = min(needed_hz, fastest_hz) * _FAST_ENOUGH
    return next(source for source in usable if source.rate_hz >= needed_hz)


def describe(
    series: CleanSeries, candidates: Sequence[CleanSeries], flights: Sequence[Interval]
) -> SourceChoice:
    """Tell where a signal came from and how it was really sampled in flight.

    Parameters
    ----------
    series : CleanSeries
        The chosen source.
    candidates : sequence of CleanSeries
        All sources of the signal, this one among them.
    flights : sequence of (start_s, end_s)
        Where there is none, the whole log counts.

    Returns
    -------
    SourceChoice
    """
    # The time steps inside the flights, of the whole log where there is no flight.
    if not flights:
        steps = np.diff(series.time_s)
    else:
        steps = np.concatenate([np.diff(series.time_s[series.within(*flight)]) for flight in flights])
    period = typical_period(np.cumsum(steps))
    gaps = steps[steps > GAP_PERIODS * period]
    # Say why this source: the reader's reason, and whether a preferred one was too slow.
    position = next(i for i, other in enumerate(candidates) if other is series)
    if position == 0:
        reason = series.reason or "the preferred source"
    else:
        passed = candidates[0]
        reason = (
            f"{series.reason or 'next in preference'}; {passed.source} is preferred but was logged at only "
            f"{passed.rate_hz:.3g} Hz"
        )
    return SourceChoice(
        signal=series.name,
        source=series.source,
        reason=reason,
        n_samples=int(series.time_s.size),
        rate_hz=1.0 / period if period > 0.0 else 0.0,
        mean_rate_hz=float(steps.size / steps.sum()) if steps.size else 0.0,
        longest_gap_s=float(steps.max()) if steps.size else 0.0,
        n_gaps=int(gaps.size),
        n_duplicate=series.n_duplicate,
        n_out_of_order=series.n_out_of_order,
        n_outliers=series.n_outliers,
        n_not_finite=series.n_not_finite,
        others=tuple((other.source, other.rate_hz) for other in candidates if other is not series),
    )
