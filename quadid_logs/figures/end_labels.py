"""Lines that bear their name at their end: the eye need not go to a legend and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from quadid_logs.figures.spec import Curve, Figure, Panel

#: A longer name would take more of the width than it is worth; more names than these are a list.
_LONGEST, _MOST = 16, 6


def labelled(panel: Panel) -> tuple[Curve, ...]:
    """Return the curves of a panel that can bear their name at their end.

    Lines with a short name that no other of the panel bears; none of a drawing, whose lines end anywhere.
    """
    lines = [curve for curve in panel.curves if curve.mark in {"line", "wide", "dashed"} and curve.x.size]
    names = [curve.label for curve in lines]
    if panel.equal or len(lines) > _MOST:
        return ()
    return tuple(
        curve for curve in lines if 0 < len(curve.label) <= _LONGEST and names.count(curve.label) == 1
    )


def at_the_right(figure: Figure) -> Iterator[Panel]:
    """Yield the panels that have room beside them: those of the last column."""
    for number, panel in enumerate(figure.panels, start=1):
        if number % figure.columns == 0:
            yield panel


def names_at_ends(figure: Figure) -> frozenset[str]:
    """Return the names that stand at ends of lines, and so need no place in the legend."""
    return frozenset(curve.label for panel in at_the_right(figure) for curve in labelled(panel))


def spread(places: Sequence[float], apart: float) -> list[float]:
    """Move places between 0 and 1 until none is nearer to another than `apart`; their order stays.

    Parameters
    ----------
    apart : float
        Where there is not room for all, those at the bottom leave the range.

    Returns
    -------
    list of float
        In the order of `places`.

    Examples
    --------
    >>> [round(place, 2) for place in spread([0.95, 0.2, 0.96], 0.1)]
    [0.9, 0.2, 1.0]
    """
    order = sorted(range(len(places)), key=lambda at: places[at])
    moved = [min(1.0, max(0.0, places[at])) for at in order]
    for at in range(1, len(moved)):
        moved[at] = max(moved[at], moved[at - 1] + apart)
    ceiling = 1.0
    for at in reversed(range(len(moved))):
        moved[at] = min(moved[at], ceiling)
        ceiling = moved[at] - apart
    return [place for _, place in sorted(zip(order, moved, strict=True))]
