"""Numbers as people read them; those with intervals are written by `quadid_logs.numerals`."""

from __future__ import annotations

import math

from quadid_logs.numerals import estimate, interval, number, plus_minus, resolved

__all__ = ["estimate", "interval", "number", "percent", "plus_minus", "resolved", "seconds", "size"]


def seconds(value: float) -> str:
    """Return a duration.

    Examples
    --------
    >>> seconds(83.02), seconds(754.0)
    ('83.0 s', '12 min 34 s')
    """
    if not math.isfinite(value):
        return "–"
    if abs(value) < 120.0:
        return f"{value:.1f} s"
    minutes, rest = divmod(round(value), 60)
    return f"{minutes} min {rest} s"


def size(n_bytes: int) -> str:
    """Return a file size in decimal units.

    Examples
    --------
    >>> size(512), size(38_000_000)
    ('512 bytes', '38.0 MB')
    """
    for unit, scale in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if n_bytes >= scale:
            return f"{n_bytes / scale:.1f} {unit}"
    return f"{n_bytes} bytes"


def percent(fraction: float) -> str:
    """Return a fraction of 1 in per cent.

    Examples
    --------
    >>> percent(0.021), percent(float("nan"))
    ('2.1 %', '–')
    """
    return "–" if math.isnan(fraction) else f"{number(100.0 * fraction, 3)} %"
