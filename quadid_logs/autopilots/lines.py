"""Lines of the gyro's spectrum, sorted by what a notch has to follow to stay on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from quadid_logs.data.health import Line, LineSource

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

    Parameters
    ----------
    lines : sequence of Line

    Returns
    -------
    SortedLines
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
