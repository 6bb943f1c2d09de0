"""The figure of the gyro's noise, after the autopilot's filters and before them."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import Axis, Curve, Figure, LeftOut, Level, Panel
from quadid_logs.figures.thinning import thin_line
from quadid_logs.identify.select import most_excited
from quadid_logs.maths.band import gyro_response
from quadid_logs.maths.spectra import averaged_spectra
from quadid_logs.vocabulary import AXES

_KEY: Final = "gyro-spectrum"
_TITLE: Final = "Spectra of the gyro, after its filters and before them"
_BLOCK_S: Final = 2.0
#: Where a filter leaves less than this, what it was given is lost in the steps of the log's numbers.
_LEAST_GAIN: Final = 0.1
#: More notches than this are those of every rotor's harmonics, and their words would cover each other.
_MOST_NOTCHES: Final = 4


def gyro_spectrum(result: Result) -> Figure | LeftOut:
    """Show the spectrum of each body rate as logged, and before the filters that are known.

    Parameters
    ----------
    result : Result

    Returns
    -------
    Figure or LeftOut
    """
    data = most_excited(result.data, result.settings.identify.most_samples)
    n_block = int(_BLOCK_S / data.sample_period_s) if data.segments else 0
    if not n_block or max(segment.n_samples for segment in data.segments) < 2 * n_block:
        return LeftOut(key=_KEY, title=_TITLE, reason="No segment was long enough for a spectrum.")
    known = _words(data)
    return Figure(
        key=_KEY,
        title=_TITLE,
        caption="Peaks above the manoeuvres are vibration: of propellers, motors and frame. "
        + (
            f"Known of the filters: {known}. Before the filters: computed from these, as far as they "
            "pass a tenth; what is faster than half the log's rate is not to be seen."
            if known
            else "No filter is known."
        ),
        panels=tuple(_panel(data, column, n_block) for column in range(len(AXES))),
        columns=3,
    )


def _words(data: FlightData) -> str:
    """Name the filters, "" where none is known."""
    low_pass_hz, notches = data.gyro_filter
    parts = [f"low-pass of {low_pass_hz:.3g} Hz"] if np.isfinite(low_pass_hz) else []
    parts += [f"notch at {notch.frequency_hz:.3g} Hz" for notch in notches[:_MOST_NOTCHES]]
    if len(notches) > _MOST_NOTCHES:
        parts.append(f"{len(notches) - _MOST_NOTCHES} more notches")
    return ", ".join(parts)


def _panel(data: FlightData, column: int, n_block: int) -> Panel:
    """Return the spectra of one axis with the notches."""
    rates = (np.degrees(segment.body_rate_rad_s[:, column]) for segment in data.segments)
    spectra = averaged_spectra(
        ((rate, rate) for rate in rates), period_s=data.sample_period_s, n_per_segment=n_block
    )
    positive = spectra.frequency_hz > 0.0
    frequency_hz, after = spectra.frequency_hz[positive], spectra.input_psd[positive]
    gain = np.abs(gyro_response(np.asarray(2j * np.pi * frequency_hz), *data.gyro_filter))
    passed = gain >= _LEAST_GAIN
    curves = [_curve("as logged, after the filters", frequency_hz, after, AXES[column])]
    if not np.allclose(gain, 1.0):
        before = after[passed] / gain[passed] ** 2
        curves.append(_curve("before the filters, computed", frequency_hz[passed], before, "muted"))
    return Panel(
        title=AXES[column].capitalize(),
        x=Axis(label="frequency", unit="Hz", log=True),
        y=Axis(label="rate density", unit="(deg/s)²/Hz", log=True),
        curves=tuple(reversed(curves)),
        levels=tuple(
            Level(value=notch.frequency_hz, role="ink", label="notch", along="x")
            for notch in data.gyro_filter.notches[:_MOST_NOTCHES]
            if frequency_hz[0] <= notch.frequency_hz <= frequency_hz[-1]
        ),
    )


def _curve(label: str, frequency_hz: FloatArray, density: FloatArray, role: str) -> Curve:
    known = np.isfinite(density) & (density > 0.0)
    x, y = thin_line(frequency_hz[known], density[known])
    return Curve(label=label, x=x, y=y, role=role)
