"""What is worked out once for each object that is held, and forgotten with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

_Of = TypeVar("_Of")
_Found = TypeVar("_Found")


class Once(Generic[_Of, _Found]):
    """A function of a log or a result whose answer is remembered for as long as that is held.

    Parameters
    ----------
    work : callable
    """

    def __init__(self, work: Callable[[_Of], _Found]) -> None:
        self._work = work
        self._known: WeakKeyDictionary[_Of, _Found] = WeakKeyDictionary()
        update_wrapper(self, work)

    def __call__(self, of: _Of) -> _Found:
        """Return what the function makes of it."""
        if of not in self._known:
            self._known[of] = self._work(of)
        return self._known[of]

    def hand_on(self, before: _Of, after: _Of) -> None:
        """Remember of another object what is known of one that it differs from in nothing that matters.

        Parameters
        ----------
        before, after
            What is not known of the first is worked out for the second when it is needed.
        """
        if before in self._known:
            self._known[after] = self._known[before]


def once(work: Callable[[_Of], _Found]) -> Once[_Of, _Found]:
    """Remember what a function makes of a log or a result for as long as that is held.

    Parameters
    ----------
    work : callable

    Returns
    -------
    Once
    """
    return Once(work)
