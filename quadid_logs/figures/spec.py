"""The vocabulary of figures: what is shown, without saying how it is drawn."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from quadid_logs.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

Mark = Literal["line", "wide", "dashed", "thick", "points", "bars"]
Along = Literal["x", "y"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """An axis: what it measures, its unit, and its range where the data's own would mislead.

    ``ticks`` replaces numbers by words: (position, word) pairs.
    """

    label: str
    unit: str = ""
    log: bool = False
    low: float | None = None
    high: float | None = None
    ticks: tuple[tuple[float, str], ...] = ()

    @property
    def title(self) -> str:
        """Label and unit as printed along the axis."""
        return f"{self.label} [{self.unit.replace('^2', '²')}]" if self.unit and self.label else self.label


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A series of a panel; NaN in ``y`` (n_points,) is a gap. ``low`` and ``high`` are error bars.

    A "wide" line is pale, and lies beneath another that it is to be compared with. ``samples`` is how many
    there were before they were thinned, 0 where that does not matter.
    """

    label: str
    x: FloatArray
    y: FloatArray
    role: str
    mark: Mark = "line"
    low: FloatArray | None = None
    high: FloatArray | None = None
    samples: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ribbon:
    """An interval around a curve: ``low`` and ``high`` (n_points,) over ``x``; NaN is a gap."""

    label: str
    x: FloatArray
    low: FloatArray
    high: FloatArray
    role: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Heat:
    """A map in colours: ``z`` (n_y, n_x) over the cells' centres ``x`` and ``y``; NaN is a gap."""

    label: str
    unit: str
    x: FloatArray
    y: FloatArray
    z: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """A shaded interval along one axis."""

    start: float
    end: float
    role: str
    label: str = ""
    along: Along = "x"


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """A reference line at one value of an axis."""

    value: float
    role: str
    label: str = ""
    along: Along = "y"


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """A few words centred at a point of a panel."""

    text: str
    x: float
    y: float
    role: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """One pair of axes; ``height`` is relative to the other panels', ``note`` is written inside.

    ``equal`` gives both axes one scale, as a drawing needs it. ``model_of`` names
    the vehicle's axis whose model the panel shows, "" where it shows none. ``heat`` lies beneath the curves.
    """

    title: str
    x: Axis
    y: Axis
    curves: tuple[Curve, ...]
    ribbons: tuple[Ribbon, ...] = ()
    bands: tuple[Band, ...] = ()
    levels: tuple[Level, ...] = ()
    height: float = 1.0
    note: str = ""
    labels: tuple[Label, ...] = ()
    equal: bool = False
    model_of: str = ""
    heat: Heat | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Figure:
    """Panels in rows of ``columns``; ``caption`` tells a pilot how to read them.

    ``over_time`` says that every x axis is the log's clock [s], so that
    panels and figures can be zoomed together; ``small`` that it is a sketch, ``low`` that it
    shares a screen with text.
    """

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 1
    over_time: bool = False
    small: bool = False
    low: bool = False

    def to_matplotlib(self) -> Canvas:
        """Return an ordinary matplotlib figure, which pyplot does not know of."""
        from quadid_logs.figures.png import draw

        return draw(self)

    def save(self, path: str | Path) -> None:
        """Write it as PNG at print quality; a file that exists is overwritten."""
        from quadid_logs.figures.png import write_png

        write_png(self, Path(path))

    def __repr__(self) -> str:
        return f"<Figure {self.key!a}: {self.title}>"

    def _repr_png_(self) -> bytes:
        """Return the picture that a notebook shows."""
        from quadid_logs.figures.png import write_png

        drawn = io.BytesIO()
        write_png(self, drawn)
        return drawn.getvalue()


#: Of several figures.
FREQUENCY: Final = Axis(label="frequency", unit="Hz", log=True)
BODY_RATE: Final = Axis(label="body rate", unit="deg/s")


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A figure that this log has nothing to show in, and why."""

    key: str
    title: str
    reason: str
