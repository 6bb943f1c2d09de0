"""Yaw: the reaction of accelerating rotors, its own band, slow logs, and what is the controller."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.model import Identification, Model, Response
from quadid_logs.data.settings import AlignSettings, IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.design import build_design
from quadid_logs.identify.inference import Estimate
from quadid_logs.identify.slow_yaw import _follows_motion
from quadid_logs.identify.splice import with_axis_of
from quadid_logs.identify.structural import with_unseen_damping
from quadid_logs.identify.structures import DAMPED
from quadid_logs.identify.terms import YAW_REACTION
from quadid_logs.load import prepare
from quadid_logs.simulator import Simulation, simulate

from .structures import ACTUATED
from .vehicles import PERIOD_S, QUAD, fly, multisine


def damped(found: Identification) -> Model:
    return next(model for model in found.models if model.structure == DAMPED.name)


@pytest.fixture(scope="module")
def flown() -> Simulation:
    """Yaw leads its torque by 76 ms in hover."""
    return simulate("rotor-reaction", seed=2, duration_s=40.0)


@pytest.fixture(scope="module")
def found(flown: Simulation) -> Identification:
    return identify(cut(prepare(flown.log), AlignSettings()), IdentifySettings(), ACTUATED)


def test_the_effectiveness_of_yaw_is_right_behind_rotors_that_react(
    flown: Simulation, found: Identification
) -> None:
    """Without the reaction it is 22 % high."""
    truth = flown.truth["models"]["damped"]["B"][2][2]
    for model in found.models[:2]:
        assert model.B[2, 2] == pytest.approx(truth, rel=0.005)
        low, high = model.entries["r_dot", "N"].ci95
        assert low < truth < high


def test_the_lead_of_the_rotors_is_found(flown: Simulation, found: Identification) -> None:
    """To 1 ms."""
    reaction = damped(found).yaw_reaction
    assert reaction is not None
    assert reaction.lead_s == pytest.approx(flown.truth["actuator"]["yaw_lead_s"], abs=0.001)


def test_roll_and_pitch_have_no_reaction(found: Identification) -> None:
    """It is about the rotors' own axis."""
    for target in ("p_dot", "q_dot"):
        assert damped(found).entries[target, YAW_REACTION.symbol].value == 0.0


def test_a_vehicle_without_reaction_has_no_column_of_it() -> None:
    """No number may change for a term that is not there."""
    model = identify(fly(QUAD, multisine(40.0), feedback=8.0), IdentifySettings()).models[0]
    assert model.yaw_reaction is None
    assert YAW_REACTION.symbol not in model.regressors


def test_an_unseen_damping_of_yaw_widens_its_interval_by_what_it_would_take_off() -> None:
    """(B + E s) / (s + 1) is (B - E + E s) / s, but for what is slower."""
    structure = DAMPED.with_reaction()
    theta = np.ones((3, len(structure.columns)))
    theta[2, structure.columns.index(YAW_REACTION.symbol)] = 10.0
    kept = np.ones(theta.shape, dtype=np.bool_)
    seen = Estimate(theta=theta, low=theta - 1.0, high=theta + 1.0, kept=kept)
    unseen = kept.copy()
    unseen[2, structure.columns.index("r")] = False
    assert with_unseen_damping(structure, seen).high[2, -1] == 2.0
    assert with_unseen_damping(structure, seen._replace(kept=unseen)).high[2, -1] == 12.0


def response_of(gain: Callable[[np.ndarray], np.ndarray]) -> Response:
    """Return a response known to 5 % in third octaves from half a hertz on."""
    frequency_hz = 0.56 * 2.0 ** (np.arange(12) / 3.0)
    same = np.ones(frequency_hz.size)
    return Response(
        frequency_hz=frequency_hz,
        gain=gain(2j * np.pi * frequency_hz),
        error=0.05 * same,
        coherence=same,
        torque_power=same,
    )


def heading_hold(s: np.ndarray) -> np.ndarray:
    """Return the controller of a copter's yaw: gains of heading and rate, a filter of the error."""
    return (0.18 + 0.018 / s) / (1.0 + s / (2.0 * np.pi * 2.5)) * (1.0 + 4.5 / s)


def test_a_response_of_the_inverse_controller_is_called_so() -> None:
    """It grows with frequency, and does not lead as a vehicle that does would."""
    assert _follows_motion([response_of(lambda s: -s / heading_hold(s))], 2.5)


@pytest.mark.parametrize("lead_s", [0.0, 0.08, 0.5])
def test_a_response_of_a_vehicle_is_none_of_the_inverse_controller(lead_s: float) -> None:
    """Also where it grows, with the reaction of its rotors."""
    gain = response_of(lambda s: 11.0 * (1.0 + s * lead_s) / (1.0 + s * 0.03) * np.exp(-s * 0.02))
    assert not _follows_motion([gain], 2.5)


def test_a_manoeuvre_in_one_held_out_block_is_divided_among_both_sets() -> None:
    """Yaw moves for four seconds only, inside the first block that an even manoeuvre would have held out."""
    torque = multisine(60.0)
    even = build_design(fly(QUAD, torque), 5.0)
    assert even is not None
    held_s = even.time_s[even.block == even.block[even.held_out][0]]
    time_s = np.arange(len(torque)) * PERIOD_S
    torque[(time_s < held_s[0] + 0.5) | (time_s > held_s[-1] - 0.5), 2] = 0.0
    design = build_design(fly(QUAD, torque), 5.0)
    assert design is not None
    moved = np.diff(design.torque.as_logged()[:, 2], prepend=0.0) ** 2
    fraction = moved[design.held_out].sum() / moved.sum()
    assert 0.05 < fraction < 0.95


def test_an_even_manoeuvre_keeps_blocks_of_five_seconds() -> None:
    """Shorter ones leave more rows out at their edges."""
    design = build_design(fly(QUAD, multisine(60.0)), 5.0)
    assert design is not None
    assert np.bincount(design.block).max() * design.period_s == pytest.approx(5.0, rel=0.02)


@pytest.fixture(scope="module")
def slow() -> Simulation:
    return simulate("pilot-sticks", seed=1, duration_s=60.0, rate_hz=10.0)


@pytest.mark.thorough
def test_yaw_of_a_slow_log_is_known_to_its_interval(slow: Simulation) -> None:
    """20 samples a second with set-points: roll and pitch are nothing, yaw is within 5 %."""
    found = identify(cut(prepare(slow.log), AlignSettings()), IdentifySettings(), ACTUATED)
    (model,) = found.models
    truth = slow.truth["models"]["damped"]["B"][2][2]
    low, high = model.entries["r_dot", "N"].ci95
    assert found.only_yaw
    assert model.B[2, 2] == pytest.approx(truth, rel=0.05)
    assert low < truth < high
    assert [entry.name for entry in model.parameters if entry.identifiable] == ["B33"]


@pytest.mark.thorough
def test_a_slow_log_without_setpoints_tells_nothing(slow: Simulation) -> None:
    """The torque of a slow log answers gusts, and nothing tells them from commands."""
    data = cut(prepare(slow.log), AlignSettings())
    bare = [dataclasses.replace(each, reference=None) for each in data.segments]
    found = identify(dataclasses.replace(data, segments=tuple(bare)), IdentifySettings(), ACTUATED)
    assert not found.models
    assert "at only" in found.skipped


@pytest.mark.thorough
def test_yaw_of_another_band_takes_its_own_row_only() -> None:
    """Roll and pitch stay to the last bit."""
    data = fly(QUAD, multisine(40.0), feedback=8.0)
    first, second = (
        identify(data, IdentifySettings(high_pass_hz=edge_hz), (DAMPED,)).models[0] for edge_hz in (0.3, 0.5)
    )
    merged = dataclasses.replace(with_axis_of(first, second, 2, data), yaw_band=second.band)
    np.testing.assert_array_equal(merged.B, [*first.B[:2], second.B[2]])
    assert merged.entries["r_dot", "N"] == second.entries["r_dot", "N"]
    assert merged.entries["p_dot", "L"] == first.entries["p_dot", "L"]
    assert merged.validation.r2_acceleration["r_dot"] == second.validation.r2_acceleration["r_dot"]
    assert merged.band_of(2) is second.band
    assert merged.band_of(0) is first.band
