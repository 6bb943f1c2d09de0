"""The one picture that convinces, or does not: rates that the fit never saw, and their prediction."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.model import FitSeries
from quadid_logs.data.result import Result
from quadid_logs.figures.bode import response_to_commands_panel
from quadid_logs.figures.spec import Axis, Curve, Figure, LeftOut, Panel, Ribbon
from quadid_logs.figures.thinning import thin_line
from quadid_logs.figures.time_series import CLOSE_LOOK_S, RATE_AXIS, spans
from quadid_logs.identify.parameters import MIN_SIMULATED_R2
from quadid_logs.maths.band import high_pass
from quadid_logs.vocabulary import AXES, RATE_SYMBOLS

KEY: Final = "evidence"
_TITLE = "Validation data: measured and predicted rates"
_TITLE_BY_COMMANDS = "Measured and predicted"
_IN_TIME = (
    f"The most excited part of each axis, up to {CLOSE_LOOK_S:g} s [deg/s]. Simulated from the logged "
    "torque only, without motion slower than the fitted band ({hz:.2g} Hz)."
)
_BY_COMMANDS = (
    "Air also moves an axis that is marked 'by commands'. Its chart shows the acceleration for a commanded "
    "torque ({unit}). Dots: measured, with 95 % intervals. Line: the model."
)
#: Said where a line leaves its chart.
RUNS_AWAY: Final = (
    "The scale is that of the measured motion. A line leaves the chart where the model's errors add up."
)
#: The band holds this fraction of the held-out errors.
_HELD = 0.95
#: Three charts share the width of two thirds of a screen; the fit's own figures show every sample.
_BUCKETS = 300
#: The chart shows the measured rate; a model that runs away leaves it.
_ROOM = 0.3


class Held(NamedTuple):
    """Held-out seconds of one axis: time [s], rates [deg/s], and how far off the prediction is [deg/s]."""

    time_s: FloatArray
    measured: FloatArray
    predicted: FloatArray
    error: float

    def curves(self) -> tuple[Curve, ...]:
        """Return the measured rate below, the predicted one on it."""
        measured, predicted = (
            thin_line(self.time_s, values, _BUCKETS) for values in (self.measured, self.predicted)
        )
        return (
            Curve(label="measured", x=measured[0], y=measured[1], role="measured", mark="wide"),
            Curve(label="predicted", x=predicted[0], y=predicted[1], role="modelled"),
        )

    def ribbons(self) -> tuple[Ribbon, ...]:
        """Return the band that holds most of the held-out errors."""
        if not np.isfinite(self.error):
            return ()
        x, y = thin_line(self.time_s, self.predicted, _BUCKETS)
        low, high = y - self.error, y + self.error
        return (Ribbon(label="95 % of validation errors", x=x, low=low, high=high, role="interval"),)

    def axis(self) -> Axis:
        """Return the axis of the rate, held to what was measured where the prediction leaves it."""
        known = self.measured[np.isfinite(self.measured)]
        if not known.size:
            return RATE_AXIS
        low, high = float(known.min()), float(known.max())
        room = max(_ROOM * (high - low), min(self.error, high - low) if np.isfinite(self.error) else 0.0)
        return Axis(label=RATE_AXIS.label, unit=RATE_AXIS.unit, low=low - room, high=high + room)

    @property
    def runs_away(self) -> bool:
        """Whether the prediction leaves the chart."""
        low, high = self.axis().low, self.axis().high
        known = self.predicted[np.isfinite(self.predicted)]
        return bool(low is not None and high is not None and ((known < low) | (known > high)).any())


def evidence_figure(result: Result) -> Figure | LeftOut:
    """Show the most excited held-out seconds of every axis."""
    model, found = result.identification.recommended, held_out_seconds(result)
    if model is None or len(found) < len(AXES):
        reason = "No model was fitted." if model is None else "No data were kept for validation."
        return LeftOut(key=KEY, title=_TITLE, reason=reason)
    verdicts = result.diagnosis.axes
    panels: list[Panel] = []
    unit, in_time_too, runs_away = "", False, False
    for axis, symbol, held in zip(AXES, RATE_SYMBOLS, found, strict=True):
        refused = axis in verdicts and verdicts[axis].verdict == "refused"
        r2 = model.validation.r2_high_passed_rate.get(symbol, float("nan"))
        explained = ": refused" if refused else ""
        if not refused and np.isfinite(r2):
            explained = f": {100.0 * r2:.3g} % predicted" if r2 > 0.0 else ": nothing predicted"
        in_time = Panel(
            title=axis.capitalize() + explained,
            x=Axis(label="time", unit="s"),
            y=replace(held.axis(), label="" if panels else RATE_AXIS.label),
            curves=held.curves(),
            ribbons=() if refused else held.ribbons(),
        )
        answer = answer_to_commands(result, axis)
        if answer is not None:
            unit = answer.y.unit.replace("^2", "²")
            answer = replace(answer, y=replace(answer.y, label=""))
        in_time_too |= answer is None
        runs_away |= answer is None and held.runs_away
        panels.append(answer or in_time)
    return Figure(
        key=KEY,
        title=_TITLE_BY_COMMANDS if unit else _TITLE,
        caption=" ".join(
            filter(
                None,
                (
                    _IN_TIME.format(hz=slowest_hz(result)) if in_time_too else "",
                    _BY_COMMANDS.format(unit=unit) if unit else "",
                    RUNS_AWAY if runs_away else "",
                ),
            )
        ),
        panels=tuple(panels),
        columns=3,
        low=True,
    )


def answer_to_commands(result: Result, axis: str) -> Panel | None:
    """Show what an axis is judged by that air moves as well; None where the torque tells its motion.

    Parameters
    ----------
    result : Result
    axis : str
        "roll", "pitch" or "yaw".
    """
    identified, verdict = result.identification, result.diagnosis.axes.get(axis)
    model = identified.recommended
    told = any(each.is_told for each in identified.spectral[AXES.index(axis) :][:1])
    if model is None or not told or verdict is None or verdict.verdict == "refused":
        return None
    r2 = model.validation.r2_high_passed_rate.get(RATE_SYMBOLS[AXES.index(axis)], float("nan"))
    return None if r2 >= MIN_SIMULATED_R2 else response_to_commands_panel(result, axis)


def held_out_seconds(result: Result) -> tuple[Held, ...]:
    """Return for each axis the held-out seconds that move it most, without what is slower than the fit.

    Of roll, pitch and yaw; empty where there is no model or nothing was held out.
    """
    model = result.identification.recommended
    fit = None if model is None else model.fit
    if model is None or fit is None:
        return ()
    shown = [most_excited_seconds(fit, column) for column in range(len(AXES))]
    # Measured and predicted held-out rates, high-passed, (n_samples, 6) [rad/s]; NaN elsewhere.
    cutoff_hz = slowest_hz(result)
    rates = np.column_stack([fit.rate, fit.simulated_rate])
    known = fit.held_out & np.isfinite(rates).all(axis=1)
    fast = np.full_like(rates, np.nan)
    for start_s, end_s in spans(fit.time_s, known):
        rows = np.flatnonzero(known & (fit.time_s >= start_s) & (fit.time_s <= end_s))
        if rows.size > 1:
            period_s = (end_s - start_s) / (rows.size - 1)
            fast[rows] = high_pass(rates[rows], period_s, cutoff_hz)
    held = []
    for column, chosen in enumerate(shown):
        if chosen is not None:
            measured, predicted = np.degrees(fast[:, column]), np.degrees(fast[:, len(AXES) + column])
            off = np.abs(predicted - measured)
            off = off[np.isfinite(off)]
            error = float(np.quantile(off, _HELD)) if off.size else float("nan")
            held.append(Held(fit.time_s[chosen], measured[chosen], predicted[chosen], error))
    return tuple(held)


def slowest_hz(result: Result) -> float:
    """Return the lower edge of the fitted band [Hz]."""
    model = result.identification.recommended
    if model is not None and model.band is not None:
        return float(model.band.low_hz[0])
    return result.settings.identify.high_pass_hz


def most_excited_seconds(fit: FitSeries, column: int) -> BoolArray | None:
    """Return which held-out seconds move an axis most.

    Parameters
    ----------
    column : int
        The axis: 0 roll, 1 pitch, 2 yaw.

    Returns
    -------
    ndarray of bool, shape (n_samples,), or None
        At most the first `CLOSE_LOOK_S` of the held-out segment whose
        acceleration has the largest standard deviation; None without any.
    """
    # At most as many seconds as an eye can follow.
    ends_s = (
        (start_s, min(end_s, start_s + CLOSE_LOOK_S)) for start_s, end_s in spans(fit.time_s, fit.held_out)
    )
    segments = [(fit.time_s >= start_s) & (fit.time_s <= end_s) for start_s, end_s in ends_s]
    segments = [chosen for chosen in segments if np.count_nonzero(chosen) > 1]
    if not segments:
        return None
    return max(segments, key=lambda part: float(np.std(np.nan_to_num(fit.acceleration[part, column]))))
