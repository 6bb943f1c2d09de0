"""One inertia tensor behind all equations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.model import Identification, Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify, rigid_body
from quadid_logs.identify.design import build_design
from quadid_logs.identify.equation_by_equation import checked, fit_unchecked
from quadid_logs.identify.fit import PooledFit
from quadid_logs.identify.structures import DAMPED, RIGID_BODY
from quadid_logs.maths.rotational_dynamics import PRODUCTS, gyroscopic_matrix

from .structures import ACTUATED
from .vehicles import QUAD, Truth, fly, multisine

_INERTIA = np.array([[0.010, -0.0009, 0.0012], [-0.0009, 0.012, 0.0007], [0.0012, 0.0007, 0.020]])
#: Rotors damp by a torque of their own axis, so what it does to the rates passes the tensor too.
ASKEW = Truth(inertia=_INERTIA, damping=np.linalg.inv(_INERTIA) @ np.diag([0.015, 0.014, 0.012]))


@pytest.fixture(scope="module")
def askew() -> Identification:
    """A vehicle with all products of inertia, lag 30 ms and noise, in closed loop."""
    return identify(fly(ASKEW, multisine(40.0), feedback=8.0), IdentifySettings(), ACTUATED)


def body(found: Identification) -> Model:
    return next(model for model in found.models if model.structure == "rigid-body")


def test_a_tensor_with_products_of_inertia_is_found_whole(askew: Identification) -> None:
    """Every entry of B within 2 % of the largest."""
    model = body(askew)
    assert model.recommended
    np.testing.assert_allclose(model.B, ASKEW.B, atol=0.02 * ASKEW.B.max())


def test_all_gyroscopic_terms_follow_from_the_tensor(askew: Identification) -> None:
    """The squares too; to a tenth of the largest."""
    expected = gyroscopic_matrix(ASKEW.inertia)
    found = body(askew).A[:, : len(PRODUCTS)]
    np.testing.assert_allclose(found, expected, atol=0.1 * np.abs(expected).max())


def test_the_body_is_consistent_with_itself(askew: Identification) -> None:
    """A is what the inertia behind B demands, whatever the noise."""
    model = body(askew)
    # Torque of this flight is in N m, so B is the inverse inertia itself.
    np.testing.assert_allclose(
        model.A[:, : len(PRODUCTS)], gyroscopic_matrix(np.linalg.inv(model.B)), atol=1e-8
    )


@pytest.mark.thorough
def test_gains_per_command_leave_the_inertia_to_the_gyroscopic_terms() -> None:
    """With another unit on each axis B is not symmetric, and A still that of the body."""
    flight = fly(ASKEW, multisine(40.0), feedback=8.0)
    units = np.array([2.0, 3.0, 0.5])
    assert flight.input is not None
    commanded = dataclasses.replace(
        flight,
        segments=tuple(
            dataclasses.replace(segment, torque=segment.torque / units) for segment in flight.segments
        ),
        input=dataclasses.replace(flight.input, kind="torque_command", unit="1"),
    )
    model = body(identify(commanded, IdentifySettings(), ACTUATED))
    np.testing.assert_allclose(model.B / units, ASKEW.B, atol=0.02 * ASKEW.B.max())
    expected = gyroscopic_matrix(ASKEW.inertia)
    np.testing.assert_allclose(model.A[:, : len(PRODUCTS)], expected, atol=0.1 * np.abs(expected).max())


def test_one_excited_axis_tells_nothing_of_the_shape() -> None:
    """Then no coupling is claimed, and the equations fitted one by one are recommended."""
    found = identify(fly(QUAD, multisine(40.0, axes=(0,)), feedback=8.0), IdentifySettings(), ACTUATED)
    model = body(found)
    assert not model.recommended
    assert not any(p.identifiable for p in model.parameters if p.regressor in PRODUCTS)


def test_a_vehicle_that_is_no_rigid_body_is_not_called_one() -> None:
    """A torque that goes with r^2 but comes from no inertia: the equations one by one explain it better."""
    flight = fly(QUAD, multisine(40.0), feedback=8.0)
    # Adding to the rate what a torque q*r on roll would have done makes rotation inconsistent.
    segment = flight.segments[0]
    p, q, r = segment.body_rate_rad_s.T
    extra = 1.5 * np.cumsum(q * r) * flight.sample_period_s
    extra -= np.polyval(np.polyfit(segment.time_s, extra, 3), segment.time_s)
    strange = dataclasses.replace(segment, body_rate_rad_s=np.column_stack([p + extra, q, r]))
    found = identify(dataclasses.replace(flight, segments=(strange,)), IdentifySettings(), ACTUATED)
    assert not body(found).recommended


@pytest.mark.thorough
def test_cross_talk_of_the_gyro_is_not_taken_for_products_of_inertia() -> None:
    """A gyro whose axes show some half per cent of each other: the truth stays within the intervals."""
    flight = fly(QUAD, multisine(40.0), feedback=8.0)
    segment = flight.segments[0]
    E = np.array([[0.0, 0.005, -0.004], [0.006, 0.0, 0.004], [-0.003, 0.005, 0.0]])
    shown = dataclasses.replace(segment, body_rate_rad_s=segment.body_rate_rad_s @ (np.eye(3) + E).T)
    model = body(identify(dataclasses.replace(flight, segments=(shown,)), IdentifySettings(), ACTUATED))
    truth = np.concatenate([gyroscopic_matrix(QUAD.inertia), -QUAD.damping, np.zeros((3, 1)), QUAD.B], axis=1)
    for parameter in model.parameters:
        if parameter.regressor in (*PRODUCTS, "L", "M", "N"):
            row = model.targets.index(parameter.target)
            true = truth[row, (*model.regressors, *model.inputs).index(parameter.regressor)]
            # One in twenty may lie outside; none by more than half of its width.
            low, high = parameter.ci95
            assert low - 0.25 * (high - low) <= true <= high + 0.25 * (high - low), parameter


@pytest.fixture(scope="module")
def parts() -> tuple[rigid_body._Body, rigid_body._Rows, np.ndarray]:
    """Return the body of a short flight, its rows, and the parameters that the search begins with."""
    flight = fly(ASKEW, multisine(20.0), feedback=8.0)
    structure = RIGID_BODY.known(("L", "M", "N"))
    whole = build_design(flight, 5.0, (DAMPED, structure))
    assert whole is not None
    first = checked(fit_unchecked(flight, whole, DAMPED, IdentifySettings()))
    body = rigid_body._Body.of(structure, first.model.design, calibrated=True)
    return body, rigid_body._rows(body, structure, first.model), rigid_body._start(body, first)


def carried_over(parts: tuple[rigid_body._Body, rigid_body._Rows, np.ndarray]) -> PooledFit:
    body, rows, x = parts
    n_columns = len(RIGID_BODY.known(("L", "M", "N")).columns)
    return rigid_body._as_fit(body, x, np.ones(body.size, dtype=bool), rows, n_columns)


def test_what_is_typical_of_vehicles_narrows_no_interval(
    parts: tuple[rigid_body._Body, rigid_body._Rows, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It helps the search, but is no observation of this one: ten times as sure, ten times as unsure."""
    half_widths = []
    for factor in (0.1, 10.0):
        monkeypatch.setattr(rigid_body, "_CORRELATION_SPREAD", factor * 0.05)
        half_widths.append(carried_over(parts).half_width)
    np.testing.assert_array_equal(*half_widths)


def test_what_is_known_of_gyros_narrows_intervals(
    parts: tuple[rigid_body._Body, rigid_body._Rows, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gyro ten times as good leaves less uncertain of every effectiveness."""
    as_it_is = carried_over(parts).half_width[:, -3:]
    monkeypatch.setattr(rigid_body, "GYRO_SYSTEMATIC", 0.1 * rigid_body.GYRO_SYSTEMATIC)
    better = carried_over(parts).half_width[:, -3:]
    assert (np.diag(better) < 0.995 * np.diag(as_it_is)).all()


def test_errors_of_the_gyro_are_no_parameters_of_the_vehicle(
    parts: tuple[rigid_body._Body, rigid_body._Rows, np.ndarray],
) -> None:
    """Gains, products of inertia and dampings of three axes, their disturbances, lag and delay."""
    body = parts[0]
    assert carried_over(parts).n_parameters == 3 + 3 + 3 + 3 * len(body.loose) + 2
