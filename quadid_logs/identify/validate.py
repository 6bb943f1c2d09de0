"""How the model predicts flight that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.model import FitSeries, Validation
from quadid_logs.identify.design import Design
from quadid_logs.identify.fit import commanded_fraction
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.structures import Structure
from quadid_logs.maths.band import high_pass
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS

#: The rate loop acts within the first, a pilot within the last.
HORIZONS_S: Final = (0.1, 0.2, 0.5)
#: Where the autocorrelation is below this, a residual tells nothing of the next.
_FORGOTTEN = 0.2
#: Residuals that remember for longer than this are no noise at all.
_LONGEST_MEMORY_S = 5.0
#: A rate loop answers within half a second.
_CORRELATED_S = 0.5
#: Distance between the starts of simulated horizons: several per second of
#: flight, so that the error is an average and not one lucky start.
_START_EVERY_S = 0.1


def validate(
    design: Design,
    structure: Structure,
    theta: FloatArray,
    torque: FloatArray,
    *,
    disturbance: FloatArray,
    high_pass_hz: float,
) -> tuple[Validation, FitSeries]:
    """Compare the model with held-out acceleration and with rates simulated from held-out torque.

    Parameters
    ----------
    design : Design
    structure : Structure
    theta : ndarray, shape (n_targets, n_columns)
        [A B]; the rows of p_dot, q_dot, r_dot are used.
    torque : ndarray, shape (n_rows, n_inputs)
        Columns of ``structure.inputs`` (behind the actuator or as logged).
    disturbance : ndarray, shape (n_targets, n_disturbances)
        Coefficients of ``design.disturbances(structure)``, which are taken from the log.
    high_pass_hz : float
        The fit left out what is slower; accelerations are compared without it too.

    Returns
    -------
    Validation, FitSeries
    """
    rate = np.column_stack([design.columns[name] for name in RATE_SYMBOLS])
    acceleration = np.column_stack([design.columns[name] for name in ACCELERATION_SYMBOLS])
    coefficients = np.column_stack([theta[:3], disturbance[:3]])
    names = (*structure.columns, *design.disturbances(structure))
    modelled = design.stack(names, torque, structure.inputs) @ coefficients.T
    pole = np.array(
        [
            coefficients[axis, names.index(name)] if name in names else 0.0
            for axis, name in enumerate(RATE_SYMBOLS)
        ]
    )
    motion = _OwnMotion(pole, modelled - pole * rate)
    simulated = _simulate_blocks(motion.mirrored(rate), rate, design)
    series = FitSeries(
        time_s=design.time_s,
        acceleration=acceleration,
        modelled_acceleration=modelled,
        rate=rate,
        simulated_rate=simulated,
        held_out=design.held_out,
    )
    held_out = design.held_out
    if np.count_nonzero(held_out) < 2:
        return Validation(held_out_s=0.0), series
    both = np.column_stack([acceleration, acceleration - modelled, torque[:, :3]])
    spread, error, given_torque = np.split(design.high_pass(both, high_pass_hz), 3, axis=1)
    missed = rate - simulated
    # After how long the held-out residual of each axis has forgotten itself, and its largest correlation with
    # its own torque, half a second around.
    n_lags = min(round(_LONGEST_MEMORY_S / design.period_s), len(error) - 1)
    reach = min(round(_CORRELATED_S / design.period_s), len(error) - 1)
    memory_s, correlation = [], []
    for left, moved in zip(
        np.where(held_out[:, np.newaxis], error, 0.0).T,
        np.where(held_out[:, np.newaxis], given_torque, 0.0).T,
        strict=True,
    ):
        products = np.array([left[lag:] @ left[: len(left) - lag] for lag in range(n_lags)])
        quiet = np.flatnonzero(products < _FORGOTTEN * products[:1])
        memory_s.append(float(quiet[0] * design.period_s) if quiet.size else float("nan"))
        size = float(np.linalg.norm(left) * np.linalg.norm(moved))
        common = [left[lag:] @ moved[: len(moved) - lag] for lag in range(reach + 1)]
        common += [moved[lag:] @ left[: len(left) - lag] for lag in range(1, reach + 1)]
        correlation.append(float(np.max(np.abs(common))) / size if size > 0.0 else float("nan"))
    commanded = {}
    if design.instruments is not None:
        project = Projection.onto(design.high_pass(design.instruments, high_pass_hz)[held_out])
        r2 = commanded_fraction(project, spread[held_out], error[held_out])
        commanded = _by_name(ACCELERATION_SYMBOLS, r2.tolist())
    r2_rate = _r2(rate[held_out], missed[held_out])
    return Validation(
        held_out_s=float(np.count_nonzero(held_out) * design.period_s),
        r2_acceleration=_by_name(ACCELERATION_SYMBOLS, _r2(spread[held_out], error[held_out])),
        r2_commanded=commanded,
        r2_simulated_rate=_by_name(RATE_SYMBOLS, r2_rate),
        r2_high_passed_rate=_by_name(RATE_SYMBOLS, _high_passed_r2(motion, rate, design, high_pass_hz)),
        # 100 (1 - |y - y_model| / |y - mean y|), as System Identification Toolbox defines fit.
        fit_percent=_by_name(
            RATE_SYMBOLS,
            [
                float(100.0 * (1.0 - np.sqrt(max(0.0, 1.0 - each)))) if np.isfinite(each) else each
                for each in r2_rate
            ],
        ),
        horizon_s=HORIZONS_S,
        horizon_rmse_rad_s=_horizon_errors(motion, rate, design, HORIZONS_S),
        residual_memory_s=_by_name(ACCELERATION_SYMBOLS, memory_s),
        input_correlation=_by_name(ACCELERATION_SYMBOLS, correlation),
    ), series


def _by_name(names: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    return dict(zip(names, values, strict=True))


def _high_passed_r2(motion: _OwnMotion, rate: FloatArray, design: Design, high_pass_hz: float) -> list[float]:
    """Return R2 of held-out rates simulated from what was high-passed, block by block.

    Gusts and drag push the rate away slowly; that is no fault of the model, and from a
    simulation that has it, it leaks into the band.
    """
    rate = design.high_pass(rate, high_pass_hz)
    fast = motion._replace(forcing=design.high_pass(motion.forcing, high_pass_hz)).mirrored(rate)
    error = rate - _simulate_blocks(fast, rate, design)
    ends = np.flatnonzero(np.diff(design.block)) + 1
    blocks = zip(*(np.split(each, ends) for each in (rate, error, design.held_out)), strict=True)
    kept = [
        tuple(
            high_pass(part, design.period_s, high_pass_hz) if high_pass_hz else part
            for part in (moved, missed)
        )
        for moved, missed, held_out in blocks
        if held_out.all()
    ]
    if not kept:
        return [float("nan")] * rate.shape[1]
    return _r2(*(np.concatenate(parts) for parts in zip(*kept, strict=True)))


class _OwnMotion(NamedTuple):
    """Each axis by itself: w' = pole * w + forcing; (3,) [1/s] and (n_rows, 3) [rad/s^2].

    The forcing is all else as measured, the other two rates too: an axis whose equation the
    flight cannot tell spoils no other.
    """

    pole: FloatArray
    forcing: FloatArray

    def mirrored(self, rate: FloatArray) -> _OwnMotion:
        """Return the motion with unstable poles mirrored, fed back from measured rates (n_rows, 3).

        The error of a free simulation grows with exp(d t) where the pole d is positive: after 1/d it
        is about its start and not about the model. With 2 d times the error fed back, the error passes
        an all-pass: its spectrum stays, and it forgets within 1/d (U. Forssell and L. Ljung, IEEE
        Transactions on Automatic Control 45, 2000). Stable axes stay as they are.
        """
        feedback = 2.0 * np.maximum(self.pole, 0.0)
        return _OwnMotion(self.pole - feedback, self.forcing + feedback * rate)

    def __call__(self, rate: FloatArray, row: IntArray) -> FloatArray:
        """Return the acceleration at own rates (n_starts, 3) and rows (n_starts,); shape (n_starts, 3)."""
        forcing = self.forcing[np.minimum(row, len(self.forcing) - 1)]
        return np.asarray(self.pole * rate + forcing, dtype=np.float64)


def _advance(
    motion: _OwnMotion, start_rate: FloatArray, start_row: IntArray, n_steps: int, period_s: float
) -> FloatArray:
    """Integrate from many starts at once by Heun's method; shape (n_steps + 1, n_starts, 3)."""
    rate, row = start_rate, start_row
    path = [rate]
    # A wrong model may be unstable: far outside any flight its error is known well enough.
    limit = 100.0 * max(1.0, float(np.abs(start_rate).max(initial=0.0)))
    for _ in range(n_steps):
        slope = motion(rate, row)
        ahead = motion(np.clip(rate + period_s * slope, -limit, limit), row + 1)
        rate = np.clip(rate + 0.5 * period_s * (slope + ahead), -limit, limit)
        row = row + 1
        path.append(rate)
    return np.stack(path)


def _simulate_blocks(motion: _OwnMotion, rate: FloatArray, design: Design) -> FloatArray:
    """Simulate every block from its first measured rate; shape (n_rows, 3)."""
    first = np.flatnonzero(np.diff(design.block, prepend=design.block[0] - 1)).astype(np.int64)
    length = np.diff(np.append(first, design.block.size))
    path = _advance(motion, rate[first], first, int(length.max()) - 1, design.period_s)
    simulated = np.empty_like(rate)
    for block, (start, count) in enumerate(zip(first, length, strict=True)):
        simulated[start : start + count] = path[:count, block]
    return simulated


def _horizon_errors(
    motion: _OwnMotion, rate: FloatArray, design: Design, horizons_s: Sequence[float]
) -> dict[str, tuple[float, ...]]:
    """Return the root mean square error of the rate per axis after each horizon [rad/s]."""
    steps = [max(1, round(horizon / design.period_s)) for horizon in horizons_s]
    starts = np.flatnonzero(design.held_out).astype(np.int64)[
        :: max(1, round(_START_EVERY_S / design.period_s))
    ]
    # The whole horizon lies inside its block.
    after = starts + max(steps)
    end = np.minimum(after, design.block.size - 1)
    starts = starts[(after < design.block.size) & (design.block[end] == design.block[starts])]
    if starts.size == 0:
        return {}
    path = _advance(motion, rate[starts], starts, max(steps), design.period_s)
    error = [np.sqrt(np.mean((path[n] - rate[starts + n]) ** 2, axis=0)) for n in steps]
    return {
        name: tuple(float(at_horizon[axis]) for at_horizon in error) for axis, name in enumerate(RATE_SYMBOLS)
    }


def _r2(measured: FloatArray, error: FloatArray) -> list[float]:
    """Return one minus the unexplained fraction of the variance, per column."""
    left = np.sum(error**2, axis=0)
    spread = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    return [float(1.0 - e / s) if s > 0.0 else float("nan") for e, s in zip(left, spread, strict=True)]
