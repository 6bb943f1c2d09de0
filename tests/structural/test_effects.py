"""What no rigid body does is named, or the interval holds the truth; clean flights keep their verdict."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.align.pool import pool
from quadid_logs.data.log import FlightLog
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.load import prepare
from quadid_logs.pipeline import judge
from quadid_logs.vocabulary import AXES, ON_AXIS
from tests.marks import thorough
from tests.structural.flights import Effects, Flight, fly

FLIGHTS = {
    "clean": Effects(),
    "clean doublets": Effects(manoeuvre="doublets"),
    "gusts": Effects(gust_rad_s2=1.2),
    "another vehicle": Effects(gain=0.9),
    "dead zone": Effects(dead_zone=0.01),
    "limit": Effects(limit=0.05),
    "mode": Effects(mode_hz=6.0),
    "tilt": Effects(tilt_1_s2=9.9),
    "pendulum": Effects(tilt_1_s2=-9.9, manoeuvre="doublets"),
    "alternating": Effects(alternating=0.2),
    "asymmetry": Effects(up_s=0.03, down_s=0.1),
    "tone": Effects(manoeuvre="tone"),
}


@functools.cache
def flown() -> dict[str, Flight]:
    """Integrate all flights once."""
    return dict(zip(FLIGHTS, fly(list(FLIGHTS.values()), seed=3), strict=True))


@functools.cache
def slung() -> Flight:
    """Doublets with a load on a string below the vehicle."""
    return fly([Effects(sling_1_s2=3.0, manoeuvre="doublets")], seed=5)[0]


def analyzed(log: FlightLog) -> Result:
    prepared = prepare(log)
    settings = Settings()
    return judge(
        prepared.log, cut(prepared, settings.align), settings, vehicle=None, published=False, timings_s={}
    )


@functools.cache
def as_flown(name: str, *, setpoints: bool) -> Result:
    """Return the analysis of a flight as it is, made once for all claims about it."""
    return analyzed(flown()[name].log(setpoints=setpoints))


@functools.cache
def rarely_limited() -> tuple[Flight, Result]:
    """Doublets with pauses between, the first peak of which is cut off; and their analysis."""
    flight = fly([Effects(limit=0.06, manoeuvre="rare doublets")], seed=5)[0]
    return flight, analyzed(flight.log())


@functools.cache
def as_slung(*, setpoints: bool) -> Result:
    """Return the analysis of the flight with a load on a string."""
    return analyzed(slung().log(setpoints=setpoints))


def codes(result: Result, axis: str) -> set[str]:
    return set(result.diagnosis.axes[axis].reasons)


def interval(result: Result, axis: str) -> tuple[float, float]:
    model = result.identification.recommended
    assert model is not None
    return model.entries[ON_AXIS[axis]].ci95


def holds_the_truth(result: Result, flight: Flight, axis: str) -> bool:
    low, high = interval(result, axis)
    return bool(low <= flight.gain[AXES.index(axis)] <= high)


@pytest.mark.parametrize("setpoints", [True, False])
@pytest.mark.parametrize("name", ["clean", thorough("clean doublets")])
def test_a_clean_flight_is_usable_and_its_interval_narrow(name: str, setpoints: bool) -> None:
    """The checks must not cry wolf, nor widen what they do not see."""
    flight = flown()[name]
    result = as_flown(name, setpoints=setpoints)
    for number, axis in enumerate(AXES):
        assert result.diagnosis.axes[axis].verdict == "usable"
        low, high = interval(result, axis)
        assert high - low < 0.04 * flight.gain[number]
        assert holds_the_truth(result, flight, axis)


@pytest.mark.parametrize(
    ("name", "axis", "code"),
    [
        ("dead zone", "roll", "QL523"),
        ("limit", "pitch", "QL524"),
        thorough("mode", "roll", "QL525"),
        ("tilt", "roll", "QL526"),
        thorough("pendulum", "pitch", "QL526"),
        thorough("alternating", "roll", "QL528"),
        thorough("tone", "pitch", "QL420"),
    ],
)
@pytest.mark.parametrize("setpoints", [True, thorough(False)])
def test_an_effect_that_no_rigid_body_has_is_named(name: str, axis: str, code: str, setpoints: bool) -> None:
    """A verdict of caution or refusal with the reason that is true."""
    assert code in codes(as_flown(name, setpoints=setpoints), axis)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_flight_at_one_frequency_is_not_told_that_calm_air_would_help(axis: str) -> None:
    """Its interval is wide because lag and effectiveness are one number there: other frequencies help."""
    found = codes(as_flown("tone", setpoints=True), axis)
    assert "QL420" in found
    assert "QL505" not in found


@pytest.mark.thorough
@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_limit_that_only_rare_peaks_reach_is_seen(axis: str) -> None:
    """A fiftieth of all samples reaches it: 7 and 19 % off, and roll was called usable."""
    flight, result = rarely_limited()
    assert result.diagnosis.axes[axis].verdict == "caution"
    assert "QL524" in codes(result, axis)
    assert holds_the_truth(result, flight, axis)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
@pytest.mark.parametrize("name", ["dead zone", "limit", "tilt", thorough("pendulum")])
def test_the_interval_holds_what_the_effect_hides(name: str, axis: str) -> None:
    """Five to thirty per cent off, at an R2 of 0.95 and more."""
    flight = flown()[name]
    low, high = interval(as_flown(name, setpoints=True), axis)
    assert low < 1.02 * flight.gain[AXES.index(axis)]
    assert high > 0.98 * flight.gain[AXES.index(axis)]


@pytest.mark.thorough
@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_load_on_a_string_is_named(axis: str) -> None:
    """It follows the tilt in another phase than a pendulum: a moment of the tilt explained nothing."""
    assert "QL526" in codes(as_slung(setpoints=False), axis)


@pytest.mark.thorough
@pytest.mark.parametrize("setpoints", [True, False])
def test_the_interval_holds_what_a_load_on_a_string_hides(setpoints: bool) -> None:
    """Roll and pitch are 4 to 6 % high."""
    result = as_slung(setpoints=setpoints)
    assert all(holds_the_truth(result, slung(), axis) for axis in AXES)


def test_a_torque_stamped_late_is_named() -> None:
    """The motion comes before its cause."""
    assert "QL522" in codes(analyzed(flown()["clean"].late(0.04).log()), "roll")


@pytest.mark.thorough
def test_of_a_torque_stamped_a_little_late_the_interval_holds_the_truth() -> None:
    """Within a sample no stamp is early or late, but the effectiveness moves."""
    flight = flown()["clean"]
    assert holds_the_truth(analyzed(flight.late(0.012).log()), flight, "roll")


def test_a_rate_setpoint_is_no_torque() -> None:
    """Behind it lies a controller, whose rate the damping is."""
    flight = flown()["clean"]
    result = analyzed(flight.log(setpoints=False, torque_command=flight.setpoint))
    for axis in AXES:
        assert "QL521" in codes(result, axis)
        assert result.diagnosis.axes[axis].verdict == "refused"


@pytest.mark.thorough
def test_a_torque_computed_from_the_rates_is_refused() -> None:
    """It explains them perfectly."""
    flight = flown()["clean"]
    torque = np.gradient(flight.rate, flight.time_s, axis=0) / 100.0
    result = analyzed(flight.log(torque_command=torque))
    assert {axis: found.verdict for axis, found in result.diagnosis.axes.items()} == dict.fromkeys(
        AXES, "refused"
    )
    assert "QL520" in codes(result, "yaw")


@pytest.mark.thorough
@pytest.mark.parametrize("steps", [4, thorough(20)])
def test_of_commands_cut_toward_zero_the_interval_holds_the_truth(steps: int) -> None:
    """A cast to whole numbers made the effectiveness 2 to 25 % too high, without a word."""
    flight = flown()["clean doublets"]
    step = np.std(flight.torque, axis=0) / steps
    result = analyzed(flight.log(torque_command=np.trunc(flight.torque / step) * step))
    for axis in AXES:
        assert "QL534" in codes(result, axis)
        assert holds_the_truth(result, flight, axis)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["clean", thorough("clean doublets")])
def test_rates_in_degrees_are_refused_without_attitude_too(name: str) -> None:
    """Every effectiveness would be 57 times too large."""
    flight = flown()[name]
    result = analyzed(flight.log(attitude=False, body_rate=np.degrees(flight.rate)))
    assert "QL320" in codes(result, "roll")
    assert result.diagnosis.axes["roll"].verdict == "refused"


@pytest.mark.thorough
@pytest.mark.parametrize("throttle", [thorough(0.3), 0.45, thorough(0.5)])
def test_a_constant_throttle_spoils_no_yaw(throttle: float) -> None:
    """Its deviation from its mean is rounding, and rounding times yaw torque is yaw torque."""
    flight = flown()["clean"]
    result = analyzed(flight.log(throttle=np.full((flight.time_s.size, 1), throttle)))
    low, high = interval(result, "yaw")
    assert high - low < 0.04 * flight.gain[2]
    assert holds_the_truth(result, flight, "yaw")


@pytest.mark.thorough
@pytest.mark.parametrize("axis", AXES)
def test_in_gusts_without_setpoints_the_interval_holds_the_truth(axis: str) -> None:
    """The controller answers the gusts, which makes the effectiveness low."""
    assert holds_the_truth(as_flown("gusts", setpoints=False), flown()["gusts"], axis)


def test_missing_setpoints_are_named() -> None:
    """So that they are logged the next time."""
    result = as_flown("clean", setpoints=False)
    assert "QL321" in {found.code for found in result.diagnosis.findings}


def test_setpoints_that_are_there_are_not_missed() -> None:
    """Nothing to log better."""
    assert "QL321" not in {found.code for found in as_flown("clean", setpoints=True).diagnosis.findings}


@pytest.mark.thorough
def test_two_vehicles_in_one_pool_are_told_apart() -> None:
    """The mean of two vehicles that differ by a tenth is that of neither, on any axis."""
    logs = [prepare(flown()[name].log()) for name in ("clean", "another vehicle")]
    settings = Settings()
    data = pool([cut(each, settings.align) for each in logs])
    result = judge(logs[0].log, data, settings, vehicle=None, published=False, timings_s={})
    assert all("QL529" in codes(result, axis) for axis in AXES)


@pytest.mark.thorough
def test_one_vehicle_in_a_pool_is_one() -> None:
    """The same flight twice."""
    prepared, settings = prepare(flown()["clean"].log()), Settings()
    part = cut(prepared, settings.align)
    result = judge(prepared.log, pool([part, part]), settings, vehicle=None, published=False, timings_s={})
    assert all(found.verdict == "usable" for found in result.diagnosis.axes.values())
