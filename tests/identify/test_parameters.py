"""When a coefficient may be claimed: each limit from just inside and from just outside."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.model import Parameter
from quadid_logs.identify.inference import Estimate
from quadid_logs.identify.parameters import build_parameters
from quadid_logs.identify.structures import DAMPED

GAIN = np.array([200.0, 150.0, 8.0])
#: (Iyy - Izz) / Ixx, (Izz - Ixx) / Iyy and (Ixx - Iyy) / Izz of moments 1, 1.4 and 2.1.
OF_A_BODY = np.array([(1.4 - 2.1) / 1.0, (2.1 - 1.0) / 1.4, (1.0 - 1.4) / 2.1])


def claimed(
    half_width: np.ndarray | float, gyroscopic: np.ndarray = OF_A_BODY
) -> dict[tuple[str, str], Parameter]:
    """Name the coefficients of a vehicle, with half widths of (3, n_columns)."""
    theta = np.zeros((3, len(DAMPED.columns)))
    theta[:, :3], theta[:, 3:6], theta[:, -3:] = np.diag(gyroscopic), -np.diag([2.0, 1.5, 1.0]), np.diag(GAIN)
    half = np.zeros(theta.shape) + half_width
    estimate = Estimate(theta, theta - half, theta + half, np.ones(theta.shape, dtype=bool))
    found = build_parameters(DAMPED, estimate, input_unit="1", caveats={})
    return {(each.target, each.regressor): each for each in found}


def only(column: int, relative: float) -> np.ndarray:
    """Return half widths of zero but for B11, B22 or B33."""
    half = np.zeros((3, len(DAMPED.columns)))
    half[column, len(DAMPED.terms) + column] = relative * GAIN[column]
    return half


@pytest.mark.parametrize(("axis", "name"), [(0, ("p_dot", "L")), (1, ("q_dot", "M")), (2, ("r_dot", "N"))])
def test_an_effectiveness_is_claimed_up_to_a_half_width_of_three_tenths_of_it(
    axis: int, name: tuple[str, str]
) -> None:
    """Of the small one of yaw as of the large ones: it is held against itself."""
    assert claimed(only(axis, 0.29))[name].identifiable
    assert not claimed(only(axis, 0.31))[name].identifiable


def test_a_coefficient_near_zero_is_claimed_where_its_interval_is_narrow_against_what_it_could_be() -> None:
    """An off-axis effectiveness of none beside an on-axis one of 200: narrow at 50, wide at 70."""
    half = np.zeros((3, len(DAMPED.columns)))
    for width, is_claimed in ((50.0, True), (70.0, False)):
        half[0, len(DAMPED.terms) + 1] = width
        assert claimed(half)["p_dot", "M"].identifiable is is_claimed


def test_gyroscopic_coefficients_of_a_body_are_claimed() -> None:
    """Their sum is minus their product, however far from zero it is."""
    found = claimed(0.001)
    assert abs(OF_A_BODY.sum()) > 0.1
    assert all(found[name].identifiable for name in (("p_dot", "qr"), ("q_dot", "pr"), ("r_dot", "pq")))


def test_gyroscopic_coefficients_of_no_body_are_not_claimed() -> None:
    """The same with the signs reversed but for the smallest; others stay."""
    found = claimed(0.001, OF_A_BODY * [-1.0, 1.0, 1.0])
    for name in (("p_dot", "qr"), ("q_dot", "pr"), ("r_dot", "pq")):
        assert "no rigid body" in found[name].reason
    assert found["p_dot", "L"].identifiable
