"""How far a loop is from instability, with the interval that the vehicle's uncertainty makes.

Every figure is computed for all drawn vehicles at once. Its interval runs from the 2.5 to the 97.5 %
quantile over them; a drawn vehicle whose loop is unstable has no margin left, and counts as zero. Above the
frequency up to which measurement supports the model, unmodelled dynamics may take phase away: each figure is
computed a second time with a further loss of phase there, and the interval covers both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.normal import ENDS_95

#: Phase that dynamics which nobody measured may take far above what is known [deg]: see `unmodelled`.
MOST_UNMODELLED_DEG: Final = math.degrees(0.5 * math.pi - math.sqrt(2.0))
#: Where modes of frames are, and a third of the relative half width of the sharpest of them.
_MODES_HZ: Final = (5.0, 75.0)
_FINE_STEP: Final = 0.003
#: Times what is known, up to where the loss of phase is computed, and at how many places.
_FAR: Final = 100.0
_N_LOST: Final = 400
#: No response is known below this [Hz].
_LOWEST_KNOWN_HZ: Final = 0.01
#: Points of loops that are looked at at once: arrays of half a megabyte, which stay in the processor's cache.
POINTS_AT_ONCE: Final = 60_000


def grid_hz(period_s: float) -> FloatArray:
    """Return frequencies from where both integrators dominate to half the loop's rate, 2 % apart.

    Parameters
    ----------
    period_s : float
        Of the control loop [s].

    Returns
    -------
    ndarray, shape (n_frequencies,)
        [Hz]. Between neighbours a loop is straight to a thousandth.
    """
    highest_hz = 0.499 / period_s
    return np.geomspace(0.01, highest_hz, int(np.log(highest_hz / 0.01) / 0.02) + 2)


def fine_grid_hz(period_s: float) -> FloatArray:
    """Return the frequencies of `grid_hz`, so close together where frames bend that no mode falls between.

    Parameters
    ----------
    period_s : float
        Of the control loop [s].

    Returns
    -------
    ndarray, shape (n_frequencies,)
        [Hz].
    """
    coarse = grid_hz(period_s)
    low_hz, high_hz = _MODES_HZ
    fine = np.geomspace(low_hz, high_hz, int(np.log(high_hz / low_hz) / _FINE_STEP) + 2)
    return np.unique(np.concatenate([coarse, fine[fine < coarse[-1]]]))


def unmodelled(frequency_hz: FloatArray, known_hz: float) -> ComplexArray:
    """Return the factor by which dynamics that nobody measured may change a loop.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
    known_hz : float
        Up to where measurement supports the model: phase is lost from there.

    Returns
    -------
    ndarray of complex, shape (n_frequencies,)

    Notes
    -----
    A delay, be it of a slow loop or of an output board's queue, is in the model: the response up to
    ``known_hz`` shows it, whatever makes it. What that does not show is how phase bends away from a delay
    further up. A low-pass of the second order (Butterworth: a driver's, a sensor's) loses
    p(x) = arg(1 - x^2 + j sqrt(2) x) at x times its cut-off c. As much of that as is a delay by what the band
    shows is known; p(f / c) - f / known_hz p(known_hz / c) is not. Over all c above the band that is at most
    4.4 degrees at twice ``known_hz``, 6.5 at three times, and pi / 2 - sqrt(2), 9 degrees, far above. What
    resonates is drawn as a mode of the frame (`flexible_mode`).
    """
    ratio, lost_rad = _most_lost()
    over = np.maximum(frequency_hz / max(known_hz, _LOWEST_KNOWN_HZ), 1.0)
    return np.asarray(np.exp(-1j * np.interp(np.log(over), ratio, lost_rad)), dtype=np.complex128)


@cache
def _most_lost() -> tuple[FloatArray, FloatArray]:
    """Return logarithms of f over what is known, and the most phase that is lost there [rad]."""
    over = np.geomspace(1.0, _FAR, _N_LOST)
    of_cutoff = np.geomspace(1.0 / _FAR, 1.0, _N_LOST)[:, np.newaxis]

    def lost(x: FloatArray) -> FloatArray:
        return np.asarray(np.arctan2(math.sqrt(2.0) * x, 1.0 - x**2))

    beyond = lost(of_cutoff * over) - over * lost(of_cutoff)
    return np.log(over), np.asarray(np.max(beyond, axis=0))


def margins_of(
    frequency_hz: FloatArray, loop: ComplexArray, integrators: int, unstable_poles: BoolArray, known_hz: float
) -> Margins:
    """Return the margins of the first loop, with intervals over all.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        As of `grid_hz`.
    loop : ndarray of complex, shape (n_plants, n_frequencies)
        Open loops: of the estimate, then of vehicles drawn around it.
    integrators, unstable_poles
        As of `is_stable`.
    known_hz : float
        As of `unmodelled`.
    """
    found, worse = figures_and_worse(frequency_hz, loop, integrators, unstable_poles, known_hz)
    places_hz = np.array([found.crossover_hz[0], found.oscillation_hz[0]])
    extrapolated = bool((places_hz[np.isfinite(places_hz)] > known_hz).any())
    fraction = float(np.mean(found.stable))
    if not found.stable[0]:
        return Margins(stable=False, stable_fraction=fraction, extrapolated=extrapolated)

    def estimated(
        name: str, at_limit: float | None, scale: Callable[[FloatArray], FloatArray]
    ) -> Estimated | None:
        # Put an unstable loop at the limit of stability; without a limit it says nothing.
        sides = [
            scale(np.where(each.stable, getattr(each, name), np.nan if at_limit is None else at_limit))
            for each in (found, worse)
        ]
        values = sides[0]
        if not np.isfinite(values[0]):
            return None
        # The quantiles of all and of the worse ones, as the nearest values: numpy.quantile takes as long as
        # all figures of a loop.
        ordered = (np.sort(each[~np.isnan(each)]) for each in sides)
        limits = [
            each[np.rint((each.size - 1) * np.array(ENDS_95)).astype(np.int64)]
            for each in ordered
            if each.size
        ]
        low, high = min(each[0] for each in limits), max(each[1] for each in limits)
        return Estimated(float(values[0]), (float(min(low, values[0])), float(max(high, values[0]))))

    return Margins(
        stable=True,
        stable_fraction=fraction,
        extrapolated=extrapolated,
        crossover_hz=estimated("crossover_hz", None, _same),
        phase_margin_deg=estimated("phase_margin_rad", 0.0, np.degrees),
        gain_margin_db=estimated("gain_margin", 1.0, _decibel),
        gain_margin_down_db=estimated("gain_margin_down", 1.0, _decibel),
        oscillation_hz=estimated("oscillation_hz", None, _same),
        delay_margin_s=estimated("delay_margin_s", 0.0, _same),
        disk_margin=estimated("disk_margin", 0.0, _same),
        peak_sensitivity=estimated("peak_sensitivity", np.inf, _same),
    )


def _same(values: FloatArray) -> FloatArray:
    return values


def _decibel(factor: FloatArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(factor))


class LoopFigures(NamedTuple):
    """Figures of loops, each (n_plants,), NaN where a loop does not have one; gains as factors."""

    stable: BoolArray
    crossover_hz: FloatArray
    phase_margin_rad: FloatArray
    delay_margin_s: FloatArray
    gain_margin: FloatArray
    oscillation_hz: FloatArray
    gain_margin_down: FloatArray
    disk_margin: FloatArray
    peak_sensitivity: FloatArray


def figures_of(
    frequency_hz: FloatArray, loop: ComplexArray, integrators: int | IntArray, unstable_poles: BoolArray
) -> LoopFigures:
    """Return the figures of open loops.

    Parameters
    ----------
    frequency_hz, loop, integrators, unstable_poles
        As of `margins_of`; integrators may be those of each loop, (n_plants,).

    Notes
    -----
    Disk margin: P. Seiler, A. Packard, P. Gahinet, "An introduction to disk margins," IEEE Control Systems
    40(5), 2020.
    """
    return figures_and_worse(frequency_hz, loop, integrators, unstable_poles, np.inf)[0]


def figures_and_worse(
    frequency_hz: FloatArray,
    loop: ComplexArray,
    integrators: int | IntArray,
    unstable_poles: BoolArray,
    known_hz: float,
) -> tuple[LoopFigures, LoopFigures]:
    """Return the figures of open loops, and those with dynamics that nobody measured.

    Parameters
    ----------
    frequency_hz, loop, integrators, unstable_poles
        As of `figures_of`.
    known_hz : float
        As of `unmodelled`.
    """

    def figures(curve: _Curve) -> LoopFigures:
        n_plants = curve.begins.size
        stable = _stable(curve.begins, curve.ends, curve.crossings, integrators, unstable_poles)
        crossover_hz, phase_rad, delay_s = _phase_margin(frequency_hz, curve.falls, n_plants, stable)
        gain, oscillation_hz, gain_down = _gain_margins(frequency_hz, curve.crossings, n_plants)
        return LoopFigures(
            stable=stable,
            crossover_hz=crossover_hz,
            phase_margin_rad=phase_rad,
            delay_margin_s=delay_s,
            gain_margin=gain,
            oscillation_hz=oscillation_hz,
            gain_margin_down=gain_down,
            disk_margin=2.0 / np.sqrt(1.0 - 4.0 * curve.ratio),
            peak_sensitivity=1.0 / np.sqrt(curve.nearest),
        )

    n_known = int(np.count_nonzero(frequency_hz <= known_hz))
    if n_known == frequency_hz.size:
        found = figures(_curve(loop, 0))
        return found, found
    later = unmodelled(frequency_hz[n_known:], known_hz)
    if not n_known:
        return figures(_curve(loop, 0)), figures(_curve(loop * later, 0))
    # Where the vehicle is known both are the same curve, which is looked at once; the step from its last
    # point is another's as well.
    known, beyond = _curve(loop[:, :n_known], 0), loop[:, n_known - 1 :]
    moved = beyond.copy()
    moved[:, 1:] *= later
    found, worse = (figures(_joined(known, _curve(each, n_known - 1))) for each in (beyond, moved))
    return found, worse


class _Curve(NamedTuple):
    """What the figures of loops need of their Nyquist curves, or of a part of the frequencies.

    Both ends, each (n_plants,); the least of |1 + L|^2, and of L's real part over that; where the curves
    cross the negative real axis, and where their gain falls below one.
    """

    begins: ComplexArray
    ends: ComplexArray
    nearest: FloatArray
    ratio: FloatArray
    crossings: _Crossings
    falls: _Falls


def _curve(loop: ComplexArray, first: int) -> _Curve:
    """Look at loops, or at their part from the frequency of that number on."""
    at_once = max(POINTS_AT_ONCE // loop.shape[1], 1)
    parts = [_some_curves(loop[row : row + at_once], row, first) for row in range(0, len(loop), at_once)]
    if len(parts) == 1:
        return parts[0]
    begins, ends, nearest, ratio, crossings, falls = zip(*parts, strict=True)
    return _Curve(
        begins=np.concatenate(begins),
        ends=np.concatenate(ends),
        nearest=np.concatenate(nearest),
        ratio=np.concatenate(ratio),
        crossings=_Crossings(*(np.concatenate(each) for each in zip(*crossings, strict=True))),
        falls=_Falls(*(np.concatenate(each) for each in zip(*falls, strict=True))),
    )


def _some_curves(loop: ComplexArray, row: int, first: int) -> _Curve:
    """Look at so few loops, the first of that number, that all arrays stay in the processor's cache."""
    real, imag = np.ascontiguousarray(loop.real), np.ascontiguousarray(loop.imag)
    power = real**2
    power += imag**2
    crossings, falls = _on_negative_axis(real, imag, row, first), _falls(loop, power, row, first)
    # |1 + L|^2; of S = 1 / (1 + L), 4 |S - 1/2|^2 is |1 - L|^2 over that.
    distance = power
    distance += 2.0 * real
    distance += 1.0
    nearest = np.min(distance, axis=1)
    ratio = np.min(np.divide(real, distance, out=real), axis=1)
    return _Curve(loop[:, 0], loop[:, -1], nearest, ratio, crossings, falls)


def _joined(one: _Curve, other: _Curve) -> _Curve:
    """Put two parts of curves together, the second from where the first ends."""
    return _Curve(
        one.begins,
        other.ends,
        np.minimum(one.nearest, other.nearest),
        np.minimum(one.ratio, other.ratio),
        _Crossings(*_by_row(one.crossings, other.crossings)),
        _Falls(*_by_row(one.falls, other.falls)),
    )


def _by_row(one: _Crossings | _Falls, other: _Crossings | _Falls) -> Iterator[Any]:
    """Yield each field of both, row after row, in a row those of the first part first."""
    order = np.argsort(np.concatenate([one.row, other.row]), kind="stable")
    return (np.concatenate(each)[order] for each in zip(one, other, strict=True))


class _Crossings(NamedTuple):
    """Where Nyquist curves cross the negative real axis, each (n_crossings,).

    Row and number of the frequency before, place between it and the next, the real part there, and in which
    sense: 1 for counterclockwise about zero, 0 where the curve only touches the axis.
    """

    row: IntArray
    before: IntArray
    place: FloatArray
    real: FloatArray
    sense: IntArray


def _on_negative_axis(real: FloatArray, imag: FloatArray, row: int, first: int) -> _Crossings:
    """Return the crossings of straight lines between the points of loops, both (n_plants, n_frequencies).

    ``row`` and ``first`` are the numbers of the first loop and of the first frequency.
    """
    side = (imag > 0.0).view(np.int8) - (imag < 0.0).view(np.int8)
    rows, before = _steps(side, np.not_equal)
    some, other = imag[rows, before], imag[rows, before + 1]
    begins = real[rows, before]
    place = some / (some - other)
    at = begins + place * (real[rows, before + 1] - begins)
    sense = (some >= 0.0).astype(np.int64) - (other >= 0.0)
    kept = at < 0.0
    return _Crossings(row + rows[kept], first + before[kept], place[kept], at[kept], sense[kept])


class _Falls(NamedTuple):
    """Where the gains of loops fall below one, each (n_falls,).

    Row and number of the frequency before, place between it and the next, phase over minus pi there [rad].
    """

    row: IntArray
    before: IntArray
    place: FloatArray
    spare_rad: FloatArray


def _falls(loop: ComplexArray, power: FloatArray, row: int, first: int) -> _Falls:
    """Return where gains fall below one, with their squares; ``row``, ``first`` as of `_on_negative_axis`."""
    rows, before = _steps(power > 1.0, np.greater)
    level, after = np.log(power[rows, before]), np.log(power[rows, before + 1])
    place = level / (level - after)
    some = loop[rows, before]
    spare = np.mod(np.pi + np.angle(some) + place * np.angle(loop[rows, before + 1] / some), 2.0 * np.pi)
    spare = np.where(spare > 1.5 * np.pi, spare - 2.0 * np.pi, spare)
    return _Falls(row + rows, first + before, place, spare)


def _steps(values: NDArray[Any], steps: np.ufunc) -> tuple[IntArray, IntArray]:
    """Return rows and columns before which a value stands so to the next of its row.

    All rows are gone through as one, which is several times as fast.
    """
    flat, n_columns = values.ravel(), values.shape[1]
    row, before = np.divmod(np.flatnonzero(steps(flat[:-1], flat[1:])), n_columns)
    inside = before < n_columns - 1
    return row[inside], before[inside]


def _least(row: IntArray, values: FloatArray, n_rows: int) -> IntArray:
    """Return for each row the number of its least value, the first of equal ones; -1 where it has none.

    ``row`` rises.
    """
    found = np.full(n_rows, -1, dtype=np.int64)
    if row.size:
        is_next = np.ones(row.size, dtype=np.bool_)
        is_next[1:] = row[1:] != row[:-1]
        of_row = np.minimum.reduceat(values, np.flatnonzero(is_next))
        least = np.flatnonzero(values == of_row[np.cumsum(is_next) - 1])[::-1]
        # Of equal ones the first is written last.
        found[row[least]] = least
    return found


def _chosen(values: FloatArray, number: IntArray) -> FloatArray:
    """Return the values of these numbers, NaN for -1."""
    return np.append(values, np.nan)[number]


def _between(frequency_hz: FloatArray, before: IntArray, place: FloatArray) -> FloatArray:
    """Return frequencies [Hz] at a place after those of these numbers, in proportion to logarithms."""
    low_hz = frequency_hz[before]
    return np.asarray(low_hz * (frequency_hz[before + 1] / low_hz) ** place)


def is_stable(loop: ComplexArray, integrators: int, unstable_poles: BoolArray) -> BoolArray:
    """Tell from the Nyquist curve whether closed loops are stable.

    Parameters
    ----------
    loop : ndarray of complex, shape (n_plants, n_frequencies)
        From where its integrators dominate to where its gain is small.
    integrators : int
        Poles of the open loop at zero frequency.
    unstable_poles : ndarray of bool, shape (n_plants,)
        The open loop has a pole in the right half plane.

    Returns
    -------
    ndarray of bool, shape (n_plants,)

    Notes
    -----
    The argument principle: without an unstable pole of the closed loop, 1 + L turns by a quarter of a circle
    for each integrator and by a half for each unstable pole, from zero frequency to high ones, where it is 1.
    """
    crossings = _on_negative_axis(loop.real, loop.imag, 0, 0)
    return _stable(loop[:, 0], loop[:, -1], crossings, integrators, unstable_poles)


def _stable(
    first: ComplexArray,
    last: ComplexArray,
    crossings: _Crossings,
    integrators: int | IntArray,
    unstable_poles: BoolArray,
) -> BoolArray:
    """Do what `is_stable` says, with the loops' ends and their crossings of the negative real axis."""
    # 1 + L turns by what lies between its ends, and once more for each crossing of the axis beyond -1.
    beyond = crossings.real <= -1.0
    turns = np.bincount(crossings.row[beyond], crossings.sense[beyond], first.size).astype(np.float64)
    begins, ends = np.angle(1.0 + first), np.angle(1.0 + last)
    # At the first frequency the vehicle's own pole has turned the curve by something between nothing and a
    # quarter.
    near = -0.5 * np.pi * (integrators + 0.5) - 0.5 * np.pi * unstable_poles
    turns += np.round((near - begins) / (2.0 * np.pi))
    return np.asarray(np.abs(ends + 2.0 * np.pi * turns) < np.pi, dtype=np.bool_)


def phase_margin(frequency_hz: FloatArray, loop: ComplexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return where open loops run out of phase first.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
    loop : ndarray of complex, shape (n_plants, n_frequencies)

    Returns
    -------
    crossover_hz, phase_margin_rad, delay_margin_s : ndarray, shape (n_plants,)
        The crossover with the least phase to spare, that phase, and the least delay that any crossover bears;
        below zero beyond -180 degrees, as nothing tells whether the loops are stable.
    """
    falls = _falls(loop, loop.real**2 + loop.imag**2, 0, 0)
    return _phase_margin(frequency_hz, falls, len(loop), np.zeros(len(loop), dtype=np.bool_))


def _phase_margin(
    frequency_hz: FloatArray, falls: _Falls, n_plants: int, stable: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Do what `phase_margin` says, with the places where gains fall below one.

    A stable loop has phase to spare at each of them, however often a mode of the frame has turned its curve:
    the least that brings it to -1, be it lost or gained. Of delay only what is lost counts.
    """
    row, spare = falls.row, falls.spare_rad
    at_hz = _between(frequency_hz, falls.before, falls.place)
    of_stable = stable[row]
    lost = np.where(of_stable, np.mod(spare, 2.0 * np.pi), spare)
    spare = np.where(of_stable, np.minimum(lost, 2.0 * np.pi - lost), spare)
    delay_s = lost / (2.0 * np.pi * at_hz)
    least = _least(row, spare, n_plants)
    return _chosen(at_hz, least), _chosen(spare, least), _chosen(delay_s, _least(row, delay_s, n_plants))


def _gain_margins(
    frequency_hz: FloatArray, crossings: _Crossings, n_plants: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return factors by which the gain may grow and may fall, and at which frequency [Hz] the first ends."""
    at_hz = _between(frequency_hz, crossings.before, crossings.place)
    inside = crossings.real > -1.0
    up = _least(crossings.row[inside], crossings.real[inside], n_plants)
    down = _least(crossings.row[~inside], -crossings.real[~inside], n_plants)
    return (
        _chosen(-1.0 / crossings.real[inside], up),
        _chosen(at_hz[inside], up),
        _chosen(-crossings.real[~inside], down),
    )
