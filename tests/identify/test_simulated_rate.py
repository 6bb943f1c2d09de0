"""Rates simulated from the torque: each axis by itself, over what can be predicted."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.structures import DAMPED
from quadid_logs.identify.validate import validate
from quadid_logs.vocabulary import RATE_SYMBOLS

from .vehicles import QUAD, Truth, fly, multisine

UNSTABLE = dataclasses.replace(QUAD, damping=np.diag([-4.0, 1.2, 0.6]))


def design_of(truth: Truth) -> Design:
    found = build_design(fly(truth, multisine(60.0), feedback=8.0), 5.0)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def design() -> Design:
    return design_of(QUAD)


@pytest.fixture(scope="module")
def unstable() -> Design:
    return design_of(UNSTABLE)


def model_of(truth: Truth, design: Design) -> tuple[np.ndarray, np.ndarray]:
    """Return the true [A B] of a vehicle without products of inertia, and no disturbances."""
    J = np.diag(truth.inertia)
    theta = np.zeros((3, len(DAMPED.columns)))
    for axis, product in enumerate(("qr", "pr", "pq")):
        theta[axis, DAMPED.columns.index(product)] = (J[(axis + 1) % 3] - J[(axis + 2) % 3]) / J[axis]
        theta[axis, DAMPED.columns.index(RATE_SYMBOLS[axis])] = -truth.damping[axis, axis]
    theta[:, -3:] = truth.B
    return theta, np.zeros((3, len(design.disturbances(DAMPED))))


def r2_of(truth: Truth, design: Design, theta: np.ndarray) -> np.ndarray:
    torque = design.torque.behind(truth.lag_s, truth.delay_s)
    _, nothing = model_of(truth, design)
    found, _ = validate(design, DAMPED, theta, torque, disturbance=nothing, high_pass_hz=0.3)
    return np.array([found.r2_high_passed_rate[name] for name in RATE_SYMBOLS])


def test_the_true_model_reproduces_the_rates(design: Design) -> None:
    """Behind the true lag and delay."""
    assert r2_of(QUAD, design, model_of(QUAD, design)[0]).min() > 0.98


def test_a_wrong_yaw_equation_leaves_roll_and_pitch_as_they_are(design: Design) -> None:
    """Simulated together, a yaw that blows up takes the others with it by gyroscopic terms."""
    theta, _ = model_of(QUAD, design)
    wrong = theta.copy()
    wrong[2, DAMPED.columns.index("r")] = 6.0
    np.testing.assert_allclose(r2_of(QUAD, design, wrong)[:2], r2_of(QUAD, design, theta)[:2], rtol=1e-12)


def test_the_wrong_equation_itself_is_seen(design: Design) -> None:
    """Of the axis that has it: below what is worth no warning."""
    theta, _ = model_of(QUAD, design)
    theta[2, DAMPED.columns.index("r")] = 6.0
    assert r2_of(QUAD, design, theta)[2] < 0.7


def test_an_unstable_axis_is_reproduced_by_its_true_model(unstable: Design) -> None:
    """Over five seconds of free simulation, noise at the start would grow by exp(20)."""
    assert r2_of(UNSTABLE, unstable, model_of(UNSTABLE, unstable)[0])[0] > 0.95


def test_a_wrong_gain_of_an_unstable_axis_is_seen(unstable: Design) -> None:
    """What is fed back from the measured rate must not hide it."""
    theta, _ = model_of(UNSTABLE, unstable)
    theta[0, -3] *= 0.5
    assert r2_of(UNSTABLE, unstable, theta)[0] < 0.8


def test_torque_that_only_answers_a_slow_push_is_seen(design: Design) -> None:
    """A torque of the wrong sign is no cause, whatever was high-passed."""
    theta, _ = model_of(QUAD, design)
    theta[0, -3] *= -1.0
    assert r2_of(QUAD, design, theta)[0] < 0.0
