"""Figures of the fitted model against the flight that it did not see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import FitSeries, Model
from quadid_logs.data.result import Result
from quadid_logs.figures.evidence import RUNS_AWAY, most_excited_seconds
from quadid_logs.figures.spec import BODY_RATE, Axis, Band, Curve, Figure, LeftOut, Level, Mark, Panel
from quadid_logs.figures.thinning import CARRIED, thin_line
from quadid_logs.figures.time_series import CLOSE_LOOK_S, MOST_BANDS, TIME, spans
from quadid_logs.vocabulary import (
    ACCELERATION_SYMBOLS,
    AXES,
    RATE_SYMBOLS,
    TORQUE_SYMBOLS,
    term_words,
)

_ACCELERATION = Axis(label="angular acceleration", unit="deg/s²")
_HELD_OUT = " Shaded: validation data, which the fit did not use. Judge the model there."
_SERIES_ROLES = 4
#: So many structures have names that need half of a page.
_MANY_STRUCTURES = 4


def fit_figures(result: Result) -> list[Figure | LeftOut]:
    """Show measured and modelled acceleration, measured and simulated rate, and what is left over."""
    model = result.identification.recommended
    fit = None if model is None else model.fit
    if model is None or fit is None or not fit.time_s.size:
        reason = "No model was fitted." if model is None else "The model keeps no series to compare."
        return [LeftOut(key="fit", title="Fit", reason=reason)]
    series = (fit.acceleration, fit.modelled_acceleration)
    panels = _pair(fit.time_s, series, ("measured", "model"), _ACCELERATION, _held_out(fit))
    known = model.validation.r2_acceleration
    notes = [_r2_note(known.get(symbol)) for symbol in ACCELERATION_SYMBOLS]
    return [
        _close_look(model, fit),
        Figure(
            key="fit",
            title=f"Measured and modelled acceleration: {model.structure}",
            caption="The two lines should lie on each other, peaks included." + _HELD_OUT,
            panels=_noted(panels, notes),
            over_time=True,
        ),
        _simulation(model, fit),
        _residuals(model, fit),
    ]


def _close_look(model: Model, fit: FitSeries) -> Figure | LeftOut:
    """Show the most excited held-out seconds at full resolution."""
    title = f"A close look at validation data: {model.structure}"
    panels: list[Panel] = []
    for column in range(len(AXES)):
        chosen = most_excited_seconds(fit, column)
        if chosen is None:
            return LeftOut(key="held-out", title=title, reason="No data were kept for validation.")
        acceleration = (fit.acceleration[chosen], fit.modelled_acceleration[chosen])
        rate = (fit.rate[chosen], fit.simulated_rate[chosen])
        for series, axis in ((acceleration, _ACCELERATION), (rate, BODY_RATE)):
            panels.append(_pair(fit.time_s[chosen], series, ("measured", "model"), axis)[column])
    return Figure(
        key="held-out",
        title=title,
        caption=(
            f"The most excited validation data of each axis, up to {CLOSE_LOOK_S:g} s. The fit did not use "
            "them. Left: the measured angular acceleration, and that caused by the torque in the model. "
            "Right: the measured rate, and that simulated from the logged torque only. Where the lines "
            "differ, the model is wrong."
        )
        + _run_away(panels),
        panels=tuple(panels),
        columns=2,
    )


def _held_out(fit: FitSeries) -> tuple[Band, ...]:
    """Return a band per held-out segment."""
    segments = spans(fit.time_s, fit.held_out)[: 2 * MOST_BANDS]
    return tuple(Band(start=start, end=end, role="held-out", label="validation") for start, end in segments)


def _pair(
    time_s: FloatArray,
    series: tuple[FloatArray, FloatArray],
    labels: tuple[str, str],
    axis: Axis,
    bands: tuple[Band, ...] = (),
) -> list[Panel]:
    """Return a panel per axis with a measured and a modelled line."""
    panels = []
    for column, name in enumerate(AXES):
        curves = []
        for label, role, values in zip(labels, ("measured", "modelled"), series, strict=True):
            x, y = thin_line(time_s, np.degrees(values[:, column]), CARRIED)
            mark: Mark = "wide" if role == "measured" else "line"
            curves.append(Curve(label=label, x=x, y=y, role=role, mark=mark, samples=time_s.size))
        # The axis, held to the measured values where a diverging model would flatten them
        measured = np.degrees(series[0][:, column])
        modelled = np.degrees(series[1][:, column])
        y_axis = axis
        if np.isfinite(measured).any() and np.isfinite(modelled).any():
            low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
            margin = (high - low) or 1.0
            shown = modelled[np.isfinite(modelled)]
            if not (shown.min() > low - margin and shown.max() < high + margin):
                y_axis = replace(axis, low=low - margin, high=high + margin)
        panels.append(
            Panel(
                title=name.capitalize(),
                x=TIME,
                y=y_axis,
                curves=tuple(curves),
                bands=bands,
                model_of=name,
            )
        )
    return panels


def _noted(panels: list[Panel], notes: list[str]) -> tuple[Panel, ...]:
    """Return the panels with a note inside each."""
    return tuple(replace(panel, note=note) for panel, note in zip(panels, notes, strict=True))


def _simulation(model: Model, fit: FitSeries) -> Figure:
    """Compare the rates that the model predicts with the measured ones."""
    series = (fit.rate, fit.simulated_rate)
    panels = _pair(fit.time_s, series, ("measured", "simulated"), BODY_RATE, _held_out(fit))
    known = model.validation.r2_simulated_rate
    notes = [_r2_note(known.get(symbol)) for symbol in RATE_SYMBOLS]
    return Figure(
        key="simulation",
        title=f"Measured and simulated rates: {model.structure}",
        caption=(
            "Simulated from the logged torque only, in blocks of some seconds. Each block starts at the "
            "measured rate. This is the hardest test, because errors add up."
        )
        + _HELD_OUT
        + _run_away(panels),
        panels=_noted(panels, notes),
        over_time=True,
    )


def _run_away(panels: Sequence[Panel]) -> str:
    """Say why a line leaves its chart, if one does: only then is the axis held to what was measured."""
    return f" {RUNS_AWAY}" if any(panel.y.low is not None for panel in panels) else ""


def _r2_note(r2: float | None) -> str:
    """Say R2 on held-out data, or nothing."""
    if r2 is None or not np.isfinite(r2):
        return ""
    # Below zero it is worse than no model at all, and by how much tells nobody anything.
    return f"validation R² {r2:.3f}" if r2 > 0.0 else "validation R² below 0"


def _residuals(model: Model, fit: FitSeries) -> Figure:
    """Show what the model leaves unexplained, over time and as a distribution."""
    bands = _held_out(fit)
    left_over = np.degrees(fit.acceleration - fit.modelled_acceleration)
    panels: list[Panel] = []
    for column, axis in enumerate(AXES):
        x, y = thin_line(fit.time_s, left_over[:, column], CARRIED)
        line = Curve(label="measured − model", x=x, y=y, role=axis, samples=fit.time_s.size)
        panels.append(
            Panel(
                title=axis.capitalize(),
                x=TIME,
                y=_ACCELERATION,
                curves=(line,),
                bands=bands,
                model_of=axis,
            )
        )
        # Histograms of the residual of fitted and of held-out samples.
        own = left_over[:, column]
        finite = np.isfinite(own)
        reach = float(np.quantile(np.abs(own[finite]), 0.998)) if finite.any() else 1.0
        edges = np.linspace(-reach or -1.0, reach or 1.0, 61)
        curves = []
        for label, role, chosen in (("fitted", axis, ~fit.held_out), ("validation", "ink", fit.held_out)):
            values = own[finite & chosen]
            if values.size:
                percent = np.histogram(values, edges)[0] * (100.0 / values.size)
                curves.append(Curve(label=label, x=(edges[1:] + edges[:-1]) / 2.0, y=percent, role=role))
        panels.append(
            Panel(
                title=f"{axis.capitalize()}: distribution",
                x=Axis(label="residual", unit="deg/s²"),
                y=Axis(label="fraction of samples", unit="%"),
                curves=tuple(curves),
                model_of=axis,
            )
        )
    return Figure(
        key="residuals",
        title=f"Residuals: {model.structure}",
        caption=(
            "The part of the acceleration that the model does not explain. It should look like even noise. "
            "A bulge during a manoeuvre means missing physics. On the right, fitted and validation data "
            "should have the same width."
        ),
        panels=tuple(panels),
        columns=2,
    )


def lag_profile(result: Result) -> Figure | LeftOut:
    """Show how the held-out error changes with actuator lag and with delay."""
    title = "Actuator lag and delay"
    model = result.identification.recommended
    actuator = None if model is None else model.actuator
    if actuator is None or actuator.loss.size == 0:
        return LeftOut(key="lag", title=title, reason="No lag or delay was fitted.")
    panels = (
        _profile(
            "Lag", actuator.lag_grid_s, np.nanmin(actuator.loss, axis=1), actuator.lag_s, actuator.lag_ci95_s
        ),
        _profile(
            "Delay",
            actuator.delay_grid_s,
            np.nanmin(actuator.loss, axis=0),
            actuator.delay_s,
            actuator.delay_ci95_s,
        ),
    )
    acts_on = f"the {actuator.acts_on}" if actuator.acts_on else "the torque"
    return Figure(
        key="lag",
        title=title,
        caption=(
            "Left: the unexplained part of the acceleration for each assumed lag. Right: the same for each "
            f"assumed delay. The other one has its best value. The lag acts on {acts_on}. A deep valley "
            "means a well-known value. A flat valley means that this flight cannot separate lag and delay."
        ),
        panels=panels,
        columns=2,
    )


def _profile(
    name: str, grid_s: FloatArray, loss: FloatArray, best_s: float, ci95_s: tuple[float, float]
) -> Panel:
    """Return the error along one grid, with the estimate and its interval."""
    milliseconds = 1e3
    low, high = ci95_s
    bands: tuple[Band, ...] = ()
    if np.isfinite(low) and np.isfinite(high):
        bands = (
            Band(start=low * milliseconds, end=high * milliseconds, role="interval", label="95 % interval"),
        )
    level = Level(value=best_s * milliseconds, role="ink", label=f"{best_s * milliseconds:.1f} ms", along="x")
    curve = Curve(label="unexplained fraction", x=grid_s * milliseconds, y=loss, role="estimate")
    return Panel(
        title=name,
        x=Axis(label=name.lower(), unit="ms"),
        y=Axis(label="unexplained fraction, 1 − R²"),
        curves=(curve,),
        bands=bands,
        levels=(level,) if np.isfinite(best_s) else (),
    )


def horizon_error(result: Result) -> Figure | LeftOut:
    """Show how the error of a prediction grows with its length, for every structure."""
    title = "Prediction error by horizon"
    models = [model for model in result.identification.models if model.validation.horizon_rmse_rad_s]
    if not models:
        return LeftOut(key="horizon", title=title, reason="No data were kept for validation.")
    panels = tuple(
        Panel(
            title=axis.capitalize(),
            x=Axis(label="prediction horizon", unit="s", low=0.0),
            y=Axis(label="rate error (RMS)", unit="deg/s", low=0.0),
            curves=_horizon_curves(models, symbol),
        )
        for axis, symbol in zip(AXES, RATE_SYMBOLS, strict=True)
    )
    return Figure(
        key="horizon",
        title=title,
        caption=(
            "Error of the predicted rate on validation data, after 0.1 s and longer. The lowest line is "
            "the best structure. The first tenths of a second matter for controller design."
        ),
        panels=panels,
        columns=3,
    )


def _horizon_curves(models: list[Model], symbol: str) -> tuple[Curve, ...]:
    """Return one line per structure that predicts this rate."""
    curves = []
    for number, model in enumerate(models):
        errors = np.degrees(np.array(model.validation.horizon_rmse_rad_s.get(symbol, ()), dtype=np.float64))
        horizons = np.array(model.validation.horizon_s[: errors.size], dtype=np.float64)
        if errors.size:
            curves.append(
                Curve(label=model.structure, x=horizons, y=errors[: horizons.size], role=_series_role(number))
            )
    return tuple(curves)


def _series_role(number: int) -> str:
    """Return a colour per structure."""
    return f"series-{number % _SERIES_ROLES + 1}"


def structure_comparison(result: Result) -> Figure | LeftOut:
    """Show the diagonal of B with its interval for every structure."""
    title = "Control effectiveness by structure"
    models = result.identification.models
    panels = [
        panel
        for axis, target, torque in zip(AXES, ACCELERATION_SYMBOLS, TORQUE_SYMBOLS, strict=True)
        if (panel := _structure_panel(models, axis, target, torque)) is not None
    ]
    if len(models) < 2 or not panels:
        return LeftOut(key="structures", title=title, reason="There are no two structures to compare.")
    return Figure(
        key="structures",
        title=title,
        caption=(
            "The same quantity from every structure, with 95 % intervals. Structures that agree within "
            "their intervals support each other. If an interval spans zero, the value is not known."
        ),
        panels=tuple(panels),
        # Four names under a third of the page would cover each other.
        columns=3 if len(models) < _MANY_STRUCTURES else 2,
    )


def _structure_panel(models: tuple[Model, ...], axis: str, target: str, torque: str) -> Panel | None:
    """Return one point with an error bar per structure."""
    found = [
        (number, model.structure, parameter)
        for number, model in enumerate(models)
        if (parameter := model.entries.get((target, torque))) is not None and np.isfinite(parameter.value)
    ]
    if not found:
        return None
    curves = tuple(
        Curve(
            label=structure,
            x=np.array([float(number)]),
            y=np.array([parameter.value]),
            low=np.array([parameter.ci95[0]]),
            high=np.array([parameter.ci95[1]]),
            role=_series_role(number),
            mark="bars",
        )
        for number, structure, parameter in found
    )
    ticks = tuple((float(number), model.structure) for number, model in enumerate(models))
    return Panel(
        title=axis.capitalize(),
        x=Axis(label="", ticks=ticks, low=-0.6, high=len(models) - 0.4),
        y=Axis(label=term_words(target, torque), unit=found[0][2].unit),
        curves=curves,
        model_of=axis,
    )
