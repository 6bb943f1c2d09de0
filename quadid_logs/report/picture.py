"""The frame of the small pictures that pages draw as SVG: no script, readable in print and aloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

WIDTH: Final = 320

#: A tick: its place in the picture, and its text.
Tick = tuple[float, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """One axis: ticks across and up, and what it shows in words; ``left`` and ``right`` end what is drawn."""

    axis: str
    across: tuple[Tick, ...]
    up: tuple[Tick, ...]
    words: str
    height: int
    left: int
    right: int
    width: int = WIDTH


class Scale(NamedTuple):
    """From a value between ``low`` and ``high`` to a place between ``begin`` and ``end`` in the picture."""

    low: float
    high: float
    begin: float
    end: float

    def at(self, value: float) -> float:
        """Return the place of a value; the middle where all are alike."""
        part = (value - self.low) / (self.high - self.low) if self.high > self.low else 0.5
        return round(self.begin + (self.end - self.begin) * part, 1)
