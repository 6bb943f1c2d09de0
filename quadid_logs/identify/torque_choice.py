"""Which of two measurements of the torque the flight supports: fitted alike, compared on validation data.

Speeds that ESCs report hold lag, battery and saturation, if they are measurements. A simulator may compute
them from the command, and an ESC may report another motor's: then the motor commands predict the flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.data.torque import TorqueComparison
from quadid_logs.identify import MIN_RATE_HZ, ROWS_PER_UNKNOWN, default_band
from quadid_logs.identify.design import build_design
from quadid_logs.identify.equation_by_equation import fit_behind_actuator
from quadid_logs.identify.excitation import excited_axes
from quadid_logs.identify.first_stage import with_strong_instruments
from quadid_logs.identify.inference import student_quantile
from quadid_logs.identify.response import Band
from quadid_logs.identify.select import most_excited
from quadid_logs.identify.structures import DAMPED
from quadid_logs.identify.thrust_curve import fit_thrust_curve
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES

#: Residuals are alike for less than a second, as in the intervals: a second counts as one observation [s].
_CLUSTER_S: Final = 1.0
#: Student's t of fewer differences tells nothing: its quantile is that of a normal distribution times 1.3.
_FEWEST_CLUSTERS: Final = 6
#: Speeds are brought to the scale of the commands to 2 %, and effectiveness is not known better than to some
#: per cent in practice: less is no matter. Noise of a torque that leaves this fraction of the acceleration
#: unexplained lowers the effectiveness by as much (errors in variables).
_MATTERS: Final = 0.05


class _Fitted(NamedTuple):
    """On-axis effectiveness with its half width (3,), and what validation data say by second.

    ``second`` (n,) are the seconds of held-out flight, ``squares`` (n, 3) the mean squared errors of the
    accelerations in each, ``spread`` (3,) the mean squares of the accelerations.
    """

    gain: FloatArray
    half_width: FloatArray
    informative: list[int]
    second: IntArray
    squares: FloatArray
    spread: FloatArray


def compare_torques(
    preferred: FlightData, other: FlightData, settings: IdentifySettings
) -> TorqueComparison | None:
    """Fit both torques of a flight, and say which one predicts validation data better.

    Parameters
    ----------
    preferred, other : FlightData
        The same flight with one torque and with the other. The preferred one is used unless the other
        predicts validation data better by more than chance (95 %), and the difference matters.
    settings : IdentifySettings

    Returns
    -------
    TorqueComparison or None
        None where no axis of the flight tells either of them.
    """
    for each in (preferred, other):
        if not each.segments or each.input is None:
            return None
        needed = [each.sources[name] for name in (each.input.kind, "body_rate") if name in each.sources]
        if any(source.rate_hz < MIN_RATE_HZ for source in needed):
            return None
    bands = [default_band(settings, each.sample_period_s) for each in (preferred, other)]
    band = min(bands, key=lambda each: each.high_hz)
    first, second = (_fitted(each, band, settings) for each in (preferred, other))
    if first is None or second is None:
        return None
    axes = sorted({*first.informative, *second.informative})
    _, here, there = np.intersect1d(first.second, second.second, return_indices=True)
    if not axes or len(here) < _FEWEST_CLUSTERS:
        return None
    errors = np.stack([first.squares[here], second.squares[there]])[:, :, axes]
    unexplained = errors.mean(axis=1) / first.spread[axes]
    # Of every axis alike, whatever its units.
    better = ((errors[0] - errors[1]) / np.maximum(errors.mean(axis=(0, 1)), 1e-300)).mean(axis=1)
    by_chance = student_quantile(np.arange(len(here))) * better.std(ddof=1) / np.sqrt(len(here))
    # By more than the intervals, and by more than matters.
    difference, known = np.abs(first.gain - second.gain), np.hypot(first.half_width, second.half_width)
    differ = [
        axis
        for axis in axes
        if difference[axis] > known[axis] and difference[axis] > _MATTERS * abs(first.gain[axis])
    ]
    matters = bool(differ) or bool((unexplained[0] - unexplained[1] > _MATTERS).any())
    takes_other = bool(better.mean() > by_chance) and matters
    pairs = [(first, unexplained[0], preferred.input), (second, unexplained[1], other.input)]
    used, left = pairs[::-1] if takes_other else pairs
    return TorqueComparison(
        used="" if used[2] is None else used[2].source,
        other="" if left[2] is None else left[2].source,
        takes_preferred=not takes_other,
        decided=bool(abs(better.mean()) > by_chance),
        effectiveness_ratio=_by_axis(axes, (left[0].gain / used[0].gain)[axes]),
        unexplained=_by_axis(axes, used[1]),
        unexplained_by_other=_by_axis(axes, left[1]),
        differ=tuple(AXES[axis] for axis in differ),
    )


def _by_axis(axes: Sequence[int], values: FloatArray) -> dict[str, float]:
    """Return values by the names of their axes."""
    return {AXES[axis]: float(value) for axis, value in zip(axes, values, strict=True)}


def _fitted(data: FlightData, band: Band, settings: IdentifySettings) -> _Fitted | None:
    """Fit the torque of a flight, with the thrust curve and the lag that explain it best."""
    data = most_excited(data, settings.most_samples)
    design = build_design(data, band.high_hz, [DAMPED])
    if design is None or np.count_nonzero(design.train) < ROWS_PER_UNKNOWN * len(DAMPED.columns):
        return None
    high_passed = design.high_passed(band.low_hz)
    design = with_strong_instruments(design, high_passed, excited_axes(high_passed))
    data, design, _ = fit_thrust_curve(data, design, band.low_hz)
    structure = DAMPED.known(design.torque.symbols)
    _, model, _, fit, informative = fit_behind_actuator(data, design.high_passed(band.low_hz), structure)
    rows = model.design
    torque = rows.torque.behind(model.actuator.lag_s, model.actuator.delay_s, structure.inputs)
    names = (*structure.columns, *rows.disturbances(structure))
    coefficients = np.column_stack([fit.theta, fit.disturbance])
    acceleration = np.column_stack([rows.columns[name] for name in ACCELERATION_SYMBOLS])
    error = acceleration - rows.stack(names, torque, structure.inputs) @ coefficients.T
    second, number = np.unique(
        np.floor(rows.time_s[rows.held_out] / _CLUSTER_S).astype(np.int64), return_inverse=True
    )
    count = np.bincount(number)
    squares = [np.bincount(number, weights=column) / count for column in (error[rows.held_out] ** 2).T]
    return _Fitted(
        structure.on_axis(fit.theta),
        structure.on_axis(fit.half_width),
        informative,
        second,
        np.column_stack(squares),
        np.mean(acceleration[rows.held_out] ** 2, axis=0) if rows.held_out.any() else np.ones(3),
    )
