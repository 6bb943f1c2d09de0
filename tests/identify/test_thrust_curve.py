"""The expo of the thrust curve, found in flights of a firmware that is set to another."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Identification, Model, ThrustCurve
from quadid_logs.data.settings import AlignSettings, IdentifySettings
from quadid_logs.data.torque import AssumedExpo, HeldScale
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.identify import identify
from quadid_logs.identify.thrust_curve import (
    _Found,
    _judged,
    _normalised,
    _scale_change,
    _with_other_changes,
    shifted,
)
from quadid_logs.load import load, prepare
from quadid_logs.simulator import Simulation, simulate

from .structures import ACTUATED

#: As quad 450 is, for people who know no more of their vehicle.
VEHICLE = Vehicle(mass_kg=1.5, arm_length_m=0.225, torque_to_thrust_m=0.016)
FIRMWARE, PROPELLERS = 0.2, 0.6


@cache
def flight(scenario: str = "expo-mismatch", autopilot: str = "ardupilot") -> Simulation:
    return simulate(scenario, seed=2, duration_s=35.0, rate_hz=200.0, autopilot=autopilot)


@cache
def data(scenario: str = "expo-mismatch", vehicle: Vehicle | None = None) -> FlightData:
    return cut(prepare(flight(scenario).log, vehicle), AlignSettings())


@cache
def found(scenario: str = "expo-mismatch", vehicle: Vehicle | None = None) -> Identification:
    return identify(data(scenario, vehicle), IdentifySettings(), ACTUATED)


def curve(identification: Identification) -> ThrustCurve:
    assert identification.thrust_curve is not None
    return identification.thrust_curve


def model(identification: Identification) -> Model:
    assert identification.recommended is not None
    return identification.recommended


def test_the_propellers_expo_is_found_and_lies_in_its_interval() -> None:
    """0.6 where the firmware is set to 0.2."""
    known = curve(found())
    assert (known.assumed, known.parameter) == (pytest.approx(FIRMWARE), "MOT_THST_EXPO")
    assert known.identifiable
    assert known.corrected
    assert known.expo == pytest.approx(PROPELLERS, abs=0.03)
    assert known.ci95[0] <= PROPELLERS <= known.ci95[1]


@pytest.mark.thorough
def test_it_is_found_in_rough_air_as_well() -> None:
    """Squares of thrust follow from no set-point linearly, and air makes none."""
    rough = curve(found("rough-air"))
    assert rough.identifiable
    assert rough.ci95[0] <= PROPELLERS <= rough.ci95[1]


@pytest.mark.thorough
def test_a_firmware_with_another_name_for_it_is_told_its_own() -> None:
    """THR_MDL_FAC; the logs are rebuilt along another path."""
    flown = flight(autopilot="px4")
    known = curve(identify(cut(prepare(flown.log), AlignSettings()), IdentifySettings(), ACTUATED))
    assert known.parameter == "THR_MDL_FAC"
    assert known.expo == pytest.approx(PROPELLERS, abs=0.03)


def test_effectiveness_is_right_at_the_mean_thrust_although_the_firmware_is_not() -> None:
    """Within 1 % and inside the interval; it was 2 to 5 % off and beside it."""
    truth = np.diag(np.array(flight().truth["models"]["damped"]["B"]))
    for axis, entry in enumerate((("p_dot", "L"), ("q_dot", "M"), ("r_dot", "N"))):
        parameter = model(found()).entries[entry]
        assert parameter.value == pytest.approx(truth[axis], rel=0.01)
        assert parameter.ci95[0] <= truth[axis] <= parameter.ci95[1]


@pytest.mark.thorough
def test_a_right_expo_moves_no_number() -> None:
    """Where the firmware is believed, the torque stays what it was, to the last digit."""
    scenario = "sysid-quad-x"
    known = curve(found(scenario))
    assert known.identifiable
    assert not known.corrected
    given = data(scenario).input
    assert given is not None
    without = identify(replace(data(scenario), input=replace(given, expo=None)), IdentifySettings())
    assert without.thrust_curve is None
    np.testing.assert_array_equal(model(found(scenario)).B, model(without).B)


def test_effectiveness_per_command_changes_with_thrust_as_the_two_curves_say() -> None:
    """The slope of the propellers' curve over that of the firmware's, relative to the mean thrust."""
    known = curve(found())

    def slope(thrust: np.ndarray) -> np.ndarray:
        y = (FIRMWARE - 1.0 + np.sqrt((1.0 - FIRMWARE) ** 2 + 4.0 * FIRMWARE * thrust)) / (2.0 * FIRMWARE)
        both = (1.0 - e + 2.0 * e * y for e in (PROPELLERS, FIRMWARE))
        return next(both) / next(both)

    mean = np.interp(1.0, known.effectiveness, known.thrust_over_mean)
    assert mean == pytest.approx(1.0, abs=1e-3)
    hover = flight().truth["mean"]["thrust_fraction"]
    expected = slope(hover * known.thrust_over_mean) / slope(np.array([hover]))
    np.testing.assert_allclose(known.effectiveness, expected, atol=0.01)


@pytest.mark.thorough
def test_a_flight_that_cannot_tell_says_so_and_keeps_what_was_assumed() -> None:
    """One axis moved gently: the interval holds what propellers have."""
    known = curve(found("single-axis", VEHICLE))
    assert not known.identifiable
    assert not known.corrected
    assert "which is too little" in known.reason
    assert known.expo == known.assumed
    assert known.ci95[0] < 0.3
    assert known.ci95[1] > 0.8


@pytest.mark.parametrize(("ratio", "identifiable"), [(1.07, False), (1.5, True)])
def test_an_expo_takes_a_range_of_thrust(ratio: float, identifiable: bool) -> None:
    """At 3.5 % to either side, 1 % of effectiveness is 0.2 of an expo: 0.28 [0.18, 0.39] was told of 0.45."""
    throttle = np.sqrt(np.linspace(0.3, 0.3 * ratio, 4000))
    thrust = throttle**2
    by_expo = thrust - throttle
    level = np.repeat(thrust[:, np.newaxis], 4, axis=1)
    segment = data().segments[0].rows(slice(0, thrust.size))
    flown = replace(segment, rotor_thrust=level, thrust_by_expo=np.repeat(by_expo[:, np.newaxis], 4, axis=1))
    known = _with_other_changes(_Found(-0.2, 0.02), replace(data(), segments=(flown,)))
    assert _judged(ASSUMED, known, 0.0)[0].identifiable is identifiable
    assert known.half_width > 0.2 or identifiable


@pytest.mark.thorough
def test_a_hover_tells_nothing_of_the_thrust_curve() -> None:
    """Nothing moves, and the reason says so."""
    known = curve(found("hover"))
    assert not known.identifiable
    assert "move too little" in known.reason


@pytest.mark.thorough
def test_inertia_follows_from_the_take_off_mass_whatever_the_firmware_believes() -> None:
    """The slope of the curve at hover over the weight: 20 % wrong with the firmware's expo."""
    inertia = model(found(vehicle=VEHICLE)).inertia
    assert inertia is not None
    truth = np.diag(np.array(flight().truth["vehicle"]["inertia_kg_m2"]))
    moments = np.diag(inertia.matrix)
    np.testing.assert_allclose(moments, truth, rtol=0.03)
    assert (np.diag(inertia.ci95_low) <= truth).all()
    assert (truth <= np.diag(inertia.ci95_high)).all()


@pytest.mark.thorough
def test_an_unknown_expo_widens_the_inertia_that_follows_from_the_mass() -> None:
    """By what propellers differ in: more than a tenth to either side, and the truth is inside."""
    inertia = model(found("single-axis", VEHICLE)).inertia
    assert inertia is not None
    low, high = inertia.ci95_low[0, 0], inertia.ci95_high[0, 0]
    assert 0.2 < (high - low) / inertia.matrix[0, 0] < 1.0
    assert low <= flight("single-axis").truth["vehicle"]["inertia_kg_m2"][0][0] <= high


@pytest.mark.parametrize("held", list(HeldScale))
def test_the_torque_of_another_expo_is_the_torque_rebuilt_with_it(held: HeldScale) -> None:
    """Exactly, but for the scale, which keeps slope, mean or full thrust."""
    (segment,) = data().segments
    given = data().input
    assert given is not None
    assert given.torque_per_thrust is not None
    assert segment.rotor_thrust is not None
    assert segment.thrust_by_expo is not None
    assert given.expo is not None
    scale = _scale_change(data(), replace(given.expo, held=held))
    moved = shifted(_normalised(segment, scale), given, 0.3 / (1.0 + 0.3 * scale))
    thrust = (segment.rotor_thrust + 0.3 * segment.thrust_by_expo) / (1.0 + 0.3 * scale)
    assert moved.rotor_thrust is not None
    np.testing.assert_allclose(moved.rotor_thrust, np.clip(thrust, 0.0, None), atol=1e-12)
    np.testing.assert_allclose(moved.torque, thrust @ given.torque_per_thrust.T, atol=1e-9)
    if held is HeldScale.WEIGHT:
        assert moved.rotor_thrust.mean() == pytest.approx(segment.rotor_thrust.mean(), rel=1e-9)
    if held is HeldScale.FULL:
        assert scale == 0.0


ASSUMED = AssumedExpo(value=0.65, parameter="X")


@pytest.mark.parametrize(
    ("shift", "half_width", "identifiable", "corrected"),
    [
        (0.05, 0.04, True, False),  # agrees
        (-0.3, 0.04, True, True),
        (-0.3, 0.2, False, False),  # not known well enough
        (1.5, 0.04, False, False),  # no propeller's
        (0.0, np.inf, False, False),
    ],
)
def test_only_an_expo_that_is_known_and_possible_and_another_is_put_in(
    shift: float, half_width: float, identifiable: bool, corrected: bool
) -> None:
    """The torque is left alone otherwise, and its possible error is that of the interval."""
    known, applied, off = _judged(ASSUMED, _Found(shift, half_width), 0.0)
    assert (known.identifiable, known.corrected) == (identifiable, corrected)
    assert applied == (shift if corrected else 0.0)
    assert off >= abs(known.expo - ASSUMED.value) * (not corrected) + 0.02
    assert bool(known.reason) != identifiable


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "truth", "identifiable"),
    [("ac47_rate_thread.BIN", 0.65, False), ("px4_quad_multisine.ulg", 0.0, True)],
)
@pytest.mark.thorough
def test_the_firmware_in_the_loop_has_the_expo_that_its_simulator_has(
    corpus, name: str, truth: float, identifiable: bool
) -> None:
    """Nothing is corrected; a hover whose thrust varies by a twentieth does not tell."""
    known = curve(identify(cut(load(corpus / "firmware" / name), AlignSettings()), IdentifySettings()))
    assert known.identifiable is identifiable
    assert not known.corrected
    assert known.expo == pytest.approx(truth, abs=0.03)
    assert known.ci95[0] <= truth <= known.ci95[1]
