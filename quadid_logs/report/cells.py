"""Tables of texts: what a template lays out."""

from __future__ import annotations

from dataclasses import dataclass

from quadid_logs.data.closed_loop import Estimated
from quadid_logs.report.numbers import interval, resolved


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One entry of a table: ``text`` in large with its ``detail``, ``name`` below it; ``weak`` is greyed."""

    text: str
    detail: str = ""
    name: str = ""
    weak: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table with a caption; the first cell of every row is its heading."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


def interval_cell(value: float, ci95: tuple[float, float], *, weak: bool = False) -> Cell:
    """Return a value with its 95 % interval below."""
    return Cell(text=resolved(value, *ci95), detail=interval(*ci95), weak=weak)


def estimated_cell(figure: Estimated | None) -> Cell:
    """Return a figure with its 95 % interval below; a dash where it is not known."""
    return Cell(text="–") if figure is None else interval_cell(*figure)
