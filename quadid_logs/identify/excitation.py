"""How much each axis was excited, and how much noise there was beside it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Excitation
from quadid_logs.identify.design import Design
from quadid_logs.identify.terms import ANGLE_SYMBOLS, Term
from quadid_logs.identify.torque_path import torque_path
from quadid_logs.maths.band import gaussian_response
from quadid_logs.maths.spectra import WINDOW_S, averaged_spectra
from quadid_logs.vocabulary import AXES, RATE_SYMBOLS, TORQUE_SYMBOLS

#: Above this fraction of the Nyquist frequency a multirotor's motion has died out
#: and what is left is noise (and vibration, which counts as noise here).
_NOISE_BAND = 0.6
#: A window of that length makes of one frequency a line of so many hertz to either side.
_LINE_HZ = 2.5 / WINDOW_S
#: A vehicle that hovers by itself turns at 1 to 2 deg/s rms; a manoeuvre must exceed that.
MIN_RATE_RMS_DEG_S: Final = 2.0
#: A sinusoid has hardly any, two that are a third apart 0.15, manoeuvres 0.3 to 0.9. Gain and phase at one
#: frequency are two numbers; effectiveness, damping, lag and delay are four.
LEAST_BANDWIDTH: Final = 0.15
#: Answers to wind widen any band: single tones in wind and rough air have up to 0.21, but 0.94 and more of
#: their power in one line. Doublets of yaw have 0.9 there (at 1 Hz a line is as wide as they are), and 0.4.
MOST_IN_ONE_LINE: Final = 0.9
_NARROW = 0.25


def holds_one_frequency(excitation: Sequence[Excitation], number: int) -> bool:
    """Say whether hardly any of an axis' torque is beside its strongest frequency.

    About an axis beside one that holds a single frequency nobody flew doublets: what is beside its own
    strongest line is what the other axes leak.

    Parameters
    ----------
    excitation : sequence of Excitation
        Of all axes.
    number : int
        0 roll, 1 pitch, 2 yaw.

    Returns
    -------
    bool
    """
    own = excitation[number]
    if own.bandwidth < LEAST_BANDWIDTH:
        return True
    no_doublets = any(each.bandwidth < LEAST_BANDWIDTH for each in excitation)
    return bool(own.line_fraction > MOST_IN_ONE_LINE and (no_doublets or own.bandwidth < _NARROW))


def excited_axes(design: Design) -> list[int]:
    """Return the axes that turn more than a hovering vehicle does, all if none does.

    On an axis at rest, the controller turns gyro noise into torque, and a
    model with a short delay explains that noise perfectly: its R2 is no proof.

    Parameters
    ----------
    design : Design

    Returns
    -------
    list of int
        0 roll, 1 pitch, 2 yaw.
    """
    return np.flatnonzero(turns(design)).tolist() or [0, 1, 2]


def turns(design: Design) -> BoolArray:
    """Say which axes turn more than a hovering vehicle does; shape (3,).

    Parameters
    ----------
    design : Design

    Returns
    -------
    ndarray of bool, shape (3,)
    """
    rate = np.column_stack([design.columns[name][design.train] for name in RATE_SYMBOLS])
    return np.asarray(np.degrees(np.std(rate, axis=0)) >= MIN_RATE_RMS_DEG_S, dtype=np.bool_)


def measure_excitation(
    data: FlightData,
    *,
    signal_to_noise: FloatArray,
    rate_rms_rad_s: FloatArray,
    band_hz: tuple[float, float],
) -> tuple[Excitation, ...]:
    """Return spectra, coherence and sizes per axis.

    Parameters
    ----------
    data : FlightData
    signal_to_noise : ndarray, shape (3,)
        Of the recommended model.
    rate_rms_rad_s : ndarray, shape (3,)
        Of the smoothed rates: vibration is no motion.
    band_hz : (float, float)
        That is fitted: lower edge, and cut-off of the filter.

    Returns
    -------
    tuple of Excitation
    """
    found = []
    for axis in range(3):
        torque = np.concatenate([segment.torque[:, axis] for segment in data.segments])
        longest = max(segment.n_samples for segment in data.segments)
        spectra = averaged_spectra(
            ((segment.torque[:, axis], segment.body_rate_rad_s[:, axis]) for segment in data.segments),
            period_s=data.sample_period_s,
            n_per_segment=min(int(WINDOW_S / data.sample_period_s), longest),
        )
        # How the torque's power lies over the fitted band, as the fit sees it: slow drift of a trim would
        # pass for a second frequency.
        frequency_hz, (low_hz, cutoff_hz) = spectra.frequency_hz, band_hz
        s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
        seen = gaussian_response(s, cutoff_hz) ** 2
        power = spectra.input_psd * seen * ((frequency_hz > 0.0) & (frequency_hz >= low_hz))
        total = float(np.sum(power))
        bandwidth = line_hz = line_fraction = float("nan")
        if total > 0.0:
            mean = np.sum(power * frequency_hz) / total
            bandwidth = float(np.sqrt(np.sum(power * (frequency_hz - mean) ** 2) / total) / mean)
            line_hz = float(frequency_hz[np.argmax(power)])
            line_fraction = float(np.sum(power[np.abs(frequency_hz - line_hz) < _LINE_HZ]) / total)
        found.append(
            Excitation(
                axis=AXES[axis],
                torque_rms=float(np.std(torque)),
                rate_rms_rad_s=float(rate_rms_rad_s[axis]),
                signal_to_noise=float(signal_to_noise[axis]),
                frequency_hz=spectra.frequency_hz,
                rate_psd=spectra.output_psd,
                torque_psd=spectra.input_psd,
                coherence=spectra.coherence,
                path=torque_path(data.segments, axis, data.sample_period_s),
                bandwidth=bandwidth,
                line_hz=line_hz,
                line_fraction=line_fraction,
            )
        )
    return tuple(found)


def noise_density(data: FlightData) -> dict[str, float]:
    """Return the one-sided noise density [unit^2/Hz] of p, q, r, L, M, N and the angles.

    Taken as the median density in the upper part of the band, where no
    rotation is left. A gyro filter makes it an underestimate: the noise floor
    that follows from it is the least there can be.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    dict of str to float
        Without the angles where the log has no attitude.
    """
    density = {}
    for names, values in (
        (RATE_SYMBOLS, [segment.body_rate_rad_s for segment in data.segments]),
        (TORQUE_SYMBOLS, [segment.torque for segment in data.segments]),
        (ANGLE_SYMBOLS, [each.attitude_rad for each in data.segments if each.attitude_rad is not None]),
    ):
        for place, name in enumerate(names if values else ()):
            pairs = [(each[:, place], each[:, place]) for each in values]
            n_per_segment = min(int(WINDOW_S / data.sample_period_s), max(len(each) for each in values))
            spectra = averaged_spectra(pairs, period_s=data.sample_period_s, n_per_segment=n_per_segment)
            upper = spectra.frequency_hz > _NOISE_BAND * spectra.frequency_hz[-1]
            density[name] = float(np.median(spectra.input_psd[upper])) if upper.any() else 0.0
    return density


class ColumnNoise:
    """Noise of smoothed columns of H_k.

    Parameters
    ----------
    density : mapping of str to float
        As of `noise_density`.
    columns : mapping of str to ndarray
        Smoothed rates by symbol.
    bandwidth_hz : float
        Equivalent noise bandwidth of the smoothing.
    """

    def __init__(
        self, density: Mapping[str, float], columns: Mapping[str, FloatArray], bandwidth_hz: float
    ) -> None:
        self._rms = {name: float(np.sqrt(value * bandwidth_hz)) for name, value in density.items()}
        self._size = {name: float(np.sqrt(np.mean(columns[name] ** 2))) for name in RATE_SYMBOLS}

    def of(self, terms: Iterable[Term]) -> FloatArray:
        """Return the noise (rms) of each term's column; shape (n_terms,)."""
        return np.array([term.noise(self._rms, self._size) for term in terms])
