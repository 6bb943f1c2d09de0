"""Figures of the flight itself: the whole log, and the part that was analyzed."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, runs
from quadid_logs.data.flight import FlightData, InputDescription
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import Axis, Band, Curve, Figure, LeftOut, Panel
from quadid_logs.figures.thinning import CARRIED, break_at_gaps, thin_line, thin_points
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES, RATE_SYMBOLS, TORQUE_SYMBOLS

#: As long as an eye can follow a manoeuvre [s].
CLOSE_LOOK_S = 5.0
TIME = Axis(label="time on the log's clock", unit="s")
RATE_AXIS = Axis(label="body rate", unit="deg/s")
ANGLE_AXIS = Axis(label="angle", unit="deg")
ANGLE_NAMES = ("roll angle", "pitch angle", "yaw angle")
#: More shaded intervals than this are noise to the eye and weight to the file.
MOST_BANDS = 60
_MODE_ROLES = 6
_HALF_TURN_DEG = 180.0


def torque_axis(description: InputDescription | None, kind: str = "") -> Axis:
    """Return the axis of the torque, which says whether it is N m or a normalised command."""
    if (description.kind if description else kind) == "torque_n_m":
        return Axis(label="torque", unit="N m")
    return Axis(label="torque", unit="normalised")


def flight_overview(result: Result) -> Figure | LeftOut:
    """Show rates, attitude and torque over the whole log, with modes and the analyzed segments."""
    data = result.data
    title = "The whole flight"
    torque = "torque_n_m" if "torque_n_m" in data.overview else "torque_command"
    candidates = (
        _overview_panel(data, "body_rate", RATE_AXIS, RATE_SYMBOLS, np.degrees(1.0)),
        _overview_panel(data, "attitude", ANGLE_AXIS, ANGLE_NAMES, np.degrees(1.0)),
        _overview_panel(data, torque, torque_axis(None, torque), TORQUE_SYMBOLS, 1.0),
    )
    panels = [panel for panel in candidates if panel is not None]
    if not panels:
        return LeftOut(key="flight", title=title, reason="The log holds neither rates, attitude nor torque.")
    bands, hidden = mode_bands(data)
    more = f" Only the first {MOST_BANDS} of {MOST_BANDS + hidden} modes are shaded." if hidden else ""
    caption = (
        "Shading shows the flight modes. The bars below show when the vehicle flew and which segments were "
        "analyzed. A gap in a line means that the log holds no data there." + more
    )
    shaded = [
        Panel(title=panel.title, x=TIME, y=panel.y, curves=panel.curves, bands=bands) for panel in panels
    ]
    return Figure(
        key="flight", title=title, caption=caption, panels=(*shaded, _timeline(result)), over_time=True
    )


def _overview_panel(
    data: FlightData, signal: str, axis: Axis, names: tuple[str, ...], scale: float
) -> Panel | None:
    """Return the panel of one signal, None where the log has none."""
    overview = data.overview.get(signal)
    if overview is None or not overview.time_s.size:
        return None
    # One thinned line per axis of the vehicle.
    time_s, values = break_at_gaps(overview.time_s, overview.values * scale)
    if overview.signal == "attitude":
        # NaN where an angle passes from 180 to -180 degrees: no vehicle turned between the two.
        after = np.flatnonzero((np.abs(np.diff(values, axis=0)) > _HALF_TURN_DEG).any(axis=1)) + 1
        if after.size:
            time_s, values = np.insert(time_s, after, time_s[after]), np.insert(values, after, np.nan, axis=0)
    return Panel(title=axis.label.capitalize(), x=TIME, y=axis, curves=axis_curves(time_s, values, names))


def axis_curves(time_s: FloatArray, values: FloatArray, names: tuple[str, ...]) -> tuple[Curve, ...]:
    """Return roll, pitch and yaw lines of (n_samples, 3) values, thinned for display."""
    curves = []
    for column, (name, role) in enumerate(zip(names, AXES, strict=True)):
        x, y = thin_line(time_s, values[:, column], CARRIED)
        curves.append(Curve(label=name, x=x, y=y, role=role, samples=time_s.size))
    return tuple(curves)


def mode_bands(data: FlightData) -> tuple[tuple[Band, ...], int]:
    """Return a band per flight mode, and how many more there would be."""
    # Of pooled logs, modes are those of the first, as the overview is.
    ends = [float(each.time_s[-1]) for each in data.overview.values() if each.time_s.size]
    end_s = max(ends, default=data.start_s + data.duration_s)
    edges = [*(mode.time_s for mode in data.modes), end_s][1:]
    names = list(dict.fromkeys(mode.name for mode in data.modes))
    bands = tuple(
        Band(
            start=mode.time_s,
            end=until_s,
            role=f"mode-{names.index(mode.name) % _MODE_ROLES + 1}",
            label=printable(mode.name, 24),
        )
        for mode, until_s in zip(data.modes[:MOST_BANDS], edges[:MOST_BANDS], strict=True)
        if until_s > mode.time_s
    )
    return bands, max(0, len(data.modes) - MOST_BANDS)


def _timeline(result: Result) -> Panel:
    """Return the bars of what was flown, analyzed and kept for validation."""
    data = result.data
    model = result.identification.recommended
    held_out = () if model is None or model.fit is None else spans(model.fit.time_s, model.fit.held_out)
    rows = (
        ("validation", "held-out", held_out),
        (
            "gap-free" if model is None else "analyzed",
            "analyzed",
            tuple((segment.start_s, segment.end_s) for segment in data.segments),
        ),
        ("in the air", "muted", data.flights),
    )
    curves = tuple(
        Curve(label=name, role=role, mark="thick", x=x, y=y)
        for height, (name, role, intervals) in enumerate(rows)
        for x, y in (_bars(intervals, float(height)),)
    )
    ticks = tuple((float(height), name) for height, (name, _, _) in enumerate(rows))
    y = Axis(label="", low=-0.6, high=2.6, ticks=ticks)
    return Panel(title="Use of the data", x=TIME, y=y, curves=curves, height=0.45)


def _bars(intervals: tuple[tuple[float, float], ...], height: float) -> tuple[FloatArray, FloatArray]:
    """Return x and y of horizontal bars, NaN between them."""
    x = np.array([value for start, end in intervals[:MOST_BANDS] for value in (start, end, end)])
    y = np.full(x.shape, height)
    y[2::3] = np.nan
    return x, y


def spans(time_s: FloatArray, mask: BoolArray) -> tuple[tuple[float, float], ...]:
    """Return start and end [s] of each run of True in `mask` (n_samples,)."""
    return tuple((float(time_s[first]), float(time_s[after - 1])) for first, after in runs(mask))


def aligned_series(result: Result) -> Figure | LeftOut:
    """Show rate and torque of each axis as they went into the identification."""
    data = result.data
    title = "The aligned series"
    if not data.segments:
        reason = data.on_ground_reason or "No segment of the log can be analyzed."
        return LeftOut(key="aligned", title=title, reason=printable(reason))
    time_s, rate, torque, saturated = _joined(data)
    y_torque = torque_axis(data.input)
    panels = []
    for column, axis in enumerate(AXES):
        x, y = thin_line(time_s, np.degrees(rate[:, column]), CARRIED)
        line = Curve(label=RATE_SYMBOLS[column], x=x, y=y, role=axis, samples=time_s.size)
        panels.append(Panel(title=f"{axis.capitalize()} rate", x=TIME, y=RATE_AXIS, curves=(line,)))
        x, y = thin_line(time_s, torque[:, column], CARRIED)
        line = Curve(label=TORQUE_SYMBOLS[column], x=x, y=y, role=axis, samples=time_s.size)
        x, y = thin_points(time_s[saturated], torque[saturated, column], (400, 60))
        marks = Curve(label="saturated", x=x, y=y, role="saturated", mark="points")
        curves = (line, marks) if x.size else (line,)
        panels.append(Panel(title=f"{axis.capitalize()} torque", x=TIME, y=y_torque, curves=curves))
    caption = (
        "The data that the model was fitted to: torque and rate on one clock, "
        f"{1.0 / data.sample_period_s:.0f} samples per second. The rate should respond to every change of "
        "its torque. A constant torque excites nothing."
    )
    if saturated.any():
        caption += " Red points: the motors could not give this torque, or it was clipped."
    return Figure(
        key="aligned", title=title, caption=caption, panels=tuple(panels), columns=2, over_time=True
    )


def _joined(data: FlightData) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return time, rates, torques and saturation of all segments, a NaN row between them."""
    gap = np.full((1, 3), np.nan)
    times: list[FloatArray] = []
    rates: list[FloatArray] = []
    torques: list[FloatArray] = []
    saturated: list[BoolArray] = []
    for segment in data.segments:
        times += [segment.time_s, np.array([segment.end_s + data.sample_period_s])]
        rates += [segment.body_rate_rad_s, gap]
        torques += [segment.torque, gap]
        saturated += [segment.saturated, np.array([False])]
    return (
        np.concatenate(times),
        np.concatenate(rates),
        np.concatenate(torques),
        np.concatenate(saturated),
    )
