"""Terms of the logged velocity, fitted where a structure lists them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.model import Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.structures import STRUCTURES, TERMS, own_structure
from quadid_logs.identify.terms import column_of

from .vehicles import PERIOD_S, flight_data, multisine

GAIN, DAMPING = 80.0, 1.5
#: Forward speed raises the nose, sideways speed rolls away from it [rad/(m s)].
PITCHED, ROLLED = 12.0, -9.0
#: What full throttle adds to the first [rad/(m s)].
LIFTED = 6.0
OWN = own_structure("in the air", ["p", "q", "r", "1", "vx", "vy"])
OWN_LIFTED = own_structure("lifted", ["p", "q", "r", "1", "vx", "vy", "vx*throttle"])


def smooth(seed: int, n_samples: int, n_columns: int) -> np.ndarray:
    """Return columns of up to some hertz, of spread 1."""
    white = np.random.default_rng(seed).standard_normal((n_samples, n_columns))
    columns = lfilter([1.0], np.poly([0.98, 0.98]), white, axis=0)
    return columns / columns.std(axis=0)


def flown(lifted: float = 0.0) -> FlightData:
    """Return 60 s of a vehicle that torque, damping and the speed through the air turn."""
    torque = multisine(60.0)
    n_samples = len(torque)
    speed, throttle = smooth(1, n_samples, 3), 0.5 + 0.1 * smooth(2, n_samples, 1)[:, 0]
    push = GAIN * torque
    push[:, 0] += ROLLED * speed[:, 1]
    push[:, 1] += (PITCHED + lifted * throttle) * speed[:, 0]
    decay = np.exp(-DAMPING * PERIOD_S)
    rate = lfilter([(1.0 - decay) / DAMPING], [1.0, -decay], push, axis=0)
    rate += 0.002 * np.random.default_rng(3).standard_normal(rate.shape)
    flight = flight_data(rate, torque)
    (segment,) = flight.segments
    segment = replace(segment, velocity_m_s=speed, attitude_rad=np.zeros((n_samples, 3)), throttle=throttle)
    return replace(flight, segments=(segment,))


@pytest.fixture(scope="module")
def models() -> dict[str, Model]:
    """By structure: with and without the terms of the velocity."""
    found = identify(flown(), IdentifySettings(), (*STRUCTURES[:1], OWN)).models
    return {model.structure: model for model in found}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("target", "term", "truth"),
    [("q_dot", "vx", PITCHED), ("p_dot", "vy", ROLLED), ("p_dot", "vx", 0.0), ("r_dot", "vx", 0.0)],
)
def test_a_moment_by_speed_is_found(models: dict[str, Model], target: str, term: str, truth: float) -> None:
    """The truth inside the interval, and the interval narrow."""
    low, high = models[OWN.name].entries[target, term].ci95
    assert low <= truth <= high
    assert high - low < 0.6


@pytest.mark.thorough
def test_speed_that_is_a_term_explains_what_was_a_disturbance(models: dict[str, Model]) -> None:
    """Of the acceleration of roll and pitch nearly all, where the torque alone explains part."""
    with_speed, without = (models[name].validation.r2_acceleration for name in (OWN.name, "damped"))
    for target in ("p_dot", "q_dot"):
        assert with_speed[target] > 0.97
        assert without[target] < 0.9


@pytest.mark.thorough
def test_effectiveness_is_right_where_speed_is_a_term(models: dict[str, Model]) -> None:
    """And its interval holds it."""
    for target, torque in (("p_dot", "L"), ("q_dot", "M")):
        found = models[OWN.name].entries[target, torque]
        assert found.ci95[0] <= GAIN <= found.ci95[1]
        assert found.value == pytest.approx(GAIN, rel=0.02)


@pytest.mark.thorough
def test_thrust_times_speed_is_told_from_speed() -> None:
    """Pitch by forward speed grows with the throttle."""
    model = next(
        model
        for model in identify(flown(LIFTED), IdentifySettings(), (*STRUCTURES[:1], OWN_LIFTED)).models
        if model.structure == OWN_LIFTED.name
    )
    low, high = model.entries["q_dot", "vx*throttle"].ci95
    assert low <= LIFTED <= high
    assert low > 0.0


@pytest.mark.thorough
def test_a_flight_without_a_velocity_is_not_fitted_with_its_terms() -> None:
    """The structures of the package are."""
    flight = flown()
    (segment,) = flight.segments
    flight = replace(flight, segments=(replace(segment, velocity_m_s=None),))
    found = identify(flight, IdentifySettings(), (*STRUCTURES[:1], OWN)).models
    assert [model.structure for model in found] == ["damped"]


def in_air(**changes: object) -> Segment:
    """Return two samples at 2 m/s backwards, 1 m/s to the right and 3 m/s down, heading east."""
    fields: dict[str, object] = {
        "time_s": np.array([0.0, 0.1]),
        "body_rate_rad_s": np.zeros((2, 3)),
        "torque": np.zeros((2, 3)),
        "attitude_rad": np.tile([0.0, 0.0, np.pi / 2.0], (2, 1)),
        "throttle": np.array([0.5, 0.25]),
        "saturated": np.zeros(2, dtype=bool),
        "velocity_m_s": np.tile([-2.0, 1.0, 3.0], (2, 1)),
    }
    return Segment(**{**fields, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("symbol", "expected"),
    [
        ("vx", [-2.0, -2.0]),
        ("vy", [1.0, 1.0]),
        ("vz", [3.0, 3.0]),
        ("vx|vx|", [-4.0, -4.0]),
        ("vz|vz|", [9.0, 9.0]),
        ("vy*throttle", [0.5, 0.25]),
        ("vx*throttle", [-1.0, -0.5]),
        ("cos(psi)", [0.0, 0.0]),
        ("sin(psi)", [1.0, 1.0]),
    ],
)
def test_a_column_is_what_its_symbol_says(symbol: str, expected: list[float]) -> None:
    """Squares keep the sign of the speed: drag pushes back."""
    np.testing.assert_allclose(column_of(TERMS[symbol], in_air(), 0.1), expected, atol=1e-12)


@pytest.mark.parametrize("lost", ["velocity_m_s", "throttle"])
def test_a_column_that_lacks_its_signal_is_none(lost: str) -> None:
    """Nothing is made up."""
    assert column_of(TERMS["vx*throttle"], in_air(**{lost: None}), 0.1) is None
