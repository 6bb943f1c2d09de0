"""What decides between models, terms and rows: each rule by a case on either side of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Identification, Validation
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import _is_rigid_body, identify
from quadid_logs.identify.actuator import ActuatorFit, Scorer, lag_limit, same_loss
from quadid_logs.identify.checks import check_change
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.excitation import ColumnNoise, noise_density
from quadid_logs.identify.first_stage import told_axes, with_strong_instruments
from quadid_logs.identify.fit import PooledFit, Regression, fit_pooled
from quadid_logs.identify.inference import clusters_of
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.model import _caveats_by_target, _criterion
from quadid_logs.identify.structures import DAMPED
from quadid_logs.identify.terms import AIR_SPEED, GYROSCOPIC, RATE_TERMS, SQUARES
from quadid_logs.identify.windows import Chunk, solve_chunks
from quadid_logs.maths.band import gaussian_reach_s
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS

from .vehicles import PERIOD_S, QUAD, flight_data, fly, multisine


@pytest.fixture(scope="module")
def flight() -> FlightData:
    return fly(QUAD, multisine(40.0), feedback=8.0)


@pytest.fixture(scope="module")
def found(flight: FlightData) -> Identification:
    return identify(flight, IdentifySettings())


@pytest.fixture(scope="module")
def design(flight: FlightData) -> Design:
    built = build_design(flight, 5.0)
    assert built is not None
    return built


def behind(lag_s: float, delay_s: float) -> ActuatorFit:
    nothing = np.zeros(0)
    return ActuatorFit(lag_s, delay_s, nothing, nothing, nothing, lag_s)


# Rows.


@pytest.mark.parametrize("achieved", [False, True])
def test_rows_that_feel_a_torque_that_was_not_given_are_not_fitted(
    flight: FlightData, achieved: bool
) -> None:
    """From the kernel's reach ahead of a saturated sample to its reach and the actuator's memory after it."""
    (segment,) = flight.segments
    at_s = 8.0
    saturated = np.abs(segment.time_s - at_s) < 0.5 * PERIOD_S
    assert flight.input is not None
    built = build_design(
        dataclasses.replace(
            flight,
            segments=(dataclasses.replace(segment, saturated=saturated),),
            input=dataclasses.replace(flight.input, achieved=achieved),
        ),
        5.0,
    )
    plain = build_design(flight, 5.0)
    assert built is not None
    assert plain is not None
    reach_s = gaussian_reach_s(5.0)
    off_s = built.time_s - at_s
    felt = (off_s > -reach_s + PERIOD_S) & (off_s < reach_s + 0.5 - PERIOD_S)
    free = (off_s < -reach_s - PERIOD_S) | (off_s > reach_s + 0.5 + PERIOD_S)
    assert plain.train[felt].any()
    assert not (built.train & felt).any() or achieved
    np.testing.assert_array_equal(built.train[free], plain.train[free])
    if achieved:
        np.testing.assert_array_equal(built.train, plain.train)


def test_lag_and_delay_are_predicted_from_rows_that_they_were_not_fitted_to(design: Design) -> None:
    """Each half of the blocks scores the fit to the other half."""
    folds = Scorer(design.without_instruments(), DAMPED, [0, 1, 2])._folds
    assert len(folds) == 2
    for fold in folds:
        assert not np.intersect1d(fold.fit, fold.score).size
    scored = np.concatenate([fold.score for fold in folds])
    np.testing.assert_array_equal(np.sort(scored), np.flatnonzero(design.train))


# Lag and delay.


class Bowl:
    """An error that has its least at a lag and a delay; ``by_sum`` where only their sum matters."""

    same_loss = 0.01

    def __init__(self, by_sum: bool) -> None:
        self._by_sum = by_sum

    def __call__(self, lag_s: float, delay_s: float) -> float:
        apart = 0.0 if self._by_sum else 1e3 * (lag_s - 0.02) ** 2
        return 1e4 * (lag_s + delay_s - 0.05) ** 2 + apart


def test_where_only_the_sum_of_lag_and_delay_matters_all_of_the_delay_may_be_lag() -> None:
    """20 ms of lag and 30 ms of delay: up to 50 ms of lag."""
    assert lag_limit(Bowl(by_sum=True), 0.02, 0.03) == pytest.approx(0.05)  # type: ignore[arg-type]


def test_a_longer_lag_is_possible_as_far_as_chance_makes_no_difference() -> None:
    """1e3 (T - 20 ms)^2 reaches 0.01 at 23.2 ms; trials are 1.5 ms apart."""
    limit_s = lag_limit(Bowl(by_sum=False), 0.02, 0.03)  # type: ignore[arg-type]
    assert 0.02 + np.sqrt(1e-5) - 0.0015 <= limit_s <= 0.02 + np.sqrt(1e-5)


def test_chance_makes_as_much_of_a_mean_over_axes_as_chi_square_says(design: Design) -> None:
    """The summed logarithms differ by 3.84 over the number of instruments; their mean by a third of that."""
    project = Projection(design, DAMPED, design.train)
    project._basis = np.linalg.qr(np.random.default_rng(1).standard_normal((100, 24)))[0]
    assert same_loss(project, [0, 1, 2]) == pytest.approx(3.84 / 24.0 / 3.0)
    assert same_loss(project, [1]) == pytest.approx(3.84 / 24.0)


# Instruments.


def with_reference(axes: tuple[int, ...]) -> Design:
    """Return a flight whose torque about some axes follows from what was commanded, no other does."""
    torque = multisine(40.0)
    data = fly(QUAD, torque)
    (segment,) = data.segments
    wanted = np.random.default_rng(2).standard_normal(torque.shape)
    wanted[:, list(axes)] = torque[:, list(axes)]
    built = build_design(
        dataclasses.replace(data, segments=(dataclasses.replace(segment, reference=wanted),)), 5.0
    )
    assert built is not None
    return built


def test_instruments_serve_the_axes_that_they_drive() -> None:
    """Roll is commanded, pitch is not: roll keeps its instruments, and no excited axis has a say without."""
    design = with_reference((0,))
    assert with_strong_instruments(design, design, [0, 1]).instruments is not None
    assert told_axes(design) == [0]
    assert with_strong_instruments(design, design, [1]).instruments is None


# Terms and their noise.


def test_a_vehicle_that_leans_moves_to_where_it_leans() -> None:
    """Nose up backwards, right side down to the right: u' = -g sin(theta) - d u, with d = 0.2 1/s."""
    phi, theta, n = 0.2, 0.3, 4000
    attitude = np.tile([phi, theta, 0.0], (n, 1))
    time_s = PERIOD_S * np.arange(1, n + 1)
    risen = 9.81 / 0.2 * (1.0 - np.exp(-0.2 * time_s))
    u, v = (term.of_attitude(attitude, PERIOD_S) for term in AIR_SPEED)
    np.testing.assert_allclose(u, -risen * np.sin(theta), rtol=2e-3)
    np.testing.assert_allclose(v, risen * np.sin(phi) * np.cos(theta), rtol=2e-3)


@pytest.mark.parametrize("term", [*SQUARES, *GYROSCOPIC, *RATE_TERMS], ids=lambda term: term.symbol)
def test_the_noise_of_a_column_is_that_of_its_factors_drawn_at_random(term: object) -> None:
    """Rates of known size with noise of known size; to a twentieth."""
    rng = np.random.default_rng(6)
    size, rms = np.array([1.0, 0.7, 0.4]), np.array([0.02, 0.03, 0.01])
    rate = size * rng.standard_normal((200_000, 3))
    noisy = rate + rms * rng.standard_normal(rate.shape)
    true = np.std(term.of_rate(noisy) - term.of_rate(rate))  # type: ignore[attr-defined]
    by_name = (dict(zip(RATE_SYMBOLS, each, strict=True)) for each in (rms, size))
    assert term.noise(*by_name) == pytest.approx(true, rel=0.05)  # type: ignore[attr-defined]


def test_the_noise_is_measured_where_no_motion_is_left() -> None:
    """White noise of 0.01 rad/s at 400 Hz is 5e-7 rad^2/s^2 per hertz; motion reaches up to 100 Hz here."""
    rng = np.random.default_rng(7)
    n = 24_000
    spectrum = np.fft.rfft(rng.standard_normal((n, 3)), axis=0)
    spectrum[np.fft.rfftfreq(n, PERIOD_S) > 100.0] = 0.0
    motion = np.fft.irfft(spectrum, n, axis=0)
    density = noise_density(flight_data(motion + 0.01 * rng.standard_normal(motion.shape), 0.1 * motion))
    for name in RATE_SYMBOLS:
        assert density[name] == pytest.approx(2.0 * 0.01**2 * PERIOD_S, rel=0.15)


def test_noise_behind_a_filter_is_the_root_of_density_times_bandwidth() -> None:
    """4e-6 per hertz over 5.3 Hz."""
    noise = ColumnNoise(dict.fromkeys(RATE_SYMBOLS, 4e-06), {name: np.ones(9) for name in RATE_SYMBOLS}, 5.3)
    np.testing.assert_allclose(noise.of(RATE_TERMS), np.sqrt(4e-6 * 5.3))


# Choice of the model.


def test_lag_and_delay_count_among_the_parameters(design: Design) -> None:
    """With all coefficients that are used; the trim is not where rows are high-passed."""
    fit = fit_pooled(design, DAMPED, behind(0.03, 0.005))
    extra = 3 * len(design.disturbances(DAMPED))
    assert fit.n_parameters == 3 * len(DAMPED.columns) + extra + 2
    as_logged = fit_pooled(design, DAMPED, None)
    assert as_logged.n_parameters == 3 * len(DAMPED.columns) + extra


def test_the_criterion_asks_a_parameter_to_earn_the_logarithm_of_the_number_of_clusters(
    design: Design,
) -> None:
    """Schwarz 1978; residuals halved on one axis earn ln 2 for every cluster."""
    fit = PooledFit(
        theta=np.zeros((3, 1)), half_width=np.zeros((3, 1)), kept=np.ones((3, 1), dtype=bool),
        r2=np.array([0.9, 0.8, 0.7]), condition_number=1.0, n_parameters=12,
    )  # fmt: skip
    n = clusters_of(design).max() + 1
    more = dataclasses.replace(fit, n_parameters=13)
    better = dataclasses.replace(fit, r2=np.array([0.95, 0.8, 0.7]))
    assert _criterion(design, more) - _criterion(design, fit) == pytest.approx(np.log(n))
    assert _criterion(design, better) - _criterion(design, fit) == pytest.approx(-n * np.log(2.0))


def test_a_body_is_recommended_only_if_it_is_the_likelier_model(found: Identification) -> None:
    """By the criterion, with everything else alike."""
    body, by_equation = (
        next(model for model in found.models if model.structure == name) for name in ("rigid-body", "damped")
    )
    assert _is_rigid_body(body, by_equation)
    assert not _is_rigid_body(body, dataclasses.replace(by_equation, criterion=body.criterion - 1.0))


def test_a_body_that_explains_held_out_flight_worse_is_not_recommended(found: Identification) -> None:
    """By a fifth more that is left of one axis."""
    body, by_equation = (
        next(model for model in found.models if model.structure == name) for name in ("rigid-body", "damped")
    )
    r2 = dict(by_equation.validation.r2_acceleration)
    r2["q_dot"] = 1.0 - 1.2 * (1.0 - r2["q_dot"])
    worse = dataclasses.replace(body, validation=dataclasses.replace(body.validation, r2_acceleration=r2))
    assert not _is_rigid_body(worse, by_equation)


@pytest.mark.parametrize(("r2", "believed"), [(0.74, False), (0.76, True)])
def test_an_equation_is_believed_that_explains_three_quarters_of_held_out_acceleration(
    design: Design, r2: float, believed: bool
) -> None:
    """A signal-to-noise ratio of three."""
    validation = Validation(held_out_s=10.0, r2_acceleration=dict.fromkeys(ACCELERATION_SYMBOLS, r2))
    assert (_caveats_by_target(design, validation) == {}) is believed


def test_nothing_is_believed_of_an_axis_at_rest() -> None:
    """However well noise explains noise: only roll was moved."""
    built = build_design(fly(QUAD, multisine(20.0, axes=(0,))), 5.0)
    assert built is not None
    validation = Validation(held_out_s=5.0, r2_acceleration=dict.fromkeys(ACCELERATION_SYMBOLS, 0.99))
    assert set(_caveats_by_target(built, validation)) == {"q_dot", "r_dot"}


# Checks.


def test_a_change_of_effectiveness_is_found_with_its_time_and_both_values(design: Design) -> None:
    """Pitch answers with 40 until the middle of the flight and with 60 from then on; roll stays at 50."""
    rng = np.random.default_rng(3)
    time_s = design.time_s[design.train]
    middle_s = 0.5 * (time_s[0] + time_s[-1])
    Z = rng.standard_normal((time_s.size, len(DAMPED.columns)))
    Y = 0.5 * rng.standard_normal((time_s.size, 3)) + 50.0 * Z[:, -3:]
    Y[:, 1] += np.where(time_s < middle_s, -10.0, 10.0) * Z[:, -2]
    project = Projection(design, DAMPED, design.train)
    regression = Regression(Z, Z, Y, np.ones((3, Z.shape[1]), dtype=bool), project)
    change = check_change(design, DAMPED, regression, [0, 1])
    assert change.before[1] == pytest.approx(40.0, rel=0.02)
    assert change.after[1] == pytest.approx(60.0, rel=0.02)
    assert change.time_s[1] == pytest.approx(middle_s, abs=2.0)
    assert change.statistic[1] > 100.0
    assert change.statistic[0] < 16.0
    assert np.isnan(change.statistic[2])


def test_a_window_counts_at_its_middle() -> None:
    """Of five samples at the third."""
    rng = np.random.default_rng(4)
    time_s = 3.0 + 0.1 * np.arange(40)
    chunk = Chunk(rng.standard_normal((40, 2)), rng.standard_normal((40, 3)), time_s)
    windows = solve_chunks([chunk], width=5, stride=3, noise=np.zeros(2))
    assert windows is not None
    np.testing.assert_allclose(windows.time_s, time_s[2:38:3][: windows.time_s.size])
