"""Modes of the frame that a log does not rule out: what bends between rotors and gyro adds gain to a loop.

Above the fitted band a flight holds the gyro's noise, which is about white over an octave and comes through
the loop as n / (1 + L). Where a mode brings L near -1 it stands above its surroundings, as a line. Each mode
that a frame may have weighs as much as it explains of the spectrum, and vehicles are drawn by these weights:
a line that is seen bounds the gain margin, and so does what a short or slow log cannot exclude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.control.frequency_response import BAND_WIDTH, MOST_OF_RATE, Response, distances
from quadid_logs.control.loop import close, gyro_filters, rate_loop
from quadid_logs.control.margins import fine_grid_hz
from quadid_logs.data.closed_loop import FrameModes, ModeEvidence, Modes, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.even_draws import Drawn, even_uniform
from quadid_logs.maths.instrument_response import INDEPENDENT, tapered_spectra
from quadid_logs.maths.median import median
from quadid_logs.maths.nonnegative import nonnegative_least_squares
from quadid_logs.maths.normal import ENDS_95
from quadid_logs.maths.spectra import WINDOW_S

#: Arms and soft mounts bend up to some tens of hertz; below the first, the harmonics that a manoeuvre makes
#: are louder than noise, and the fitted band shows modes itself. Half an octave above that band, for a mode
#: at its edge has no surroundings.
_LOWEST_HZ: Final = 12.0
_HIGHEST_HZ: Final = 60.0
_ABOVE_FITTED: Final = 1.5
#: Of vehicles, have a mode that their gyro sees: judgement; in a study in which all have one, 3 % of the
#: intervals lie more than 1 dB above the truth. How much the gyro sees of it, on the body's side or against
#: it; its damping, from a bolted frame's to a rubber mount's. Sizes are as likely in each octave.
_PRESENT: Final = 0.25
_SIZES: Final = tuple(np.geomspace(0.05, 1.5, 13).tolist())
_GAINS: Final = (*_SIZES, *(-size for size in _SIZES))
#: Powers of the gains, (n_gains, 3).
_OF_GAIN: Final = np.array(_GAINS)[:, np.newaxis] ** np.arange(3)
_DAMPINGS: Final = tuple(np.geomspace(0.01, 0.05, 4).tolist())
#: Modes are looked for by third octaves, in each alone: a line elsewhere rules out none.
_BAND_OCTAVES: Final = 1.0 / 3.0
#: Neighbours in frequency are half as far apart as the sharpest mode is wide.
_STEP: Final = 0.01
#: A mode changes the spectrum over this much to either side.
_NEAR: Final = 1.25
#: Torque of the air or of a manoeuvre near the mode, over the noise of the surroundings, in power: it passes
#: the mode, which the gyro's noise does not. Above 1 it is louder at the mode than beside it.
_OF_AIR: Final = (0.0, 0.01, 0.1, 1.0, 10.0)
#: Half an octave to either side makes the surroundings of a line.
_BESIDE: Final = 2.0**0.5
#: So many points for each line of a window, which averages over them by its taper.
_FINE: Final = 4
_FEWEST_WINDOWS: Final = 4
_FEWEST_LINES: Final = 16
#: A model that is a fifth off leaves a 25th of what set-points and injected torques do: so much of it is
#: hidden in the noise. Steady noise is above so many times its mean once in 20 000 lines.
_LOUD: Final = 10.0
#: The noise beside what the model leaves of set-points, where that is no louder: by a fixed point, each round
#: at half the distance from it. Where it is louder, a line tells nothing of the noise about it: a doublet's
#: comb is as wide as its gaps, and its median is above the noise.
_ROUNDS: Final = 3
#: So many neighbours, in lines and windows, are alike: a Hann window's noise is 1.5 lines wide.
_ALIKE: Final = 1.5 / INDEPENDENT
#: Set-points of two axes that are one but for this part of their power, as rounding leaves it, are one.
_SAME_OTHERS: Final = 1e-9
#: With a probability of less that there is none, a mode is seen: one log in some hundred has three axes
#: without any of which one is taken for a line.
_SEEN: Final = 0.001
#: A line may be no mode of the frame but a propeller's or a radio link's: so many vehicles are drawn without,
#: and the interval goes up to what they have.
_NO_MODE: Final = 0.25
#: A drawn mode with which the vehicle could not have flown is drawn again, so many times at most.
_SPARE_DRAWS: Final = 3
#: Points of a mode's circle in the plane of the open loop.
_CIRCLE: Final = 121
#: Every analysis of a log draws the same modes.
_SEED = 3


class _Noise(NamedTuple):
    """The spectrum of one axis over what its loop makes of white noise, one about each line's surroundings.

    ``left`` is the most that the model leaves of set-points and injected torques, in the same unit;
    ``n_independent`` is the number of averages of each line that are independent of each other.
    """

    frequency_hz: FloatArray
    relative: FloatArray
    left: FloatArray
    n_independent: FloatArray


class Measured(NamedTuple):
    """The measured response of a vehicle over that of the estimate, in the bands that are known.

    ``drawn`` are vehicles that the fit allows over the estimate, (n_plants, n_bands); None where it is one.
    """

    ratio: Response
    drawn: ComplexArray | None = None


class _Candidates(NamedTuple):
    """Modes that are looked for: frequencies, and damping and gain of each kind (n_kinds,)."""

    natural_hz: FloatArray
    damping_ratio: FloatArray
    gain: FloatArray


def frame_modes(
    data: FlightData,
    number: int,
    controller: AxisController,
    estimate: Plant,
    *,
    fitted_hz: float,
    known_hz: float,
    n: int,
    measured: Measured | None = None,
) -> FrameModes | None:
    """Return the modes that the flight allows about one axis.

    Parameters
    ----------
    data : FlightData
    number : int
        Of the axis.
    controller : AxisController
    estimate : Plant
        The vehicle as it was fitted, alone.
    fitted_hz, known_hz : float
        Up to where, and up to where its measured response agrees with it: no mode is there.
    n : int
        How many are drawn, after that of the estimate.
    measured : Measured, optional
        What the log shows of the vehicle's response: a mode above it, of which it would show the skirt, is
        none.

    Returns
    -------
    FrameModes or None
        None where the loop has no frequencies for any.
    """
    low_hz, high_hz = (
        max(_ABOVE_FITTED * fitted_hz, known_hz, _LOWEST_HZ),
        min(_HIGHEST_HZ, 0.45 / controller.period_s),
    )
    if not low_hz < high_hz:
        return None
    natural_hz = np.geomspace(low_hz, high_hz, int(np.log(high_hz / low_hz) / _STEP) + 2)
    wanted = _Candidates(natural_hz, *_kinds())

    noise = _noise(data, number, controller, estimate, fitted_hz)
    gained = _log_likelihood(noise, wanted, controller, estimate)
    if measured is not None:
        gained = gained - np.tile(_ruled_out(wanted, measured), len(_OF_AIR))
    modes, absent = _weighed(wanted, gained, (controller, estimate), n)
    seen = absent < _SEEN
    line_hz, height = np.nan, np.nan
    if seen and noise is not None:
        near = np.abs(np.log(noise.frequency_hz / float(modes.natural_hz[0]))) < np.log(_NEAR)
        if near.any():
            place = int(np.argmax(np.where(near, _over_none(noise), 0.0)))
            line_hz, height = float(noise.frequency_hz[place]), float(noise.relative[place])
    return FrameModes(
        modes=modes,
        seen=seen,
        line_hz=line_hz,
        line_height=height,
        absent=absent,
        visible_hz=0.0 if noise is None else float(noise.frequency_hz[-1]),
        evidence=ModeEvidence(wanted.natural_hz, _whatever_air(gained)),
    )


def with_earlier(
    now: FrameModes,
    earlier: Sequence[FrameModes],
    controller: AxisController,
    estimate: Plant,
    known_hz: float,
) -> FrameModes | None:
    """Return the modes that a flight and earlier ones of the same vehicle allow together.

    Noise of one flight is independent of that of another: what each mode explains of their spectra adds up.

    Parameters
    ----------
    now : FrameModes
    earlier : sequence of FrameModes
    controller : AxisController
        That of now.
    estimate : Plant
        The vehicle, alone.
    known_hz : float
        Up to where any of the flights measured a response that agrees with it: no mode is there.

    Returns
    -------
    FrameModes or None
        A line that an earlier flight alone shows has no place or height here. None where no frequencies are
        left for any.
    """
    evidence = now.evidence
    if evidence is None:
        return now
    above = evidence.natural_hz >= known_hz
    if not above.any():
        return None
    natural_hz, gained = evidence.natural_hz[above], evidence.gained[above]
    for one in earlier:
        if one.evidence is not None:
            gained = gained + one.evidence.at(natural_hz)
    wanted = _Candidates(natural_hz, *_kinds())
    modes, absent = _weighed(wanted, gained, (controller, estimate), now.modes.gain.size - 1)
    return replace(now, modes=modes, absent=absent, seen=absent < _SEEN)


def _whatever_air(gained: FloatArray) -> FloatArray:
    """Return the gain in log likelihood of each mode over all airs, (n_frequencies, n_modes)."""
    by_air = gained.reshape(len(gained), len(_OF_AIR), -1)
    most = by_air.max(axis=1)
    mean = np.mean(np.exp(by_air - most[:, np.newaxis]), axis=1)
    return np.asarray(most + np.log(mean), dtype=np.float64)


def _weighed(
    wanted: _Candidates, gained: FloatArray, loop: tuple[AxisController, Plant], n: int
) -> tuple[Modes, float]:
    """Draw modes by what they explain, that of the estimate first; and the probability that there is none."""
    # In each band a mode is looked for alone: a frame has several, and what explains one part of a spectrum
    # rules out none in another. But what stands beside a line is measured against surroundings with the line
    # in them: that makes one band.
    octave = np.log2(wanted.natural_hz / wanted.natural_hz[0])
    line = octave[int(np.argmax(gained.max(axis=1)))]
    near = np.abs(octave - line) <= np.log2(_BESIDE)
    seen = 1.0 - _present(gained[near], wanted.natural_hz.size) < _SEEN
    number = np.where(near & seen, -1, np.floor(octave / _BAND_OCTAVES).astype(np.int64))
    bands = [np.flatnonzero(number == one) for one in np.unique(number)]
    present = np.array([_present(gained[band], wanted.natural_hz.size) for band in bands])
    absent = float(np.prod(1.0 - present))
    every_hz = fine_grid_hz(loop[0].period_s)
    without = rate_loop(*loop, every_hz)[0]
    random = np.random.default_rng(_SEED)
    # Of each band, several modes for each that is wanted, with which the vehicle could have flown.
    drawn = []
    for band in bands:
        weight = np.cumsum(np.exp(gained[band] - gained[band].max()).ravel())
        picked = np.searchsorted(weight, weight[-1] * _even(_SPARE_DRAWS * n, random), side="right")
        place, mode = np.divmod(picked, gained.shape[1])
        kind = np.mod(mode, wanted.gain.size)
        # Somewhere between their neighbours in frequency.
        natural_hz = wanted.natural_hz[band[place]] * np.exp(_STEP * random.uniform(-0.5, 0.5, picked.size))
        modes = Modes(natural_hz, wanted.damping_ratio[kind], wanted.gain[kind])
        used = _gain_used(modes, every_hz, without)
        flies = np.flatnonzero(used < 1.0)
        if not flies.size:
            none = np.zeros(1 + picked.size, dtype=np.int64)
            drawn.append(_Drawn(modes.at(none)._replace(gain=np.zeros(none.size)), used[none]))
        else:
            middle = flies[np.argsort(used[flies])[flies.size // 2]]
            taken = np.append(middle, np.resize(flies, picked.size))
            drawn.append(_Drawn(modes.at(taken), used[taken]))
    return _most_of(drawn, present, absent < _SEEN, random, n), absent


def _kinds() -> tuple[FloatArray, FloatArray]:
    """Return damping and gain of each kind of mode, (n_kinds,)."""
    damping_ratio, gain = np.meshgrid(_DAMPINGS, _GAINS, indexing="ij")
    return damping_ratio.ravel(), gain.ravel()


def _noise(
    data: FlightData, number: int, controller: AxisController, estimate: Plant, fitted_hz: float
) -> _Noise | None:
    """Return what the set-point leaves of the rate, over the estimate's response to white noise."""
    n_samples = round(WINDOW_S / data.sample_period_s)
    windows = [
        columns[first : first + n_samples]
        for columns in (_columns(segment, number) for segment in data.segments)
        for first in range(0, len(columns) - n_samples + 1, n_samples // 2)
    ]
    if len(windows) < _FEWEST_WINDOWS:
        return None
    every_hz = np.fft.rfftfreq(n_samples, data.sample_period_s)
    used = (every_hz > fitted_hz) & (every_hz < MOST_OF_RATE / data.sample_period_s)
    if np.count_nonzero(used) < _FEWEST_LINES:
        return None
    frequency_hz = np.asarray(every_hz[used], dtype=np.float64)
    spectra = tapered_spectra(np.stack(windows))[:, used]
    loop = close(controller, estimate, frequency_hz)
    sensitivity = 1.0 / (1.0 + loop.rate[0])
    by_target, by_noise = loop.target_to_rate[0], gyro_filters(controller, frequency_hz) * sensitivity
    vehicle = estimate.response(frequency_hz, controller.period_s)[0]
    rate, target, chirp = (spectra[..., column] for column in range(3))
    residual = rate - by_target * target
    driven = np.abs(by_target * target) ** 2 + np.abs(chirp) ** 2 * np.maximum(
        np.abs(by_target) ** 2, np.abs(vehicle * by_noise) ** 2
    )
    gentle = driven <= _LOUD * np.median(np.abs(residual) ** 2, axis=0)
    others = by_target * np.moveaxis(spectra[..., 3:], -1, 0)
    left = np.abs(residual - _of_other_axes(frequency_hz, residual, others, gentle)) ** 2
    # What the model leaves of a strong excitation is no noise, nor is what comes and goes.
    middle = np.median(left, axis=0)
    quiet = (driven <= _LOUD * middle) & (left <= _LOUD * middle / np.log(2.0))
    n_quiet = np.count_nonzero(quiet, axis=0)
    known = n_quiet >= _FEWEST_WINDOWS
    unexplained = _unexplained(frequency_hz, left, driven, middle)
    power, driven_power = (
        np.sum(np.where(quiet, each, 0.0), axis=0) / np.maximum(n_quiet, 1) / np.abs(by_noise) ** 2
        for each in (left, driven)
    )
    n_independent = INDEPENDENT * np.where(known, n_quiet, 0.0)
    if np.count_nonzero(known) < _FEWEST_LINES:
        return None
    mean = _surroundings(frequency_hz, power, n_independent)
    loud = np.zeros(frequency_hz.size, dtype=np.bool_)
    for _ in range(_ROUNDS):
        of_driven = unexplained * driven_power / mean
        loud |= of_driven > 1.0
        shared = power / (1.0 + np.minimum(of_driven, 1.0))
        mean = _surroundings(frequency_hz, shared, np.where(loud, 0.0, n_independent))
    known &= np.isfinite(mean)
    relative, of_driven = (
        np.where(known, each / mean, other)
        for each, other in ((power, 1.0), (unexplained * driven_power, 0.0))
    )
    return _Noise(frequency_hz, relative, of_driven, np.where(known, n_independent, 0.0))


def _of_other_axes(
    frequency_hz: FloatArray, residual: ComplexArray, others: ComplexArray, gentle: BoolArray
) -> ComplexArray:
    """Return what set-points of other axes make of a residual; it and what is used (n_windows, n_lines).

    A vehicle couples its axes, and a doublet's spectrum is a comb of lines: without this, one about roll
    is a line in yaw. ``others`` are those set-points behind a loop's response, (n_others, n_windows,
    n_lines). A coupling is smooth, and fitted by least squares over half an octave: no line is. What it
    explains counts beyond chance alone (the positive-part estimator of James and Stein, 1961).
    """
    used = np.where(gentle, others, 0.0)
    products = np.einsum("iwf,jwf->fij", used.conj(), used)
    with_residual = np.einsum("iwf,wf->fi", used.conj(), residual)
    log_hz = np.log(frequency_hz)
    first, last = (np.searchsorted(log_hz, log_hz + side * 0.5 * np.log(_BESIDE)) for side in (-1, 1))

    def near(values: NDArray[Any]) -> NDArray[Any]:
        sums = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
        return np.asarray(sums[last] - sums[first])

    total = near(np.sum(np.where(gentle, np.abs(residual) ** 2, 0.0), axis=0))
    n_summed = near(np.count_nonzero(gentle, axis=0))
    gained = near(with_residual)
    inverse = np.linalg.pinv(near(products), rcond=_SAME_OTHERS, hermitian=True)
    coupling = np.einsum("fij,fj->fi", inverse, gained)
    explained = np.einsum("fi,fi->f", gained.conj(), coupling).real
    chance = len(others) * _ALIKE * np.maximum(total - explained, 0.0) / np.maximum(n_summed, 1)
    beyond = np.maximum(explained - chance, 0.0)
    counts = np.divide(beyond, explained, where=beyond > 0.0, out=np.zeros(beyond.shape))
    return np.asarray(np.einsum("f,fi,iwf->wf", counts, coupling, others), dtype=np.complex128)


def _unexplained(
    frequency_hz: FloatArray, left: FloatArray, driven: FloatArray, noise: FloatArray
) -> FloatArray:
    """Return which fraction of the driven power the model leaves at most, (n_lines,).

    Notes
    -----
    Where a window is driven well above the noise, it is seen. A gain that is off by a fraction e leaves
    e^2, a delay that is off by t (2 pi f t)^2: both are fitted, and hold where nothing is driven as much.
    Rotors are not linear, and leave more at some lines: as much more as at 97.5 % of those that are seen.
    """
    _, line = np.nonzero(loud := driven > _LOUD * noise)
    if not line.size:
        return np.zeros(frequency_hz.size)
    share = (left - noise)[loud] / driven[loud]
    of_gain_and_delay = np.column_stack([np.ones(frequency_hz.size), frequency_hz**2])
    scale = of_gain_and_delay[-1]
    fitted = nonnegative_least_squares(of_gain_and_delay[line] / scale, share)
    fraction = np.asarray(of_gain_and_delay @ (fitted / scale), dtype=np.float64)
    most = float(np.quantile(share - fraction[line], ENDS_95[1]))
    return fraction + max(most, 0.0)


def _columns(segment: Segment, number: int) -> FloatArray:
    """Return an axis' rate, its set-point, what a system-ID mode injects, the other axes' set-points.

    Shape (n_samples, 5).
    """
    found = np.zeros((segment.n_samples, 5))
    found[:, 0] = segment.body_rate_rad_s[:, number]
    if segment.reference is not None:
        found[:, 1] = segment.reference[:, number]
        found[:, 2] = segment.reference[:, 3] if segment.reference.shape[1] > 3 else 0.0
        found[:, 3:] = np.delete(segment.reference[:, :3], number, axis=1)
    return found


def _surroundings(frequency_hz: FloatArray, power: FloatArray, n_independent: FloatArray) -> FloatArray:
    """Return the mean power about each line, from the median, which a line does not move; or infinity."""
    known = np.flatnonzero(n_independent)
    # Wilson and Hilferty: the median of a chi-squared variable over its mean.
    mean = power[known] / (1.0 - 1.0 / (9.0 * n_independent[known])) ** 3
    log_hz, log_power = np.log(frequency_hz[known]), np.log(np.maximum(mean, np.finfo(float).tiny))
    at = np.log(frequency_hz)
    a, b, first, last = (
        np.searchsorted(log_hz, at + octaves * np.log(_BESIDE)).tolist() for octaves in (-1, 1, -2, 2)
    )
    found = np.full(at.size, np.inf)
    halves = _Halves(log_hz, log_power)
    for place in range(at.size):
        near = slice(a[place], b[place])
        if near.stop - near.start >= _FEWEST_LINES:
            slope = halves.slope(first[place], last[place])
            found[place] = median(log_power[near] - slope * (log_hz[near] - at[place]))
    return np.asarray(np.exp(found), dtype=np.float64)


class _Halves:
    """Slopes of y over x, both (n,), between the medians of the two halves of a part."""

    def __init__(self, x: FloatArray, y: FloatArray) -> None:
        self._y = y
        centred = y - np.mean(y) if y.size else y
        # Sums from the first one on: those of any part are differences.
        self._sums = np.cumsum([np.append(0.0, each) for each in (x, centred, centred**2)], axis=1).tolist()

    def slope(self, first: int, last: int) -> float:
        """Return the slope of a part, less by what chance makes of none.

        It counts where one side alone has lines. The positive-part estimator of James and Stein (1961) takes
        little from a slope that is seen, and all from one that is not.
        """
        middle = first + (last - first) // 2
        (low_x, low, chance), (high_x, high, more) = self._half(first, middle), self._half(middle, last)
        rise = high - low
        return max(1.0 - (chance + more) / rise**2, 0.0) * rise / (high_x - low_x) if rise else 0.0

    def _half(self, first: int, last: int) -> tuple[float, float, float]:
        """Return the mean of x, the median of y and its variance by chance."""
        n = last - first
        x, y, square = ((each[last] - each[first]) / n for each in self._sums)
        # A median's variance is pi / 2 times that of a mean.
        return x, median(self._y[first:last]), 0.5 * np.pi * max(square - y**2, 0.0) / n


def _log_likelihood(
    noise: _Noise | None, wanted: _Candidates, controller: AxisController, estimate: Plant
) -> FloatArray:
    """Return by how much each mode explains the spectrum better than none, (n_frequencies, n_kinds).

    Notes
    -----
    Whittle's likelihood of averaged periodograms. What even the best mode leaves beyond chance is of
    something that is not modelled: all differences count for less by that (McCullagh and Nelder,
    *Generalized Linear Models*, chapter 9).
    """
    found = np.zeros((wanted.natural_hz.size, len(_OF_AIR), wanted.gain.size))
    if noise is None:
        return np.asarray(found.reshape(wanted.natural_hz.size, -1), dtype=np.float64)
    step_hz = float(noise.frequency_hz[1] - noise.frequency_hz[0])
    offset = np.arange(-2 * _FINE, (noise.relative.size + 2) * _FINE) / _FINE
    fine_hz = np.asarray(np.maximum(noise.frequency_hz[0] + step_hz * offset, 0.1), dtype=np.float64)
    loop, taper = rate_loop(controller, estimate, fine_hz)[0], _taper()
    for place, natural_hz in enumerate(wanted.natural_hz.tolist()):
        first, last = np.searchsorted(noise.frequency_hz, (natural_hz / _NEAR, natural_hz * _NEAR)).tolist()
        if last - first < _FEWEST_LINES or natural_hz > noise.frequency_hz[-1]:
            continue
        part = slice(first * _FINE, (last + 4) * _FINE)
        found[place] = _explained(fine_hz[part] / natural_hz, loop[part], taper, noise, slice(first, last))
    used = (noise.frequency_hz >= wanted.natural_hz[0]) & (noise.n_independent > 0.0)
    deviance = (
        2.0 * float(np.sum((noise.n_independent * _deviance(_over_none(noise)))[used])) - 2.0 * found.max()
    )
    of_chance = max(deviance / max(np.count_nonzero(used), 1), 1.0)
    return np.asarray(found.reshape(wanted.natural_hz.size, -1) / of_chance, dtype=np.float64)


def _ruled_out(wanted: _Candidates, measured: Measured) -> FloatArray:
    """Return by how much each mode makes the measured response less likely, (n_frequencies, n_kinds).

    Below a mode the response changes by its skirt, 1 + gain h, over whole bands: taken at the lower end of
    each, where it is least. A response that is more like the mode's than the model's proves none: a lag of
    another order changes it, too. What is off without any mode is not modelled, and counts as for the noise.
    """
    n_kinds = wanted.gain.size
    found = np.zeros((wanted.natural_hz.size, n_kinds))
    below = measured.ratio.frequency_hz * BAND_WIDTH < wanted.natural_hz[:, np.newaxis]
    # Modes above the same bands are held against these at once.
    for bands in np.unique(below, axis=0):
        n_below = int(np.count_nonzero(bands))
        if not n_below:
            continue
        places = np.flatnonzero((below == bands).all(axis=1))
        ratio = measured.ratio.of(bands)
        x = ratio.frequency_hz / np.sqrt(BAND_WIDTH) / wanted.natural_hz[places, np.newaxis, np.newaxis]
        h = x**2 / (1.0 - x**2 + 2j * wanted.damping_ratio[:, np.newaxis] * x)
        skirts = 1.0 + wanted.gain[:, np.newaxis] * h
        expected = np.vstack([np.ones(n_below), skirts.reshape(-1, n_below)])
        drawn = None if measured.drawn is None else measured.drawn[:, bands]
        off = distances(ratio, drawn, expected)
        of_chance = max(float(off[0]) / (2.0 * n_below), 1.0)
        found[places] = np.maximum(off[1:] - off[0], 0.0).reshape(-1, n_kinds) / (2.0 * of_chance)
    return found


def _deviance(ratio: FloatArray) -> FloatArray:
    return np.asarray(ratio - 1.0 - np.log(np.maximum(ratio, np.finfo(float).tiny)))


def _with_left(expected: FloatArray | float, seen: FloatArray, left: FloatArray) -> FloatArray:
    """Return what is expected with as much left of set-points as fits best, of none to the most."""
    return np.asarray(np.minimum(np.maximum(seen, expected), expected + left), dtype=np.float64)


def _over_none(noise: _Noise) -> FloatArray:
    """Return the spectrum over what is expected of a vehicle without modes."""
    return np.asarray(noise.relative / _with_left(1.0, noise.relative, noise.left), dtype=np.float64)


def _explained(
    x: FloatArray, loop: ComplexArray, taper: FloatArray, noise: _Noise, lines: slice
) -> FloatArray:
    """Return the gain in log likelihood of modes of one frequency, (n_airs, n_kinds).

    ``x`` is the frequency over theirs. With M = 1 + gain h, |1 + L M|^2 and |M|^2 are polynomials of gain.
    """
    h = x**2 / (1.0 - x**2 + 2j * np.array(_DAMPINGS)[:, np.newaxis] * x)
    closes, mode = (
        _OF_GAIN
        @ np.stack([np.broadcast_to(abs(a) ** 2, h.shape), 2.0 * (np.conj(a) * b).real, abs(b) ** 2], 1)
        for a, b in ((1.0 + loop, loop * h), (np.ones(x.shape), h))
    )
    through = np.abs(1.0 + loop) ** 2 / np.maximum(closes, np.finfo(float).tiny)
    by_noise, by_air = (_tapered(each.reshape(-1, x.size), taper) for each in (through, through * mode))
    seen, left = noise.relative[lines], noise.left[lines]
    air = np.array(_OF_AIR)[:, np.newaxis, np.newaxis]
    expected = np.maximum(1.0 - air, 0.0) * by_noise + air * by_air
    without = _deviance(seen / _with_left(1.0, seen, left))
    better = without - _deviance(seen / _with_left(expected, seen, left))
    return np.asarray(better @ noise.n_independent[lines], dtype=np.float64)


def _taper() -> FloatArray:
    """Return what a line of a tapered window (Hann) holds of a fine spectrum that begins two lines before.

    Shape (_FINE, n_parts): point by point, in parts of a line's width.
    """
    offset = np.arange(1 - 2 * _FINE, 2 * _FINE) / _FINE
    # The taper's transform is sinc x / (1 - x^2), one half at the neighbouring lines.
    beside = np.abs(offset) == 1.0
    weight = np.where(beside, 0.25, (np.sinc(offset) / np.where(beside, 1.0, 1.0 - offset**2)) ** 2)
    return np.append(0.0, weight / weight.sum()).reshape(-1, _FINE).T


def _tapered(fine: FloatArray, taper: FloatArray) -> FloatArray:
    """Return the lines of fine spectra (n_spectra, (n_lines + n_parts) * _FINE), (n_spectra, n_lines)."""
    n_parts = taper.shape[1]
    parts = fine.reshape(len(fine), -1, _FINE) @ taper
    n_lines = parts.shape[1] - n_parts
    return np.asarray(sum(parts[:, part : part + n_lines, part] for part in range(n_parts)))


def _present(gained: FloatArray, n_frequencies: int) -> float:
    """Return the probability that there is a mode in a band, by how much one explains the spectrum."""
    most = max(float(gained.max()), 0.0)
    none = (1.0 - _PRESENT) ** (len(gained) / n_frequencies)
    odds = (1.0 / none - 1.0) * float(np.mean(np.exp(gained - most)))
    return float(odds / (odds + np.exp(-most)))


class _Drawn(NamedTuple):
    """Modes of one band, and how far each goes towards -1; (1 + n_spare,), the estimate's first."""

    modes: Modes
    used: FloatArray


def _even(n: int, random: np.random.Generator) -> FloatArray:
    """Return numbers between 0 and 1 in random order, one in each of n equal parts, (n,)."""
    return np.asarray((random.permutation(n) + random.random(n)) / n, dtype=np.float64)


def _most_of(
    drawn: list[_Drawn], present: FloatArray, seen: bool, random: np.random.Generator, n: int
) -> Modes:
    """Return of the modes that a vehicle has the one that takes most of its gain, or none; (1 + n,).

    In the order of what they take, vehicles get those of even numbers: how bad the worst of them are does
    not depend on which were drawn.
    """
    used = np.stack([each.used for each in drawn])
    n_spare = used.shape[1] - 1
    there = np.empty(used.shape, dtype=np.bool_)
    there[:, 1:] = [_even(n_spare, random) < one for one in present.tolist()]
    there[:, 0] = present == present.max()
    there[:, 1:] &= _even(n_spare, random) >= _NO_MODE
    which = np.argmax(np.where(there, used, -1.0), axis=0)
    every = [np.stack(values) for values in zip(*(each.modes for each in drawn), strict=True)]
    modes = Modes(*(values[which, np.arange(which.size)] for values in every))
    there[:, 0] &= seen
    modes = modes._replace(gain=np.where(there.any(axis=0), modes.gain, 0.0))
    taken = np.max(np.where(there, used, -1.0), axis=0)[1:]
    even = even_uniform(Drawn.MODE, n, _SEED)[:, 0]
    numbers = 1 + np.argsort(taken, kind="stable")[(even * n_spare).astype(np.int64)]
    return modes.at(np.append(0, numbers))


def _gain_used(modes: Modes, every_hz: FloatArray, without: ComplexArray) -> FloatArray:
    """Return how far the circles of modes go towards -1, (n_modes,): with 1 and more no vehicle flies.

    ``without`` is the open loop at those frequencies, as if there were no mode.
    """
    away = np.tan(np.linspace(-1.5, 1.5, _CIRCLE))
    # Over the natural frequency, all modes of one damping go through the same circle.
    damping_ratio, kind = np.unique(modes.damping_ratio, return_inverse=True)
    x = 1.0 + damping_ratio[:, np.newaxis] * away
    circle = x**2 / (1.0 - x**2 + 2j * damping_ratio[:, np.newaxis] * x)
    loop = np.interp(modes.natural_hz[:, np.newaxis] * x[kind], every_hz, without)
    loop *= 1.0 + modes.gain[:, np.newaxis] * circle[kind]
    imag = np.ascontiguousarray(loop.imag)
    crosses = (imag[:, :-1] * imag[:, 1:] <= 0.0) & (imag[:, :-1] != imag[:, 1:])
    row, before = np.nonzero(crosses)
    first, second = loop[row, before], loop[row, before + 1]
    place = first.imag / (first.imag - second.imag)
    used = np.zeros(modes.gain.size)
    np.maximum.at(used, row, -(first.real + place * (second.real - first.real)))
    return used
