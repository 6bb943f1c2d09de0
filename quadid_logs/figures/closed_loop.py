"""Figures of the loop that controller and vehicle make."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.room import whole
from quadid_logs.data.closed_loop import AxisLoop, LoopCurve
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import (
    BODY_RATE,
    FREQUENCY,
    Axis,
    Band,
    Curve,
    Figure,
    Label,
    LeftOut,
    Level,
    Mark,
    Panel,
    Ribbon,
)
from quadid_logs.figures.thinning import thin_line
from quadid_logs.figures.time_series import CLOSE_LOOK_S, TIME, spans, torque_axis

#: Farther from zero than this, an open loop says nothing about stability.
_NYQUIST = 3.0
#: A rate loop that is of use answers within this time [s].
STEP_S = 1.5


def loop_figures(result: Result) -> list[Figure | LeftOut]:
    """Show what the set-points predict, the open loop twice, and the step response."""
    axes = {} if result.closed_loop is None else result.closed_loop.axes
    known = {axis: found for axis, found in axes.items() if found.margins is not None}
    return [
        _figure(
            "loop-tracking",
            "Set-point, rate and torque",
            "The most excited seconds of the validation data. Left: the commanded rate, the measured rate, "
            "and the rate that model and controller predict from the set-points alone. Right: the torque "
            "for it. Feedback makes the predicted rate right even with a wrong model. The torque is right "
            "only with the right model.",
            [panel for axis, found in known.items() for panel in _tracking(axis, found)],
            columns=2,
        ),
        _figure(
            "loop-bode",
            "The open loop, cut at the mixer",
            "Gain and phase around the loop. Where the gain passes 0 dB, the phase must be above -180 "
            "degrees: the distance is the phase margin. Where the phase passes -180 degrees, the gain must "
            "be below 0 dB: the distance is the gain margin. Shaded: the 95 % interval of the line. "
            "Points: the log, as far as set-points or a system-ID excitation show it.",
            _in_rows([_bode(axis, found) for axis, found in known.items()]),
            columns=3,
        ),
        _figure(
            "loop-nyquist",
            "The open loop around the point of instability",
            "The same loop in the complex plane. A loop through -1 oscillates without end. The circle "
            "around -1 shows the disk margin. The loop stays stable while gain and phase together change "
            "by no more than that.",
            _in_rows([_nyquist(axis, found) for axis, found in known.items()]),
            columns=3,
        ),
        _figure(
            "loop-step",
            "Rate step response",
            "The rate step response of the model with its 95 % interval (shaded), and the measured one if "
            "the log shows it. The log's set-points are smoother than a step, so its line overshoots less. "
            "Overshoot and ringing mean little margin.",
            _in_rows([_step(axis, found) for axis, found in known.items()]),
            columns=3,
        ),
    ]


def _figure(key: str, title: str, caption: str, panels: list[Panel], columns: int) -> Figure | LeftOut:
    if not panels:
        return LeftOut(key=key, title=title, reason="No loop is known.")
    return Figure(key=key, title=title, caption=caption, panels=tuple(panels), columns=columns)


def _in_rows(by_axis: list[tuple[Panel, ...]]) -> list[Panel]:
    """Put one axis beside the other; empty panels keep the columns where an axis has nothing."""
    if not any(by_axis):
        return []
    n_rows = max(len(panels) for panels in by_axis)
    empty = Panel(title="", x=Axis(label=""), y=Axis(label=""), curves=())
    filled = [[*panels, *[empty] * (n_rows - len(panels))] for panels in by_axis]
    filled += [[empty] * n_rows] * (3 - len(filled))
    return [panel for row in zip(*filled, strict=True) for panel in row]


def _tracking(axis: str, found: AxisLoop) -> tuple[Panel, ...]:
    """Return rate and torque of one axis, measured and predicted."""
    if found.prediction is None:
        return ()
    series = found.prediction.series
    parts = [
        (series.time_s >= start_s) & (series.time_s <= min(end_s, start_s + CLOSE_LOOK_S))
        for start_s, end_s in spans(series.time_s, series.held_out)
    ]
    chosen = max(parts, key=lambda part: float(np.std(series.torque[part])))
    time_s = series.time_s[chosen]

    def curve(label: str, values: FloatArray, role: str, mark: Mark = "line") -> Curve:
        x, y = thin_line(time_s, values[chosen])
        return Curve(label=label, x=x, y=y, role=role, mark=mark)

    name = axis.capitalize()
    return (
        Panel(
            title=f"{name}: rate",
            x=TIME,
            y=BODY_RATE,
            curves=(
                curve("set-point", np.degrees(series.setpoint), "series-1", "dashed"),
                curve("measured", np.degrees(series.rate), "measured", "wide"),
                curve("predicted", np.degrees(series.predicted_rate), "modelled"),
            ),
            model_of=axis,
        ),
        Panel(
            title=f"{name}: torque",
            x=TIME,
            # A loop is closed per unit of command, whatever the torque was calibrated to.
            y=torque_axis(None),
            curves=(
                curve("measured", series.torque, "measured", "wide"),
                curve("predicted", series.predicted_torque, "modelled"),
            ),
            model_of=axis,
        ),
    )


def _bode(axis: str, found: AxisLoop) -> tuple[Panel, ...]:
    """Return gain and phase of the open loop."""
    curve, measured, name = found.curve, found.measured, axis.capitalize()
    if curve is None:
        return ()
    x, model_rad = curve.frequency_hz, phase_of(curve)
    points: tuple[Curve, ...] = ()
    angles: tuple[Curve, ...] = ()
    if measured is not None:
        at_hz = measured.frequency_hz
        points = (_points(at_hz, decibels(np.abs(measured.response))),)
        # Phases on the turn of the circle that lies nearest to the model's.
        model = np.interp(at_hz, curve.frequency_hz, phase_of(curve))
        apart = np.angle(measured.response) - model
        nearest = model + np.mod(apart + np.pi, 2.0 * np.pi) - np.pi
        angles = (_points(at_hz, np.degrees(nearest)),)
    known = (Band(start=0.1, end=found.known_hz, role="held-out", label="measured or fitted"),)
    return (
        Panel(
            title=f"{name}: gain",
            x=FREQUENCY,
            y=Axis(label="gain", unit="dB", low=-60.0, high=40.0),
            curves=(
                Curve(label="model", x=x, y=decibels(np.abs(curve.response)), role="modelled"),
                *points,
            ),
            ribbons=(_interval(x, decibels(curve.gain_low), decibels(curve.gain_high)),),
            bands=known if found.known_hz > 0.1 else (),
            levels=(Level(value=0.0, role="muted", label="crossover"),),
            model_of=axis,
        ),
        Panel(
            title=f"{name}: phase",
            x=FREQUENCY,
            y=Axis(label="phase", unit="deg", low=-360.0, high=0.0),
            curves=(Curve(label="model", x=x, y=np.degrees(model_rad), role="modelled"), *angles),
            ribbons=(_interval(x, np.degrees(curve.phase_low), np.degrees(curve.phase_high)),),
            levels=(Level(value=-180.0, role="muted", label="instability"),),
            model_of=axis,
        ),
    )


def decibels(gain: FloatArray) -> FloatArray:
    """Return a gain as the margins are told: 20 log10; NaN where there is none."""
    return np.asarray(20.0 * np.log10(np.where(gain > 0.0, gain, np.nan)), dtype=np.float64)


def _interval(x: FloatArray, low: FloatArray, high: FloatArray) -> Ribbon:
    return Ribbon(label="95 % interval", x=x, low=low, high=high, role="interval")


def phase_of(curve: LoopCurve) -> FloatArray:
    """Return the model's phase [rad] on the turn of the circle that its interval lies on."""
    own = np.unwrap(np.angle(curve.response))
    middle = 0.5 * float(np.median(curve.phase_low + curve.phase_high))
    turns = np.round((middle - float(np.median(own))) / (2.0 * np.pi))
    return np.asarray(own + 2.0 * np.pi * turns, dtype=np.float64)


def _points(x: FloatArray, y: FloatArray) -> Curve:
    return Curve(label="log", x=x, y=y, role="measured", mark="points")


def _nyquist(axis: str, found: AxisLoop) -> tuple[Panel, ...]:
    """Return the open loop in the complex plane with the disk that it keeps free."""
    curve, measured, margins = found.curve, found.measured, found.margins
    if curve is None or margins is None:
        return ()
    near = np.abs(curve.response) < _NYQUIST
    loop = np.where(near, curve.response, np.nan + 0j)
    curves = [Curve(label="model", x=loop.real, y=loop.imag, role="modelled")]
    disk = whole(margins).disk_margin
    if disk is not None:
        ends = -(2.0 - disk.value) / (2.0 + disk.value), -(2.0 + disk.value) / (2.0 - disk.value)
        turn = np.linspace(0.0, 2.0 * np.pi, 73)
        centre, radius = 0.5 * sum(ends), 0.5 * abs(ends[0] - ends[1])
        x, y = centre + radius * np.cos(turn), radius * np.sin(turn)
        curves.append(Curve(label="disk margin", x=x, y=y, role="interval", mark="dashed"))
    if measured is not None:
        shown = measured.response[np.abs(measured.response) < _NYQUIST]
        curves.append(_points(shown.real, shown.imag))
    return (
        Panel(
            title=axis.capitalize(),
            x=Axis(label="real part"),
            y=Axis(label="imaginary part"),
            curves=tuple(curves),
            labels=(Label(text="-1", x=-1.0, y=0.0, role="ink"),),
            equal=True,
            model_of=axis,
        ),
    )


def _step(axis: str, found: AxisLoop) -> tuple[Panel, ...]:
    """Return the step response with its band, and as measured."""
    step = found.step
    if step is None:
        return ()
    shown = step.time_s <= STEP_S
    x = step.time_s[shown]
    curves = [Curve(label="model", x=x, y=step.response[shown], role="modelled")]
    if step.measured is not None:
        log = Curve(label="log", x=x, y=step.measured[shown], role="measured", mark="wide")
        curves.insert(0, log)
    return (
        Panel(
            title=axis.capitalize(),
            x=Axis(label="time after the step", unit="s"),
            y=Axis(label="rate divided by set-point", low=-0.1),
            curves=tuple(curves),
            ribbons=(_interval(x, step.low[shown], step.high[shown]),),
            levels=(Level(value=1.0, role="muted"),),
            model_of=axis,
        ),
    )
