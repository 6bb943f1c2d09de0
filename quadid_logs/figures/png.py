"""Draw a figure as PNG with matplotlib's object interface: no window system, no global state."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from quadid_logs.figures.end_labels import at_the_right, labelled, names_at_ends, spread
from quadid_logs.figures.palette import (
    HEAT_COLOURS,
    HEAT_PERCENTILES,
    LIGHT,
    WIDE_OPACITY,
    band_opacity,
)
from quadid_logs.figures.spec import Curve, Figure, Panel
from quadid_logs.figures.ticks import log_ticks, shown_range

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

_WIDTH_IN = 10.0
_DPI = 140
_ROW_IN = {1: 1.75, 2: 1.75, 3: 3.2}
_TITLE_IN, _CAPTION_LINE_IN, _GAP_IN = 0.95, 0.17, 0.62
_CAPTION_WIDTH = 150
_MOST_LEGEND_ENTRIES = 12
_END_PT, _LETTER_IN = 8.0, 0.064
_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.edgecolor": LIGHT["muted"],
    "axes.labelcolor": LIGHT["ink"],
    "xtick.color": LIGHT["muted"],
    "ytick.color": LIGHT["muted"],
    "path.simplify": True,
    "path.simplify_threshold": 0.5,
    "agg.path.chunksize": 20000,
}


def write_png(figure: Figure, path: Path | BinaryIO) -> None:
    """Write one figure at print quality.

    Parameters
    ----------
    path : Path or binary file
        Overwritten if it exists; the caller decides about that.
    """
    from matplotlib import rc_context

    with rc_context(_STYLE):  # type: ignore[arg-type]
        draw(figure).savefig(path, format="png", dpi=_DPI, pil_kwargs={"compress_level": 2})


def draw(figure: Figure) -> Canvas:
    """Return an ordinary matplotlib figure, which pyplot does not know of."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with rc_context(_STYLE):  # type: ignore[arg-type]
        canvas = _draw(figure)
        FigureCanvasAgg(canvas)
    return canvas


def _draw(figure: Figure) -> Canvas:
    """Lay out title, panels, legend and caption."""
    from matplotlib.figure import Figure as Canvas

    caption = textwrap.wrap(_drawable(figure.caption), _CAPTION_WIDTH)
    rows = [
        figure.panels[first : first + figure.columns]
        for first in range(0, len(figure.panels), figure.columns)
    ]
    base = _ROW_IN[figure.columns] if len(rows) > 1 or figure.columns == 3 else 3.2
    heights = [base * max(panel.height for panel in row) for row in rows]
    below_in = 0.62 + _CAPTION_LINE_IN * len(caption)
    total_in = _TITLE_IN + sum(heights) + _GAP_IN * (len(heights) - 1) + below_in
    canvas = Canvas(figsize=(_WIDTH_IN, total_in), facecolor="white")
    # The number of letters of the longest name at the end of a line.
    names = [curve.label for panel in at_the_right(figure) for curve in labelled(panel)]
    grid = canvas.add_gridspec(
        len(heights),
        figure.columns,
        height_ratios=heights,
        left=0.085,
        right=0.985 - _LETTER_IN * max(map(len, names), default=0) / _WIDTH_IN,
        top=1.0 - _TITLE_IN / total_in,
        bottom=below_in / total_in,
        hspace=_GAP_IN / (sum(heights) / len(heights)),
        wspace={1: 0.0, 2: 0.2, 3: 0.3}[figure.columns],
    )
    shared: Axes | None = None
    drawn: list[Axes] = []
    for number, panel in enumerate(figure.panels):
        axes = canvas.add_subplot(
            grid[divmod(number, figure.columns)], sharex=shared if figure.over_time else None
        )
        shared = shared or axes
        drawn.append(axes)
        bottom = number >= len(figure.panels) - figure.columns
        _draw_panel(axes, panel, with_x_label=bottom or not figure.over_time)
    # Not all of the canvas: colour scales are axes as well.
    for axes, panel in zip(drawn, figure.panels, strict=True):
        if any(panel is one for one in at_the_right(figure)):
            _name_ends(axes, panel)
    canvas.text(0.012, 1.0 - 0.1 / total_in, _drawable(figure.title), va="top", fontsize=13, weight="bold")
    canvas.text(0.012, 0.08 / total_in, "\n".join(caption), va="bottom", fontsize=8.5, color=LIGHT["muted"])
    _legend(canvas, figure, total_in)
    return canvas


def _name_ends(axes: Axes, panel: Panel) -> None:
    """Write the names of lines beside their ends; after all panels are drawn, whose ranges are shared."""
    ends = []
    for curve in labelled(panel):
        known = np.flatnonzero(np.isfinite(curve.y))
        if known.size:
            point = axes.transData.transform((curve.x[known[-1]], curve.y[known[-1]]))
            ends.append((curve, *axes.transAxes.inverted().transform(point)))
    height_pt = 72.0 * axes.get_window_extent().height / axes.figure.dpi
    places = spread([float(up) for _, _, up in ends], 1.15 * _END_PT / height_pt)
    for (curve, right, _), place in zip(ends, places, strict=True):
        axes.annotate(
            _drawable(curve.label), (right, place), xycoords="axes fraction", xytext=(4, 0),
            textcoords="offset points", ha="left", va="center", fontsize=_END_PT, color=LIGHT[curve.role],
        )  # fmt: skip


def _draw_panel(axes: Axes, panel: Panel, *, with_x_label: bool) -> None:
    """Draw one panel."""
    axes.set_title(_drawable(panel.title), loc="left", y=1.0, fontsize=9.5, color=LIGHT["ink"], pad=3)
    axes.grid(color=LIGHT["grid"], linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for band in panel.bands:
        shade = axes.axvspan if band.along == "x" else axes.axhspan
        shade(band.start, band.end, color=LIGHT[band.role], alpha=band_opacity(band.role), linewidth=0)
    if panel.heat is not None:
        known = panel.heat.z[np.isfinite(panel.heat.z)]
        low, high = np.percentile(known, HEAT_PERCENTILES)
        colours: dict[str, Any] = {"cmap": HEAT_COLOURS.lower(), "vmin": low, "vmax": high}
        mesh = axes.pcolormesh(
            panel.heat.x, panel.heat.y, panel.heat.z, **colours, shading="nearest", rasterized=True
        )
        axes.figure.colorbar(mesh, ax=axes, label=_drawable(panel.heat.unit), fraction=0.05, pad=0.02)
    for ribbon in panel.ribbons:
        colour, opacity = LIGHT[ribbon.role], band_opacity("interval")
        axes.fill_between(ribbon.x, ribbon.low, ribbon.high, color=colour, alpha=opacity, linewidth=0)
    for curve in panel.curves:
        _draw_curve(axes, curve)
    for level in panel.levels:
        along_y = level.along == "y"
        add_line = axes.axhline if along_y else axes.axvline
        add_line(level.value, color=LIGHT[level.role], linewidth=1.1, linestyle=(0, (5, 2)), zorder=3)
        if level.label:
            axes.annotate(
                _drawable(level.label),
                (0.995, level.value) if along_y else (level.value, 0.97),
                xycoords=("axes fraction", "data") if along_y else ("data", "axes fraction"),
                xytext=(0, 2) if along_y else (3, 0),
                textcoords="offset points",
                ha="right" if along_y else "left",
                va="bottom" if along_y else "top",
                fontsize=8,
                zorder=5,
                bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.0},
            )
    for label in panel.labels:
        axes.text(
            label.x, label.y, _drawable(label.text), color=LIGHT[label.role], ha="center", va="center",
            fontsize=10, weight="bold", zorder=4,
        )  # fmt: skip
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    _set_axis(axes, "x", panel, labelled=with_x_label)
    _set_axis(axes, "y", panel, labelled=True)
    if panel.note:
        axes.text(
            0.99, 0.97, _drawable(panel.note), transform=axes.transAxes, ha="right", va="top", fontsize=8,
            zorder=5, bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.5},
        )  # fmt: skip


def _draw_curve(axes: Axes, curve: Curve) -> None:
    """Draw one series the way its mark says."""
    colour = LIGHT[curve.role]
    if curve.mark == "points":
        axes.plot(curve.x, curve.y, ".", color=colour, markersize=2.5, alpha=0.6, rasterized=True)
    elif curve.mark == "bars":
        # Lengths below and above, 0 where unknown.
        error = None
        if curve.low is not None and curve.high is not None:
            lengths = np.array([curve.y - curve.low, curve.high - curve.y])
            error = np.where(np.isfinite(lengths), np.maximum(lengths, 0.0), 0.0)
        axes.errorbar(
            curve.x,
            curve.y,
            yerr=error,
            fmt="o",
            color=colour,
            markersize=5,
            capsize=4,
            linewidth=1.4,
        )
    else:
        width = {"line": 0.9, "wide": 3.2, "dashed": 0.9, "thick": 7.0}[curve.mark]
        style = "--" if curve.mark == "dashed" else "-"
        opacity = WIDE_OPACITY if curve.mark == "wide" else 1.0
        axes.plot(
            curve.x, curve.y, style, color=colour, alpha=opacity, linewidth=width, solid_capstyle="butt"
        )


def _set_axis(axes: Axes, name: str, panel: Panel, *, labelled: bool) -> None:
    """Set scale, range, ticks and label of one axis."""
    axis = panel.x if name == "x" else panel.y
    if axis.log:
        from matplotlib.ticker import NullLocator

        # Minor ticks without labels took a fifth of the time of drawing.
        axes.set(**{f"{name}scale": "log"})
        getattr(axes, f"{name}axis").set_minor_locator(NullLocator())
        shown = shown_range(panel, name)
        if shown is not None:
            limits = getattr(axes, f"get_{name}lim")()
            ticks = log_ticks(*shown)
            axes.set(
                **{
                    f"{name}ticks": [tick.value for tick in ticks],
                    f"{name}ticklabels": [tick.text for tick in ticks],
                }
            )
            # A tick beyond the data would widen the axis.
            axes.set(**{f"{name}lim": limits})
    if axis.low is not None or axis.high is not None:
        axes.set(**{f"{name}lim": (axis.low, axis.high)})
    if axis.ticks:
        positions, labels = zip(*axis.ticks, strict=True)
        axes.set(**{f"{name}ticks": positions, f"{name}ticklabels": [_drawable(word) for word in labels]})
    if labelled:
        axes.set(**{f"{name}label": _drawable(axis.title)})
    else:
        axes.tick_params(labelbottom=False)


def _legend(canvas: Canvas, figure: Figure, total_in: float) -> None:
    """Put one legend for all panels under the title."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: dict[str, Any] = {}
    at_ends = names_at_ends(figure)
    for panel in figure.panels:
        for curve in panel.curves:
            if curve.mark != "thick" and curve.label not in at_ends:
                point = curve.mark == "points"
                handles.setdefault(
                    _drawable(curve.label),
                    Line2D(
                        [],
                        [],
                        color=LIGHT[curve.role],
                        linewidth=4.0 if curve.mark == "wide" else 2.0,
                        alpha=WIDE_OPACITY if curve.mark == "wide" else 1.0,
                        marker="o" if point else "",
                        linestyle="" if point else "-",
                    ),
                )
        shaded = [(band.label, band.role, band_opacity(band.role)) for band in panel.bands if band.label]
        shaded += [(ribbon.label, ribbon.role, band_opacity("interval")) for ribbon in panel.ribbons]
        for label, role, opacity in shaded:
            handles.setdefault(_drawable(label), Patch(color=LIGHT[role], alpha=min(1.0, 2.0 * opacity)))
    shown = list(handles.items())[:_MOST_LEGEND_ENTRIES]
    canvas.legend(
        [handle for _, handle in shown],
        [label for label, _ in shown],
        loc="upper left",
        bbox_to_anchor=(0.0, 1.0 - 0.33 / total_in),
        ncols=max(1, len(shown)),
        frameon=False,
        fontsize=8.0,
        handlelength=1.4,
        columnspacing=1.2,
    )


def _drawable(text: str) -> str:
    """Replace what the built-in font has no picture for, and keep "$" from being read as TeX."""
    plain = "".join(letter if ord(letter) < 0x250 or letter in "−…–" else "?" for letter in text)
    return plain.replace("\\", "/").replace("$", r"\$")
