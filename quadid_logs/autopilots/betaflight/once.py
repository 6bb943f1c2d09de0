"""What is worked out once for each log: loops are closed many times around one flight."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar
from weakref import WeakKeyDictionary

from quadid_logs.data.log import FlightLog

_Found = TypeVar("_Found")


def once_per_log(work: Callable[[FlightLog], _Found]) -> Callable[[FlightLog], _Found]:
    """Remember what a function makes of a log for as long as that is held.

    Parameters
    ----------
    work : callable

    Returns
    -------
    callable
    """
    known: WeakKeyDictionary[FlightLog, _Found] = WeakKeyDictionary()

    @wraps(work)
    def remembered(log: FlightLog) -> _Found:
        if log not in known:
            known[log] = work(log)
        return known[log]

    return remembered
