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

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.maths.band import ComplexArray

#: Of dynamics that nobody measured: two steps of a slow control loop, an output board's queue (5.4 ms is
#: documented of one), a stiff frame's first mode.
UNMODELLED_DELAY_S: Final = 0.005
_CI = (0.025, 0.975)
#: Where modes of frames are, and a third of the relative half width of the sharpest of them.
_MODES_HZ: Final = (5.0, 75.0)
_FINE_STEP: Final = 0.003


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
    limits = [np.quantile(each, _CI, method="nearest") for each in kept if each.size]
    low, high = min(each[0] for each in limits), max(each[1] for each in limits)
    return Estimated(float(values[0]), (float(min(low, values[0])), float(max(high, values[0]))))


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
    frequency_hz: FloatArray, loop: ComplexArray, integrators: int, unstable_poles: BoolArray
) -> LoopFigures:
    """Return the figures of open loops.

    Parameters
    ----------
    frequency_hz, loop, integrators, unstable_poles
        As of `margins_of`.

    Returns
    -------
    LoopFigures

    Notes
    -----
    Disk margin: P. Seiler, A. Packard, P. Gahinet, "An introduction to disk margins," IEEE Control Systems
    40(5), 2020.
    """
    crossover_hz, phase_rad, delay_s = phase_margin(frequency_hz, loop)
    gain, oscillation_hz, gain_down = _gain_margins(frequency_hz, loop)
    sensitivity = 1.0 / (1.0 + loop)
    return LoopFigures(
        stable=is_stable(loop, integrators, unstable_poles),
        crossover_hz=crossover_hz,
        phase_margin_rad=phase_rad,
        delay_margin_s=delay_s,
        gain_margin=gain,
        oscillation_hz=oscillation_hz,
        gain_margin_down=gain_down,
        disk_margin=1.0 / np.max(np.abs(sensitivity - 0.5), axis=1),
        peak_sensitivity=np.max(np.abs(sensitivity), axis=1),
    )


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
    difference = 1.0 + loop
    turned = np.sum(np.angle(difference[:, 1:] / difference[:, :-1]), axis=1)
    # At the first frequency the vehicle's own pole has turned the curve by something between nothing and a
    # quarter.
    near = -0.5 * np.pi * (integrators + 0.5) - 0.5 * np.pi * unstable_poles
    first = np.angle(difference[:, 0])
    first += 2.0 * np.pi * np.round((near - first) / (2.0 * np.pi))
    return np.asarray(np.abs(first + turned) < np.pi, dtype=np.bool_)


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
    level = np.log(np.abs(loop))
    crossing = (level[:, :-1] > 0.0) & (level[:, 1:] <= 0.0)
    place = np.divide(
        level[:, :-1], level[:, :-1] - level[:, 1:], where=crossing, out=np.zeros(crossing.shape)
    )
    at_hz = frequency_hz[:-1] * (frequency_hz[1:] / frequency_hz[:-1]) ** place
    turn = np.angle(loop[:, 1:] / loop[:, :-1])
    spare = np.mod(np.pi + np.angle(loop[:, :-1]) + place * turn, 2.0 * np.pi)
    spare = np.where(spare > 1.5 * np.pi, spare - 2.0 * np.pi, spare)
    least = np.where(crossing, spare, np.inf)
    rows, number = np.arange(len(loop)), np.argmin(least, axis=1)
    some = crossing.any(axis=1)
    delay = np.min(np.where(crossing, spare / (2.0 * np.pi * at_hz), np.inf), axis=1)
    return (
        np.where(some, at_hz[rows, number], np.nan),
        np.where(some, least[rows, number], np.nan),
        np.where(some, delay, np.nan),
    )


def _gain_margins(frequency_hz: FloatArray, loop: ComplexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return factors by which the gain may grow and may fall, and at which frequency [Hz] the first ends."""
    above, below = loop[:, :-1], loop[:, 1:]
    change = above.imag - below.imag
    crossing = above.imag * below.imag <= 0.0
    crossing &= change != 0.0
    place = np.divide(above.imag, change, where=crossing, out=np.zeros(crossing.shape))
    real = above.real + place * (below.real - above.real)
    crossing &= real < 0.0
    inside, outside = crossing & (real > -1.0), crossing & (real <= -1.0)
    up = np.where(inside, real, 0.0)
    rows, number = np.arange(len(loop)), np.argmin(up, axis=1)
    down = np.max(np.where(outside, real, -np.inf), axis=1)
    at_hz = frequency_hz[:-1] * (frequency_hz[1:] / frequency_hz[:-1]) ** place
    some_up, some_down = inside.any(axis=1), outside.any(axis=1)
    largest = up[rows, number]
    return (
        np.divide(-1.0, largest, where=some_up, out=np.full(largest.shape, np.nan)),
        np.where(some_up, at_hz[rows, number], np.nan),
        np.where(some_down, -down, np.nan),
    )
