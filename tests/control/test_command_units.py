"""A loop is closed per unit of command, whatever unit the model is in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.control.command_units import per_command
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model, Parameter, Posterior, Validation
from quadid_logs.data.torque import Calibration
from quadid_logs.vocabulary import ON_AXIS
from tests.control.loop_flights import flight

N_M = (4.0, 3.0, 0.5)
SIGMA = 0.1


def entry(name: str, place: tuple[str, str], value: float, half_width: float) -> Parameter:
    return Parameter(
        name=name, target=place[0], regressor=place[1], value=value, unit="rad/s^2 per N m",
        ci95=(value - half_width, value + half_width), identifiable=True, reason="")  # fmt: skip


@pytest.fixture(scope="module")
def calibrated() -> tuple[FlightData, Model]:
    """A tenth of calibration error, and 2 % that the flight itself leaves, both standard deviations.

    The posterior knows of the flight alone.
    """
    data = flight(seconds=2.0)
    assert data.input is not None
    given = replace(
        data.input, unit="N m", calibration=Calibration(n_m_per_command=N_M, relative_sigma=(SIGMA,) * 3)
    )
    segments = tuple(replace(each, torque=each.torque * N_M) for each in data.segments)
    sigma = np.hypot(SIGMA, 0.02)
    covariance = np.zeros((3, 5, 5))
    covariance[:, 0, 0] = 2.0**2
    covariance[:, 1, 1] = 0.25
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.3 * 0.5 * 2.0
    mean = np.tile([100.0, -2.0, 0.03, 0.004, 5.0], (3, 1))
    model = Model(
        structure="damped", recommended=True, states=(), regressors=(), targets=(), inputs=("L", "M", "N"),
        A=np.zeros((3, 3)), B=100.0 * np.eye(3),
        parameters=tuple(
            entry(f"B{number}{number}", place, 100.0, 1.959964 * 100.0 * sigma)
            for number, place in enumerate(ON_AXIS.values(), 1)
        ),
        windows=None, validation=Validation(held_out_s=0.0),
        posterior=Posterior(mean=mean, covariance=covariance, lag_or_delay_s=0.0),
    )  # fmt: skip
    return replace(data, input=given, segments=segments), model


def test_effectiveness_is_per_unit_of_command(calibrated: tuple[FlightData, Model]) -> None:
    """A hundred per newton metre, at four newton metres per unit."""
    _, model = per_command(*calibrated)
    assert model.posterior is not None
    assert model.posterior.mean[:, 0] == pytest.approx([400.0, 300.0, 50.0])
    assert model.posterior.mean[:, 4] == pytest.approx([20.0, 15.0, 2.5])
    assert [one.value for one in model.parameters] == pytest.approx([400.0, 300.0, 50.0])


def test_the_calibration_does_not_widen_the_loops_intervals(calibrated: tuple[FlightData, Model]) -> None:
    """The controller's command is not in newton metres: what they are uncertain by cancels."""
    _, model = per_command(*calibrated)
    assert model.posterior is not None
    assert np.sqrt(model.posterior.covariance[:, 0, 0]) == pytest.approx(0.02 * np.array([400, 300, 50]))
    low, high = model.parameters[0].ci95
    assert high - low == pytest.approx(2 * 1.959964 * 0.02 * 400.0)


def test_correlation_with_the_damping_is_kept(calibrated: tuple[FlightData, Model]) -> None:
    """Draws are joint: a scaled covariance, not a diagonal one."""
    _, model = per_command(*calibrated)
    assert model.posterior is not None
    covariance = model.posterior.covariance[0]
    assert covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]) == pytest.approx(0.3)


def test_the_logged_torque_is_what_the_controller_commanded(calibrated: tuple[FlightData, Model]) -> None:
    """Predictions are compared with it."""
    data, _ = per_command(*calibrated)
    assert data.segments[0].torque == pytest.approx(flight(seconds=2.0).segments[0].torque)


def test_a_model_per_command_stays_as_it_is(calibrated: tuple[FlightData, Model]) -> None:
    """Most logs are not calibrated."""
    data = flight(seconds=2.0)
    assert per_command(data, calibrated[1])[1] is calibrated[1]


def test_the_torque_of_a_rotor_is_per_unit_of_command_too(calibrated: tuple[FlightData, Model]) -> None:
    """Rotors that lag make the torque that the loop is measured with."""
    data, model = calibrated
    assert data.input is not None
    arms = np.ones((3, 4))
    given, _ = per_command(replace(data, input=replace(data.input, torque_per_thrust=arms)), model)
    assert given.input is not None
    assert given.input.torque_per_thrust == pytest.approx(arms / np.array(N_M)[:, np.newaxis])
