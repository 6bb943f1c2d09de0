"""Discretisation, also of models that no vehicle can have."""

from __future__ import annotations

import numpy as np

from quadid_logs.maths.discretise import zero_order_hold


def test_an_integrator_sums_its_held_input() -> None:
    """p_dot = 2 u over half a second adds u."""
    A_d, B_d = zero_order_hold(np.zeros((1, 1)), np.array([[2.0]]), 0.5)
    np.testing.assert_allclose((A_d, B_d), ([[1.0]], [[1.0]]))


def test_a_model_that_explodes_is_not_finite_and_no_warning() -> None:
    """A damaged log can give gains of any size."""
    A_d, _ = zero_order_hold(np.diag([1e6, 0.0]), np.ones((2, 1)), 1.0)
    assert not np.isfinite(A_d).all()


def test_a_double_integrator_goes_from_its_input_through_the_rate_to_the_angle() -> None:
    """x1_dot = x2, x2_dot = u: h and h^2 / 2 above the diagonal, nothing below."""
    A_d, B_d = zero_order_hold(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), 0.2)
    np.testing.assert_allclose(A_d, [[1.0, 0.2], [0.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(B_d, [[0.02], [0.2]], atol=1e-12)
