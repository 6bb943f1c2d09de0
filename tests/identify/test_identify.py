"""The truth is found where the flight holds it, and refused where it does not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Identification, Model, Parameter
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify

from .structures import ACTUATED
from .vehicles import PERIOD_S, QUAD, Truth, flight_data, fly, multisine


@pytest.fixture(scope="module")
def moved() -> FlightData:
    """Forty seconds in closed loop with noise, lag and delay, all axes moved."""
    return fly(QUAD, multisine(40.0), feedback=8.0)


@pytest.fixture(scope="module")
def found(moved: FlightData) -> Identification:
    return identify(moved, IdentifySettings())


@pytest.fixture(scope="module")
def model(found: Identification) -> Model:
    assert found.recommended is not None
    return found.recommended


def parameter(model: Model, name: str) -> Parameter:
    return next(each for each in model.parameters if each.name == name)


def test_the_rigid_body_is_recommended_for_a_rigid_body(model: Model) -> None:
    """It explains held-out flight best."""
    assert model.structure == "rigid-body"


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_on_axis_effectiveness_is_found_within_one_per_cent(model: Model, axis: int) -> None:
    """B = J^-1, behind lag, delay, noise and feedback."""
    assert model.B[axis, axis] == pytest.approx(QUAD.B[axis, axis], rel=0.01)


def test_lag_and_delay_are_found_to_a_millisecond_or_two(model: Model) -> None:
    """The held torque adds half a sample (1.25 ms) to the delay."""
    assert model.actuator is not None
    assert model.actuator.lag_s == pytest.approx(QUAD.lag_s, abs=0.002)
    assert model.actuator.delay_s == pytest.approx(QUAD.delay_s + 0.00125, abs=0.002)


def test_gyroscopic_coefficients_are_those_of_the_inertia(model: Model) -> None:
    """A11 = (Iyy - Izz) / Ixx and so on, eq. (9); to 0.05, a tenth of their size."""
    Ixx, Iyy, Izz = np.diag(QUAD.inertia)
    expected = [(Iyy - Izz) / Ixx, (Izz - Ixx) / Iyy, (Ixx - Iyy) / Izz]
    found = [model.A[axis, model.regressors.index(name)] for axis, name in enumerate(("qr", "pr", "pq"))]
    np.testing.assert_allclose(found, expected, atol=0.05)


def test_damping_is_found_within_ten_per_cent(model: Model) -> None:
    """The diagonal of the rate terms."""
    found = [-model.A[axis, model.regressors.index(name)] for axis, name in enumerate("pqr")]
    np.testing.assert_allclose(found, np.diag(QUAD.damping), rtol=0.1)


def test_what_is_called_identifiable_has_an_interval_near_the_truth(model: Model) -> None:
    """The truth lies within the interval widened by half a per cent of the gain."""
    for axis in range(3):
        on_axis = parameter(model, f"B{axis + 1}{axis + 1}")
        slack = 0.005 * on_axis.value
        assert on_axis.identifiable
        assert on_axis.ci95[0] - slack < QUAD.B[axis, axis] < on_axis.ci95[1] + slack


def test_off_axis_effectiveness_of_a_diagonal_vehicle_has_intervals_around_zero(model: Model) -> None:
    """No coupling is claimed where there is none."""
    for name in ("B12", "B13", "B21", "B23", "B31", "B32"):
        low, high = parameter(model, name).ci95
        assert low - 0.5 < 0.0 < high + 0.5  # 0.5 of 50 to 100 rad/s^2 per N m


def test_held_out_flight_is_explained(model: Model) -> None:
    """On data that no fit has seen."""
    assert model.validation.held_out_s > 8.0
    assert min(model.validation.r2_acceleration.values()) > 0.98
    assert min(model.validation.r2_simulated_rate.values()) > 0.95


def test_the_inertia_in_n_m_is_the_inverse_of_b(model: Model) -> None:
    """Given torque in N m, J comes out in kg m^2 within two per cent."""
    assert model.inertia is not None
    np.testing.assert_allclose(np.diag(model.inertia.matrix), np.diag(QUAD.inertia), rtol=0.02)


@pytest.mark.thorough
def test_a_full_inertia_tensor_gives_its_full_inverse() -> None:
    """Products of inertia: every element of B within 2 % of the largest."""
    tensor = np.array([[0.010, 0.001, -0.0015], [0.001, 0.012, 0.0008], [-0.0015, 0.0008, 0.020]])
    truth = dataclasses.replace(QUAD, inertia=tensor)
    model = identify(fly(truth, multisine(40.0), feedback=8.0), IdentifySettings(), ACTUATED).recommended
    assert model is not None
    assert np.abs(model.B - truth.B).max() < 0.02 * np.abs(truth.B).max()


def test_a_known_gyro_filter_is_modelled_and_not_taken_for_lag() -> None:
    """20 Hz delays by 11 ms; with the filter known, lag and delay stay what they are."""
    truth = dataclasses.replace(QUAD, gyro_filter_hz=20.0)
    model = identify(fly(truth, multisine(40.0)), IdentifySettings(), ACTUATED).recommended
    assert model is not None
    assert model.actuator is not None
    assert model.actuator.lag_s + model.actuator.delay_s == pytest.approx(0.03625, abs=0.002)
    assert model.B[0, 0] == pytest.approx(truth.B[0, 0], rel=0.01)


def test_an_axis_at_rest_is_not_identifiable() -> None:
    """Only roll is moved: whatever comes out for pitch and yaw is not called a finding."""
    model = identify(
        fly(QUAD, multisine(40.0, axes=(0,)), feedback=8.0), IdentifySettings(), ACTUATED
    ).recommended
    assert model is not None
    assert parameter(model, "B11").identifiable
    assert not parameter(model, "B22").identifiable
    assert not parameter(model, "B33").identifiable


@pytest.mark.thorough
def test_torque_unrelated_to_the_motion_gives_no_identifiable_gain() -> None:
    """Noise against noise."""
    rng = np.random.default_rng(1)
    rate = np.cumsum(rng.standard_normal((16_000, 3)), axis=0) * 1e-3
    model = identify(
        flight_data(rate, rng.standard_normal((16_000, 3))), IdentifySettings(), ACTUATED
    ).recommended
    assert model is not None
    assert not any(parameter(model, name).identifiable for name in ("B11", "B22", "B33"))


def test_without_segments_nothing_is_identified_and_the_reason_is_given() -> None:
    """An empty identification, not an error."""
    empty = flight_data(np.zeros((10, 3)), np.zeros((10, 3)), segments=())
    assert "no segment of flight" in identify(empty, IdentifySettings()).skipped


def test_a_flight_of_two_seconds_is_too_short() -> None:
    """Fewer rows than the unknowns need."""
    short = fly(QUAD, multisine(1.2))
    assert "too short" in identify(short, IdentifySettings()).skipped


def test_a_constant_torque_does_not_crash() -> None:
    """Zero columns everywhere."""
    result = identify(flight_data(np.zeros((16_000, 3)), np.zeros((16_000, 3))), IdentifySettings(), ACTUATED)
    assert not any(p.identifiable and p.regressor in "LMN" for m in result.models for p in m.parameters)


def test_the_wanted_structure_comes_first() -> None:
    """--structure wins over the held-out error."""
    result = identify(fly(QUAD, multisine(20.0)), IdentifySettings(structure="quadrotor-6"))
    assert result.models[0].structure == "quadrotor-6"
    assert result.models[0].recommended


def test_the_published_windows_are_consecutive_samples(found: Identification) -> None:
    """Width 6, stride 1, at the sample period of the data."""
    windows = next(m for m in found.models if m.structure == "quadrotor-6").windows
    assert windows is not None
    assert (windows.width, windows.stride) == (6, 1)
    np.testing.assert_allclose(np.diff(windows.time_s), 0.0025, atol=1e-9)


@pytest.mark.thorough
def test_wider_windows_tame_the_condition_number(moved: FlightData, found: Identification) -> None:
    """Half a second (--window 200) instead of 15 ms: the medians differ by orders of magnitude."""
    plain = next(m for m in found.models if m.structure == "quadrotor-6").windows
    wide = next(
        m
        for m in identify(moved, IdentifySettings(window=200, stride=50)).models
        if m.structure == "quadrotor-6"
    ).windows
    assert plain is not None
    assert wide is not None
    assert np.median(wide.condition_number) < 1e-3 * np.median(plain.condition_number)


def test_the_discrete_model_steps_as_the_continuous_one(model: Model) -> None:
    """For small rates A_d = 1 + A h and B_d = B h to first order."""
    assert model.discrete is not None
    np.testing.assert_allclose(model.discrete.B_d, model.B * 0.0025, rtol=0.01, atol=1e-4)


def test_ignoring_the_lag_would_give_a_wrong_effectiveness(found: Identification) -> None:
    """The structure of the paper, without lag, is off by more than the damped one: the lag matters."""
    plain = next(m for m in found.models if m.structure == "quadrotor-6")
    assert abs(plain.B[0, 0] / QUAD.B[0, 0] - 1.0) > 0.03


@pytest.mark.thorough
def test_the_truth_may_have_no_lag_at_all() -> None:
    """ArduPilot's simulator has none: the lag found is near zero, the gain right."""
    truth = Truth(inertia=QUAD.inertia, damping=QUAD.damping, lag_s=0.0, delay_s=0.0)
    model = identify(fly(truth, multisine(40.0)), IdentifySettings(), ACTUATED).recommended
    assert model is not None
    assert model.actuator is not None
    assert model.actuator.lag_s < 0.002
    assert model.B[1, 1] == pytest.approx(truth.B[1, 1], rel=0.01)


@pytest.mark.thorough
def test_products_that_no_rigid_body_explains_are_not_claimed() -> None:
    """A force that happens to go with q r: the coefficients' sum and product do not cancel."""
    data = fly(QUAD, multisine(40.0), feedback=8.0)
    segment = data.segments[0]
    _, q, r = segment.body_rate_rad_s.T
    pushed = segment.torque.copy()
    pushed[:, 0] -= 0.4 * QUAD.inertia[0, 0] * q * r
    model = identify(
        dataclasses.replace(data, segments=(dataclasses.replace(segment, torque=pushed),)),
        IdentifySettings(),
        ACTUATED,
    ).recommended
    assert model is not None
    assert not parameter(model, "A11").identifiable
    assert "no rigid body" in parameter(model, "A11").reason


def test_gyroscopic_coefficients_of_a_rigid_body_are_claimed(model: Model) -> None:
    """Otherwise the test above would prove nothing."""
    assert parameter(model, "A11").identifiable
    assert parameter(model, "A22").identifiable


def test_a_flight_of_which_one_half_of_the_blocks_is_cut_out_is_fitted_to_the_other() -> None:
    """Six blocks, one held out, and the only odd one left saturated throughout."""
    data = fly(QUAD, multisine(12.0), feedback=8.0)
    segment = data.segments[0]
    sixth = (segment.end_s - segment.start_s) / 6.0
    cut = (segment.time_s > 1.9 * sixth) & (segment.time_s < 3.1 * sixth)
    marked = dataclasses.replace(segment, saturated=cut)
    found = identify(dataclasses.replace(data, segments=(marked,)), IdentifySettings(), ACTUATED).recommended
    assert found is not None
    assert np.isfinite(found.B).all()


@pytest.mark.thorough
def test_axes_excited_in_turn_need_longer_windows_than_axes_excited_at_once() -> None:
    """A window that sees one axis only has directions that are all noise."""
    at_once = multisine(48.0)
    turn = (np.arange(len(at_once)) * PERIOD_S // 2.0).astype(int) % 3
    in_turn = at_once * (turn[:, np.newaxis] == np.arange(3))
    width_s = []
    for torque in (at_once, in_turn):
        models = identify(fly(QUAD, torque), IdentifySettings()).models
        windows = next(model.windows for model in models if model.structure == "damped")
        assert windows is not None
        assert np.mean(windows.used) >= 0.5
        width_s.append(windows.width * windows.period_s)
    assert width_s[1] > width_s[0]
