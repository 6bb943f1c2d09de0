"""Figures of the windows: one solution of H_k each, and how far it can be trusted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.model import Model, Parameter, Windows
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import Axis, Band, Curve, Figure, LeftOut, Level, Panel
from quadid_logs.figures.thinning import break_at_gaps, thin_line, thin_points
from quadid_logs.figures.time_series import TIME
from quadid_logs.maths.sliding_windows import weakest_words
from quadid_logs.numerals import resolved
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, TORQUE_SYMBOLS, term_words

#: Fraction of the windows that a panel must show; the outliers would flatten the picture.
_SHOWN_FRACTION = 0.85
_CONDITION = Axis(label="condition number of H_k", log=True)


class _Effect(NamedTuple):
    """The windows' estimates of one diagonal element of B, and the pooled one."""

    axis: str
    name: str
    estimates: FloatArray
    pooled: Parameter | None
    unit: str


def _effects(model: Model, windows: Windows) -> list[_Effect]:
    """Return roll, pitch and yaw torque effectiveness of every window."""
    effects = []
    for axis, target, torque in zip(AXES, ACCELERATION_SYMBOLS, TORQUE_SYMBOLS, strict=True):
        if target not in model.targets or torque not in model.inputs:
            continue
        row, column = model.targets.index(target), len(model.regressors) + model.inputs.index(torque)
        pooled = model.entries.get((target, torque))
        name = term_words(target, torque)
        unit = pooled.unit if pooled else ""
        effects.append(_Effect(axis, name, windows.coefficients[:, row, column], pooled, unit))
    return effects


def window_figures(result: Result) -> list[Figure | LeftOut]:
    """Show estimate against condition number per structure; the rest for the first one only.

    The first is the recommended one, if it was solved in windows: three more
    figures for every structure would repeat themselves.
    """
    # The models that were solved window by window.
    windowed = tuple(
        (model, model.windows)
        for model in result.identification.models
        if model.windows is not None and model.windows.time_s.size
    )
    if not windowed:
        reason = "No window of H_k could be solved."
        return [LeftOut(key="windows", title="The windows", reason=reason)]
    figures: list[Figure | LeftOut] = [_against_condition(*pair) for pair in windowed]
    return [*figures, _over_time(*windowed[0]), _singular_values(*windowed[0])]


def _against_condition(model: Model, windows: Windows) -> Figure:
    """Plot each window's estimate over how well its equations could be solved."""
    panels = tuple(_condition_panel(effect, windows) for effect in _effects(model, windows))
    caption = (
        f"Each point is one window of {windows.width} samples, {windows.period_s * 1000.0:.3g} ms apart, "
        "with scaled columns. Further right, a larger condition number amplifies small errors of the log, "
        "and points scatter. The line with its band is the pooled estimate with its 95 % interval. If the "
        "median of the windows stays on the line, windows and pooled estimate agree."
    )
    return Figure(
        key=f"condition-{model.structure}",
        title=f"Estimate against condition number: {model.structure}",
        caption=caption,
        panels=panels,
        columns=3,
    )


def _condition_panel(effect: _Effect, windows: Windows) -> Panel:
    """Return the scatter of one axis with the median along it."""
    y_axis, note = _estimate_axis(effect)
    finite = np.isfinite(windows.condition_number) & (windows.condition_number > 0.0)
    curves = _points(
        np.log10(np.where(finite, windows.condition_number, np.nan)), effect, windows.used, y_axis
    )
    curves = [
        Curve(label=curve.label, x=10.0**curve.x, y=curve.y, role=curve.role, mark=curve.mark)
        for curve in curves
    ]
    median = _running_median(windows.condition_number[finite], effect.estimates[finite])
    if median is not None:
        curves.append(median)
    bands, levels = _pooled_marks(effect)
    return Panel(
        title=effect.name.capitalize(),
        x=_CONDITION,
        y=y_axis,
        curves=tuple(curves),
        bands=bands,
        levels=levels,
        note=note,
    )


def _over_time(model: Model, windows: Windows) -> Figure:
    """Plot each window's estimate over the flight."""
    panels = []
    for effect in _effects(model, windows):
        y_axis, note = _estimate_axis(effect)
        bands, levels = _pooled_marks(effect)
        panels.append(
            Panel(
                title=effect.name.capitalize(),
                x=TIME,
                y=y_axis,
                curves=tuple(_points(windows.time_s, effect, windows.used, y_axis)),
                bands=bands,
                levels=levels,
                note=note,
                model_of=effect.axis,
            )
        )
    caption = (
        "The same windows along the flight. A level cloud around the line means that the vehicle stays the "
        "same. A slope or a step may come from a sagging battery, a dropped load or damage. Grey windows "
        "are not used: they are rank deficient or below the noise floor."
    )
    return Figure(
        key="over-time",
        title=f"Window estimates over time: {model.structure}",
        caption=caption,
        panels=tuple(panels),
        over_time=True,
    )


def _points(x: FloatArray, effect: _Effect, used: BoolArray, y_axis: Axis) -> list[Curve]:
    """Return the visible windows, the unused ones below the used ones."""
    low, high = y_axis.low or 0.0, y_axis.high or 0.0
    inside = np.isfinite(x) & (effect.estimates >= low) & (effect.estimates <= high)
    curves = []
    for label, role, chosen in (("unused window", "unused", ~used), ("window", effect.axis, used)):
        picked_x, picked_y = thin_points(x[inside & chosen], effect.estimates[inside & chosen])
        if picked_x.size:
            curves.append(Curve(label=label, x=picked_x, y=picked_y, role=role, mark="points"))
    return curves


def _estimate_axis(effect: _Effect) -> tuple[Axis, str]:
    """Return an axis that shows most windows and the pooled interval, and what it leaves out."""
    finite = effect.estimates[np.isfinite(effect.estimates)]
    pooled = effect.pooled
    if not finite.size and pooled is None:
        return Axis(label="estimate", unit=effect.unit, low=-1.0, high=1.0), "no finite estimate"
    centre = pooled.value if pooled is not None else float(np.median(finite))
    reach = [abs(value - centre) for value in (pooled.ci95 if pooled is not None else ())]
    if finite.size:
        reach.append(float(np.quantile(np.abs(finite - centre), _SHOWN_FRACTION)))
    half = 1.15 * max((value for value in reach if np.isfinite(value)), default=0.0) or max(abs(centre), 1.0)
    outside = float(np.mean(np.abs(finite - centre) > half)) if finite.size else 0.0
    note = f"{100.0 * outside:.0f} % of the windows lie outside" if outside >= 0.005 else ""
    return Axis(label="estimate", unit=effect.unit, low=centre - half, high=centre + half), note


def _pooled_marks(effect: _Effect) -> tuple[tuple[Band, ...], tuple[Level, ...]]:
    """Return the pooled value as a line and its interval as a band."""
    if effect.pooled is None or not np.isfinite(effect.pooled.value):
        return (), ()
    low, high = effect.pooled.ci95
    label = f"pooled {resolved(effect.pooled.value, low, high)}"
    level = Level(value=effect.pooled.value, role="ink", label=label)
    if not (np.isfinite(low) and np.isfinite(high)):
        return (), (level,)
    return (Band(start=low, end=high, role="interval", along="y", label="95 % interval"),), (level,)


def _running_median(condition: FloatArray, estimates: FloatArray) -> Curve | None:
    """Return the median estimate in steps of the condition number, where enough windows are."""
    n_bins, fewest = 24, 8
    finite = np.isfinite(estimates)
    logarithm, estimates = np.log10(condition[finite]), estimates[finite]
    if logarithm.size < n_bins * fewest:
        return None
    lowest, highest = (float(end) for end in np.quantile(logarithm, [0.002, 0.998]))
    edges = np.linspace(lowest, highest, n_bins + 1)
    bin_of = np.digitize(logarithm, edges) - 1
    rows = [
        (10.0 ** float(np.mean(edges[number : number + 2])), float(np.median(estimates[bin_of == number])))
        for number in range(n_bins)
        if np.count_nonzero(bin_of == number) >= fewest
    ]
    x, y = np.array(rows).reshape(-1, 2).T
    return Curve(label="median of the windows", x=x, y=y, role="ink")


def _singular_values(model: Model, windows: Windows) -> Figure:
    """Plot the singular values of H_k against what noise alone would give."""
    caption = (
        "How strongly the flight excited each independent combination of regressors, the strongest first. "
        "A bar that reaches down into the noise floor marks a direction that was not excited. There H_k "
        "holds only noise, even if the condition number looks good. The weakest direction here: "
        f"{weakest_words(windows.weakest, (*model.regressors, *model.inputs))}."
    )
    curves = []
    smallest = windows.singular_values[:, -1]
    for label, role, values in (
        ("smallest", "estimate", smallest),
        ("noise floor", "noise", windows.noise_floor),
    ):
        time_s, broken = break_at_gaps(windows.time_s, _positive(values)[:, np.newaxis])
        x, y = thin_line(time_s, broken[:, 0], 700)
        curves.append(Curve(label=label, x=x, y=y, role=role))
    return Figure(
        key="singular",
        title=f"Singular values against the noise floor: {model.structure}",
        caption=caption,
        panels=(
            _spread_panel(windows),
            Panel(
                title="The weakest direction over time",
                x=TIME,
                y=Axis(label="singular value", log=True),
                curves=tuple(curves),
            ),
        ),
        columns=2,
    )


def _spread_panel(windows: Windows) -> Panel:
    """Return median and 5 to 95 % of each singular value."""
    values = np.where(np.isfinite(windows.singular_values), windows.singular_values, 0.0)
    low, middle, high = _positive(np.quantile(values, [0.05, 0.5, 0.95], axis=0))
    order = np.arange(1.0, values.shape[1] + 1.0)
    noise = windows.noise_floor[np.isfinite(windows.noise_floor) & (windows.noise_floor > 0.0)]
    bands: tuple[Band, ...] = ()
    if noise.size:
        end = float(np.median(noise))
        lowest = float(np.nanmin(low)) if np.isfinite(low).any() else end
        bands = (Band(start=min(lowest, end) / 2.0, end=end, role="noise", along="y", label="noise"),)
    return Panel(
        title="All windows: median and 5 to 95 %",
        x=Axis(label="singular value, strongest first", low=0.5, high=order[-1] + 0.5),
        y=Axis(label="singular value", log=True),
        curves=(
            Curve(
                label="singular value", x=order, y=middle, role="estimate", mark="bars", low=low, high=high
            ),
        ),
        bands=bands,
    )


def _positive(values: FloatArray) -> FloatArray:
    """Return values fit for a logarithmic axis: zero becomes NaN."""
    return np.where(np.isfinite(values) & (values > 0.0), values, np.nan)
