"""Structures, windows and excitation as tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from quadid_logs.arrays import FloatArray, runs
from quadid_logs.data.model import Model, Windows
from quadid_logs.data.result import Result
from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.numbers import number, percent
from quadid_logs.report.verdict import input_unit, refused_axes
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, ON_AXIS, RATE_SYMBOLS


def structures_table(result: Result) -> Table | None:
    """Compare all structures by what they predict of held-out data."""
    models, distrusted = result.identification.models, refused_axes(result)
    if not models:
        return None
    return Table(
        caption="All structures, judged on validation data (roll / pitch / yaw)",
        head=(
            "structure",
            "diagonal of B",
            "R² acceleration",
            "R² simulated rate",
            "fit [%]",
            "condition number",
        ),
        rows=tuple(_structure(model, distrusted) for model in models),
        note=(
            "At best, R² is 1 and fit is 100 %. Below 0, the model is worse than none. Noise in the "
            "acceleration lowers R², and no model can explain it."
        )
        + (" In brackets: refused axes, not to be trusted." if any(distrusted) else ""),
    )


def _structure(model: Model, distrusted: tuple[bool, ...]) -> tuple[Cell, ...]:
    """Return one row of the table of structures."""
    on_axis = [model.entries.get(place) for place in ON_AXIS.values()]
    diagonal = [math.nan if parameter is None else parameter.value for parameter in on_axis]
    checked = model.validation
    return (
        Cell(text=model.structure, detail="recommended" if model.recommended else printable(model.note, 240)),
        Cell(text=_three(diagonal, distrusted)),
        Cell(text=_three(values_of(checked.r2_acceleration, ACCELERATION_SYMBOLS), distrusted, low=0.0)),
        Cell(text=_three(values_of(checked.r2_simulated_rate, RATE_SYMBOLS), distrusted, low=0.0)),
        Cell(text=_three(values_of(checked.fit_percent, RATE_SYMBOLS), distrusted, low=0.0)),
        Cell(text=number(model.condition_number, 3)),
    )


def values_of(values: Mapping[str, float], symbols: tuple[str, ...]) -> list[float]:
    """Return the value of each symbol, NaN where there is none."""
    return [values.get(symbol, math.nan) for symbol in symbols]


def _three(values: Iterable[float], bracketed: tuple[bool, ...], low: float = -math.inf) -> str:
    """Return three values in one cell, some in brackets; how far one lies below `low` is not told."""
    texts = [f"< {low:g}" if value < low else number(value, 3) for value in values]
    return " / ".join(f"({text})" if no else text for text, no in zip(texts, bracketed, strict=True))


def windows_table(result: Result) -> Table | None:
    """Return how well the windows of each structure could be solved."""
    rows = tuple(
        _window_row(model.structure, model.windows)
        for model in result.identification.models
        if model.windows is not None and model.windows.time_s.size
    )
    if not rows:
        return None
    return Table(
        caption="Windows: H_k is solved for each one by itself",
        head=("structure", "windows", "used", "width × stride", "condition number", "full rank"),
        rows=rows,
        note=(
            "Condition number of the column-scaled H_k: median, then 5 to 95 %. The relative error of a "
            "window's coefficients is at most the condition number times the relative error of its data."
        ),
    )


def _window_row(structure: str, windows: Windows) -> tuple[Cell, ...]:
    """Return one row of the table of windows."""
    low, middle, high = np.quantile(windows.condition_number, [0.05, 0.5, 0.95], method="nearest")
    full = float(np.mean(windows.rank == windows.coefficients.shape[2]))
    return (
        Cell(text=structure),
        Cell(text=str(windows.time_s.size)),
        Cell(text=percent(float(np.mean(windows.used)))),
        Cell(
            text=f"{windows.width} × {windows.stride}", detail=f"{number(windows.period_s * 1e3, 3)} ms apart"
        ),
        Cell(text=number(float(middle), 3), detail=f"{number(float(low), 3)} to {number(float(high), 3)}"),
        Cell(text=percent(full)),
    )


def excitation_table(result: Result) -> Table | None:
    """Return how much each axis was excited."""
    items = result.identification.excitation
    if not items:
        return None
    unit = "N m" if input_unit(result) == "N m" else "normalised"
    rows = tuple(
        (
            Cell(text=item.axis),
            Cell(text=number(item.torque_rms, 3)),
            Cell(text=number(math.degrees(item.rate_rms_rad_s), 3)),
            Cell(text=number(item.signal_to_noise, 3)),
            Cell(text=_coherent(item.frequency_hz, item.coherence)),
        )
        for item in items
    )
    return Table(
        caption="Excitation of each axis",
        head=("axis", f"torque RMS [{unit}]", "rate RMS [deg/s]", "signal to noise", "coherent (above 0.5)"),
        rows=rows,
        note=(
            "Signal to noise: power of the acceleration that the torque explains, divided by the power of "
            "the rest."
        ),
    )


def _coherent(frequency_hz: FloatArray, coherence: FloatArray) -> str:
    """Return the widest span of frequencies, in octaves, all over which torque and rate belong together."""
    known = frequency_hz > 0.0
    frequency_hz, good = frequency_hz[known], coherence[known] > 0.5
    spans = [(float(frequency_hz[first]), float(frequency_hz[after - 1])) for first, after in runs(good)]
    if not spans:
        return "nowhere"
    low, high = max(spans, key=lambda span: span[1] / span[0])
    return f"{number(low, 2)} to {number(high, 2)} Hz"
