"""The interval of the inertia tensor, by its first-order formula and by numbers drawn at random."""

from __future__ import annotations

import numpy as np

from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import Inertia, Parameter
from quadid_logs.data.torque import Calibration
from quadid_logs.identify.inertia import inertia_of
from quadid_logs.identify.inference import Estimate
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, TORQUE_SYMBOLS

B = np.array([[90.0, -6.0, 2.0], [-6.0, 80.0, 3.0], [2.0, 3.0, 45.0]])
HALF = np.array([[1.8, 0.9, 0.7], [0.9, 1.2, 0.5], [0.7, 0.5, 1.4]])
IN_N_M = InputDescription(kind="torque_n_m", unit="N m", source="test")


def identified(axes: tuple[int, ...] = (0, 1, 2)) -> list[Parameter]:
    return [
        Parameter(
            name=f"B{axis + 1}{axis + 1}", target=ACCELERATION_SYMBOLS[axis], regressor=TORQUE_SYMBOLS[axis],
            value=float(B[axis, axis]), unit="", ci95=(0.0, 1.0), identifiable=axis in axes,
        )
        for axis in range(3)
    ]  # fmt: skip


def inertia(
    gain: np.ndarray = B,
    half: np.ndarray = HALF,
    given: InputDescription = IN_N_M,
    axes: tuple[int, ...] = (0, 1, 2),
) -> Inertia:
    found = inertia_of(
        Estimate(gain, gain - half, gain + half, np.ones((3, 3), dtype=bool)), identified(axes), given
    )
    assert found is not None
    return found


def half_width(found: Inertia) -> np.ndarray:
    np.testing.assert_allclose(found.ci95_high - found.matrix, found.matrix - found.ci95_low)
    return 0.5 * (found.ci95_high - found.ci95_low)


def test_moments_are_as_uncertain_as_the_gains_that_they_are_the_inverse_of() -> None:
    """In relative numbers, where no axis turns another."""
    found = inertia(np.diag(np.diag(B)), np.diag(np.diag(HALF)))
    relative = np.diag(half_width(found)) / np.diag(found.matrix)
    np.testing.assert_allclose(relative, np.diag(HALF) / np.diag(B))


def test_the_interval_is_the_spread_of_inverses_of_gains_drawn_at_random() -> None:
    """Gains with these half widths, independent of each other: the inverse spreads as widely, to a tenth."""
    rng = np.random.default_rng(9)
    inverses = np.linalg.inv(B + HALF / 1.96 * rng.standard_normal((4000, 3, 3)))
    spread = 1.96 * inverses.std(axis=0)
    # The larger one of each pair: the tensor is symmetric, its interval covers both.
    np.testing.assert_allclose(half_width(inertia()), np.maximum(spread, spread.T), rtol=0.1)


def test_commands_of_known_torque_give_the_same_tensor_with_what_is_not_known_of_that_torque() -> None:
    """0.4 N m per full command, known to 3 %: 1.96 times that beside the interval of the gain."""
    per_command = 0.4
    calibration = Calibration(n_m_per_command=(per_command,) * 3, relative_sigma=(0.03, 0.03, 0.03))
    given = InputDescription(kind="torque_command", unit="1", source="test", calibration=calibration)
    gain, half = np.diag(np.diag(B)), np.diag(np.diag(HALF))
    found = inertia(per_command * gain, per_command * half, given)
    np.testing.assert_allclose(np.diag(found.matrix), 1.0 / np.diag(B))
    relative = np.diag(half_width(found)) / np.diag(found.matrix)
    np.testing.assert_allclose(relative, np.hypot(np.diag(HALF) / np.diag(B), 1.959964 * 0.03))


def test_an_axis_whose_gain_is_not_identified_has_no_inertia() -> None:
    """Nor products with it."""
    found = inertia(axes=(0, 1))
    assert np.isnan(found.matrix[2]).all()
    np.testing.assert_allclose(found.matrix[:2, :2], np.linalg.inv(B[:2, :2]))


def test_a_tensor_is_symmetric_where_the_gains_are_not_quite() -> None:
    """The mean of both."""
    askew = B + np.array([[0.0, 2.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    J = np.linalg.inv(askew)
    np.testing.assert_allclose(inertia(askew).matrix, 0.5 * (J + J.T))
