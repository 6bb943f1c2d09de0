"""The figures of what a log shows, whether or not a model comes of it; each caption judges its figure."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import Overview
from quadid_logs.data.health import (
    AxisSteps,
    CommandNoise,
    Course,
    GyroSpectrum,
    Health,
    Line,
    Map,
    Noise,
    Topic,
)
from quadid_logs.data.log import GyroFilter
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import Axis, Curve, Figure, Heat, LeftOut, Level, Mark, Panel, Ribbon
from quadid_logs.figures.thinning import BUCKETS, CARRIED, PAUSE_PERIODS, break_at_gaps, thin_line
from quadid_logs.figures.time_series import TIME
from quadid_logs.maths.band import gyro_response
from quadid_logs.numerals import number
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

_NOT_LOOKED_AT: Final = "The flights of this result were judged one by one."
#: Label, colour and mark of what was flown, and of what was commanded.
_DESIRED_AND_ACTUAL: Final[tuple[tuple[str, str, Mark], ...]] = (
    ("actual", "measured", "wide"),
    ("desired", "series-1", "line"),
)
#: Where a filter leaves less than this, what it was given is lost in the steps of the log's numbers.
_LEAST_GAIN: Final = 0.1
#: More notches than this are those of every rotor's harmonics, and their words would cover each other.
_MOST_NOTCHES: Final = 4
#: Labels of lines whose frequencies lie nearer to each other than this ratio would cover each other.
_LABELS_APART: Final = 4.0
_MOST_POINTS: Final = 600
#: Of a density, what makes one of degrees of that of radians, and one of per cent of that of fractions.
_SQUARE_DEGREES: Final = float(np.degrees(1.0)) ** 2
_SQUARE_PERCENT: Final = 1e4
#: A level further above all data would only press them flat.
_NEAR_LIMIT: Final = 3.0
_ROLES: Final = ("series-1", "series-2", "series-3", "series-4")


def health_figures(result: Result) -> list[Figure | LeftOut]:
    """Return every figure of what the log shows, those that it has no data for with the reason."""
    health = result.health or Health(missing=dict.fromkeys(_TITLES, _NOT_LOOKED_AT))
    # Show the angles that were commanded over those that were flown.
    if health.attitude is None:
        angles: Figure | None = None
    else:
        angles = _followed(
            result,
            "attitude",
            ("attitude", "attitude_setpoint"),
            Axis(label="angle", unit="deg"),
            f"{_said(health.attitude)} Wide line: the vehicle. Thin line: its set-point.",
        )
    rates = steps = None
    if health.tracking is not None:
        rates = _followed(
            result,
            "tracking",
            ("body_rate", "body_rate_setpoint"),
            Axis(label="body rate", unit="deg/s"),
            f"{_said(health.tracking)} Wide line: the rate. Thin line: its set-point. In a good loop the "
            "rate follows a little later. A rate that swings while its set-point is calm is an "
            "oscillation. A rate that stays short of its set-point meets a limit.",
        )
    if health.steps is not None:
        steps = Figure(
            key=_KEYS["steps"],
            title=_TITLES["steps"],
            caption=(
                f"{_said(health.steps)} Computed from set-points and rates of the whole flight. Shaded: the "
                "95 % interval. Dashed: a perfect loop, as sharp as these set-points can show it. A step "
                "counts as large from half of the largest set-points on."
            ),
            panels=tuple(_step_panel(axis, one) for axis, one in health.steps.axes.items()),
            columns=3,
        )
    made: dict[str, Figure | None] = {
        "tracking": rates,
        "rates": _course(health.rates, "rates"),
        "attitude": angles,
        "tilt": _course(health.tilt, "tilt"),
        "steps": steps,
        "noise": _spectrum(health, result.data.gyro_filter),
        "command_noise": _command_spectrum(health.command_noise),
        "maps": _maps(health, result.data.gyro_filter),
        "motors": _motors(health),
        "torque": _course(health.torque, "torque"),
        "throttle": _course(health.throttle, "throttle"),
        "thrust": _course(health.thrust, "thrust"),
        "vibration": _vibration(health),
        "battery": _battery(health),
    }
    return [
        figure or LeftOut(key=_KEYS[name], title=_TITLES[name], reason=_reason(health, name))
        for name, figure in made.items()
    ]


_KEYS: Final = {
    "tracking": "tracking",
    "rates": "rates",
    "attitude": "attitude-tracking",
    "tilt": "tilt",
    "steps": "step-response",
    "noise": "gyro-spectrum",
    "command_noise": "command-spectrum",
    "maps": "spectrogram",
    "motors": "motors",
    "torque": "torque",
    "throttle": "throttle",
    "thrust": "thrust",
    "vibration": "vibration",
    "battery": "battery",
}
#: Drawn where the log holds nothing to compare with.
_INSTEAD: Final = {
    "rates": "The rates are drawn with their set-points above.",
    "tilt": "The log holds no attitude.",
    "torque": "The motor commands are drawn instead.",
    "thrust": "The log holds no thrust in newtons.",
}
_TITLES: Final = {
    "tracking": "Desired and actual rates",
    "rates": "Body rates",
    "attitude": "Desired and actual angles",
    "tilt": "Tilt from the vertical",
    "steps": "Measured step response of the rates",
    "noise": "Spectra of the gyro, after its filters and before them",
    "command_noise": "Spectra of the controller's output",
    "maps": "The gyro's spectrum over time and over throttle",
    "motors": "Motor commands",
    "torque": "Torque that the controller commanded",
    "throttle": "Throttle",
    "thrust": "Thrust and weight",
    "vibration": "Vibration",
    "battery": "Battery under load",
}


def _said(topic: Topic) -> str:
    """Return the sentence that judges a figure."""
    return printable(topic.sentence, 600)


def _reason(health: Health, name: str) -> str:
    if name in _INSTEAD:
        return _INSTEAD[name] if health.topics.keys() - {"standstill"} else _reason(health, "tracking")
    told = health.missing.get("noise" if name == "maps" else name, "the log holds too little")
    return f"{printable(told[:1].upper() + told[1:], 200)}."


def _followed(result: Result, name: str, signals: tuple[str, str], axis: Axis, caption: str) -> Figure | None:
    found = [result.data.overview.get(signal) for signal in signals]
    if any(each is None or not each.time_s.size for each in found):
        return None
    panels = tuple(
        Panel(
            title=title.capitalize(),
            x=TIME,
            y=axis,
            curves=tuple(
                _tracked(each, column, drawn)
                for each, drawn in zip(found, _DESIRED_AND_ACTUAL, strict=True)
                if each is not None
            ),
        )
        for column, title in enumerate(AXES)
    )
    return Figure(key=_KEYS[name], title=_TITLES[name], caption=caption, panels=panels, over_time=True)


def _tracked(overview: Overview, column: int, drawn: tuple[str, str, Mark]) -> Curve:
    """Return one rate [deg/s] or angle [deg] as a line with gaps."""
    label, role, mark = drawn
    values = np.degrees(overview.values[:, column : column + 1])
    time_s, values = break_at_gaps(overview.time_s, values)
    angle = overview.signal.startswith("attitude")
    if angle:
        # No vehicle turned between 180 and -180 degrees.
        after = np.flatnonzero(np.abs(np.diff(values[:, 0])) > 180.0) + 1
        time_s, values = np.insert(time_s, after, time_s[after]), np.insert(values, after, np.nan, axis=0)
    # Angles change slowly: they need no more than a screen shows.
    x, y = thin_line(time_s, values[:, 0], BUCKETS if angle else CARRIED)
    return Curve(label=label, x=x, y=y, role=role, mark=mark, samples=time_s.size)


def _step_panel(axis: str, steps: AxisSteps) -> Panel:
    time_ms = 1e3 * steps.time_s
    roles = {"all": "series-1", "small": "series-3", "large": "series-2"}
    words = {"all": "all steps", "small": "small steps", "large": "large steps"}
    return Panel(
        title=axis.capitalize(),
        x=Axis(label="time after the step", unit="ms"),
        y=Axis(label="rate divided by set-point", unit=""),
        curves=(
            Curve(label="following at once", x=time_ms, y=steps.ideal, role="muted", mark="dashed"),
            *(
                Curve(label=words[one.size], x=time_ms, y=one.response, role=roles[one.size])
                for one in steps.curves
            ),
        ),
        ribbons=tuple(
            Ribbon(label="95 % interval", x=time_ms, low=one.low, high=one.high, role=roles[one.size])
            for one in steps.curves
        ),
        levels=(Level(value=1.0, role="muted"),),
        note=f"small below {np.degrees(steps.split_rad_s):.0f} deg/s" if len(steps.curves) > 1 else "",
    )


def _spectrum(health: Health, known: GyroFilter) -> Figure | None:
    """Show the gyro's spectrum of each axis behind the filters and before them."""
    noise = health.noise
    if noise is None:
        return None
    low_pass_hz, notches = known.low_pass_hz, known.notches
    parts = [f"low-pass of {number(low_pass_hz, 3)} Hz"] if np.isfinite(low_pass_hz) else []
    parts += [f"notch at {number(notch.frequency_hz, 3)} Hz" for notch in notches[:_MOST_NOTCHES]]
    if len(notches) > _MOST_NOTCHES:
        parts.append(f"{len(notches) - _MOST_NOTCHES} more notches")
    for group in known.tracked:
        lowest_hz = [min(notch.frequency_hz for notch in notches) for notches in group if notches]
        if lowest_hz:
            low, high = (number(one, 3) for one in (min(lowest_hz), max(lowest_hz)))
            parts.append(
                f"notches that did not move, the lowest at {low} Hz"
                if low == high
                else f"notches that moved, the lowest from {low} to {high} Hz"
            )
    words = ", ".join(parts)
    filters = f" Known filters: {words}." if words else ""
    if noise.before is None and noise.after is not None and words:
        filters += (
            " The spectrum before the filters is computed from the filtered one, at frequencies where the "
            "filters pass a tenth or more."
        )
    return Figure(
        key=_KEYS["noise"],
        title=_TITLES["noise"],
        caption=f"{_said(noise)}{filters} Below about 10 Hz the spectrum shows the vehicle's own motion.",
        panels=tuple(_spectrum_panel(noise, column, known) for column in range(len(AXES))),
        columns=3,
    )


def _spectrum_panel(noise: Noise, column: int, known: GyroFilter) -> Panel:
    """Return the spectra of one axis with its lines and the notches."""
    curves = []
    if noise.before is not None:
        curves.append(_density("before the filters", noise.before, column, "muted"))
    elif noise.after is not None:
        gain = np.abs(gyro_response(np.asarray(2j * np.pi * noise.after.frequency_hz), *known))
        if not np.allclose(gain, 1.0):
            passed = gain >= _LEAST_GAIN
            before = _SQUARE_DEGREES * noise.after.density[passed, column] / gain[passed] ** 2
            curves.append(
                _line("before the filters, computed", noise.after.frequency_hz[passed], before, "muted")
            )
    if noise.after is not None:
        curves.append(_density("as the controller receives it", noise.after, column, AXES[column]))
    shown = noise.after or noise.before
    highest_hz = float(shown.frequency_hz[-1]) if shown is not None else 0.0
    lines = noise.lines.get(AXES[column], ())
    labelled: list[tuple[Line, str]] = []
    for line in sorted(lines[:2], key=lambda one: -one.height_db):
        near = any(
            label and 1.0 / _LABELS_APART < line.frequency_hz / other.frequency_hz < _LABELS_APART
            for other, label in labelled
        )
        labelled.append((line, "" if near else f"{line.frequency_hz:.3g} Hz"))
    return Panel(
        title=AXES[column].capitalize(),
        x=Axis(label="frequency", unit="Hz", log=True),
        y=Axis(label="rate density", unit="(deg/s)²/Hz", log=True),
        curves=tuple(curves),
        levels=(
            *(
                Level(value=notch.frequency_hz, role="muted", label="notch", along="x")
                for notch in known.notches[:_MOST_NOTCHES]
                if notch.frequency_hz <= highest_hz
            ),
            *(
                Level(value=line.frequency_hz, role="saturated", label=label, along="x")
                for line, label in labelled
            ),
        ),
    )


def _density(label: str, spectrum: GyroSpectrum, column: int, role: str) -> Curve:
    return _line(label, spectrum.frequency_hz, _SQUARE_DEGREES * spectrum.density[:, column], role)


def _line(label: str, frequency_hz: FloatArray, density: FloatArray, role: str) -> Curve:
    known = np.isfinite(density) & (density > 0.0)
    x, y = thin_line(frequency_hz[known], density[known], _MOST_POINTS)
    return Curve(label=label, x=x, y=y, role=role)


def _command_spectrum(noise: CommandNoise | None) -> Figure | None:
    """Show what goes to the mixer, and the terms that it is the sum of."""
    if noise is None:
        return None
    terms = any(one.term_densities for one in noise.axes.values())
    said = " The terms add up to the output, with I, which passes no noise." if terms else ""
    return Figure(
        key=_KEYS["command_noise"],
        title=_TITLES["command_noise"],
        caption=(
            f"{_said(noise)} The output goes to the mixer and from there to the motors.{said} Right of the "
            "line, it only heats them."
        ),
        panels=tuple(
            Panel(
                title=axis.capitalize(),
                x=Axis(label="frequency", unit="Hz", log=True),
                y=Axis(label="output density", unit="%²/Hz", log=True),
                curves=(
                    *(
                        _line(name, noise.frequency_hz, _SQUARE_PERCENT * each, role)
                        for (name, each), role in zip(one.term_densities.items(), _ROLES[1:], strict=False)
                    ),
                    _line("output", noise.frequency_hz, _SQUARE_PERCENT * one.density, "measured"),
                ),
                levels=(Level(value=noise.above_hz, role="muted", along="x"),),
                note=f"{number(100.0 * one.rms.value, 2)} % rms above {noise.above_hz:g} Hz",
            )
            for axis, one in noise.axes.items()
        ),
        columns=3,
    )


def _maps(health: Health, known: GyroFilter) -> Figure | None:
    """Show the spectrum over time and over throttle, with the rotors' speed and the notches."""
    noise = health.noise
    if noise is None or noise.over_time is None:
        return None
    notches = tuple(
        Level(value=notch.frequency_hz, role="paper", label="notch")
        for notch in known.notches[:_MOST_NOTCHES]
        if notch.frequency_hz <= noise.over_time.frequency_hz[-1]
    )
    time_s = noise.over_time.x
    speed: tuple[Curve, ...] = ()
    if noise.rotor_hz.size == time_s.size:
        shown = np.where(noise.rotor_hz <= noise.over_time.frequency_hz[-1], noise.rotor_hz, np.nan)
        x, y = break_at_gaps(time_s, shown[:, np.newaxis])
        speed = (Curve(label="rotors' mean speed", x=x, y=y[:, 0], role="saturated"),)
    panels = [_map_panel("Over time", TIME, _with_pauses(noise.over_time), speed, notches)]
    if noise.over_throttle is not None:
        percent = Axis(label="throttle", unit="%")
        scaled = Map(
            x=100.0 * noise.over_throttle.x,
            frequency_hz=noise.over_throttle.frequency_hz,
            level_db=noise.over_throttle.level_db,
        )
        panels.append(_map_panel("Over throttle", percent, scaled, (), notches))
    return Figure(
        key=_KEYS["maps"],
        title=_TITLES["maps"],
        caption=(
            "All axes together. Bright means strong. A line that rises with the throttle comes from the "
            "rotors. A line that stays comes from the frame, the electronics or the control loop."
        ),
        panels=tuple(panels),
        columns=len(panels),
    )


def _with_pauses(shown: Map) -> Map:
    """Return a map over time that is empty between flights: a cell would reach halfway to the next one."""
    step_s = np.diff(shown.x)
    period_s = float(np.median(step_s))
    after = np.flatnonzero(step_s > PAUSE_PERIODS * period_s) + 1
    ends_s = np.column_stack([shown.x[after - 1] + period_s, shown.x[after] - period_s]).ravel()
    return Map(
        x=np.insert(shown.x, np.repeat(after, 2), ends_s),
        frequency_hz=shown.frequency_hz,
        level_db=np.insert(shown.level_db, np.repeat(after, 2), np.nan, axis=1),
    )


def _map_panel(
    title: str, x: Axis, shown: Map, curves: tuple[Curve, ...], levels: tuple[Level, ...]
) -> Panel:
    return Panel(
        title=title,
        x=x,
        y=Axis(label="frequency", unit="Hz", low=0.0, high=float(shown.frequency_hz[-1])),
        curves=curves,
        levels=levels,
        heat=Heat(label="density", unit="dB", x=shown.x, y=shown.frequency_hz, z=shown.level_db),
        height=1.5,
    )


def _motors(health: Health) -> Figure | None:
    """Show each motor's mean and range, and all of them over time."""
    motors = health.motors
    if motors is None:
        return None
    scale, unit = (100.0, "% of range") if motors.unit == "1" else (1.0, "us")
    numbers = np.arange(1.0, len(motors.names) + 1.0)
    time_s, output = break_at_gaps(motors.time_s, scale * motors.output)
    ends = (0.0, 100.0) if motors.unit == "1" else (None, None)
    mean = Curve(
        label="mean, and the range in 90 % of the flight",
        x=numbers,
        y=scale * motors.mean,
        low=scale * motors.low,
        high=scale * motors.high,
        role="series-1",
        mark="bars",
    )
    return Figure(
        key=_KEYS["motors"],
        title=_TITLES["motors"],
        caption=(
            f"{_said(motors)} A difference between opposite motors shows where the weight is. If all motors "
            "with one sense of rotation work harder than the others, a motor is tilted or an arm is "
            "twisted."
        ),
        panels=(
            Panel(
                title="Each motor",
                x=Axis(
                    label="motor",
                    low=0.5,
                    high=len(motors.names) + 0.5,
                    # A phone has room for numbers alone; their places stand in the other panel's legend.
                    ticks=tuple((number, f"{number:.0f}") for number in numbers.tolist()),
                ),
                y=Axis(label="output", unit=unit, low=ends[0], high=ends[1]),
                curves=(mean,),
            ),
            Panel(
                title="Over time",
                x=TIME,
                y=Axis(label="output", unit=unit, low=ends[0], high=ends[1]),
                curves=tuple(
                    Curve(
                        label=name,
                        x=time_s,
                        y=output[:, number],
                        role=_ROLES[number % len(_ROLES)],
                        mark="dashed" if number >= len(_ROLES) else "line",
                    )
                    for number, name in enumerate(motors.names)
                ),
            ),
        ),
        columns=2,
    )


def _course(course: Course | None, name: str) -> Figure | None:
    """Show one quantity over time, with the levels that it is judged by."""
    if course is None:
        return None
    time_s, values = break_at_gaps(course.time_s, course.values)
    highest = float(np.nanmax(np.abs(course.values)))
    return Figure(
        key=_KEYS[name],
        title=_TITLES[name],
        caption=_said(course),
        panels=(
            Panel(
                title=_TITLES[name],
                x=TIME,
                y=Axis(label=course.label, unit=course.unit),
                curves=tuple(
                    Curve(label=label, x=time_s, y=values[:, number], role=_ROLES[number])
                    for number, label in enumerate(course.columns)
                ),
                levels=tuple(
                    Level(value=limit, role="saturated", label=words)
                    for limit, words in course.limits
                    if limit <= _NEAR_LIMIT * highest
                ),
            ),
        ),
        over_time=True,
    )


def _vibration(health: Health) -> Figure | None:
    """Show the vibration over time, with its published levels."""
    vibration = health.vibration
    if vibration is None:
        return None
    words = ("normal below", "nearly always trouble above")
    highest = float(np.nanmax(vibration.values))
    time_s, values = break_at_gaps(vibration.time_s, vibration.values)
    return Figure(
        key=_KEYS["vibration"],
        title=_TITLES["vibration"],
        caption=_said(vibration),
        panels=(
            Panel(
                title="Vibration",
                x=TIME,
                y=Axis(label="vibration", unit="m/s^2", low=0.0),
                curves=tuple(
                    Curve(
                        label=name or "vibration",
                        x=time_s,
                        y=values[:, number],
                        role=_ROLES[number],
                    )
                    for number, name in enumerate(vibration.columns)
                ),
                levels=tuple(
                    Level(value=limit, role="saturated", label=f"{word} {limit:.3g}")
                    for limit, word in zip(vibration.limits, words, strict=False)
                    if limit <= _NEAR_LIMIT * highest
                ),
            ),
        ),
        over_time=True,
    )


def _battery(health: Health) -> Figure | None:
    """Show the voltage over time."""
    battery = health.battery
    if battery is None:
        return None
    normal = battery.lowest_v.normal
    time_s, voltage = break_at_gaps(battery.time_s, battery.voltage[:, np.newaxis])
    return Figure(
        key=_KEYS["battery"],
        title=_TITLES["battery"],
        caption=_said(battery),
        panels=(
            Panel(
                title="Voltage",
                x=TIME,
                y=Axis(label="voltage", unit="V"),
                curves=(Curve(label="voltage", x=time_s, y=voltage[:, 0], role="series-1"),),
                levels=()
                if normal is None
                else (Level(value=normal[0], role="saturated", label="3.5 V for each cell"),),
            ),
        ),
        over_time=True,
    )
