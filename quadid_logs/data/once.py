"""What is worked out once for each object that is held, and forgotten with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar
from weakref import WeakKeyDictionary

_Of = TypeVar("_Of")
_Found = TypeVar("_Found")


def once(work: Callable[[_Of], _Found]) -> Callable[[_Of], _Found]:
    """Remember what a function makes of a log or a result for as long as that is held.

    Parameters
    ----------
    work : callable

    Returns
    -------
    callable
    """
    known: WeakKeyDictionary[_Of, _Found] = WeakKeyDictionary()

    @wraps(work)
    def remembered(of: _Of) -> _Found:
        if of not in known:
            known[of] = work(of)
        return known[of]

    return remembered
