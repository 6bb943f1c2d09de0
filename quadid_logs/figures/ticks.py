"""The ticks of logarithmic axes, the same in every drawing."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from quadid_logs.figures.spec import Panel

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Over fewer decades than this, 2 and 5 have their ticks, too.
_DECADES_WITH_STEPS = 2.3
#: More labels than this run into each other along a low panel.
_MOST_LABELS = 5
#: Decades from 10^-3 to 10^6 are read faster as 0.001 to 1 000 000.
_PLAIN = range(-3, 7)


class Tick(NamedTuple):
    """A place on an axis and what is written there."""

    value: float
    text: str


def log_ticks(low: float, high: float) -> tuple[Tick, ...]:
    """Return the ticks of a logarithmic axis.

    Parameters
    ----------
    low, high : float
        Ends of what is shown, positive.

    Returns
    -------
    tuple of Tick
        Whole decades and, over few of them, 2 and 5 between; all of them plain numbers or all powers.

    Examples
    --------
    >>> [tick.text for tick in log_ticks(0.3, 30.0)]
    ['0.2', '0.5', '1', '2', '5', '10', '20', '50']
    >>> [tick.text for tick in log_ticks(1e-10, 1.0)]
    ['10⁻¹⁰', '10⁻⁸', '10⁻⁶', '10⁻⁴', '10⁻²', '10⁰']
    """
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    exponents = range(first, last + 1)
    plain = first in _PLAIN and last in _PLAIN
    if math.log10(high / low) < _DECADES_WITH_STEPS and plain:
        values = [step * 10.0**exponent for exponent in exponents for step in (1.0, 2.0, 5.0)]
        return tuple(Tick(value, _plain(value)) for value in values if 0.5 * low <= value <= 2.0 * high)
    every = -(-(last - first) // _MOST_LABELS) or 1
    return tuple(
        Tick(
            10.0**exponent, _plain(10.0**exponent) if plain else f"10{str(exponent).translate(_SUPERSCRIPTS)}"
        )
        for exponent in exponents[::every]
    )


def _plain(value: float) -> str:
    """Return a tick's number, thousands apart."""
    return f"{value:,.0f}".replace(",", "\u2009") if value >= 1000.0 else f"{value:g}"


def shown_range(panel: Panel, name: str) -> tuple[float, float] | None:
    """Return the lowest and the highest value along an axis of a panel, None where it has none.

    Parameters
    ----------
    name : str
        "x" or "y"; of a logarithmic axis, only positive values count.
    """
    axis = panel.x if name == "x" else panel.y
    if axis.low is not None and axis.high is not None:
        return axis.low, axis.high
    parts = [curve.x if name == "x" else curve.y for curve in panel.curves]
    parts += [
        part for each in panel.ribbons for part in ((each.x,) if name == "x" else (each.low, each.high))
    ]
    values = np.concatenate([np.zeros(0), *parts])
    values = values[np.isfinite(values) & ((values > 0.0) if axis.log else True)]
    return (float(values.min()), float(values.max())) if values.size else None
