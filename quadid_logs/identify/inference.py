"""Covariances and intervals: the one place where the uncertainty of an estimate is made.

Statistical uncertainty comes from residuals that are correlated in time and
from what is not known of the torque; to it are added, in squares, what the
sensors cannot tell and what is not known of a newton metre.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import BandCheck, Posterior
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.design import Design
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.rotors import RotorSlopes
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.systematic import systematic_half_width
from quadid_logs.identify.torque import RowTorque
from quadid_logs.maths.least_squares import Equation, clustered_covariance, first_order_change
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import TORQUE_SYMBOLS

_YAW: Final = 2

#: Stamps place torque against rate to no better than this fraction of a sample period: lag and delay
#: are not known better.
TIMING_SYSTEMATIC: Final = 0.015
#: A rotor is a first-order lag to some thousandths: its time constant goes with its speed.
LAG_SYSTEMATIC: Final = 0.003
#: Residuals of flight data are correlated over some tenths of a second (rate
#: loop, gusts); a second holds that memory, and thirty of them a variance; with
#: fewer than a dozen there is none.
_CLUSTER_S = 1.0
MIN_CLUSTERS = 12
#: A lag with less phase than this [rad] at the smoothing cut-off acts as a
#: delay does; their derivatives are then parallel and only the sum is known.
_LAG_SEEN = 0.1
#: What is left of feedback's effect on least squares, in instruments per independent row: what they follow by
#: chance would be one (Bound, Jaeger and Baker, JASA 90, 1995) were it not told by other seconds; set-points
#: answer the same disturbances through the attitude, which does as much as that.
_LEFT_OF_FEEDBACK = 1.0
#: Places of effectiveness, damping and reaction in a `Posterior`; lag and delay, of all axes, stand between.
_OF_THE_EQUATION: Final = np.array([0, 1, 4])


class TorqueUnknowns(NamedTuple):
    """What is not known of the torque beside lag and delay.

    ``slopes`` for the spin-up/spin-down asymmetry of rotors; ``errors`` are what
    the torque may have been off by (see `torque_errors`).
    """

    slopes: RotorSlopes | None = None
    errors: tuple[RowTorque, ...] = ()


NOTHING_UNKNOWN: Final = TorqueUnknowns()


class TorqueEffects(NamedTuple):
    """What is not known of the torque, as it reaches the targets on the training rows.

    ``shared`` are the derivatives of all targets by lag, delay and asymmetry, each (n_train,
    n_targets), as far as they follow from the instruments, and ``unexplained`` the rest of them;
    ``errors`` (n_train, n_targets, n_errors) is what possible errors of the torque, each at its
    95 %, make of the targets.
    """

    shared: Mapping[str, FloatArray]
    errors: FloatArray
    unexplained: Mapping[str, FloatArray] = MappingProxyType({})


class Feedback(NamedTuple):
    """What feedback still does to estimates with instruments.

    ``fraction`` of what it does to plain least squares; ``unexplained`` is what the instruments leave of
    the Jacobian of each equation, (n_train, n_own).
    """

    fraction: float
    unexplained: Sequence[FloatArray]


class Uncertainty(NamedTuple):
    """Joint covariance of all parameters, of A and B first, then those ``shared`` by all targets, by name.

    The roots of the covariance's diagonal are half widths of 95 % intervals. ``lag_s`` and
    ``delay_s`` are those of lag and delay [s], NaN where not fitted.
    """

    joint: FloatArray
    shared: tuple[str, ...]

    @property
    def covariance(self) -> FloatArray:
        """Of the parameters of A and B; shape (n_parameters, n_parameters)."""
        n_parameters = len(self.joint) - len(self.shared)
        return self.joint[:n_parameters, :n_parameters]

    @property
    def lag_s(self) -> float:
        """Half width of the interval of the lag [s], NaN where it was not fitted."""
        return self._of_shared("lag")

    @property
    def delay_s(self) -> float:
        """Half width of the interval of the delay [s], NaN where it was not fitted."""
        return self._of_shared("delay")

    def _of_shared(self, name: str) -> float:
        if name not in self.shared:
            return float("nan")
        place = self.shared.index(name) - len(self.shared)
        return float(np.sqrt(max(self.joint[place, place], 0.0)))

    def of_axes(self, slopes: FloatArray) -> FloatArray:
        """Return the covariance of the numbers of `data.model.Posterior` of each axis; shape (3, 5, 5).

        Parameters
        ----------
        slopes : ndarray, shape (3, 3, n_parameters)
            Of the axis' on-axis effectiveness, of its damping and of the reaction of its rotors, by the
            parameters of A and B.

        Returns
        -------
        ndarray, shape (3, 5, 5)
            Its roots are half widths of 95 % intervals; zero for a lag that was not fitted.
        """
        whole = np.zeros((3, 5, len(self.joint)))
        whole[:, _OF_THE_EQUATION, : slopes.shape[2]] = slopes
        for row, name in enumerate(("lag", "delay"), start=2):
            if name in self.shared:
                whole[:, row, self.shared.index(name) - len(self.shared)] = 1.0
        return np.asarray(whole @ self.joint @ whole.transpose(0, 2, 1))

    @property
    def half_width(self) -> FloatArray:
        """Of the 95 % interval of each parameter; shape (n_parameters,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


class Estimate(NamedTuple):
    """theta, interval and which columns were used, each (n_targets, n_columns)."""

    theta: FloatArray
    low: FloatArray
    high: FloatArray
    kept: BoolArray


def infer(
    equations: Sequence[Equation],
    weight: FloatArray,
    clusters: IntArray,
    effects: TorqueEffects,
    n_parameters: int,
    prior_precision: FloatArray | None = None,
    feedback: Feedback | None = None,
) -> Uncertainty:
    """Return the uncertainty of parameters whose equations have lag, delay and asymmetry in common.

    Parameters
    ----------
    equations : sequence of Equation
        One per target, by the parameters of A and B alone.
    weight : ndarray, shape (n_targets,)
        Of each target's rows: one over the size of its residual.
    clusters : ndarray of int, shape (n_train,)
        As of `clusters_of`.
    effects : TorqueEffects
    n_parameters : int
        Of A and B.
    prior_precision : ndarray, shape (n_parameters,), optional
        As of `quadid_logs.maths.least_squares.clustered_covariance`.
    feedback : Feedback, optional
        None without instruments.

    Returns
    -------
    Uncertainty
    """
    names = list(effects.shared)
    of_actuator = np.arange(n_parameters, n_parameters + len(names), dtype=np.int64)
    weighted = [
        Equation(
            jacobian=np.column_stack([jacobian, *(column[:, row] for column in effects.shared.values())])
            * weight[row],
            residuals=residuals * weight[row],
            parameters=np.concatenate([parameters, of_actuator]),
        )
        for row, (jacobian, residuals, parameters) in enumerate(equations)
    ]
    prior = np.zeros(n_parameters + len(names))
    if prior_precision is not None:
        prior[:n_parameters] = prior_precision
    errors = effects.errors * weight[:, np.newaxis]
    joint = covariance_95(weighted, clusters, errors, prior)
    if feedback is not None:
        # What the whole of feedback's effect would change parameters by.
        left = [
            np.column_stack([own, *(column[:, row] for column in effects.unexplained.values())]) * weight[row]
            for row, own in enumerate(feedback.unexplained)
        ]
        residuals = [equation.residuals[:, np.newaxis] for equation in weighted]
        change = first_order_change(weighted, residuals, prior.size, prior, through=left)
        joint = joint + feedback.fraction**2 * change @ change.T
    return Uncertainty(joint, tuple(names))


def feedback_left(
    design: Design, explained: Iterable[tuple[FloatArray, FloatArray]], n: int
) -> Feedback | None:
    """Return what feedback still does to an estimate with so many instruments; None without any.

    Parameters
    ----------
    design : Design
    explained : iterable of (ndarray, ndarray), each of shape (n_train, n_own)
        The Jacobian of each equation, and what the instruments make of it.
    n : int
        Number of instruments.

    Returns
    -------
    Feedback or None
    """
    if not n:
        return None
    trained_s = np.count_nonzero(design.train) * design.period_s
    # As many values a second as twice the bandwidth are independent.
    independent = 2.0 * (design.smoothing_hz - design.high_pass_hz) * trained_s
    fraction = min(1.0, _LEFT_OF_FEEDBACK * n / max(independent, 1.0))
    return Feedback(fraction, [jacobian - projected for jacobian, projected in explained])


def covariance_95(
    equations: Sequence[Equation], clusters: IntArray, errors: FloatArray, prior_precision: FloatArray
) -> FloatArray:
    """Return the covariance whose roots are half widths of 95 % intervals.

    Parameters
    ----------
    equations, clusters
        As of `quadid_logs.maths.least_squares.clustered_covariance`.
    errors : ndarray, shape (n_samples, n_equations, n_errors)
        What possible errors of the torque, each at its 95 %, make of the
        targets, weighted as their residuals are.
    prior_precision : ndarray, shape (n_parameters,)
        Zero where nothing was known before.

    Returns
    -------
    ndarray, shape (n_parameters, n_parameters)
    """
    n_parameters = prior_precision.size
    of_residuals = clustered_covariance(equations, clusters, n_parameters, prior_precision)
    by_row = [errors[:, row] for row in range(len(equations))]
    change = first_order_change(equations, by_row, n_parameters, prior_precision)
    return np.asarray(student_quantile(clusters) ** 2 * of_residuals + change @ change.T)


def student_quantile(clusters: IntArray, tail: float = 0.025) -> float:
    """Return the two-sided quantile, 95 % by default, of Student's t for a variance from so many clusters.

    One degree of freedom less than there are clusters (Bell and McCaffrey, Survey Methodology 28, 2002).

    Parameters
    ----------
    clusters : ndarray of int, shape (n_rows,)
        From 0, without gaps.
    tail : float
        Probability on either side.

    Returns
    -------
    float
    """
    from scipy.special import stdtrit

    return float(stdtrit(max(int(clusters.max()), 1), 1.0 - tail))


def clusters_of(design: Design) -> IntArray:
    """Return the number of the cluster of each training row; residuals are correlated inside one only.

    Parameters
    ----------
    design : Design

    Returns
    -------
    ndarray of int, shape (n_train,)
        From 0, without gaps.
    """
    train = design.train
    length_s = min(_CLUSTER_S, np.count_nonzero(train) * design.period_s / MIN_CLUSTERS)
    # Clusters end where a chunk or a block ends: only neighbours in time are correlated.
    elapsed = np.floor((design.time_s - design.time_s[0]) / length_s).astype(np.int64)[train]
    key = design.block[train] * (elapsed.max() + 1) + elapsed
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64)


def torque_effects(
    design: Design,
    actuator: ActuatorFit | None,
    B: FloatArray,
    unknown: TorqueUnknowns,
    project: Projection,
    *,
    symbols: Sequence[str] = TORQUE_SYMBOLS,
) -> TorqueEffects:
    """Return what is not known of the torque as it reaches the targets through B (n_targets, n_symbols).

    Parameters
    ----------
    design : Design
    actuator : ActuatorFit or None
        None for the torque as logged, of which all is taken for known.
    B : ndarray, shape (n_targets, n_symbols)
    unknown : TorqueUnknowns
    project : Projection
        On the training rows.
    symbols : sequence of str
        Of the torques that B belongs to.

    Returns
    -------
    TorqueEffects
    """
    train = design.train
    if actuator is None:
        return TorqueEffects({}, np.zeros((np.count_nonzero(train), len(B), 0)))
    lag_s, delay_s = actuator.lag_s, actuator.delay_s

    def of_targets(torque: FloatArray) -> FloatArray:
        return np.asarray(torque[train] @ B.T)

    shared = {}
    if lag_s * 2.0 * np.pi * design.smoothing_hz >= _LAG_SEEN:
        by_lag = design.torque.by_lag(lag_s, delay_s, symbols)
        if unknown.slopes is not None:
            by_lag = by_lag + unknown.slopes.by_lag.behind(lag_s, delay_s, symbols)
            shared["asymmetry"] = of_targets(unknown.slopes.by_asymmetry.behind(lag_s, delay_s, symbols))
        shared["lag"] = of_targets(by_lag)
    shared["delay"] = of_targets(design.torque.by_delay(lag_s, delay_s, symbols))
    errors = [of_targets(error.behind(lag_s, delay_s, symbols)) for error in unknown.errors]
    none = np.zeros((np.count_nonzero(train), len(B), 0))
    explained = {name: project(column) for name, column in shared.items()}
    return TorqueEffects(
        explained,
        np.stack(errors, axis=2) if errors else none,
        {name: shared[name] - explained[name] for name in shared},
    )


def intervals(
    structure: Structure,
    theta: FloatArray,
    half_width: FloatArray,
    kept: BoolArray,
    *,
    knows_gyro: bool,
    band: BandCheck | None,
    given: InputDescription | None,
) -> Estimate:
    """Return theta with 95 % intervals that cover all that is known to be uncertain.

    Parameters
    ----------
    structure : Structure
    theta, half_width : ndarray, shape (n_targets, n_columns)
        [A B], and the statistical half widths.
    kept : ndarray of bool, shape (n_targets, n_columns)
    knows_gyro : bool
        The fit had the gyro's errors among its unknowns.
    band : BandCheck or None
        The interval of an on-axis effectiveness covers its values in all bands.
    given : InputDescription or None
        Whose calibration widens effectiveness per N m.

    Returns
    -------
    Estimate
    """
    half = np.hypot(half_width, systematic_half_width(structure, theta, knows_gyro=knows_gyro))
    low, high = theta - half, theta + half
    inputs = slice(len(structure.regressors), None)
    if band is not None:
        axes = np.arange(3), len(structure.regressors) + np.arange(3)
        low[axes] = np.fmin(low[axes], band.on_axis_gain.min(axis=0))
        high[axes] = np.fmax(high[axes], band.on_axis_gain.max(axis=0))
    if given is not None and given.unit != "1":
        fraction = NORMAL_95 * np.nan_to_num(np.array(given.calibration.relative_sigma))
        spread = np.zeros(theta.shape)
        spread[:, inputs] = np.abs(theta[:, inputs]) * fraction
        low, high = theta - np.hypot(theta - low, spread), theta + np.hypot(high - theta, spread)
    return Estimate(theta=theta, low=low, high=high, kept=kept)


def lag_interval(actuator: ActuatorFit, half_width_s: float, period_s: float) -> tuple[float, float]:
    """Return the 95 % interval of the lag [s], up to where it could not be told from a delay.

    Parameters
    ----------
    actuator : ActuatorFit
        With its ``lag_limit_s``.
    half_width_s : float
        The statistical one [s], NaN where the lag was too short to be seen.
    period_s : float
        Of the samples [s].

    Returns
    -------
    tuple of float
    """
    systematic_s = np.hypot(TIMING_SYSTEMATIC * period_s, LAG_SYSTEMATIC * actuator.lag_s)
    half = np.hypot(np.nan_to_num(half_width_s), systematic_s)
    low = max(0.0, actuator.lag_s - half) if np.isfinite(half_width_s) else 0.0
    return low, max(actuator.lag_s + half, actuator.lag_limit_s)


def delay_interval(actuator: ActuatorFit, half_width_s: float, period_s: float) -> tuple[float, float]:
    """Return the 95 % interval of the delay [s]; what might be lag is taken off its lower end.

    Parameters
    ----------
    actuator, half_width_s, period_s
        As of `lag_interval`, of the delay.

    Returns
    -------
    tuple of float
    """
    half = np.hypot(half_width_s, TIMING_SYSTEMATIC * period_s)
    mistaken_s = actuator.lag_limit_s - actuator.lag_s
    low = min(actuator.delay_s - half, actuator.delay_s - mistaken_s)
    return max(0.0, low), actuator.delay_s + half


def posterior_of(
    as_measured: FloatArray,
    half_width: FloatArray,
    actuator: ActuatorFit,
    of_axes: FloatArray,
    period_s: float,
) -> Posterior:
    """Return what is known together of effectiveness, damping, lag, delay and reaction of each axis.

    Parameters
    ----------
    as_measured, half_width : ndarray, shape (3, 3)
        On-axis effectiveness, damping and reaction of the rates as measured; half widths of their 95 %
        intervals with all that is systematic but the gyro's scale and the torque's calibration.
    actuator : ActuatorFit
    of_axes : ndarray, shape (3, 5, 5)
        As of `Uncertainty.of_axes`.
    period_s : float
        Of the samples [s].

    Returns
    -------
    Posterior
        Each number has its interval; the correlations are those of the fit, because what is systematic of
        one number says nothing about another.
    """
    systematic_s = TIMING_SYSTEMATIC * period_s
    covariance = of_axes.copy()
    for column, number in enumerate(_OF_THE_EQUATION):
        statistical = of_axes[:, number, number]
        covariance[:, number, number] = np.maximum(half_width[:, column] ** 2, statistical)
    covariance[:, 2, 2] += systematic_s**2 + (LAG_SYSTEMATIC * actuator.lag_s) ** 2
    covariance[:, 3, 3] += systematic_s**2
    times = np.tile([actuator.lag_s, actuator.delay_s], (len(as_measured), 1))
    return Posterior(
        mean=np.column_stack([as_measured[:, :2], times, as_measured[:, 2:]]),
        covariance=covariance / NORMAL_95**2,
        lag_or_delay_s=max(0.0, min(actuator.lag_limit_s - actuator.lag_s, actuator.delay_s)),
    )


def with_damping_of_vehicles(posterior: Posterior, seen: BoolArray, most_1_s: FloatArray) -> Posterior:
    """Return what is known of each axis from its flight and from the dampings that vehicles have.

    Parameters
    ----------
    posterior : Posterior
        Of the flight.
    seen : ndarray of bool, shape (3,)
        The flight shows the damping of this axis.
    most_1_s : ndarray, shape (3,)
        No damping of a vehicle is larger in 95 % [1/s].

    Returns
    -------
    Posterior
        A damping that the flight does not show is zero with that half width.

    Notes
    -----
    Normal distributions of both, of which the second tells of the damping alone: what is known of the other
    numbers moves with it as far as the flight takes the one for the other. Nothing drives yaw: where feedback
    from slow air makes it seem so, the most probable damping is none.
    """
    mean, covariance = posterior.mean.copy(), posterior.covariance.copy()
    variance = (most_1_s / NORMAL_95) ** 2
    for axis in range(3):
        if seen[axis]:
            gain = covariance[axis, :, 1] / (covariance[axis, 1, 1] + variance[axis])
            mean[axis] -= gain * mean[axis, 1]
            covariance[axis] -= np.outer(gain, covariance[axis, 1])
        else:
            mean[axis, 1] = covariance[axis, 1, :] = covariance[axis, :, 1] = 0.0
            covariance[axis, 1, 1] = variance[axis]
    drives = mean[_YAW, 1] > 0.0
    if drives:
        mean[_YAW] -= covariance[_YAW, :, 1] / covariance[_YAW, 1, 1] * mean[_YAW, 1]
    roll, pitch, yaw = (not each for each in seen)
    return replace(
        posterior, mean=mean, covariance=covariance, only_brakes=(roll, pitch, bool(yaw or drives))
    )
