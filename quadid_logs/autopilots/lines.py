"""Lines of the gyro's spectrum and the filters that meet them, whatever an autopilot calls its settings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from quadid_logs.data.health import Line, LineSource
from quadid_logs.data.log import Notch
from quadid_logs.data.tuning import Cutoffs

#: Width of a notch on a line that stands, over its frequency: half of what ArduPilot's documentation gives
#: one that moves.
STANDING_WIDTH: Final = 0.25

#: A line is worth a notch of its own where it stands in most of the flight.
_LEAST_SHARE: Final = 0.5
#: Lines of several axes nearer than this are one.
_SAME: Final = 0.05


class SortedLines(NamedTuple):
    """Frequencies [Hz] of lines, the strongest first; of rotors the harmonics that were seen."""

    harmonics: tuple[int, ...]
    by_throttle_hz: tuple[float, ...]
    fixed_hz: tuple[float, ...]
    all_hz: tuple[float, ...]


def sorted_lines(lines: Sequence[Line]) -> SortedLines:
    """Sort the lines of all axes.

    Without oscillations of the loop, which no notch cures.
    """
    kept = sorted((one for one in lines if one.source is not LineSource.LOOP), key=lambda one: -one.rms)
    rotor = {one.harmonic for one in kept if one.source is LineSource.ROTOR}
    throttle = (one for one in kept if one.source is LineSource.FOLLOWS_THROTTLE)
    still = (
        one
        for one in kept
        if one.source in (LineSource.FIXED, LineSource.UNKNOWN) and one.share >= _LEAST_SHARE
    )
    return SortedLines(
        tuple(sorted(rotor)), tuple(_apart(throttle)), tuple(_apart(still)), tuple(_apart(kept))
    )


def _apart(lines: Iterable[Line]) -> Iterator[float]:
    """Yield frequencies that are not those of a stronger line."""
    seen: list[float] = []
    for one in lines:
        if all(abs(one.frequency_hz / other - 1.0) > _SAME for other in seen):
            seen.append(one.frequency_hz)
            yield one.frequency_hz


def is_on(notch: Notch, line_hz: float) -> bool:
    """Tell whether a line lies within half a notch's width of its centre.

    Examples
    --------
    >>> is_on(Notch(80.0, 0.25, 0.01), 89.0), is_on(Notch(80.0, 0.25, 0.01), 91.0)
    (True, False)
    """
    return abs(line_hz - notch.frequency_hz) <= 0.5 * notch.inverse_q * notch.frequency_hz


def low_passes_on(parameters: Mapping[str, float], ranges: Cutoffs) -> Cutoffs:
    """Return of these low-passes those that are on, each with the range of its cut-off [Hz]."""
    return {name: ends for name, ends in ranges.items() if 0.0 < parameters.get(name, 0.0) < math.inf}
