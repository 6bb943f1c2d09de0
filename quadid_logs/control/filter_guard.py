"""Whether filters are worth changing: the next flight with them, against that with gains alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

from quadid_logs.data.tuning import AxisTuning
from quadid_logs.diagnose.findings import finding

#: The part of gust error or noise that no flight would show, as of `_NO_DIFFERENCE` in the search.
_NOT_SHOWN: Final = 0.05


class Refiltered(NamedTuple):
    """The next flight of an axis with filters and gains, and what of gusts these leave in the end.

    ``in_the_end`` is the gust error at the target of gains and filters, over that at the target of gains
    alone, each raised by what is missing there of the limits.
    """

    tuning: AxisTuning
    in_the_end: float


def is_no_worse(filtered: AxisTuning, alone: AxisTuning, in_the_end: float = 1.0) -> bool:
    """Tell whether an axis has no more gust error than with gains alone; what nobody can tell counts as more.

    Filters that are changed take some of what a controller may change in one flight, and gains get the rest.
    So the next flight may lose what no flight would show, if flights gain as much in the end.

    Parameters
    ----------
    filtered, alone : AxisTuning
        The next flight with filters and gains, and with gains alone, under the same limits.
    in_the_end : float
        As of `Refiltered`; what is lost in the end, no flight before makes up for.

    Returns
    -------
    bool
    """
    lost = filtered.attitude_error / _gust_error(alone)
    return lost <= 1.0 or (lost <= 1.0 + _NOT_SHOWN and lost * in_the_end <= 1.0)


def is_worth_it(filtered: Mapping[str, AxisTuning], alone: Mapping[str, AxisTuning]) -> bool:
    """Tell whether filters that change together leave one axis a twentieth less gust error or noise.

    Parameters
    ----------
    filtered, alone : mapping of str to AxisTuning
        By axis, as for `is_no_worse`.

    Returns
    -------
    bool
    """
    most = 1.0 - _NOT_SHOWN
    return any(
        new.attitude_error <= most * _gust_error(alone[axis])
        or new.torque_noise_next <= most * alone[axis].torque_noise_next
        for axis, new in filtered.items()
    )


def with_flown_filters(axis: str, alone: AxisTuning) -> AxisTuning:
    """Return gains alone, and say that the filters stay.

    Parameters
    ----------
    axis : str
    alone : AxisTuning

    Returns
    -------
    AxisTuning
        A refused axis as it is: it says why.
    """
    if alone.verdict == "refused":
        return alone
    return replace(alone, reasons=(*alone.reasons, finding("QL674", "info", {}, axes=(axis,))))


def _gust_error(alone: AxisTuning) -> float:
    """Return that of the next flight over the flown one; an axis that is refused stays as it flew."""
    return 1.0 if alone.verdict == "refused" else alone.attitude_error
