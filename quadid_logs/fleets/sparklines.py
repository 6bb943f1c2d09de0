"""A series over a vehicle's history as a drawing the height of a line of text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.fleets.changes import Series
from quadid_logs.numerals import resolved

WIDTH: Final = 132.0
HEIGHT: Final = 34.0
_EDGE: Final = 3.0
#: More points than pixels show nothing; a long history is thinned evenly.
_MOST_POINTS: Final = 100
#: An interval may reach this many times the spread of the values outside the drawing.
_REACH: Final = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Sparkline:
    """SVG path data in a box of `WIDTH` x `HEIGHT`, the same in words, and the latest value.

    ``line`` joins the estimates, ``bars`` are their 95 % intervals, ``marks``
    the x of every change.
    """

    words: str
    now: str
    line: str
    bars: str
    dots: tuple[tuple[float, float], ...]
    marks: tuple[float, ...]


def sparkline(one: Series, label: str, changes: Sequence[int]) -> Sparkline | None:
    """Return the drawing of a series; None if it is nowhere identifiable.

    Parameters
    ----------
    label : str
        What it is, for those who do not see it.
    changes : sequence of int
        Flights from which on the vehicle is another one.
    """
    known = one.known
    if not len(known):
        return None
    known = known[np.unique(np.linspace(0, len(known) - 1, min(len(known), _MOST_POINTS)).astype(int))]
    value, half = one.value[known], one.half_width[known]
    low, high = float(value.min()), float(value.max())
    room = max(high - low, 2.0 * float(np.median(half)), 1e-3 * abs(high)) * _REACH
    bottom, top = low - room, high + room
    last = max(len(one.value) - 1, 1)

    def across(index: float) -> float:
        return round(_EDGE + (WIDTH - 2.0 * _EDGE) * index / last, 1)

    def up(level: float) -> float:
        height = float(np.clip((level - bottom) / (top - bottom), 0.0, 1.0)) if top > bottom else 0.5
        return round(HEIGHT - _EDGE - (HEIGHT - 2.0 * _EDGE) * height, 1)

    points = [(across(float(k)), up(float(v))) for k, v in zip(known, value, strict=True)]
    bars = [
        f"M{across(float(k)):g} {up(float(v - h)):g}V{up(float(v + h)):g}"
        for k, v, h in zip(known, value, half, strict=True)
    ]
    spread = float(np.median(half))
    least, most = (resolved(end, end - spread, end + spread) for end in (low, high))
    now = resolved(value[-1], value[-1] - half[-1], value[-1] + half[-1])
    words = f"{label} over {len(one.known)} flights: {least} to {most}, latest {now}"
    if changes:
        words += f"; changed at flight {', '.join(str(flight + 1) for flight in changes)}"
    return Sparkline(
        words=words,
        now=now,
        line="M" + "L".join(f"{x:g} {y:g}" for x, y in points),
        bars="".join(bars),
        dots=(points[-1],),
        marks=tuple(across(flight - 0.5) for flight in changes),
    )
