"""Figures and their 95 % intervals as people read them: one rule for every surface.

A value and both ends of its interval have the same decimals: those that give
two significant digits of half its width. More would be noise, fewer would hide
what the flight knows.
"""

from __future__ import annotations

import math
from typing import Final

#: Of the larger end. An interval below a millionth of its value is finer than anything that is logged.
_MOST_DIGITS = 6


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


def beside(value: float, limit: float, decimals: int) -> str:
    """Return a number with so many decimals, and more where it would read like a limit that it is not at.

    Parameters
    ----------
    value, limit : float
        In one unit; the limit is written beside it.
    decimals : int
        At least; three more at most.
    """
    most = decimals + 3
    while decimals < most and value != limit and round(value, decimals) == limit:
        decimals += 1
    return f"{value:.{decimals}f}"


def interval(low: float, high: float) -> str:
    """Return a 95 % interval, or that there is none.

    Examples
    --------
    >>> interval(432.1, 447.9)
    '432.1 to 447.9'
    >>> interval(29.838, 30.151)
    '29.84 to 30.15'
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return "not bounded"
    return f"{resolved(low, low, high)} to {resolved(high, low, high)}"


def estimate(value: float, low: float, high: float) -> str:
    """Return a value with its 95 % interval, all three with the same decimals.

    Examples
    --------
    >>> estimate(439.8123, 432.1, 447.9), estimate(1.5974e-5, 1.541e-5, 1.653e-5)
    ('439.8 (432.1 to 447.9)', '1.597e−5 (1.541e−5 to 1.653e−5)')
    """
    return f"{resolved(value, low, high)} ({interval(low, high)})"


def plus_minus(value: float, half_width: float) -> str:
    """Return a value with half the width of its 95 % interval.

    Examples
    --------
    >>> plus_minus(11.02, 0.4), plus_minus(-51.63, 2.61)
    ('11.02 ± 0.40', '−51.6 ± 2.6')
    """
    ends = value - half_width, value + half_width
    return f"{resolved(value, *ends)} ± {resolved(half_width, *ends)}"


def resolved(value: float, low: float, high: float) -> str:
    """Return a value with the decimals that show two significant digits of half the interval's width.

    Examples
    --------
    >>> resolved(439.8123, 432.1, 447.9), resolved(2.7e-5, -0.31, 0.31), resolved(27912, 26600, 29200)
    ('439.8', '0.00', '27900')
    """
    half, largest = 0.5 * (high - low), max(abs(low), abs(high))
    if not (math.isfinite(half) and half > 0.0 and math.isfinite(value)):
        return number(value)
    decimals = min(1 - _magnitude(half), _MOST_DIGITS - 1 - _magnitude(largest))
    power = 0 if 1e-4 <= largest < 1e6 else _magnitude(largest)
    # Adding zero takes the sign off what is rounded to zero.
    rounded = round(value, decimals) + 0.0
    shown = f"{rounded / 10.0**power:.{max(0, decimals + power)}f}"
    return (f"{shown}e{power}" if power else shown).replace("-", "−")


def p_words(p_value: float) -> str:
    """Return a p-value to one digit; below a billionth no interval is known well enough to say more.

    Examples
    --------
    >>> p_words(0.00123), p_words(4e-30)
    ('p = 0.001', 'p < 1e-09')
    """
    return f"p = {p_value:.1g}" if p_value >= _LEAST_P else f"p < {_LEAST_P:.1g}"


_LEAST_P: Final = 1e-9


def _magnitude(value: float) -> int:
    """Return the power of ten of a value above zero."""
    return math.floor(math.log10(value))
