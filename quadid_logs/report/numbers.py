"""Numbers as people read them."""

from __future__ import annotations

import math


def number(value: float, digits: int = 4) -> str:
    """Return a value with the digits that matter, "–" where there is none.

    Examples
    --------
    >>> number(439.8123), number(0.00081234), number(float("nan")), number(38_000_000.0)
    ('439.8', '0.0008123', '–', '3.8e7')
    """
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value and not 1e-4 <= abs(value) < 1e6:
        digit, power = f"{value:.{digits - 1}e}".split("e")
        digit = digit.rstrip("0").rstrip(".") if "." in digit else digit
        return f"{digit}e{int(power)}".replace("-", "−")
    decimals = max(0, digits - 1 - (math.floor(math.log10(abs(value))) if value else 0))
    shown = f"{value:.{min(decimals, 10)}f}"
    return (shown.rstrip("0").rstrip(".") if "." in shown else shown).replace("-", "−")


def interval(low: float, high: float) -> str:
    """Return a 95 % interval, or that there is none.

    Examples
    --------
    >>> interval(432.1, 447.9)
    '432.1 to 447.9'
    >>> interval(97.818, 101.576)
    '97.82 to 101.58'
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return "not bounded"
    return f"{resolved(low, low, high)} to {resolved(high, low, high)}"


def estimate(value: float, low: float, high: float) -> str:
    """Return a value with its 95 % interval, both with the digits that the interval allows.

    Examples
    --------
    >>> estimate(439.8123, 432.1, 447.9)
    '439.8 (432.1 to 447.9)'
    """
    return f"{resolved(value, low, high)} ({interval(low, high)})"


def resolved(value: float, low: float, high: float) -> str:
    """Return a value with the digits that its 95 % interval allows: what is nothing against it is 0.

    Examples
    --------
    >>> resolved(439.8123, 432.1, 447.9), resolved(2.7e-5, -0.31, 0.31)
    ('439.8', '0')
    """
    width = high - low
    if not (math.isfinite(width) and width > 0.0 and math.isfinite(value)):
        return number(value)
    step = 10.0 ** math.floor(math.log10(width / 50.0))
    return number(round(value / step) * step, _digits(low, high))


def _digits(low: float, high: float) -> int:
    """Return how many digits resolve the interval to a fiftieth of its width."""
    width = high - low
    if not width > 0.0:
        return 4
    return min(6, max(2, 1 + _magnitude(max(abs(low), abs(high))) + math.ceil(math.log10(50.0 / width))))


def _magnitude(value: float) -> int:
    """Return the power of ten of a value."""
    return math.floor(math.log10(abs(value))) if value else 0


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
