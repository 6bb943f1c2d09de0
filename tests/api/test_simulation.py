"""A model's equations, solved forward in time, are those of physics."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Actuator, Model, Validation
from quadid_logs.errors import SettingsError, ShapeError
from quadid_logs.identify.simulation import simulate_rates
from quadid_logs.identify.structures import TERMS
from quadid_logs.identify.terms import YAW_REACTION
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS, TORQUE_SYMBOLS

TIME_S = np.arange(0.0, 2.0, 0.001)
NOTHING = np.zeros((TIME_S.size, 3))


def model_of(
    columns: dict[str, FloatArray], B: FloatArray, lag_s: float = 0.0, delay_s: float = 0.0
) -> Model:
    """Return a model with these columns of A (3,)."""
    grid = np.zeros(1)
    return Model(
        structure="own",
        recommended=True,
        states=RATE_SYMBOLS,
        regressors=tuple(columns),
        targets=ACCELERATION_SYMBOLS,
        inputs=TORQUE_SYMBOLS,
        A=np.column_stack([*columns.values()]),
        B=B,
        parameters=(),
        windows=None,
        validation=Validation(held_out_s=0.0),
        actuator=Actuator(
            lag_s=lag_s,
            lag_ci95_s=(lag_s, lag_s),
            delay_s=delay_s,
            delay_ci95_s=(delay_s, delay_s),
            acts_on="torque",
            lag_grid_s=grid,
            delay_grid_s=grid,
            loss=grid,
        ),
    )


def simulated(model: Model, torque: FloatArray, **start: FloatArray) -> FloatArray:
    """Return its rates."""
    return simulate_rates(model, [TERMS[symbol] for symbol in model.regressors], torque, TIME_S, **start)


def test_a_step_of_torque_gives_the_known_response_of_lag_delay_and_damping() -> None:
    """Two poles and a dead time, in closed form."""
    pole, gain, lag_s, delay_s = -2.0, 50.0, 0.05, 0.02
    model = model_of({"p": np.array([pole, 0.0, 0.0])}, gain * np.eye(3), lag_s, delay_s)
    # A ramp over one sample stands for the step: its middle is half a sample late.
    step = np.outer(TIME_S > 0.0, [0.1, 0.0, 0.0])
    t = np.maximum(TIME_S - delay_s - 0.0005, 0.0)
    slow, fast = np.exp(pole * t), np.exp(-t / lag_s)
    expected = 0.1 * gain * ((1.0 - slow) / -pole - (fast - slow) / (-1.0 / lag_s - pole))
    np.testing.assert_allclose(simulated(model, step)[:, 0], expected, atol=1e-4)


def test_a_body_without_torque_keeps_its_energy_and_angular_momentum() -> None:
    """The gyroscopic terms do no work."""
    inertia = np.array([0.01, 0.014, 0.02])
    x, y, z = inertia
    columns = {
        "qr": np.array([(y - z) / x, 0.0, 0.0]),
        "pr": np.array([0.0, (z - x) / y, 0.0]),
        "pq": np.array([0.0, 0.0, (x - y) / z]),
    }
    start = np.array([3.0, -2.0, 1.0])
    rates = simulated(model_of(columns, np.diag(1.0 / inertia)), NOTHING, start_rate_rad_s=start)
    np.testing.assert_allclose(rates**2 @ inertia, start**2 @ inertia, rtol=1e-5)
    np.testing.assert_allclose(rates**2 @ inertia**2, start**2 @ inertia**2, rtol=1e-5)
    assert np.abs(rates - start).max() > 1.0


def test_a_moment_of_the_tilt_makes_a_pendulum() -> None:
    """The angle is integrated from the rates, with the start that was given."""
    model = model_of({"phi": np.array([-25.0, 0.0, 0.0])}, np.eye(3))
    rates = simulated(model, NOTHING, start_attitude_rad=np.array([0.1, 0.0, 0.0]))
    np.testing.assert_allclose(rates[:, 0], -0.5 * np.sin(5.0 * TIME_S), atol=1e-4)


def test_yaw_answers_more_strongly_at_more_throttle() -> None:
    """The product of yaw torque and throttle is made inside."""
    model = model_of({"N*throttle": np.array([0.0, 0.0, 4.0])}, np.diag([1.0, 1.0, 2.0]))
    torque = np.outer(np.ones(TIME_S.size), [0.0, 0.0, 0.1])
    rates = simulated(model, torque, throttle=np.full(TIME_S.size, 0.25))
    np.testing.assert_allclose(rates[:, 2], (2.0 + 4.0 * 0.25) * 0.1 * TIME_S, atol=1e-6)


def test_the_reaction_of_rotors_follows_the_slope_of_the_yaw_torque() -> None:
    """A ramp of torque has a constant reaction."""
    model = model_of({"N_dot": np.array([0.0, 0.0, 3.0])}, np.zeros((3, 3)))
    ramp = np.outer(TIME_S, [0.0, 0.0, 0.2])
    rates = simulate_rates(model, [YAW_REACTION], ramp, TIME_S)
    np.testing.assert_allclose(rates[:, 2], 3.0 * 0.2 * TIME_S, atol=1e-6)


def test_an_unstable_model_stays_finite() -> None:
    """A wrong estimate must not end in overflow."""
    model = model_of({"p": np.array([400.0, 0.0, 0.0]), "pp": np.array([9.0, 0.0, 0.0])}, np.eye(3))
    assert np.isfinite(simulated(model, NOTHING + 1.0)).all()


@pytest.mark.parametrize(
    ("torque", "time_s"),
    [
        (np.zeros((5, 2)), np.arange(5.0)),
        (np.zeros((4, 3)), np.arange(5.0)),
        (np.zeros((5, 3)), np.zeros(5)),
        (np.full((5, 3), np.nan), np.arange(5.0)),
    ],
)
def test_arrays_that_do_not_fit_are_refused(torque: FloatArray, time_s: FloatArray) -> None:
    """With their shapes, not with a broadcast."""
    with pytest.raises(ShapeError):
        simulate_rates(model_of({"p": np.zeros(3)}, np.eye(3)), [TERMS["p"]], torque, time_s)


def test_a_regressor_that_the_torque_does_not_give_is_refused_by_name() -> None:
    """The speed through the air follows from no torque."""
    with pytest.raises(SettingsError, match="regressor u "):
        simulated(model_of({"u": np.ones(3)}, np.eye(3)), NOTHING)
