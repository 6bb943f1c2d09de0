"""Turn a figure into what Plotly.js draws: plain dictionaries, with colours as "@role".

The page replaces "@role" by the colour of the light or the dark palette. The
plotly package is not imported (that takes a second); only its script is used.
"""

from __future__ import annotations

import base64
import html
from typing import Any

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.figures.end_labels import at_the_right, labelled, names_at_ends
from quadid_logs.figures.palette import HEAT_COLOURS, HEAT_PERCENTILES, WIDE_OPACITY, band_opacity
from quadid_logs.figures.spec import Axis, Curve, Figure, Heat, Panel, Ribbon
from quadid_logs.figures.ticks import log_ticks, shown_range

_ROW_PX = {1: 190.0, 2: 180.0, 3: 300.0}
_NARROW_ROW_PX = 200.0
_LOW_ROW_PX = 170.0
_TOP_PX, _BOTTOM_PX = 56.0, 54.0
_LEGEND_ROW_PX, _LEGEND_WIDE_PX, _LEGEND_NARROW_PX = 20.0, 900.0, 290.0
_GAP_PX, _GAP_WITH_LABEL_PX = 34.0, 74.0
_COLUMN_GAP = 0.09
_BOXED = {"bgcolor": "@paper", "opacity": 0.85}
_MOST_LEGEND_BANDS = 12
_RIGHT_PX, _LETTER_PX, _LETTER_NARROW_PX = 14, 7.0, 6.4


def interactive(figure: Figure) -> dict[str, Any]:
    """Return traces, and one layout for wide and one for narrow screens.

    ``key``, ``over_time``, ``data`` and ``layouts`` (``wide``, ``narrow``), ready for `json.dumps`; arrays
    are base64 typed arrays, in which a gap is NaN. A trace whose ``meta`` says ``end`` bears its name at its
    end in the panels at the right edge; the page's script puts it there, because it moves with the zoom.
    """
    seen = set(map(_name, names_at_ends(figure)))
    traces = [
        trace
        for number, panel in enumerate(figure.panels, start=1)
        for trace in (
            *(() if panel.heat is None else (_heat(panel.heat, number),)),
            *(_shaded(ribbon, number, seen) for ribbon in panel.ribbons),
            *(_trace(curve, panel, number, seen) for curve in panel.curves),
        )
    ]
    # Empty traces explain the shading in the legend.
    bands = {band.label: band for panel in figure.panels for band in panel.bands if band.label}
    traces += [
        {
            "type": "scatter",
            "name": _name(label),
            "legendgroup": _name(label),
            "x": [None],
            "y": [None],
            "mode": "markers",
            "hoverinfo": "skip",
            "marker": {
                "symbol": "square",
                "size": 11,
                "color": f"@{band.role}",
                "opacity": min(1.0, 2.5 * band_opacity(band.role)),
            },
        }
        for label, band in list(bands.items())[:_MOST_LEGEND_BANDS]
    ]
    return {
        "key": figure.key,
        "over_time": figure.over_time,
        "data": traces,
        "layouts": {"wide": _layout(figure, figure.columns), "narrow": _layout(figure, 1, narrow=True)},
    }


def _heat(heat: Heat, number: int) -> dict[str, Any]:
    """Return a map of colours in 254 steps, finer than eyes tell apart; with gaps, as full numbers."""
    known = np.isfinite(heat.z)
    low, high = (float(one) for one in np.percentile(heat.z[known], HEAT_PERCENTILES))
    step = (high - low) / 254.0 or 1.0
    scaled = np.clip((heat.z - low) / step, 0.0, 254.0)
    ticks = np.linspace(low, high, 4)
    shape = {"shape": f"{heat.z.shape[0]}, {heat.z.shape[1]}"}
    return {
        "type": "heatmap",
        "name": _name(heat.label),
        "xaxis": _axis_id("x", number),
        "yaxis": _axis_id("y", number),
        "x": _typed(heat.x, "f4"),
        "y": _typed(heat.y, "f4"),
        "z": _typed(scaled, "u1" if known.all() else "f4") | shape,
        "zmin": 0,
        "zmax": 254,
        "colorscale": HEAT_COLOURS,
        "hoverinfo": "x+y",
        "showscale": number == 1,
        "colorbar": {
            "title": {"text": html.escape(heat.unit, quote=False), "side": "right"},
            "thickness": 8,
            "tickvals": [float((tick - low) / step) for tick in ticks],
            "ticktext": [f"{tick:.0f}" for tick in ticks],
        },
    }


def _shaded(ribbon: Ribbon, number: int, seen: set[str]) -> dict[str, Any]:
    """Return the area between two lines, out along the upper one and back along the lower one."""
    name = _name(ribbon.label)
    known = np.isfinite(ribbon.low) & np.isfinite(ribbon.high)
    x, low, high = ribbon.x[known], ribbon.low[known], ribbon.high[known]
    trace = {
        "type": "scatter",
        "name": name,
        "legendgroup": name,
        "showlegend": name not in seen,
        "xaxis": _axis_id("x", number),
        "yaxis": _axis_id("y", number),
        "x": _typed(np.concatenate([x, x[::-1]]), _shortest(x)),
        "y": _typed(np.concatenate([high, low[::-1]]), "f4"),
        "mode": "lines",
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": f"@{ribbon.role}",
        "opacity": band_opacity("interval"),
        "hoverinfo": "skip",
    }
    seen.add(name)
    return trace


def _trace(curve: Curve, panel: Panel, number: int, seen: set[str]) -> dict[str, Any]:
    """Return one Plotly trace; a label enters the legend once."""
    name = _name(curve.label)
    colour = f"@{curve.role}"
    unit = f" {panel.y.unit.replace('^2', '²')}" if panel.y.unit else ""
    trace: dict[str, Any] = {
        "type": "scatter",
        "name": name,
        "legendgroup": name,
        "showlegend": curve.mark != "thick" and name not in seen,
        "xaxis": _axis_id("x", number),
        "yaxis": _axis_id("y", number),
        "x": _typed(curve.x, _shortest(curve.x)),
        "y": _typed(curve.y, "f4"),
        "mode": "markers" if curve.mark in {"points", "bars"} else "lines",
        "hovertemplate": f"%{{y:.4~g}}{html.escape(unit, quote=False)}",
    }
    seen.add(name)
    meta = {"samples": curve.samples, "end": curve in labelled(panel)}
    if any(meta.values()):
        trace["meta"] = {name: value for name, value in meta.items() if value}
    if curve.mark == "points":
        trace["marker"] = {"color": colour, "size": 4, "opacity": 0.55}
    elif curve.mark == "bars":
        trace["marker"] = {"color": colour, "size": 8}
        if curve.low is not None and curve.high is not None:
            up, down = curve.high - curve.y, curve.y - curve.low
            trace["error_y"] = {
                "type": "data",
                "symmetric": False,
                "array": _typed(np.where(np.isfinite(up), up, 0.0), "f4"),
                "arrayminus": _typed(np.where(np.isfinite(down), down, 0.0), "f4"),
                "color": colour,
                "thickness": 1.6,
            }
    else:
        width = {"line": 1.3, "wide": 4.5, "dashed": 1.3, "thick": 10}[curve.mark]
        trace["line"] = {
            "color": colour,
            "width": width,
            "dash": "dash" if curve.mark == "dashed" else "solid",
        }
    if curve.mark == "wide":
        trace["opacity"] = WIDE_OPACITY
    if curve.mark == "thick":
        trace["hovertemplate"] = "%{x:.4~g} s"
    return trace


def _layout(figure: Figure, columns: int, *, narrow: bool = False) -> dict[str, Any]:
    """Return axes, shading and notes for a given number of columns."""
    rows = [figure.panels[first : first + columns] for first in range(0, len(figure.panels), columns)]
    base_px = _ROW_PX[columns] if columns == figure.columns else _NARROW_ROW_PX
    if len(rows) == 1 and columns < 3:
        base_px = _ROW_PX[3]
    if figure.low:
        base_px = _LOW_ROW_PX
    heights = [base_px * max(panel.height for panel in row) for row in rows]
    gap_px = _GAP_PX if figure.over_time else _GAP_WITH_LABEL_PX
    inside_px = sum(heights) + gap_px * (len(rows) - 1)
    legend_px = _LEGEND_NARROW_PX if narrow else _LEGEND_WIDE_PX * (0.65 if figure.low else 1.0)
    # How many rows the legend needs: Plotly gives every entry the width of the longest.
    labels = {curve.label for panel in figure.panels for curve in panel.curves if curve.mark != "thick"}
    labels -= names_at_ends(figure)
    labels |= {band.label for panel in figure.panels for band in panel.bands if band.label}
    labels |= {ribbon.label for panel in figure.panels for ribbon in panel.ribbons}
    longest_px = _LETTER_PX * max(map(len, labels), default=0) + 48.0
    top_px = _TOP_PX + _LEGEND_ROW_PX * (-(-len(labels) // max(1, int(legend_px / longest_px))))
    # To the right, names at the ends of lines.
    panels = figure.panels if narrow else at_the_right(figure)
    longest = max((len(curve.label) for panel in panels for curve in labelled(panel)), default=0)
    layout: dict[str, Any] = {
        "height": round(inside_px + top_px + _BOTTOM_PX),
        "margin": {
            "l": 66,
            "r": _RIGHT_PX + round(longest * (_LETTER_NARROW_PX if narrow else _LETTER_PX)),
            "t": top_px,
            "b": _BOTTOM_PX,
        },
        "paper_bgcolor": "@paper",
        "plot_bgcolor": "@paper",
        "font": {"color": "@ink", "size": 12, "family": "system-ui, sans-serif"},
        "hovermode": "x unified" if figure.over_time else "closest",
        "hoverlabel": {"bgcolor": "@paper", "font": {"color": "@ink"}},
        "dragmode": "zoom",
        "legend": {
            "orientation": "h",
            "x": 0,
            "y": 1 + 24 / inside_px,
            "yanchor": "bottom",
            "xanchor": "left",
        },
        "shapes": [],
        "annotations": [],
        # A decimal point, and nothing between thousands: seconds of a log are no sums of money.
        "separators": ".",
    }
    top = 1.0
    for row, (panels, height) in enumerate(zip(rows, heights, strict=True)):
        bottom = max(0.0, top - height / inside_px)
        for column, panel in enumerate(panels):
            number = row * columns + column + 1
            with_labels = not figure.over_time or number > len(figure.panels) - columns
            # Left and right end of a column, as fractions of the width.
            width = (1.0 - _COLUMN_GAP * (columns - 1)) / columns
            left = column * (width + _COLUMN_GAP)
            x_domain = (left, min(1.0, left + width))
            _add_axes(layout, figure, panel, number, (x_domain, (bottom, top)), labelled=with_labels)
        top = bottom - gap_px / inside_px
    return layout


def _name(label: str) -> str:
    """Return a label as Plotly shows it: as text, whatever it holds."""
    return html.escape(label, quote=False)


def _add_axes(
    layout: dict[str, Any],
    figure: Figure,
    panel: Panel,
    number: int,
    domains: tuple[tuple[float, float], tuple[float, float]],
    *,
    labelled: bool,
) -> None:
    """Add both axes, the title, the shading and the reference lines of one panel."""
    x_id, y_id = _axis_id("x", number), _axis_id("y", number)
    x_axis = _axis(panel, "x", domains[0]) | {"anchor": y_id, "showticklabels": labelled}
    if figure.low:
        # Three beside each other: the times of a log take seven letters each.
        x_axis |= {"nticks": 3, "tickangle": 0}
    if not labelled:
        x_axis.pop("title")
    if figure.over_time:
        leader = 1
    elif not (panel.x.log and panel.x.unit == "Hz"):
        leader = 0
    else:
        mine = panel.x, shown_range(panel, "x")
        alike = ((each.x, shown_range(each, "x")) == mine for each in figure.panels)
        leader = next(number for number, same in enumerate(alike, start=1) if same)
    first = _axis_id("x", leader or number)
    if first != x_id:
        x_axis["matches"] = first
    layout[_axis_id("xaxis", number)] = x_axis
    layout[_axis_id("yaxis", number)] = _axis(panel, "y", domains[1]) | {"anchor": x_id}
    if panel.equal:
        layout[_axis_id("yaxis", number)] |= {"scaleanchor": x_id, "scaleratio": 1}
    layout["shapes"] += _shapes(panel, x_id, y_id)
    title = f"<b>{html.escape(panel.title, quote=False)}</b>"
    layout["annotations"].append(_text(title, (x_id, y_id), (0.0, 1.0), ("left", "bottom")))
    layout["annotations"] += [
        {
            "text": f"<b>{html.escape(label.text, quote=False)}</b>",
            "xref": x_id,
            "yref": y_id,
            "x": label.x,
            "y": label.y,
            "showarrow": False,
            "font": {"size": 14, "color": f"@{label.role}"},
        }
        for label in panel.labels
    ]
    for level in panel.levels:
        if level.label:
            # At the end of the line.
            along_y = level.along == "y"
            axis = panel.y if along_y else panel.x
            place = float(np.log10(level.value)) if axis.log else level.value
            words = html.escape(level.label, quote=False)
            if along_y:
                written = _text(words, (x_id, y_id), (1.0, place), ("right", "bottom")) | {"yref": y_id}
            else:
                written = _text(words, (x_id, y_id), (place, 1.0), ("left", "top")) | {"xref": x_id}
            layout["annotations"].append(written | _BOXED)
    if panel.note:
        note = html.escape(panel.note, quote=False)
        layout["annotations"].append(_text(note, (x_id, y_id), (1.0, 1.0), ("right", "top")) | _BOXED)


def _axis(panel: Panel, name: str, domain: tuple[float, float]) -> dict[str, Any]:
    """Return one Plotly axis."""
    axis: Axis = panel.x if name == "x" else panel.y
    plotly: dict[str, Any] = {
        "domain": [round(end, 5) for end in domain],
        "title": {"text": html.escape(axis.title, quote=False), "standoff": 6},
        "type": "log" if axis.log else "linear",
        "gridcolor": "@grid",
        "linecolor": "@muted",
        "zeroline": False,
        "automargin": False,
    }
    if name == "x" and axis.unit and not axis.log and not axis.ticks:
        # The suffix of the last tick is what the hover shows everywhere.
        plotly |= {"ticksuffix": f" {axis.unit}", "showticksuffix": "last"}
    shown = shown_range(panel, name) if axis.log else None
    if shown is not None:
        ticks = log_ticks(*shown)
        plotly["tickvals"] = [tick.value for tick in ticks]
        plotly["ticktext"] = [tick.text for tick in ticks]
    if axis.low is not None and axis.high is not None:
        ends = [axis.low, axis.high]
        plotly["range"] = [float(np.log10(end)) for end in ends] if axis.log else ends
    elif axis.low is not None:
        plotly["rangemode"] = "tozero"
    if axis.ticks:
        plotly["tickvals"] = [position for position, _ in axis.ticks]
        plotly["ticktext"] = [html.escape(word, quote=False) for _, word in axis.ticks]
    return plotly


def _shapes(panel: Panel, x_id: str, y_id: str) -> list[dict[str, Any]]:
    """Return bands below the curves and reference lines above them."""
    shapes: list[dict[str, Any]] = []
    for band in panel.bands:
        along, across = ("x", "y") if band.along == "x" else ("y", "x")
        shapes.append(
            _across(x_id, y_id, band.along)
            | {
                "type": "rect",
                "layer": "below",
                f"{along}0": band.start,
                f"{along}1": band.end,
                f"{across}0": 0,
                f"{across}1": 1,
                "fillcolor": f"@{band.role}",
                "opacity": band_opacity(band.role),
                "line": {"width": 0},
            }
        )
    for level in panel.levels:
        along, across = ("x", "y") if level.along == "x" else ("y", "x")
        ends = {f"{along}0": level.value, f"{along}1": level.value, f"{across}0": 0, f"{across}1": 1}
        line = {"color": f"@{level.role}", "width": 1.4, "dash": "dash"}
        shapes.append(_across(x_id, y_id, level.along) | {"type": "line", "line": line} | ends)
    return shapes


def _across(x_id: str, y_id: str, along: str) -> dict[str, str]:
    """Return the references of a shape that spans the panel in the other direction."""
    if along == "x":
        return {"xref": x_id, "yref": f"{y_id} domain"}
    return {"xref": f"{x_id} domain", "yref": y_id}


def _text(
    text: str, axes: tuple[str, str], at: tuple[float, float], anchor: tuple[str, str]
) -> dict[str, Any]:
    """Return an annotation at a place given as fractions of its panel."""
    return {
        "text": text,
        "xref": f"{axes[0]} domain",
        "yref": f"{axes[1]} domain",
        "x": at[0],
        "y": at[1],
        "xanchor": anchor[0],
        "yanchor": anchor[1],
        "showarrow": False,
        "align": anchor[0],
        "font": {"size": 12},
    }


def _axis_id(name: str, number: int) -> str:
    """Return Plotly's name of an axis: the first one bears no number."""
    return name if number == 1 else f"{name}{number}"


def _shortest(values: FloatArray) -> str:
    """Return the shorter type where no eye can see its rounding, at any zoom that still shows points."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "f4"
    rounding = float(np.abs(finite).max()) * float(np.finfo(np.float32).eps)
    return "f4" if rounding < float(np.ptp(finite)) / 1e5 else "f8"


def _typed(values: FloatArray, dtype: str) -> dict[str, str]:
    """Return a base64 typed array, as Plotly.js reads it (since 2.28)."""
    data = np.ascontiguousarray(values, dtype=f"<{dtype}").tobytes()
    return {"dtype": dtype, "bdata": base64.b64encode(data).decode("ascii")}
