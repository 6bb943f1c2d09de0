"""The figure of the frequency response: what the log shows, and what the model says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import GyroFilter
from quadid_logs.data.model import Model, Response
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import FREQUENCY, Axis, Band, Curve, Figure, LeftOut, Level, Panel
from quadid_logs.figures.time_series import torque_axis
from quadid_logs.identify.select import most_excited
from quadid_logs.maths.band import ComplexArray, delay_response, gyro_response, lag_response
from quadid_logs.maths.spectra import WINDOW_S, averaged_spectra
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS

_TITLE = "Response of the angular acceleration to torque, by frequency"
_KEY = "response"
#: Above, a multirotor's body answers with less than the noise.
_HIGHEST_HZ = 30.0
#: Below this coherence, gain and phase of the log are mostly chance.
_WORTH_SHOWING = 0.6
#: Parts of octaves that are known worse than this are mostly chance, too.
_LARGEST_ERROR = 0.5
_HEIGHT = 0.65
_BY_COMMANDS = (
    ", or from the response to commands alone if the axis is identified from that (in sixths of octaves, "
    "and without small points)"
)
#: Of a line beyond the first and the last dot: a sixth of an octave.
_BEYOND = 2.0 ** (1.0 / 6.0)
_LINE_POINTS = 100


def frequency_response(result: Result) -> Figure | LeftOut:
    """Show gain, phase and coherence of each axis, and the model's gain and phase over them."""
    model = result.identification.recommended
    data = most_excited(result.data, result.settings.identify.most_samples)
    longest = max((segment.n_samples for segment in data.segments), default=0)
    n_block = int(WINDOW_S / data.sample_period_s) if data.segments else 0
    if model is None or not n_block or longest < 2 * n_block:
        reason = (
            "No model was fitted."
            if model is None
            else "No segment of the flight is long enough for a spectrum."
        )
        return LeftOut(key=_KEY, title=_TITLE, reason=reason)
    found = result.identification.responses
    by_commands = [fit.is_told for fit in result.identification.spectral] or [False] * len(AXES)
    columns = [
        _axis(data, model, column, n_block, found[column] if found else None, by_commands[column])
        for column in range(len(AXES))
    ]
    chosen = (
        ""
        if data is result.data
        else " Of this long flight, only the minutes that the model was fitted to are shown."
    )
    by_hand = " that was set by hand" if result.settings.identify.smoothing_hz else ""
    band_words = "".join(
        f" Shaded: the fitted band{by_hand}, {band.start:.2g} to {band.end:.2g} Hz."
        for band in _fitted_band(model)
    )
    return Figure(
        key=_KEY,
        title=_TITLE,
        caption=(
            "How strongly and how late each axis accelerates for a torque. Small points: the log, at "
            f"frequencies where torque explains at least {100.0 * _WORTH_SHOWING:g} % of the rate "
            "(coherence). Dots: third-octave averages with 95 % intervals, from the set-points where those "
            f"explain the torque{_BY_COMMANDS if any(by_commands) else ''}. Line: the model with its lag, "
            f"delay and the gyro's filter.{band_words} A rigid body with a motor lag has a level gain and a "
            "falling phase. If the gain grows with frequency and the phase is near -90 degrees, the log "
            "shows the inverse of the controller. Every log does that above the frequencies of its "
            f"manoeuvres.{chosen}"
        ),
        panels=tuple(panel for row in zip(*columns, strict=True) for panel in row),
        columns=3,
    )


def response_to_commands_panel(result: Result, axis: str) -> Panel | None:
    """Show the gain of an axis that its response to commands tells, measured and of the model.

    Parameters
    ----------
    result : Result
    axis : str
        "roll", "pitch" or "yaw".

    Returns
    -------
    Panel or None
        None where no frequency is known to half.
    """
    model, found = result.identification.recommended, result.identification.responses
    column, gyro_filter = AXES.index(axis), result.data.gyro_filter
    measured = _octaves(found[column], gyro_filter, by_commands=True) if found else None
    if model is None or measured is None or not measured.x.size:
        return None
    ends_hz = measured.x[0] / _BEYOND, measured.x[-1] * _BEYOND
    frequency_hz = np.asarray(np.geomspace(*ends_hz, _LINE_POINTS), dtype=np.float64)
    response = 2j * np.pi * frequency_hz * model_response(model, frequency_hz, gyro_filter)[:, column]
    return _panel(
        f"{axis.capitalize()}: by commands",
        # As the effectiveness is told, at which the line is level.
        Axis(label="gain", unit=_gain_unit(result.data, "rad"), log=True),
        (*measured.gain_curve(np.abs), _line(frequency_hz, np.abs(response))),
    )


def _gain_unit(data: FlightData, angle: str = "deg") -> str:
    unit = torque_axis(data.input).unit
    return f"{angle}/s^2 per unit" if unit == "normalised" else f"{angle}/s^2/({unit})"


def _abs_degrees(gain: ComplexArray) -> FloatArray:
    return np.asarray(np.degrees(np.abs(gain)), dtype=np.float64)


def _fitted_band(model: Model) -> tuple[Band, ...]:
    """Shade what the model was fitted to."""
    if model.band is None:
        return ()
    return (Band(start=float(model.band.low_hz[0]), end=float(model.band.cutoff_hz[0]), role="held-out"),)


def _axis(
    data: FlightData,
    model: Model,
    column: int,
    n_block: int,
    found: Response | None,
    by_commands: bool,
) -> tuple[Panel, ...]:
    """Return gain, phase and coherence of one axis."""
    spectra = averaged_spectra(
        ((segment.torque[:, column], segment.body_rate_rad_s[:, column]) for segment in data.segments),
        period_s=data.sample_period_s,
        n_per_segment=n_block,
    )
    band = (spectra.frequency_hz > 0.0) & (spectra.frequency_hz <= _HIGHEST_HZ)
    frequency_hz = spectra.frequency_hz[band]
    s = 2j * np.pi * frequency_hz
    response = s * model_response(model, frequency_hz, data.gyro_filter)[:, column]
    model_deg = np.degrees(np.unwrap(np.angle(response)))
    good = (spectra.coherence[band] >= _WORTH_SHOWING) & (spectra.input_psd[band] > 0.0)
    measured = spectra.cross[band][good] / spectra.input_psd[band][good]
    if by_commands:
        good, measured = np.zeros_like(good), measured[:0]
    measured = measured * s[good]
    octaves = _octaves(found, data.gyro_filter, by_commands=by_commands)
    turned = []
    for at, value in ((frequency_hz[good], measured), (octaves.x, octaves.gain)):
        # On the turn of the circle that lies nearest to the model's phase: a phase has no other.
        phase_deg, near_deg = np.degrees(np.angle(value)), np.interp(at, frequency_hz, model_deg)
        turned.append(near_deg + (phase_deg - near_deg + 180.0) % 360.0 - 180.0)
    name = AXES[column]
    panels = (
        _panel(
            f"{name.capitalize()}: gain",
            Axis(label="gain", unit=_gain_unit(data), log=True),
            (
                _points(frequency_hz[good], np.degrees(np.abs(measured))),
                _line(frequency_hz, np.degrees(np.abs(response))),
                *octaves.gain_curve(),
            ),
        ),
        _panel(
            f"{name.capitalize()}: phase",
            Axis(label="phase", unit="deg"),
            (
                _points(frequency_hz[good], turned[0]),
                _line(frequency_hz, model_deg),
                *octaves.phase_curve(turned[1]),
            ),
        ),
        Panel(
            title=f"{name.capitalize()}: coherence",
            x=FREQUENCY,
            y=Axis(label="coherence", low=0.0, high=1.02),
            curves=(Curve(label="coherence", x=frequency_hz, y=spectra.coherence[band], role=name),),
            levels=(Level(value=_WORTH_SHOWING, role="muted"),),
            height=_HEIGHT,
        ),
    )
    return tuple(replace(panel, model_of=name, bands=_fitted_band(model)) for panel in panels)


class _Octaves(NamedTuple):
    """Response in parts of octaves as the log shows it, behind the gyro's filter, with its standard error."""

    x: FloatArray
    gain: ComplexArray
    error: FloatArray
    label: str

    def gain_curve(self, size_of: Callable[[ComplexArray], FloatArray] = _abs_degrees) -> tuple[Curve, ...]:
        """Return the gain with bars of 95 %; a logarithmic axis has no place for zero."""
        size = size_of(self.gain)
        low, high = np.maximum(1.0 - 2.0 * self.error, 0.1) * size, (1.0 + 2.0 * self.error) * size
        return self._curve(size, low, high)

    def phase_curve(self, phase_deg: FloatArray) -> tuple[Curve, ...]:
        """Return the phase, turned to the model's, with bars of 95 %."""
        off = np.degrees(2.0 * self.error)
        return self._curve(phase_deg, phase_deg - off, phase_deg + off)

    def _curve(self, y: FloatArray, low: FloatArray, high: FloatArray) -> tuple[Curve, ...]:
        if not self.x.size:
            return ()
        return (Curve(label=self.label, x=self.x, y=y, role="estimate", mark="bars", low=low, high=high),)


def _octaves(found: Response | None, gyro_filter: GyroFilter, *, by_commands: bool) -> _Octaves:
    """Return the parts of octaves that are known to better than by half."""
    label = "measured by commands" if by_commands else "third octaves"
    if found is None:
        return _Octaves(np.zeros(0), np.zeros(0, dtype=np.complex128), np.zeros(0), label)
    known = (found.error < _LARGEST_ERROR) & (found.frequency_hz <= _HIGHEST_HZ)
    frequency_hz = found.frequency_hz[known]
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    gain = np.asarray(found.gain[known] * gyro_response(s, *gyro_filter), dtype=np.complex128)
    return _Octaves(frequency_hz, gain, found.error[known], label)


def _points(x: FloatArray, y: FloatArray) -> Curve:
    return Curve(label="log", x=x, y=y, role="measured", mark="points")


def _line(x: FloatArray, y: FloatArray) -> Curve:
    return Curve(label="model", x=x, y=y, role="modelled")


def _panel(title: str, y: Axis, curves: tuple[Curve, ...]) -> Panel:
    """Return a panel of curves that the axis has a place for."""
    kept = []
    for curve in curves:
        keep = np.isfinite(curve.y) & ((curve.y > 0.0) if y.log else np.ones(curve.y.shape, dtype=bool))
        low, high = (None if each is None else each[keep] for each in (curve.low, curve.high))
        kept.append(replace(curve, x=curve.x[keep], y=curve.y[keep], low=low, high=high))
    return Panel(title=title, x=FREQUENCY, y=y, curves=tuple(kept), height=_HEIGHT)


def model_response(model: Model, frequency_hz: FloatArray, gyro_filter: GyroFilter) -> ComplexArray:
    """Return the response of each logged rate to its own torque.

    Parameters
    ----------
    model : Model
        Its terms in p, q, r and the rotors' reaction are used; products of rates and angles are not linear
        or act slowly.
    frequency_hz : ndarray, shape (n,)
    gyro_filter : GyroFilter
        That the logged rates have passed.

    Returns
    -------
    ndarray of complex, shape (n, 3)
        diag of G F (s I - A_rates)^-1 (B + s b) [rad/s per unit of torque], with G the gyro filter, F the
        actuator's lag and delay, and b the column of dN/dt (0 but for yaw torque).
    """
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    rates = np.zeros((3, 3))
    for column, symbol in enumerate(RATE_SYMBOLS):
        if symbol in model.regressors:
            rates[:, column] = model.A[_rows(model), model.regressors.index(symbol)]
    derivative = s[:, np.newaxis, np.newaxis]
    # What the change of each torque does, (3, 3): rotors that speed up turn the vehicle, too.
    reaction = np.zeros((3, 3))
    if "N_dot" in model.regressors:
        reaction[:, AXES.index("yaw")] = model.A[_rows(model), model.regressors.index("N_dot")]
    gains = model.B[_rows(model)] + derivative * reaction
    free = np.linalg.solve(derivative * np.eye(3) - rates, gains)
    on_axis = np.diagonal(free, axis1=1, axis2=2)
    shaping = np.ones(s.shape, dtype=np.complex128)
    if model.actuator is not None:
        shaping = lag_response(s, model.actuator.lag_s) * delay_response(s, model.actuator.delay_s)
        shaping = shaping * gyro_response(s, *gyro_filter)
    return np.asarray(on_axis * shaping[:, np.newaxis], dtype=np.complex128)


def _rows(model: Model) -> list[int]:
    """Return the rows of the three accelerations among the model's targets."""
    return [model.targets.index(symbol) for symbol in ACCELERATION_SYMBOLS]
