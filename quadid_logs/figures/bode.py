"""The figure of the frequency response: what the log shows, and what the model says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import GyroFilter
from quadid_logs.data.model import Model
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import Axis, Curve, Figure, LeftOut, Level, Panel
from quadid_logs.figures.time_series import torque_axis
from quadid_logs.identify.select import most_excited
from quadid_logs.maths.band import ComplexArray, delay_response, gyro_response, lag_response
from quadid_logs.maths.spectra import Spectra, averaged_spectra
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS

_TITLE = "Frequency response from torque to rate"
_KEY = "frequency"
_BLOCK_S = 4.0
#: Above, a multirotor's body answers with less than the noise.
_HIGHEST_HZ = 30.0
#: Below this coherence, gain and phase of the log are mostly chance.
_WORTH_SHOWING = 0.6
_HEIGHT = 0.65
_FREQUENCY = Axis(label="frequency", unit="Hz", log=True)


def frequency_response(result: Result) -> Figure | LeftOut:
    """Show gain, phase and coherence of each axis, and the model's gain and phase over them."""
    model = result.identification.recommended
    data = most_excited(result.data, result.settings.identify.most_samples)
    longest = max((segment.n_samples for segment in data.segments), default=0)
    n_block = int(_BLOCK_S / data.sample_period_s) if data.segments else 0
    if model is None or not n_block or longest < 2 * n_block:
        reason = "No model was fitted." if model is None else "No segment was long enough for a spectrum."
        return LeftOut(key=_KEY, title=_TITLE, reason=reason)
    columns = [_axis(data, model, column, n_block) for column in range(len(AXES))]
    chosen = "" if data is result.data else " Of this long flight: the minutes that the model was fitted to."
    return Figure(
        key=_KEY,
        title=_TITLE,
        caption="How strongly and how late each rate answers to its torque. Points: the log, where at least "
        f"{100.0 * _WORTH_SHOWING:g} % of the rate belongs to the torque (coherence). Line: the model with "
        "its lag, delay and the gyro's filter. In the band of the manoeuvre the points should lie on the "
        "line. Above it they often leave together, coherence near 1: there the log shows how the controller "
        f"answers to the gyro's noise, and not the vehicle.{chosen}",
        panels=tuple(panel for row in zip(*columns, strict=True) for panel in row),
        columns=3,
    )


def _axis(data: FlightData, model: Model, column: int, n_block: int) -> tuple[Panel, ...]:
    """Return gain, phase and coherence of one axis."""
    spectra = averaged_spectra(
        ((segment.torque[:, column], segment.body_rate_rad_s[:, column]) for segment in data.segments),
        period_s=data.sample_period_s,
        n_per_segment=n_block,
    )
    band = (spectra.frequency_hz > 0.0) & (spectra.frequency_hz <= _HIGHEST_HZ)
    frequency_hz = spectra.frequency_hz[band]
    response = model_response(model, frequency_hz, data.gyro_filter)[:, column]
    model_deg = np.degrees(np.unwrap(np.angle(response)))
    good, measured = _measured(spectra, band)
    # The turn of the circle that lies nearest to the model's phase: a phase has no other.
    apart = np.degrees(np.angle(measured)) - model_deg[good]
    measured_deg = model_deg[good] + (apart + 180.0) % 360.0 - 180.0
    name, unit = AXES[column], torque_axis(data.input).unit
    gain_unit = "deg/s per unit" if unit == "normalised" else f"deg/s/({unit})"
    measured_hz = frequency_hz[good]
    panels = (
        _panel(
            f"{name.capitalize()}: gain",
            Axis(label="gain", unit=gain_unit, log=True),
            (measured_hz, np.degrees(np.abs(measured))),
            (frequency_hz, np.degrees(np.abs(response))),
        ),
        _panel(
            f"{name.capitalize()}: phase",
            Axis(label="phase", unit="deg"),
            (measured_hz, measured_deg),
            (frequency_hz, model_deg),
        ),
        Panel(
            title=f"{name.capitalize()}: coherence",
            x=_FREQUENCY,
            y=Axis(label="coherence", low=0.0, high=1.02),
            curves=(Curve(label="coherence", x=frequency_hz, y=spectra.coherence[band], role=name),),
            levels=(Level(value=_WORTH_SHOWING, role="muted"),),
            height=_HEIGHT,
        ),
    )
    return tuple(replace(panel, model_of=name) for panel in panels)


def _measured(spectra: Spectra, band: BoolArray) -> tuple[BoolArray, ComplexArray]:
    """Return which frequencies of the band the log tells of, and its response there."""
    good = (spectra.coherence[band] >= _WORTH_SHOWING) & (spectra.input_psd[band] > 0.0)
    return good, spectra.cross[band][good] / spectra.input_psd[band][good]


def _panel(
    title: str, y: Axis, points: tuple[FloatArray, FloatArray], line: tuple[FloatArray, FloatArray]
) -> Panel:
    """Return points of the log over the line of the model."""
    keep = np.isfinite(line[1]) & ((line[1] > 0.0) if y.log else np.ones(line[1].shape, dtype=bool))
    return Panel(
        title=title,
        x=_FREQUENCY,
        y=y,
        curves=(
            Curve(label="log", x=points[0], y=points[1], role="measured", mark="points"),
            Curve(label="model", x=line[0][keep], y=line[1][keep], role="modelled"),
        ),
        height=_HEIGHT,
    )


def model_response(model: Model, frequency_hz: FloatArray, gyro_filter: GyroFilter) -> ComplexArray:
    """Return the response of each logged rate to its own torque.

    Parameters
    ----------
    model : Model
        Its terms in p, q, r are used; products of rates and angles are not linear or act slowly.
    frequency_hz : ndarray, shape (n,)
    gyro_filter : GyroFilter
        That the logged rates have passed.

    Returns
    -------
    ndarray of complex, shape (n, 3)
        diag of G F (s I - A_rates)^-1 B [rad/s per unit of torque], with
        G the gyro filter and F the actuator's lag and delay.
    """
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    rates = np.zeros((3, 3))
    for column, symbol in enumerate(RATE_SYMBOLS):
        if symbol in model.regressors:
            rates[:, column] = model.A[_rows(model), model.regressors.index(symbol)]
    gains = model.B[_rows(model)]
    free = np.linalg.solve(s[:, np.newaxis, np.newaxis] * np.eye(3) - rates, gains[np.newaxis])
    on_axis = np.diagonal(free, axis1=1, axis2=2)
    shaping = np.ones(s.shape, dtype=np.complex128)
    if model.actuator is not None:
        shaping = lag_response(s, model.actuator.lag_s) * delay_response(s, model.actuator.delay_s)
        shaping = shaping * gyro_response(s, *gyro_filter)
    return np.asarray(on_axis * shaping[:, np.newaxis], dtype=np.complex128)


def _rows(model: Model) -> list[int]:
    """Return the rows of the three accelerations among the model's targets."""
    return [model.targets.index(symbol) for symbol in ACCELERATION_SYMBOLS]
