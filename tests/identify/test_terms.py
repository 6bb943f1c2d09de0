"""A term is one object: the package knows of a column what the object says, and nothing else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.flight import Segment
from quadid_logs.data.model import Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.structures import DAMPED, RIGID_BODY, STRUCTURES
from quadid_logs.identify.terms import ROTOR_DAMPING, Family, RateTerm, RotorField, column_of

from .vehicles import QUAD, fly, multisine

#: Drag of a body whose air speed goes with its rate: nothing in the package knows of it.
QUADRATIC = RateTerm(
    symbol="p|p|",
    units=("1", "s"),
    words="p|p|: drag that grows with the square of the roll rate",
    factors=("p", "p"),
    plausible=5.0,
    notable=0.2,
    family=Family(("p|p|",), lambda M: np.full((1, 1), M[0, 0] * abs(M[0, 0]))),
    of_rate=lambda rate: rate[:, 0] * np.abs(rate[:, 0]),
)
WITH_DRAG = DAMPED._replace(name="damped and dragged", terms=(*DAMPED.terms, QUADRATIC))
BODY_WITH_DRAG = RIGID_BODY._replace(terms=(*RIGID_BODY.terms, QUADRATIC))


@pytest.fixture(scope="module")
def dragged() -> dict[str, Model]:
    """A flight with rates of some rad/s, whose roll is damped by 0.8 p |p| besides."""
    truth = dataclasses.replace(QUAD, quadratic_roll_damping=0.8)
    flight = fly(truth, multisine(40.0, size=0.45))
    models = identify(flight, IdentifySettings(), (WITH_DRAG, BODY_WITH_DRAG, DAMPED)).models
    return {model.structure: model for model in models}


@pytest.mark.thorough
@pytest.mark.parametrize("structure", [WITH_DRAG.name, BODY_WITH_DRAG.name])
def test_a_new_term_is_fitted_where_a_structure_lists_it(dragged: dict[str, Model], structure: str) -> None:
    """To 5 %, the truth inside the interval, equation by equation and behind one tensor."""
    found = dragged[structure].entries["p_dot", "p|p|"]
    assert found.value == pytest.approx(-0.8, rel=0.05)
    assert found.ci95[0] < -0.8 < found.ci95[1]
    assert found.identifiable
    assert found.unit == "1"


@pytest.mark.thorough
def test_a_new_term_takes_from_the_others_what_is_its_own(dragged: dict[str, Model]) -> None:
    """Without it the drag passes for damping."""
    with_drag, without = (dragged[name].entries["p_dot", "p"].value for name in (WITH_DRAG.name, "damped"))
    assert with_drag == pytest.approx(-1.5, rel=0.1)
    assert without < -1.8


def test_a_new_term_is_simulated_and_seen_by_the_windows(dragged: dict[str, Model]) -> None:
    """Rates from the torque alone follow the flight better with the drag."""
    both = [dragged[name].validation.r2_simulated_rate["p"] for name in (WITH_DRAG.name, "damped")]
    assert 1.0 - both[0] < 0.5 * (1.0 - both[1])
    windows = dragged[WITH_DRAG.name].windows
    assert windows is not None
    assert windows.coefficients.shape[2] == len(WITH_DRAG.columns)


def test_a_term_that_the_flight_does_not_need_comes_out_near_zero() -> None:
    """Then its interval holds zero, and the fit is that of the other terms."""
    model = identify(fly(QUAD, multisine(40.0, size=0.45)), IdentifySettings(), (WITH_DRAG,)).models[0]
    low, high = model.entries["p_dot", "p|p|"].ci95
    assert low < 0.0 < high
    assert model.B[0, 0] == pytest.approx(QUAD.B[0, 0], rel=0.01)


def test_structures_are_told_by_their_names() -> None:
    """And every term's symbol stands for one column of it."""
    assert len({structure.name for structure in STRUCTURES}) == len(STRUCTURES)
    for structure in STRUCTURES:
        assert len(set(structure.columns)) == len(structure.columns)


#: Roll, pitch, yaw per thrust of a quad in X: front right and rear left turn one way, the others the other.
X_FRAME = np.array([[-0.5, 0.5, 0.5, -0.5], [0.5, -0.5, 0.5, -0.5], [0.5, 0.5, -0.5, -0.5]])


def rotor_damping(thrust: list[float], rate: list[float]) -> list[float]:
    """Return the three columns of one sample at a mean thrust of 1."""
    segment = Segment(
        time_s=np.zeros(1),
        body_rate_rad_s=np.array([rate]),
        torque=np.zeros((1, 3)),
        attitude_rad=None,
        throttle=None,
        rotor_thrust=np.array([thrust]),
        saturated=np.zeros(1, dtype=bool),
    )
    columns = (column_of(term, segment, 0.01, RotorField(X_FRAME, 1.0)) for term in ROTOR_DAMPING)
    return [float(column[0]) for column in columns if column is not None]


def test_rotors_at_their_mean_speed_damp_by_the_damping_alone() -> None:
    """Nothing is left for the columns beside it."""
    assert rotor_damping([1.0, 1.0, 1.0, 1.0], [1.0, 2.0, 3.0]) == pytest.approx([0.0, 0.0, 0.0])


def test_rotors_twice_as_fast_damp_twice() -> None:
    """Thrust goes with the square of the speed, damping with the speed."""
    assert rotor_damping([4.0, 4.0, 4.0, 4.0], [1.0, 2.0, 3.0]) == pytest.approx([1.0, 2.0, 3.0])


def test_a_yaw_command_lets_the_rotors_damp_pitch_by_roll() -> None:
    """One diagonal is faster, the other slower: a roll rate meets its resistance askew."""
    roll, pitch, yaw = rotor_damping([2.25, 2.25, 0.25, 0.25], [1.0, 0.0, 0.0])
    assert (roll, yaw) == pytest.approx((0.0, 0.0))
    assert pitch == pytest.approx(-0.5)


def test_a_log_without_rotor_thrusts_has_no_column_of_their_damping() -> None:
    """The damping itself stays."""
    segment = Segment(
        time_s=np.zeros(1),
        body_rate_rad_s=np.ones((1, 3)),
        torque=np.zeros((1, 3)),
        attitude_rad=None,
        throttle=None,
        rotor_thrust=None,
        saturated=np.zeros(1, dtype=bool),
    )
    assert column_of(ROTOR_DAMPING[0], segment, 0.01, RotorField(X_FRAME, 1.0)) is None
