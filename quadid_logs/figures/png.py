"""Draw a figure as PNG with Pillow: the few marks that our figures have, without a plotting library.

Importing matplotlib and drawing five figures with it took a quarter of an analysis.
"""

from __future__ import annotations

import math
import textwrap
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, NamedTuple

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from quadid_logs.arrays import FloatArray
from quadid_logs.figures.end_labels import at_the_right, labelled, names_at_ends, spread
from quadid_logs.figures.palette import LIGHT, WIDE_OPACITY, band_opacity
from quadid_logs.figures.spec import Axis, Curve, Figure, Mark, Panel
from quadid_logs.figures.ticks import linear_ticks, log_ticks

_DPI: Final = 140
_POINT: Final = _DPI / 72.0
_WIDTH: Final = 10 * _DPI
#: Lines are drawn so many times as large and averaged: their edges are smooth then.
_FINER: Final = 2
#: Height of a row of panels by the number of columns, and of what stands around panels [inch].
_ROW_IN: Final = {1: 1.75, 2: 1.75, 3: 3.2}
_TITLE_IN, _CAPTION_LINE_IN, _GAP_IN, _BELOW_IN = 0.95, 0.17, 0.62, 0.62
_LEFT, _RIGHT = 0.085, 0.985
_WIDTH_GAP: Final = {1: 0.0, 2: 0.2, 3: 0.3}
_CAPTION_WIDTH: Final = 150
_MOST_LEGEND_ENTRIES: Final = 12
_END_PT, _LETTER_IN = 8.0, 0.064
#: Room beyond the data on either side of an axis, of its length.
_MARGIN: Final = 0.05
#: Widths of lines by their mark [pt].
_LINE_PT: Final = {"line": 0.9, "wide": 3.2, "dashed": 0.9, "thick": 7.0, "bars": 1.4}
_DASH_PT: Final = (3.3, 1.5)
_BEYOND: Final = 1e4
#: Signs that are drawn: all up to the end of Latin, and these.
_PLAIN: Final = 0x250
_MORE: Final = frozenset("−…–\u2009⁻⁰⁴⁵⁶⁷⁸⁹")
#: What is larger is no measurement, and would overflow.
_LARGEST: Final = 1e100
#: More ticks than these are read no faster.
_MOST_TICKS: Final = 9
#: Ticks across are as far apart as their labels are long, ticks up as these are high [px].
_APART_PX: Final = (80.0, 38.0)

_Box = tuple[float, float, float, float]
_Colour = tuple[int, int, int]


def write_png(figure: Figure, path: Path | BinaryIO) -> None:
    """Write one figure at print quality.

    Parameters
    ----------
    figure : Figure
    path : Path or binary file
        Overwritten if it exists; the caller decides about that.
    """
    _Drawing(figure).image().save(path, format="PNG", compress_level=2, dpi=(_DPI, _DPI))


class _Scale(NamedTuple):
    """One axis of a panel: the ends of what is shown, and where they are [px]."""

    low: float
    high: float
    at_low: float
    at_high: float
    log: bool

    def place(self, values: Any) -> FloatArray:
        """Return where values are [px]; what cannot be shown is NaN."""
        given = np.asarray(values, dtype=np.float64)
        with np.errstate(all="ignore"):
            if self.log:
                part = np.log(given / self.low) / math.log(self.high / self.low)
            else:
                part = (given - self.low) / (self.high - self.low)
            placed = self.at_low + part * (self.at_high - self.at_low)
        # Far beyond the panel is far enough: larger numbers are none that can be drawn.
        return np.where(np.isfinite(placed), np.clip(placed, -_BEYOND, _BEYOND), np.nan)


class _Drawing:
    """One figure on its way to an image."""

    def __init__(self, figure: Figure) -> None:
        self._figure = figure
        self._caption = textwrap.wrap(_drawable(figure.caption), _CAPTION_WIDTH)
        self._heights = _row_heights(figure)
        below_in = _BELOW_IN + _CAPTION_LINE_IN * len(self._caption)
        total_in = _TITLE_IN + sum(self._heights) + _GAP_IN * (len(self._heights) - 1) + below_in
        self._height = round(_DPI * total_in)
        fine = (_WIDTH * _FINER, self._height * _FINER)
        self._lines = Image.new("RGB", fine, "white")
        self._words: list[tuple[Any, ...]] = []

    def image(self) -> Image.Image:
        """Return the picture."""
        figure = self._figure
        shared = _shared_range(figure.panels) if figure.over_time else None
        ends = [id(panel) for panel in at_the_right(figure)]
        for number, panel in enumerate(figure.panels):
            bottom = number >= len(figure.panels) - figure.columns
            box = self._box(number)
            scales = _scales(panel, box, shared)
            self._panel(panel, box, scales, with_x_label=bottom or not figure.over_time)
            if id(panel) in ends:
                self._name_ends(panel, box, scales)
        self._write(figure.title, 0.012 * _WIDTH, 0.1 * _DPI, 13.0, "la", bold=True)
        for row, line in enumerate(self._caption):
            up = self._height - 0.08 * _DPI - _CAPTION_LINE_IN * _DPI * (len(self._caption) - row)
            self._write(line, 0.012 * _WIDTH, up, 8.5, "la", "muted")
        self._legend()
        image = self._lines.reduce(_FINER)
        pen = ImageDraw.Draw(image)
        for x, y, text, points, anchor, colour, bold, paper, upright in self._words:
            font = _font(points, bold=bold)
            if upright:
                _write_upright(image, (x, y), text, font, colour)
                continue
            if paper:
                left, top, right, bottom_ = pen.textbbox((x, y), text, font=font, anchor=anchor)
                pen.rectangle((left - 3, top - 3, right + 3, bottom_ + 3), fill="white")
            pen.text((x, y), text, fill=colour, font=font, anchor=anchor)
        return image

    def _box(self, number: int) -> _Box:
        """Return left, top, right and bottom of a panel [px]."""
        row, column = divmod(number, self._figure.columns)
        columns, gap = self._figure.columns, _WIDTH_GAP[self._figure.columns]
        left = _LEFT * _WIDTH
        right = _RIGHT * _WIDTH - _LETTER_IN * _longest_name(self._figure) * _DPI
        width = (right - left) / (columns + gap * (columns - 1))
        top = _DPI * (_TITLE_IN + sum(self._heights[:row]) + _GAP_IN * row)
        start = left + column * width * (1.0 + gap)
        return start, top, start + width, top + _DPI * self._heights[row]

    def _panel(self, panel: Panel, box: _Box, scales: tuple[_Scale, _Scale], *, with_x_label: bool) -> None:
        """Draw one panel: what lies beneath first."""
        left, top, right, bottom = box
        x, y = scales
        inside = Image.new("RGB", (round((right - left) * _FINER), round((bottom - top) * _FINER)), "white")
        pen = _Pen(inside, left, top)
        for band in panel.bands:
            scale = x if band.along == "x" else y
            ends = scale.place([band.start, band.end])
            pen.band(ends, band.along, _thin(LIGHT[band.role], band_opacity(band.role)))
        ticks = self._ticks(panel, box, scales, with_x_label=with_x_label)
        for value in ticks[0]:
            pen.line(np.array([value, value]), np.array([top, bottom]), LIGHT["grid"], 0.6)
        for value in ticks[1]:
            pen.line(np.array([left, right]), np.array([value, value]), LIGHT["grid"], 0.6)
        for ribbon in panel.ribbons:
            colour = _thin(LIGHT[ribbon.role], band_opacity("interval"))
            pen.ribbon(x.place(ribbon.x), y.place(ribbon.low), y.place(ribbon.high), colour)
        for curve in panel.curves:
            _draw_curve(pen, curve, x, y)
        self._levels(panel, box, scales, pen)
        self._lines.paste(inside, (round(left * _FINER), round(top * _FINER)))
        frame = _Pen(self._lines, 0.0, 0.0)
        frame.line(np.array([left, left, right]), np.array([top, bottom, bottom]), LIGHT["muted"], 0.8)
        for label in panel.labels:
            at = float(x.place(label.x)), float(y.place(label.y))
            self._write(label.text, *at, 10.0, "mm", label.role, bold=True)
        self._write(panel.title, left, top - 3.0 * _POINT, 9.5, "ls")
        if panel.note:
            at = right - 0.01 * (right - left), top + 0.03 * (bottom - top)
            self._write(panel.note, *at, 8.0, "ra", paper=True)

    def _ticks(
        self, panel: Panel, box: _Box, scales: tuple[_Scale, _Scale], *, with_x_label: bool
    ) -> tuple[list[float], list[float]]:
        """Write ticks and labels along both axes; return where the ticks are [px]."""
        left, top, right, bottom = box
        frame = _Pen(self._lines, 0.0, 0.0)
        found: tuple[list[float], list[float]] = ([], [])
        widest = 0.0
        for value, text in _ticks_of(panel.x, scales[0], int((right - left) / _APART_PX[0])):
            at = float(scales[0].place(value))
            found[0].append(at)
            frame.line(np.array([at, at]), np.array([bottom, bottom + 3.5 * _POINT]), LIGHT["muted"], 0.8)
            if with_x_label:
                self._write(text, at, bottom + 7.0 * _POINT, 9.0, "ma", "muted")
        for value, text in _ticks_of(panel.y, scales[1], int((bottom - top) / _APART_PX[1])):
            at = float(scales[1].place(value))
            found[1].append(at)
            frame.line(np.array([left - 3.5 * _POINT, left]), np.array([at, at]), LIGHT["muted"], 0.8)
            self._write(text, left - 7.0 * _POINT, at, 9.0, "rm", "muted")
            widest = max(widest, _font(9.0).getlength(_drawable(text)))
        if with_x_label:
            self._write(panel.x.title, 0.5 * (left + right), bottom + 18.5 * _POINT, 9.0, "ma")
        across = left - 11.0 * _POINT - widest
        self._write(panel.y.title, across, 0.5 * (top + bottom), 9.0, "mb", upright=True)
        return found

    def _levels(self, panel: Panel, box: _Box, scales: tuple[_Scale, _Scale], pen: _Pen) -> None:
        """Draw reference lines with their words at their ends."""
        left, top, right, bottom = box
        for level in panel.levels:
            along_y = level.along == "y"
            at = float(scales[1 if along_y else 0].place(level.value))
            line = (np.array([left, right]), np.array([at, at]))
            line = line if along_y else (line[1], np.array([top, bottom]))
            pen.line(*line, LIGHT[level.role], 1.1, dashed=True)
            if along_y:
                place = right - 0.005 * (right - left), at - 2.0 * _POINT
            else:
                place = at + 3.0 * _POINT, top + 0.03 * (bottom - top)
            self._write(level.label, *place, 8.0, "rb" if along_y else "la", paper=True)

    def _name_ends(self, panel: Panel, box: _Box, scales: tuple[_Scale, _Scale]) -> None:
        """Write the names of lines beside their ends."""
        _, top, _, bottom = box
        ends = []
        for curve in labelled(panel):
            known = np.flatnonzero(np.isfinite(curve.y))
            if known.size:
                x, y = (float(scales[i].place(of[known[-1]])) for i, of in enumerate((curve.x, curve.y)))
                ends.append((curve, x, (bottom - y) / (bottom - top)))
        apart = 1.15 * _END_PT * _POINT / (bottom - top)
        places = spread([up for _, _, up in ends], apart)
        for (curve, x, _), place in zip(ends, places, strict=True):
            at = x + 4.0 * _POINT, bottom - place * (bottom - top)
            self._write(curve.label, *at, _END_PT, "lm", curve.role)

    def _legend(self) -> None:
        """Put one legend for all panels under the title."""
        handles: dict[str, tuple[Mark | Literal["patch"], _Colour]] = {}
        at_ends = names_at_ends(self._figure)
        for panel in self._figure.panels:
            for curve in panel.curves:
                if curve.mark != "thick" and curve.label not in at_ends:
                    opacity = WIDE_OPACITY if curve.mark == "wide" else 1.0
                    drawn = curve.mark, _mixed(LIGHT[curve.role], opacity)
                    handles.setdefault(_drawable(curve.label), drawn)
            shaded = [(band.label, band.role, band_opacity(band.role)) for band in panel.bands if band.label]
            shaded += [(ribbon.label, ribbon.role, band_opacity("interval")) for ribbon in panel.ribbons]
            for label, role, opacity in shaded:
                handles.setdefault(_drawable(label), ("patch", _mixed(LIGHT[role], min(1.0, 2.0 * opacity))))
        pen = _Pen(self._lines, 0.0, 0.0)
        x, y, width = 0.012 * _WIDTH, 0.46 * _DPI, 11.0 * _POINT
        for label, (kind, colour) in list(handles.items())[:_MOST_LEGEND_ENTRIES]:
            if kind == "points":
                pen.points(np.array([x + 0.5 * width]), np.array([y]), colour, 5.0)
            else:
                points = {"patch": 6.0, "wide": 4.0}.get(kind, 2.0)
                pen.line(np.array([x, x + width]), np.array([y, y]), colour, points)
            self._write(label, x + width + 5.0 * _POINT, y, 8.0, "lm")
            x += width + 15.0 * _POINT + _font(8.0).getlength(label)

    def _write(
        self,
        text: str,
        x: float,
        y: float,
        points: float,
        anchor: str,
        role: str = "ink",
        *,
        bold: bool = False,
        paper: bool = False,
        upright: bool = False,
    ) -> None:
        """Note a text; all are written when the lines are done."""
        if text and math.isfinite(x) and math.isfinite(y):
            self._words.append((x, y, _drawable(text), points, anchor, LIGHT[role], bold, paper, upright))


class _Pen:
    """Draws on an image that is finer than the picture, whose left top corner is somewhere in it [px]."""

    def __init__(self, image: Image.Image, left: float, top: float) -> None:
        self._draw = ImageDraw.Draw(image)
        #: What is drawn with this is as thin as its fourth number says.
        self._thin = ImageDraw.Draw(image, "RGBA")
        self._size = image.size
        self._left, self._top = left, top

    def _fine(self, x: FloatArray, y: FloatArray) -> FloatArray:
        return np.column_stack([(x - self._left) * _FINER, (y - self._top) * _FINER])

    def line(self, x: FloatArray, y: FloatArray, colour: Any, points: float, *, dashed: bool = False) -> None:
        """Draw a line [px]; NaN is a gap."""
        width = max(1, round(points * _POINT * _FINER))
        joint = "curve" if width > _FINER else None
        for part in _parts(self._fine(x, y)):
            for drawn in _dashes(part) if dashed else (part,):
                self._draw.line(drawn.ravel().tolist(), fill=colour, width=width, joint=joint)

    def points(self, x: FloatArray, y: FloatArray, colour: Any, diameter_pt: float) -> None:
        """Draw points."""
        radius = 0.5 * diameter_pt * _POINT * _FINER
        places = self._fine(x, y)
        for across, down in places[np.isfinite(places).all(axis=1)].tolist():
            self._thin.ellipse((across - radius, down - radius, across + radius, down + radius), fill=colour)

    def ribbon(self, x: FloatArray, low: FloatArray, high: FloatArray, colour: Any) -> None:
        """Fill between two lines."""
        for part in _parts(np.column_stack([self._fine(x, low), self._fine(x, high)])):
            outline = np.vstack([part[:, :2], part[::-1, 2:]])
            self._thin.polygon(outline.ravel().tolist(), fill=colour)

    def band(self, ends: FloatArray, along: str, colour: Any) -> None:
        """Fill between two values along one axis."""
        if not np.isfinite(ends).all():
            return
        low, high = sorted(((ends - (self._left if along == "x" else self._top)) * _FINER).tolist())
        width, height = self._size
        self._thin.rectangle((low, 0, high, height) if along == "x" else (0, low, width, high), fill=colour)


def _parts(places: FloatArray) -> list[FloatArray]:
    """Split rows at those that hold NaN; single rows are no line."""
    known = np.isfinite(places).all(axis=1)
    starts = np.flatnonzero(np.diff(known, prepend=False))
    runs = np.split(places, starts)[1::2] if starts.size else []
    return [run for run in runs if len(run) > 1]


def _dashes(places: FloatArray) -> list[FloatArray]:
    """Return the dashes of a line, (n, 2) each."""
    step = np.hypot(*np.diff(places, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(step)])
    dash, gap = (points * _POINT * _FINER for points in _DASH_PT)
    starts = np.arange(0.0, along[-1], dash + gap)
    found = []
    for start, end in zip(starts, np.minimum(starts + dash, along[-1]), strict=True):
        inside = along[(along > start) & (along < end)]
        at = np.concatenate([[start], inside, [end]])
        found.append(np.column_stack([np.interp(at, along, column) for column in places.T]))
    return found


def _draw_curve(pen: _Pen, curve: Curve, x: _Scale, y: _Scale) -> None:
    """Draw one series the way its mark says."""
    across, up = x.place(curve.x), y.place(curve.y)
    if curve.mark == "points":
        pen.points(across, up, _thin(LIGHT[curve.role], 0.6), 1.8)
    elif curve.mark == "bars":
        if curve.low is not None and curve.high is not None:
            for place, low, high in zip(across, y.place(curve.low), y.place(curve.high), strict=True):
                pen.line(np.array([place, place]), np.array([low, high]), LIGHT[curve.role], _LINE_PT["bars"])
                for end in (low, high):
                    cap = np.array([place - 4.0 * _POINT, place + 4.0 * _POINT])
                    pen.line(cap, np.array([end, end]), LIGHT[curve.role], _LINE_PT["bars"])
        pen.points(across, up, LIGHT[curve.role], 5.0)
    else:
        colour = _mixed(LIGHT[curve.role], WIDE_OPACITY if curve.mark == "wide" else 1.0)
        pen.line(across, up, colour, _LINE_PT[curve.mark], dashed=curve.mark == "dashed")


def _shared_range(panels: tuple[Panel, ...]) -> tuple[float, float] | None:
    """Return the range of x that panels over the same clock show."""
    ranges = [found for panel in panels if (found := _data_range(panel, "x")) is not None]
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None


def _data_range(panel: Panel, name: str) -> tuple[float, float] | None:
    """Return the lowest and the highest value along an axis, None where it has none."""
    axis = panel.x if name == "x" else panel.y
    parts: list[Any] = []
    for curve in panel.curves:
        of_y = [part for part in (curve.y, curve.low, curve.high) if part is not None]
        parts += [curve.x] if name == "x" else of_y
    for ribbon in panel.ribbons:
        parts += [ribbon.x] if name == "x" else [ribbon.low, ribbon.high]
    parts += [[band.start, band.end] for band in panel.bands if band.along == name]
    parts += [[level.value] for level in panel.levels if level.along == name]
    values = np.concatenate([np.zeros(0), *(np.asarray(part, dtype=np.float64) for part in parts)])
    values = values[(np.abs(values) < _LARGEST) & ((values > 1.0 / _LARGEST) if axis.log else True)]
    return (float(values.min()), float(values.max())) if values.size else None


def _scales(panel: Panel, box: _Box, shared: tuple[float, float] | None) -> tuple[_Scale, _Scale]:
    """Return both axes of a panel."""
    left, top, right, bottom = box
    x, y = _ends(panel.x, shared or _data_range(panel, "x")), _ends(panel.y, _data_range(panel, "y"))
    if panel.equal:
        # One scale on both: the axis with room to spare shows more.
        across, up = (right - left) / (x[1] - x[0]), (bottom - top) / (y[1] - y[0])
        per_unit = min(across, up)
        x, y = (
            (0.5 * (low + high) - 0.5 * size / per_unit, 0.5 * (low + high) + 0.5 * size / per_unit)
            for (low, high), size in ((x, right - left), (y, bottom - top))
        )
    return _Scale(*x, left, right, panel.x.log), _Scale(*y, bottom, top, panel.y.log)


def _ends(axis: Axis, found: tuple[float, float] | None) -> tuple[float, float]:
    """Return the ends of an axis: its own, else those of the data with some room."""
    low, high = found or ((0.1, 10.0) if axis.log else (0.0, 1.0))
    largest = max(abs(low), abs(high))
    varies = high - low > max(1e-9 * largest, 1.0 / _LARGEST)
    if axis.log:
        room = (high / low) ** _MARGIN if varies else 2.0
        low, high = low / room, high * room
    else:
        room = _MARGIN * ((high - low) if varies else largest if largest > 1.0 / _LARGEST else 1.0)
        low, high = low - room, high + room
    low = low if axis.low is None or (axis.log and axis.low <= 0.0) else axis.low
    high = high if axis.high is None else axis.high
    return (low, high) if high > low else (low, 2.0 * abs(low) + 1.0)


def _ticks_of(axis: Axis, scale: _Scale, most: int) -> list[tuple[float, str]]:
    """Return values and texts of the ticks within an axis, hardly more than so many."""
    if axis.ticks:
        ticks = list(axis.ticks)
    elif axis.log:
        ticks = [(tick.value, tick.text) for tick in log_ticks(scale.low, scale.high)]
    else:
        found = linear_ticks(scale.low, scale.high, min(most, _MOST_TICKS))
        ticks = [(tick.value, tick.text) for tick in found]
    low, high = sorted((scale.at_low, scale.at_high))
    return [(value, text) for value, text in ticks if low - 0.5 <= scale.place(value) <= high + 0.5]


def _longest_name(figure: Figure) -> int:
    """Return the number of letters of the longest name at the end of a line."""
    names = [curve.label for panel in at_the_right(figure) for curve in labelled(panel)]
    return max(map(len, names), default=0)


def _row_heights(figure: Figure) -> list[float]:
    """Return the height of each row [inch]."""
    rows = [
        figure.panels[first : first + figure.columns]
        for first in range(0, len(figure.panels), figure.columns)
    ]
    base = _ROW_IN[figure.columns] if len(rows) > 1 or figure.columns == 3 else 3.2
    return [base * max(panel.height for panel in row) for row in rows]


@lru_cache(maxsize=512)
def _mixed(colour: str, opacity: float) -> _Colour:
    """Return a colour as thin as that on white paper."""
    red, green, blue = (round(255 - opacity * (255 - each)) for each in ImageColor.getrgb(colour)[:3])
    return red, green, blue


def _thin(colour: str, opacity: float) -> tuple[int, int, int, int]:
    """Return a colour through which so much of what lies beneath is hidden."""
    return (*_mixed(colour, 1.0), round(255 * opacity))


@lru_cache(maxsize=32)
def _font(points: float, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return matplotlib's own font, which has all signs that we write; nothing of matplotlib is imported."""
    found = find_spec("matplotlib")
    folder = Path((found.submodule_search_locations or [""])[0] if found else "")
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    # The basic layout sets letter by letter: no ligatures and no right-to-left, which none of our texts has.
    path = folder / "mpl-data" / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), points * _POINT, layout_engine=ImageFont.Layout.BASIC)


def _write_upright(
    image: Image.Image, at: tuple[float, float], text: str, font: ImageFont.FreeTypeFont, colour: str
) -> None:
    """Write a text from bottom to top, centred at a height, its foot at a place [px]."""
    _, top, width, bottom = font.getbbox(text, anchor="ls")
    mask = Image.new("L", (math.ceil(width) + 2, math.ceil(bottom - top) + 2), 0)
    ImageDraw.Draw(mask).text((1, 1 - top), text, fill=255, font=font, anchor="ls")
    turned = mask.transpose(Image.Transpose.ROTATE_90)
    left, up = round(at[0] - turned.width), round(at[1] - 0.5 * turned.height)
    image.paste(Image.new("RGB", turned.size, colour), (left, up), turned)


def _drawable(text: str) -> str:
    """Replace what the font has no picture for, and what is no letter."""
    known = (letter in _MORE or (letter.isprintable() and ord(letter) < _PLAIN) for letter in text)
    return "".join(letter if drawn else "?" for letter, drawn in zip(text, known, strict=True))
