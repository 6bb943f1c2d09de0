"""Figures of how much each axis was excited, and at which frequencies."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Excitation
from quadid_logs.data.result import Result
from quadid_logs.figures.spec import FREQUENCY, Axis, Band, Curve, Figure, LeftOut, Level, Panel
from quadid_logs.figures.thinning import thin_line
from quadid_logs.figures.time_series import torque_axis

#: Coherence above this means that noise takes less than half of what is seen.
_HALF = 0.5


def excitation_spectra(result: Result) -> Figure | LeftOut:
    """Show spectra of rate and torque and their coherence, one line per axis."""
    title = "Spectra and coherence"
    shown = [item for item in result.identification.excitation if item.frequency_hz.size > 1]
    if not shown:
        return LeftOut(
            key="excitation", title=title, reason="No segment of the flight is long enough for a spectrum."
        )
    unit = torque_axis(result.data.input).unit
    density = "1/Hz" if unit == "normalised" else f"({unit})²/Hz"
    # The band below the cut-off of the fit's filter
    model = result.identification.recommended
    if model is None or not np.isfinite(model.smoothing_hz):
        bands: tuple[Band, ...] = ()
    else:
        first = min(
            (
                float(item.frequency_hz[1])
                for item in result.identification.excitation
                if item.frequency_hz.size > 1
            ),
            default=0.0,
        )
        bands = (Band(start=first, end=model.smoothing_hz, role="held-out", label="fitted band"),)
    panels = (
        Panel(
            title="Body rate",
            x=FREQUENCY,
            y=Axis(label="rate density", unit="(deg/s)²/Hz", log=True),
            curves=tuple(_curve(item, item.rate_psd * np.degrees(1.0) ** 2) for item in shown),
            bands=bands,
        ),
        Panel(
            title="Torque",
            x=FREQUENCY,
            y=Axis(label="torque density", unit=density, log=True),
            curves=tuple(_curve(item, item.torque_psd) for item in shown),
            bands=bands,
        ),
        Panel(
            title="Coherence of rate and torque",
            x=FREQUENCY,
            y=Axis(label="coherence", low=0.0, high=1.02),
            curves=tuple(_curve(item, item.coherence) for item in shown),
            bands=bands,
            levels=(Level(value=_HALF, role="muted", label="half is noise"),),
        ),
    )
    caption = (
        "An axis can be identified at frequencies where its torque has power and the coherence is near 1. "
        "Below 0.5, noise, wind or the other axes move the vehicle more than this torque does."
    )
    if bands:
        caption += " Shaded: the band that was fitted."
    return Figure(key="excitation", title=title, caption=caption, panels=panels)


def _curve(item: Excitation, density: FloatArray) -> Curve:
    """Return the line of one axis; frequency 0 has no place on a logarithmic axis."""
    keep = (item.frequency_hz > 0.0) & np.isfinite(density) & (density > 0.0)
    x, y = thin_line(item.frequency_hz[keep], density[keep])
    return Curve(label=item.axis, x=x, y=y, role=item.axis)
