"""How far a loop is from instability, with the interval that the vehicle's uncertainty makes.

Every figure is computed for all drawn vehicles at once. Its interval runs from the 2.5 to the 97.5 %
quantile over them; a drawn vehicle whose loop is unstable has no margin left, and counts as zero. Above the
frequency up to which measurement supports the model, unmodelled dynamics may take phase away: each figure is
computed a second time with a further delay there, and the interval covers both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.maths.band import ComplexArray

#: Of dynamics that nobody measured: two steps of a slow control loop, an output board's queue (5.4 ms is
#: documented of one), a stiff frame's first mode.
UNMODELLED_DELAY_S: Final = 0.005
_CI = (0.025, 0.975)
#: Where modes of frames are, and a third of the relative half width of the sharpest of them.
_MODES_HZ: Final = (5.0, 75.0)
_FINE_STEP: Final = 0.003
#: Loops whose figures are computed at once: arrays of some hundred kilobytes.
_AT_ONCE: Final = 100


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
        Up to where measurement supports the model: the phase of the delay grows from there.

    Returns
    -------
    ndarray of complex, shape (n_frequencies,)
    """
    beyond_hz = np.maximum(frequency_hz - known_hz, 0.0)
    return np.asarray(np.exp(-2j * np.pi * beyond_hz * UNMODELLED_DELAY_S), dtype=np.complex128)


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

    Returns
    -------
    Margins
    """
    found = figures_of(frequency_hz, loop, integrators, unstable_poles)
    worse = found
    if known_hz < frequency_hz[-1]:
        later = loop * unmodelled(frequency_hz, known_hz)
        worse = figures_of(frequency_hz, later, integrators, unstable_poles)
    places_hz = np.array([found.crossover_hz[0], found.oscillation_hz[0]])
    extrapolated = bool((places_hz[np.isfinite(places_hz)] > known_hz).any())
    fraction = float(np.mean(found.stable))
    if not found.stable[0]:
        return Margins(stable=False, stable_fraction=fraction, extrapolated=extrapolated)

    def estimated(
        name: str, at_limit: float | None, scale: Callable[[FloatArray], FloatArray]
    ) -> Estimated | None:
        sides = [scale(_at_limit(getattr(each, name), each.stable, at_limit)) for each in (found, worse)]
        return _estimated(*sides)

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


def _at_limit(values: FloatArray, stable: BoolArray, at_limit: float | None) -> FloatArray:
    """Put an unstable loop at the limit of stability; without a limit it says nothing."""
    return np.where(stable, values, np.nan if at_limit is None else at_limit)


def _estimated(values: FloatArray, worse: FloatArray) -> Estimated | None:
    """Return the first value with the quantiles of all and of the worse ones; None where it has none."""
    if not np.isfinite(values[0]):
        return None
    kept = [each[~np.isnan(each)] for each in (values, worse)]
    limits = [_nearest(each) for each in kept if each.size]
    low, high = min(each[0] for each in limits), max(each[1] for each in limits)
    return Estimated(float(values[0]), (float(min(low, values[0])), float(max(high, values[0]))))


def _nearest(values: FloatArray) -> FloatArray:
    """Return the values nearest to the quantiles; numpy.quantile takes as long as all figures of a loop."""
    places = np.rint((values.size - 1) * np.array(_CI)).astype(np.int64)
    return np.asarray(np.sort(values)[places])


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

    Returns
    -------
    LoopFigures

    Notes
    -----
    Disk margin: P. Seiler, A. Packard, P. Gahinet, "An introduction to disk margins," IEEE Control Systems
    40(5), 2020.
    """
    poles = np.broadcast_to(integrators, len(loop))
    some = [slice(first, first + _AT_ONCE) for first in range(0, max(len(loop), 1), _AT_ONCE)]
    parts = [_figures_of_some(frequency_hz, loop[one], poles[one], unstable_poles[one]) for one in some]
    return LoopFigures(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _figures_of_some(
    frequency_hz: FloatArray, loop: ComplexArray, integrators: IntArray, unstable_poles: BoolArray
) -> LoopFigures:
    """Return the figures of so few loops that all arrays stay in the processor's cache."""
    real, imag = np.ascontiguousarray(loop.real), np.ascontiguousarray(loop.imag)
    power = real**2
    power += imag**2
    crossover_hz, phase_rad, delay_s = _phase_margin(frequency_hz, loop, power)
    crossings = _on_negative_axis(real, imag)
    gain, oscillation_hz, gain_down = _gain_margins(frequency_hz, crossings, len(loop))
    # |1 + L|^2; of S = 1 / (1 + L), 4 |S - 1/2|^2 is |1 - L|^2 over that.
    distance = power
    distance += 2.0 * real
    distance += 1.0
    nearest = np.min(distance, axis=1)
    ratio = np.divide(real, distance, out=real)
    return LoopFigures(
        stable=_stable(loop, crossings, integrators, unstable_poles),
        crossover_hz=crossover_hz,
        phase_margin_rad=phase_rad,
        delay_margin_s=delay_s,
        gain_margin=gain,
        oscillation_hz=oscillation_hz,
        gain_margin_down=gain_down,
        disk_margin=2.0 / np.sqrt(1.0 - 4.0 * np.min(ratio, axis=1)),
        peak_sensitivity=1.0 / np.sqrt(nearest),
    )


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


def _on_negative_axis(real: FloatArray, imag: FloatArray) -> _Crossings:
    """Return the crossings of straight lines between the points of loops, both (n_plants, n_frequencies)."""
    above, below = imag > 0.0, imag < 0.0
    on_one_side = (above[:, :-1] & above[:, 1:]) | (below[:, :-1] & below[:, 1:])
    row, before = _where(~on_one_side)
    some, other = imag[row, before], imag[row, before + 1]
    change = some - other
    place = np.divide(some, change, where=change != 0.0, out=np.zeros(change.shape))
    first = real[row, before]
    at = first + place * (real[row, before + 1] - first)
    sense = (some >= 0.0).astype(np.int64) - (other >= 0.0)
    kept = (change != 0.0) & (at < 0.0)
    return _Crossings(row[kept], before[kept], place[kept], at[kept], sense[kept])


def _where(mask: BoolArray) -> tuple[IntArray, IntArray]:
    """Return rows and columns where a mask is set; `numpy.nonzero` of two dimensions takes far longer."""
    return np.divmod(np.flatnonzero(mask), mask.shape[1])


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
    return _stable(loop, _on_negative_axis(loop.real, loop.imag), integrators, unstable_poles)


def _stable(
    loop: ComplexArray, crossings: _Crossings, integrators: int | IntArray, unstable_poles: BoolArray
) -> BoolArray:
    """Do what `is_stable` says, with the crossings of the negative real axis."""
    # 1 + L turns by what lies between its ends, and once more for each crossing of the axis beyond -1.
    beyond = crossings.real <= -1.0
    turns = np.bincount(crossings.row[beyond], crossings.sense[beyond], len(loop)).astype(np.float64)
    begins, ends = np.angle(1.0 + loop[:, 0]), np.angle(1.0 + loop[:, -1])
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
        The crossover with the least phase to spare, that phase, and the least delay that any crossover bears.
    """
    return _phase_margin(frequency_hz, loop, loop.real**2 + loop.imag**2)


def _phase_margin(
    frequency_hz: FloatArray, loop: ComplexArray, power: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Do what `phase_margin` says, with the square of the gain."""
    above = power > 1.0
    row, before = _where(above[:, :-1] & ~above[:, 1:])
    level, after = np.log(power[row, before]), np.log(power[row, before + 1])
    place = level / (level - after)
    at_hz = _between(frequency_hz, before, place)
    some = loop[row, before]
    spare = np.mod(np.pi + np.angle(some) + place * np.angle(loop[row, before + 1] / some), 2.0 * np.pi)
    spare = np.where(spare > 1.5 * np.pi, spare - 2.0 * np.pi, spare)
    delay_s = spare / (2.0 * np.pi * at_hz)
    least = _least(row, spare, len(loop))
    return _chosen(at_hz, least), _chosen(spare, least), _chosen(delay_s, _least(row, delay_s, len(loop)))


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
