"""Each ingredient of an interval against a value that was found in another way."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import BandCheck
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.data.torque import Calibration
from quadid_logs.identify import identify
from quadid_logs.identify.actuator import ActuatorFit
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.fit import _mean_half_width, fit_pooled, with_trim
from quadid_logs.identify.inference import (
    NOTHING_UNKNOWN,
    Feedback,
    TorqueEffects,
    TorqueUnknowns,
    clusters_of,
    delay_interval,
    feedback_left,
    infer,
    intervals,
    lag_interval,
    student_quantile,
    torque_effects,
)
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.structures import DAMPED
from quadid_logs.identify.systematic import systematic_half_width
from quadid_logs.identify.torque import RowGrid
from quadid_logs.identify.torque_errors import sampling_errors
from quadid_logs.maths.least_squares import Equation

from .vehicles import PERIOD_S, QUAD, fly, multisine

NO_EFFECTS = TorqueEffects({}, np.zeros((600, 1, 0)))


@pytest.fixture(scope="module")
def rows() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two regressors, residuals that are alike inside each of twenty clusters, and the clusters."""
    rng = np.random.default_rng(3)
    Z = rng.standard_normal((600, 2))
    clusters = np.repeat(np.arange(20), 30)
    Z[clusters == 4] *= 4.0
    noise = rng.standard_normal(20)[clusters] + 0.5 * rng.standard_normal(600)
    return Z, Z @ [2.0, -1.0] + noise, clusters


def fitted(Z: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(Z, y, rcond=None)[0]


def equation(Z: np.ndarray, y: np.ndarray) -> Equation:
    return Equation(Z, y - Z @ fitted(Z, y), np.arange(Z.shape[1]))


@pytest.mark.parametrize(
    ("n_clusters", "quantile"), [(2, 12.7062), (13, 2.1788), (31, 2.0423), (121, 1.9799)]
)
def test_the_quantile_is_that_of_the_table_of_students_t(n_clusters: int, quantile: float) -> None:
    """Two-sided 95 %, one degree of freedom less than there are clusters."""
    assert student_quantile(np.arange(n_clusters)) == pytest.approx(quantile, abs=1e-4)


def test_half_widths_are_those_of_fits_without_each_cluster(
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """The jackknife by refitting: what CR3 computes without refitting, with t of 19 degrees of freedom."""
    Z, y, clusters = rows
    without = np.array([fitted(Z[clusters != each], y[clusters != each]) for each in range(20)])
    variance = 19.0 / 20.0 * np.sum((without - fitted(Z, y)) ** 2, axis=0)
    found = infer([equation(Z, y)], np.ones(1), clusters, NO_EFFECTS, 2)
    np.testing.assert_allclose(found.half_width, 2.093024 * np.sqrt(variance), rtol=1e-5)


def test_the_size_of_the_weights_changes_no_interval(rows: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """One target alone: weights say which of several targets counts more, of errors of the torque too."""
    Z, y, clusters = rows
    effects = TorqueEffects({}, 0.3 * Z[:, :1, np.newaxis])
    half_widths = [
        infer([equation(Z, y)], np.array([weight]), clusters, effects, 2).half_width for weight in (1.0, 7.0)
    ]
    np.testing.assert_allclose(half_widths[1], half_widths[0], rtol=1e-8)


def test_an_error_of_the_torque_is_added_in_squares(rows: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """As far as least squares takes it for the vehicle."""
    Z, y, clusters = rows
    error = 0.3 * Z[:, 0] + 0.1 * np.sin(np.arange(600.0))
    effects = TorqueEffects({}, error[:, np.newaxis, np.newaxis])
    plain = infer([equation(Z, y)], np.ones(1), clusters, NO_EFFECTS, 2).half_width
    found = infer([equation(Z, y)], np.ones(1), clusters, effects, 2).half_width
    np.testing.assert_allclose(found, np.hypot(plain, fitted(Z, error)), rtol=1e-8)


def test_a_shared_unknown_widens_as_one_more_column_does(
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """A lag whose derivative resembles a regressor takes precision from it."""
    Z, y, clusters = rows
    by_lag = Z[:, 0] + 0.5 * np.cos(np.arange(600.0))
    residual = equation(Z, y).residuals
    whole = Equation(np.column_stack([Z, by_lag]), residual, np.arange(3))
    expected = infer([whole], np.ones(1), clusters, NO_EFFECTS, 3).half_width
    effects = TorqueEffects({"lag": by_lag[:, np.newaxis]}, np.zeros((600, 1, 0)))
    found = infer([equation(Z, y)], np.ones(1), clusters, effects, 2)
    np.testing.assert_allclose([*found.half_width, found.lag_s], expected, rtol=1e-8)
    assert np.isnan(found.delay_s)


def test_where_the_data_say_nothing_the_interval_is_that_of_the_prior(
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Standard deviation 0.2 before, t of 19 degrees of freedom."""
    Z, y, clusters = rows
    weak = equation(1e-6 * Z, y)
    found = infer([weak], np.ones(1), clusters, NO_EFFECTS, 2, np.full(2, 1.0 / 0.2**2))
    np.testing.assert_allclose(found.half_width, 2.093024 * 0.2, rtol=1e-3)


def instrumented(rng: np.random.Generator, n: int, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x as the instruments explain it, x, and y = 2 x + e where feedback puts e into x."""
    W, e = np.linalg.qr(rng.standard_normal((n, k)))[0], rng.standard_normal(n)
    x = W @ np.full(k, np.sqrt(n / k)) - 0.8 * e + 0.6 * rng.standard_normal(n)
    return W @ (W.T @ x), x, 2.0 * x + e


def test_many_instruments_leave_as_much_of_feedback_as_there_are_of_them_per_row() -> None:
    """The mean error of two-stage least squares, over 4000 draws, is that fraction of the change."""
    rng = np.random.default_rng(0)
    errors, changes = [], []
    for _ in range(4000):
        explained, x, y = instrumented(rng, 100, 10)
        value = (explained @ y) / (explained @ explained)
        errors.append(value - 2.0)
        changes.append((x - explained) @ (y - value * x) / (explained @ explained))
    assert np.mean(errors) < -0.05
    assert np.mean(errors) == pytest.approx(10.0 / 100.0 * np.mean(changes), rel=0.15)


def test_what_is_left_of_feedback_is_added_in_squares() -> None:
    """Of the parameter and of a lag that it goes with."""
    explained, x, y = instrumented(np.random.default_rng(1), 600, 12)
    residual, clusters = y - 1.9 * x, np.repeat(np.arange(20), 30)
    by_lag, more = explained + np.cos(np.arange(600.0)), np.sin(np.arange(600.0))
    effects = TorqueEffects(
        {"lag": by_lag[:, np.newaxis]}, np.zeros((600, 1, 0)), {"lag": more[:, np.newaxis]}
    )
    one = [Equation(explained[:, np.newaxis], residual, np.array([0]))]
    plain = infer(one, np.ones(1), clusters, effects, 1)
    feedback = Feedback(0.3, [(x - explained)[:, np.newaxis]])
    found = infer(one, np.full(1, 5.0), clusters, effects, 1, feedback=feedback)
    J = np.column_stack([explained, by_lag])
    change = 0.3 * np.linalg.solve(J.T @ J, np.array([(x - explained) @ residual, more @ residual]))
    expected = np.hypot([plain.half_width[0], plain.lag_s], change)
    np.testing.assert_allclose([found.half_width[0], found.lag_s], expected, rtol=1e-8)


def test_less_of_feedback_is_left_in_a_longer_flight_and_none_is_said_without_instruments() -> None:
    """One instrument per independent row of the band: as many rows as twice its width, times the time."""
    fractions = []
    for duration_s in (20.0, 40.0):
        design = build_design(fly(QUAD, multisine(duration_s)), 5.0, (DAMPED,)).high_passed(0.3)
        found = feedback_left(design, [], 24)
        assert found is not None
        trained_s = design.train.mean() * duration_s
        assert found.fraction == pytest.approx(24 / (2.0 * 4.7 * trained_s), rel=0.05)
        fractions.append(found.fraction)
    assert fractions[1] < 0.7 * fractions[0]
    assert feedback_left(design, [], 0) is None


@pytest.mark.thorough
def test_the_effectiveness_of_a_rigid_body_is_known_no_better_than_the_scale_of_the_gyro() -> None:
    """Per command it is off by as much as the gyro, 1 %; gyroscopic terms tell a fifth of that apart."""
    flight = fly(dataclasses.replace(QUAD, noise_rad_s=1e-6), multisine(40.0))
    given = InputDescription(kind="torque_command", unit="1", source="test")
    models = identify(dataclasses.replace(flight, input=given), IdentifySettings()).models
    body = next(model for model in models if model.structure == "rigid-body")
    for target, torque in (("p_dot", "L"), ("q_dot", "M"), ("r_dot", "N")):
        parameter = body.entries[target, torque]
        relative = 0.5 * (parameter.ci95[1] - parameter.ci95[0]) / parameter.value
        assert 0.007 < relative < 0.0125


@pytest.fixture(scope="module")
def design() -> Design:
    found = build_design(fly(QUAD, multisine(40.0)), 5.0)
    assert found is not None
    return found


def test_clusters_hold_neighbours_only(design: Design) -> None:
    """A second at most, of one block, so that residuals of different clusters are independent."""
    clusters, time_s, block = clusters_of(design), design.time_s[design.train], design.block[design.train]
    for number in range(clusters.max() + 1):
        rows = clusters == number
        assert np.ptp(time_s[rows]) < 1.0
        assert np.unique(block[rows]).size == 1


def test_the_interval_of_a_mean_is_that_of_the_means_of_blocks(design: Design) -> None:
    """Students t over blocks of equal weight, for residuals that are one number per block."""
    levels = np.random.default_rng(2).standard_normal(design.block.max() + 1)
    column = levels[design.block[design.train]]
    blocks = np.unique(design.block[design.train])
    without = np.array([column[design.block[design.train] != each].mean() for each in blocks])
    n = blocks.size
    expected = student_quantile(np.arange(n)) * np.sqrt((n - 1) / n * np.sum((without - column.mean()) ** 2))
    (found,) = _mean_half_width(column[:, np.newaxis], design)
    assert found == pytest.approx(expected, rel=1e-6)


def test_not_knowing_the_torque_between_samples_costs_what_every_nth_sample_misses(design: Design) -> None:
    """White torque of variance 1: what n-th samples miss, over n, is (1/2 + 1/3) / 2 of it on average."""
    rng = np.random.default_rng(5)
    chunks = [
        dataclasses.replace(chunk, torque=rng.standard_normal(chunk.torque.shape)) for chunk in design.chunks
    ]
    n_samples = chunks[0].n_samples
    whole_band = RowGrid.of(n_samples, design.sample_period_s, design.smoothing_hz)
    torque = dataclasses.replace(design.torque, grids=(whole_band,))
    found = sampling_errors(dataclasses.replace(design, chunks=tuple(chunks), torque=torque))
    spectra = [error.spectra[0][:, :3] for error in found]
    errors = [np.fft.irfft(spectrum, whole_band.n_padded, axis=0)[:n_samples] for spectrum in spectra]
    variance = np.sum([np.mean(error**2) for error in errors])
    assert variance == pytest.approx(1.96**2 * 0.5 * (1.0 / 2.0 + 1.0 / 3.0), rel=0.03)


def theta_of_quad() -> np.ndarray:
    """A and B of `DAMPED`."""
    theta = np.zeros((3, len(DAMPED.columns)))
    theta[:, 3:6], theta[:, 7:] = -QUAD.damping, QUAD.B
    return theta


def widened(half_width: float, **changes: object) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the interval of B reaches below and above it; each (3, 3)."""
    theta = theta_of_quad()
    given: dict[str, object] = {"knows_gyro": False, "band": None, "given": None} | changes
    estimate = intervals(
        DAMPED, theta, np.full(theta.shape, half_width), np.ones(theta.shape, dtype=bool), **given
    )
    return (theta - estimate.low)[:, 7:], (estimate.high - theta)[:, 7:]


def test_systematic_uncertainty_is_added_in_squares() -> None:
    """To the statistical half width, on both sides."""
    systematic = systematic_half_width(DAMPED, theta_of_quad())[:, 7:]
    for side in widened(0.4):
        np.testing.assert_allclose(side, np.hypot(0.4, systematic))


def test_an_effectiveness_per_newton_metre_is_as_uncertain_as_the_newton_metre() -> None:
    """Standard deviations of 3, 4 and 5 %, added in squares by axis of torque."""
    sigma = np.array([0.03, 0.04, 0.05])
    given = InputDescription(
        kind="torque_n_m",
        unit="N m",
        source="test",
        calibration=Calibration(n_m_per_command=(1.0, 1.0, 1.0), relative_sigma=tuple(sigma.tolist())),
    )
    below, above = widened(0.4, given=given)
    expected = np.hypot(widened(0.4)[0], 1.959964 * sigma * QUAD.B)
    np.testing.assert_allclose(below, expected)
    np.testing.assert_allclose(above, expected)


def test_an_effectiveness_per_command_does_not_depend_on_the_newton_metre() -> None:
    """The same calibration, but torque as commanded."""
    given = InputDescription(
        kind="torque_command",
        unit="1",
        source="test",
        calibration=Calibration(n_m_per_command=(1.0, 1.0, 1.0), relative_sigma=(0.1, 0.1, 0.1)),
    )
    np.testing.assert_array_equal(widened(0.4, given=given), widened(0.4))


def test_the_interval_covers_the_effectiveness_in_every_band() -> None:
    """Ten units below in one band, twenty above in another; off-axis entries stay."""
    gain = np.diag(QUAD.B)
    band = BandCheck(
        low_hz=np.full(3, 0.3),
        cutoff_hz=np.array([5.0, 2.5, 8.0]),
        on_axis_gain=np.array([gain, gain - 10, gain + 20]),
    )
    below, above = widened(0.4, band=band)
    np.testing.assert_allclose(np.diag(below), 10.0)
    np.testing.assert_allclose(np.diag(above), 20.0)
    assert above[0, 1] == widened(0.4)[1][0, 1]


def actuator(lag_s: float, delay_s: float, lag_limit_s: float) -> ActuatorFit:
    nothing = np.zeros(0)
    return ActuatorFit(lag_s, delay_s, nothing, nothing, nothing, lag_limit_s)


def test_lag_and_delay_are_known_to_a_fraction_of_a_sample_at_best() -> None:
    """1.5 % of 10 ms, and 0.3 % of the lag, in squares to 1 ms and 0.5 ms."""
    found = actuator(0.04, 0.01, 0.04)
    low, high = lag_interval(found, 1e-3, 0.01)
    assert 0.5 * (high - low) == pytest.approx(np.sqrt(1e-3**2 + 1.5e-4**2 + 1.2e-4**2))
    low, high = delay_interval(found, 5e-4, 0.01)
    assert 0.5 * (high - low) == pytest.approx(np.hypot(5e-4, 1.5e-4))


def test_what_might_be_lag_or_delay_is_in_the_interval_of_both() -> None:
    """Up to 8 ms of the delay could be lag."""
    found = actuator(0.004, 0.010, 0.012)
    assert lag_interval(found, 1e-3, PERIOD_S)[1] == pytest.approx(0.012)
    assert delay_interval(found, 1e-4, PERIOD_S)[0] == pytest.approx(0.002)


def test_a_lag_too_short_to_be_seen_may_be_zero() -> None:
    """Then it was no parameter of the fit."""
    assert lag_interval(actuator(0.002, 0.01, 0.004), float("nan"), PERIOD_S)[0] == 0.0


ACTUATOR = actuator(0.03, 0.005, 0.03)


def test_clusters_end_where_a_block_ends(design: Design) -> None:
    """Also where blocks begin within a second of each other: half a second after each whole one."""
    blocks = ((design.time_s - design.time_s[0] + 0.5) // 3.0).astype(np.int64)
    shifted = dataclasses.replace(design, block=blocks, held_out=np.zeros_like(design.held_out))
    clusters, block = clusters_of(shifted), blocks[shifted.train]
    assert all(np.unique(block[clusters == number]).size == 1 for number in range(clusters.max() + 1))


def test_units_of_an_axis_change_no_relative_interval(design: Design) -> None:
    """Lag and delay are common to all axes: one in other units must not count for more."""
    other = dict(design.columns, q_dot=100.0 * design.columns["q_dot"])
    fits = [
        fit_pooled(each, DAMPED, ACTUATOR) for each in (design, dataclasses.replace(design, columns=other))
    ]
    gain, half = (
        np.array([DAMPED.on_axis(getattr(fit, of)) for fit in fits]) for of in ("theta", "half_width")
    )
    np.testing.assert_allclose(gain[1], gain[0] * [1.0, 100.0, 1.0], rtol=1e-9)
    np.testing.assert_allclose(half[1] / gain[1], half[0] / gain[0], rtol=1e-6)


def test_what_is_not_known_of_the_torque_reaches_the_targets_through_the_effectiveness(
    design: Design,
) -> None:
    """Also across axes: B times the torque that may have been, row by row."""
    B = np.array([[90.0, 5.0, 0.0], [-7.0, 80.0, 2.0], [1.0, 0.0, 45.0]])
    error = dataclasses.replace(design.torque)
    unknown = TorqueUnknowns(errors=(error,))
    project = Projection(design, DAMPED, design.train)
    found = torque_effects(design, ACTUATOR, B, unknown, project)
    torque = error.behind(ACTUATOR.lag_s, ACTUATOR.delay_s)[design.train]
    np.testing.assert_allclose(found.errors[:, :, 0], torque @ B.T)


@pytest.mark.parametrize(("lag_s", "names"), [(0.03, {"lag", "delay"}), (0.001, {"delay"})])
def test_a_lag_that_is_seen_is_an_unknown_and_one_that_is_not_is_none(
    design: Design, lag_s: float, names: set[str]
) -> None:
    """Of a millisecond there are 2 degrees of phase at 5 Hz: only its sum with the delay is seen."""
    project = Projection(design, DAMPED, design.train)
    assert (
        set(torque_effects(design, actuator(lag_s, 0.005, lag_s), np.eye(3), NOTHING_UNKNOWN, project).shared)
        == names
    )


def test_the_trim_is_what_the_torque_leaves_when_it_has_passed_the_actuator() -> None:
    """A torque that rises for a whole flight is 0.13 s old when it acts: the trim must know that."""
    data = fly(QUAD, multisine(40.0))
    (segment,) = data.segments
    rising = 0.02 * segment.time_s[:, np.newaxis] * np.ones(3)
    built = build_design(
        dataclasses.replace(data, segments=(dataclasses.replace(segment, torque=rising),)), 5.0, (DAMPED,)
    )
    assert built is not None
    late = actuator(0.08, 0.05, 0.08)
    theta = np.zeros((3, len(DAMPED.columns)))
    theta[:, -3:] = np.diag([100.0, 80.0, 50.0])
    fit = dataclasses.replace(
        fit_pooled(built, DAMPED, late),
        theta=theta,
        disturbance=np.zeros((3, len(built.disturbances(DAMPED)))),
    )
    expected = [
        np.mean(built.columns[target][built.train] - gain * 0.02 * (built.time_s[built.train] - 0.13))
        for target, gain in zip(("p_dot", "q_dot", "r_dot"), (100.0, 80.0, 50.0), strict=True)
    ]
    found = with_trim(fit, DAMPED, built, late).theta[:, DAMPED.regressors.index("1")]
    np.testing.assert_allclose(found, expected, atol=0.02)
