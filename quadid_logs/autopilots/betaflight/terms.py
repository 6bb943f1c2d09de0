"""The terms of Betaflight's PID as the log holds them: whole thousandths, rounded or cut towards zero."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.signals import PID_SCALE, TO_FRD, middle
from quadid_logs.containers.blackbox import Column, FrameTable
from quadid_logs.data.log import ControllerTerms, Rows
from quadid_logs.vocabulary import AXES

#: What the log calls the terms; axisS, of wings, stands with the feed-forward that it adds to.
_FIELDS: Final = {"P": "P", "I": "I", "D": "D", "FF": "FS"}


class WholeTerms(Mapping[str, FloatArray]):
    """Terms of one axis [1], FRD, made from the log's whole numbers at each access.

    Parameters
    ----------
    columns : mapping of str to sequence of ndarray of int
        By term what adds up to it.
    sign : float
        Of this axis from forward-left-up to FRD.
    cut : bool
        As of `signals.cuts_terms`.
    """

    __slots__ = ("_columns", "_cut", "_sign")

    def __init__(self, columns: Mapping[str, tuple[Column, ...]], sign: float, *, cut: bool) -> None:
        self._columns = dict(columns)
        self._sign = sign
        self._cut = cut

    def __getitem__(self, term: str) -> FloatArray:
        """Return a term: the middle of the values that became the logged one."""
        wholes = (column.astype(np.float64) for column in self._columns[term])
        return np.asarray(self._sign * PID_SCALE * sum(middle(whole, cut=self._cut) for whole in wholes))

    def __iter__(self) -> Iterator[str]:
        """Iterate over the terms' names."""
        return iter(self._columns)

    def __len__(self) -> int:
        """Return how many terms there are."""
        return len(self._columns)


def controller_terms(main: FrameTable, rows: Rows, *, cut: bool) -> tuple[ControllerTerms, ...]:
    """Return the terms of every axis.

    Parameters
    ----------
    main : FrameTable
        Whose columns are kept as they are: two bytes a row.
    cut : bool
        As of `signals.cuts_terms`.
    """
    found = []
    for number, axis in enumerate(AXES):
        columns = {term: _columns(main, letters, number) for term, letters in _FIELDS.items()}
        present = {term: each for term, each in columns.items() if each}
        if present:
            values = WholeTerms(present, float(TO_FRD[number]), cut=cut)
            found.append(ControllerTerms(axis=axis, rows=rows, values=values))
    return tuple(found)


def _columns(main: FrameTable, letters: str, number: int) -> tuple[Column, ...]:
    columns = (main.columns.get(f"axis{letter}[{number}]") for letter in letters)
    return tuple(column for column in columns if column is not None)
